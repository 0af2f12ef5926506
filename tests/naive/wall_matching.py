"""Which walls are compared and which points match, by looking at all; and the pull of a match, from its formula."""

from __future__ import annotations

import math

import numpy as np


def near_pairs(poses, reach, visits, gap):
    """Pairs (earlier, later), each later node with the nearest of its nearest few visits."""
    pairs = []
    for later in range(len(poses)):
        runs, run = [], []
        for earlier in range(later - gap + 1):
            distance = math.dist(poses[earlier][:2], poses[later][:2])
            if distance < reach:
                run.append((distance, earlier))
            if run and (distance >= reach or earlier == later - gap):
                runs.append(min(run, key=lambda item: (item[0], -item[1])))
                run = []
        pairs += [(earlier, later) for _, earlier in sorted(runs)[:visits]]
    return pairs


def transformed(pose, vectors, is_point=True):
    """Vectors of the pose's frame in the frame that the pose is given in."""
    x, y, theta = pose
    turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
    return vectors @ turn.T + (np.array([x, y]) if is_point else 0.0)


def match(points_a, normals_a, points_b, normals_b, pose_a_b, gate, cos):
    """For each of b's points the nearest of a's that faces the same way, or -1."""
    places, facing = transformed(pose_a_b, points_b), transformed(pose_a_b, normals_b, is_point=False)
    partners = []
    for place, normal in zip(places, facing, strict=True):
        distances = np.hypot(*(points_a - place).T)
        distances[normals_a @ normal <= cos] = np.inf
        nearest = int(np.argmin(distances)) if len(distances) else -1
        partners.append(nearest if nearest >= 0 and distances[nearest] < gate else -1)
    return partners


def cost(points_a, normals_a, points_b, pose_a_b, partners, sigma, kernel):
    """Geman and McClure's cost of the distances from matched points to the lines of their partners."""
    total = 0.0
    for place, partner in zip(transformed(pose_a_b, points_b), partners, strict=True):
        if partner >= 0:
            square = (normals_a[partner] @ (place - points_a[partner]) / sigma) ** 2
            bound = (kernel / sigma) ** 2
            total += 0.5 * square * bound / (bound + square)
    return total
