"""Affinity of two vertices, one test point and one pair of segments at a time, in world coordinates."""

from __future__ import annotations

import math

import numpy as np

from tests.naive import pose as se2


def label_at(distances, free, x, y, thickness, states, reach):
    """Inside (-1), outside (1) or unknown (0) at a place in the vertex's frame."""
    n = len(distances)
    distance, bearing = math.hypot(x, y), math.atan2(y, x)
    ray = min(range(n), key=lambda i: abs(math.remainder(bearing - 2.0 * math.pi * i / n, 2.0 * math.pi)))
    wall = distances[ray]
    if states == 2:
        return 0 if distance > 1.25 * reach else 1 if distance > wall else -1
    if distance >= wall:
        return 1 if distance < wall + thickness else 0
    known_free = free[ray] if math.isinf(wall) else max(free[ray], wall - 0.1)
    return -1 if distance < known_free else 0


def label_raster(distances, free, size, cell, thickness, states, reach):
    """Every cell's label, at its centre."""
    centres = (np.arange(1, size - 1) + 0.5 - 0.5 * size) * cell  # the outermost cells stay unknown
    inner = [[label_at(distances, free, x, y, thickness, states, reach) for x in centres] for y in centres]
    return np.pad(np.array(inner), 1)


def look_up(labels, cell, pose, place):
    """Label of a place in the world in a vertex's raster."""
    x, y, _ = se2.between(pose, (place[0], place[1], 0.0))
    size = labels.shape[0]
    row, column = math.floor(y / cell + 0.5 * size), math.floor(x / cell + 0.5 * size)
    return int(labels[row, column]) if 0 <= row < size and 0 <= column < size else 0


def point_scores(labels_a, labels_b, pose_a, pose_b, pattern):
    """Score of every test point; the pattern lies around the middle and is turned as a is."""
    middle = np.array([0.5 * (pose_a[0] + pose_b[0]), 0.5 * (pose_a[1] + pose_b[1]), pose_a[2]])
    scores = []
    for x, y in zip(pattern.x, pattern.y, strict=True):
        place = se2.compose(middle, (x * pattern.cell, y * pattern.cell, 0.0))
        a, b = look_up(labels_a, pattern.cell, pose_a, place), look_up(labels_b, pattern.cell, pose_b, place)
        agreed = pattern.both_free if a < 0 else pattern.both_wall
        scores.append(0.0 if a == 0 or b == 0 else agreed if a == b else pattern.differ)
    return scores


def point_affinity(labels_a, labels_b, pose_a, pose_b, pattern):
    """Mean score, or the mean of the first 16, 32, ... points once that is too low."""
    scores = point_scores(labels_a, labels_b, pose_a, pose_b, pattern)
    for seen in range(16, len(scores) + 1, 16):
        if sum(scores[:seen]) / seen < pattern.early_exit:
            return sum(scores[:seen]) / seen
    return sum(scores) / len(scores)


def segments_of(walls, rays=2, jump=0.2):
    """(start, end) of each wall segment in the vertex's frame, in ccw order."""
    n = walls.distances.size

    def point(ray):
        angle = 2.0 * math.pi * ray / n
        return walls.distances[ray % n] * np.array([math.cos(angle), math.sin(angle)])

    found = []
    for ray in range(0, n - n % rays, rays):
        near, far = walls.distances[ray], walls.distances[(ray + rays) % n]
        if math.isfinite(near) and math.isfinite(far) and abs(near - far) < jump:
            found.append((point(ray), point(ray + rays)))
    return found


def segment_affinity(walls_a, walls_b, pose_a, pose_b, scale):
    """n_a . n_b exp(-d / scale) |a| |b| over all pairs of segments placed in the world, those within 5 scales."""

    def placed(walls, pose):
        for start, end in segments_of(walls):
            a, b = (se2.compose(pose, (*point, 0.0))[:2] for point in (start, end))
            yield 0.5 * (a + b), np.array([b[1] - a[1], a[0] - b[0]])  # the middle; the normal, as long as the segment

    total = 0.0
    for middle_a, normal_a in placed(walls_a, pose_a):
        for middle_b, normal_b in placed(walls_b, pose_b):
            distance = math.dist(middle_a, middle_b)
            if distance < 5.0 * scale:
                total += float(normal_a @ normal_b) * math.exp(-distance / scale)
    return total
