"""Douglas and Peucker as they say it: split at the farthest point, and do the same with both halves."""

from __future__ import annotations

import math


def distance(point, start, end):
    """From a point to the segment from start to end."""
    length = math.dist(start, end)
    if length == 0.0:
        return math.dist(point, start)
    along = sum((p - s) * (e - s) for p, s, e in zip(point, start, end, strict=True)) / length**2
    foot = [s + min(1.0, max(0.0, along)) * (e - s) for s, e in zip(start, end, strict=True)]
    return math.dist(point, foot)


def thinned(points, tolerance):
    """The points that are needed."""
    if len(points) < 3:
        return list(points)
    away = [distance(point, points[0], points[-1]) for point in points[1:-1]]
    split = 1 + max(range(len(away)), key=away.__getitem__)
    if away[split - 1] <= tolerance:
        return [points[0], points[-1]]
    return thinned(points[: split + 1], tolerance)[:-1] + thinned(points[split:], tolerance)
