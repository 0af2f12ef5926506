"""Leave out what a curve does not need: points within a tolerance of the line that stays (Douglas and Peucker)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def needed(points, tolerance):
    """Which of a curve's `points` (n, 2) to keep, (n,) bool; those left out lie within `tolerance` of the line kept.

    Both ends are kept. The farthest point of a stretch splits it, until none is farther than the tolerance.
    """
    n = points.shape[0]
    is_needed = np.zeros(n, np.bool_)
    if n == 0:
        return is_needed
    is_needed[0] = is_needed[n - 1] = True
    firsts, lasts = np.empty(n, np.int64), np.empty(n, np.int64)  # stretches still to be split: at most one a point
    firsts[0], lasts[0] = 0, n - 1
    waiting = 1
    while waiting > 0:
        waiting -= 1
        first, last = firsts[waiting], lasts[waiting]
        farthest, split = tolerance * tolerance, -1
        for point in range(first + 1, last):
            distance = squared_distance(points, point, first, last)
            if distance > farthest:
                farthest, split = distance, point
        if split >= 0:
            is_needed[split] = True
            firsts[waiting], lasts[waiting] = first, split
            firsts[waiting + 1], lasts[waiting + 1] = split, last
            waiting += 2
    return is_needed


@njit(cache=True)
def squared_distance(points, point, first, last):
    """From a point to the segment between two others (m^2)."""
    x, y = points[point, 0] - points[first, 0], points[point, 1] - points[first, 1]
    dx, dy = points[last, 0] - points[first, 0], points[last, 1] - points[first, 1]
    square = dx * dx + dy * dy
    along = 0.0 if square == 0.0 else min(1.0, max(0.0, (x * dx + y * dy) / square))
    return (x - along * dx) ** 2 + (y - along * dy) ** 2
