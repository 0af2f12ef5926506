"""The wall near a point from all that a map remembers, wherever it lies."""

import math

import numpy as np


def wall_near(surfels, x, y, normal, radius):
    """Way from the wall along its normal, and the normal; None where there is no wall."""
    off, mean = 0.0, np.zeros(2)
    for hits, u, v, *other in surfels:
        apart = np.hypot(x - u, y - v)
        if apart < radius and (not np.any(normal) or np.dot(normal, other) >= 0.5):
            weight = (1.0 - (apart / radius) ** 2) ** 2 * hits
            off += weight * np.dot([x - u, y - v], other)
            mean += weight * np.array(other)
    size = math.hypot(mean[0], mean[1])
    return None if size == 0.0 else (off / size, mean[0] / size, mean[1] / size)


def lay(surfels, is_free, scan, guess, prior, rule, resolution=0.05):
    """Pose, its information, and the misfit's cost: Gauss-Newton as `slam.map_matching.lay` tells it, by matrices."""
    pose, reach, most = np.array(guess, float), rule.first_reach, 0.5 * (rule.kernel / rule.sigma) ** 2
    hessian, cost = np.array(prior, float), 0.0
    for _ in range(rule.rounds):
        off = pose - guess
        hessian, gradient = np.array(prior, float), prior @ off
        cost = 0.5 * off @ prior @ off
        turn = np.array([[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]])
        for point, normal in zip(scan.points, scan.normals, strict=True):
            arm = turn @ point
            x, y = arm + pose[:2]
            wall = wall_near(surfels, x, y, turn @ normal, reach * resolution)
            if wall is None:
                cost += most if is_free(x, y) else rule.unknown
                continue
            share = 1.0 / (1.0 + (wall[0] / rule.kernel) ** 2)
            row = np.array([wall[1], wall[2], wall[2] * arm[0] - wall[1] * arm[1]])
            cost += 0.5 * (wall[0] / rule.sigma) ** 2 * share
            hessian = hessian + share**2 / rule.sigma**2 * np.outer(row, row)
            gradient = gradient + share**2 / rule.sigma**2 * wall[0] * row
        step = np.linalg.solve(hessian, gradient)
        pose = pose - step
        if reach <= rule.last_reach and max(math.hypot(step[0], step[1]), 3.0 * abs(step[2])) < 1e-3:
            break
        reach = max(rule.last_reach, reach - 1.0)
    return pose, hessian, cost
