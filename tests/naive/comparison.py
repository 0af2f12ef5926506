"""Affinity of a path by sorting all earlier vertices by distance."""

from __future__ import annotations

import math
import statistics


def nearest_earlier(path, newest, rule):
    """Up to `neighbours` vertices within range and old enough, the nearest first, of equals the newest."""
    place = path[newest][:2]
    distances = {other: math.dist(place, path[other][:2]) for other in range(newest - rule.gap, -1, -1)}
    near = [other for other, distance in distances.items() if distance < rule.range]
    return sorted(near, key=lambda other: distances[other])[: rule.neighbours]


def path_affinity(path, first, rule, score):
    """Sum of score(newest, other) from vertex `first` on."""
    newer = range(first, len(path))
    return sum(score(newest, other) for newest in newer for other in nearest_earlier(path, newest, rule))


def chance(newest, others, score):
    """What `newest` scores with walls of elsewhere: the median of the best of ten ways to lay each."""
    ways = [(0.0, aside, turn) for turn in (0.0, math.pi) for aside in (-0.3, -0.15, 0.0, 0.15, 0.3)]
    best = [max(score(newest, (0.0, 0.0, 0.0), other, way) for way in ways) for other in others]
    return max(0.0, statistics.median(best))
