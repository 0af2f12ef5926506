"""Trajectory errors one pose at a time, with matrices, and alignment by singular values as Umeyama wrote it."""

from __future__ import annotations

import itertools
import math

import numpy as np

from tests.naive import pose as se2


def alignment(points, reference_points):
    """Rotation (2, 2) and translation (2,): Umeyama, IEEE PAMI 13, 1991, equations 40 to 42, with scale 1."""
    mean, reference_mean = np.mean(points, axis=0), np.mean(reference_points, axis=0)
    covariance = sum(np.outer(b - reference_mean, a - mean) for a, b in zip(points, reference_points, strict=True))
    u, _, vt = np.linalg.svd(covariance)
    mirror = np.diag([1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ mirror @ vt
    return rotation, reference_mean - rotation @ mean


def absolute_errors(poses, reference):
    """Distances after alignment."""
    rotation, translation = alignment(poses[:, :2], reference[:, :2])
    return [
        float(np.linalg.norm(rotation @ p[:2] + translation - q[:2])) for p, q in zip(poses, reference, strict=True)
    ]


def motion_error(pose_a, pose_b, reference_a, reference_b):
    """Translation and rotation by which one motion misses another."""
    residual = se2.between(se2.between(reference_a, reference_b), se2.between(pose_a, pose_b))
    return math.hypot(residual[0], residual[1]), abs(residual[2])


def relative_errors_by_rows(poses, reference, step):
    """Errors of the motion over each `step` rows, without overlap."""
    firsts = range(0, len(poses) - step, step)
    return [motion_error(poses[i], poses[i + step], reference[i], reference[i + step]) for i in firsts]


def relative_errors_by_metres(poses, reference, step):
    """Errors of the motion over each `step` metres of the reference's path, without overlap."""
    errors, first, walked = [], 0, 0.0
    for row in range(1, len(reference)):
        walked += math.dist(reference[row, :2], reference[row - 1, :2])
        if walked >= step - 1e-9:
            errors.append(motion_error(poses[first], poses[row], reference[first], reference[row]))
            first, walked = row, 0.0
    return errors


def interpolate(times, poses, at):
    """Pose at a time from the two rows around it (strictly ascending times), or None outside."""
    for a, b, pose_a, pose_b in zip(times[:-1], times[1:], poses[:-1], poses[1:], strict=True):
        if a <= at <= b:
            share = (at - a) / (b - a)
            turn = math.remainder(pose_b[2] - pose_a[2], 2.0 * math.pi)
            x, y = (1.0 - share) * pose_a[:2] + share * pose_b[:2]
            return np.array([x, y, math.remainder(pose_a[2] + share * turn, 2.0 * math.pi)])
    return None


def relations_errors(times, poses, relations):
    """Translation and rotation errors of each relation (t1, t2, motion) whose ends lie on the trajectory."""
    errors = []
    for first_time, second_time, motion in relations:
        first, second = interpolate(times, poses, first_time), interpolate(times, poses, second_time)
        if first is not None and second is not None:
            residual = se2.between(motion, se2.between(first, second))
            errors.append((math.hypot(residual[0], residual[1]), abs(residual[2])))
    return errors


def revisits(reference, max_distance, min_path):
    """(later, earlier) rows: the nearest place that was left at least `min_path` metres of the way before."""
    path = [0.0]
    for a, b in itertools.pairwise(reference):
        path.append(path[-1] + math.dist(a[:2], b[:2]))
    pairs = []
    for later in range(len(reference)):
        earlier = [row for row in range(later) if path[later] - path[row] >= min_path]
        distances = [math.dist(reference[row, :2], reference[later, :2]) for row in earlier]
        if distances and min(distances) < max_distance:
            pairs.append((later, earlier[int(np.argmin(distances))]))
    return pairs


def wall_spread(path, curves, reach, min_path):
    """Distances along the normals between like-facing wall points of visits far apart, one pair of points at a time."""
    way = [0.0]
    for a, b in itertools.pairwise(path):
        way.append(way[-1] + math.dist(a[:2], b[:2]))
    seen = [
        [item for curve in found for item in oriented(pose, curve)] for pose, found in zip(path, curves, strict=True)
    ]
    distances = []
    for later in range(len(path)):
        for earlier in nearest_of_visits(path, way, later, reach, min_path):
            for x, y, nx, ny in seen[later]:
                candidates = [
                    abs((u - x) * nx + (v - y) * ny)
                    for u, v, mx, my in seen[earlier]
                    if abs((u - x) * ny - (v - y) * nx) <= 0.1 and nx * mx + ny * my >= math.cos(math.radians(25.0))
                ]
                if candidates and min(candidates) < reach:
                    distances.append(min(candidates))
    return distances


def nearest_of_visits(path, way, later, reach, min_path):
    """Of every stretch of earlier rows near a later one, the nearest."""
    found, best = [], None
    for earlier in range(later + 1):
        apart = math.dist(path[earlier][:2], path[later][:2])
        if way[earlier] > way[later] - min_path or apart >= 2.0 * reach:
            found, best = (found if best is None else [*found, best[1]]), None
        elif best is None or apart < best[0]:
            best = apart, earlier
    return found


def oriented(pose, curve):
    """Rows (x, y, normal) of a curve's points in the world; the normal is a quarter turn left of the way along it."""
    rows = []
    for i in range(len(curve)):
        before, after = curve[max(i - 1, 0)], curve[min(i + 1, len(curve) - 1)]
        angle = math.atan2(after[1] - before[1], after[0] - before[0]) + pose[2] + 0.5 * math.pi
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        x, y = curve[i]
        rows.append((pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y, math.cos(angle), math.sin(angle)))
    return rows if len(curve) > 1 else []
