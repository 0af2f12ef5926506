"""Counts of a cost grid by looking at every cell from every vertex, and shortest ways by Bellman and Ford."""

from __future__ import annotations

import math

import numpy as np


def count_free(path, distances, free, x, y, resolution, shape):
    """How many vertices saw each cell's centre free."""
    counts = np.zeros(shape, int)
    n_rays = free.shape[1]
    for pose, wall, seen in zip(path, distances, free, strict=True):
        for row, column in np.ndindex(*shape):
            across, up = x + (column + 0.5) * resolution - pose[0], y + (row + 0.5) * resolution - pose[1]
            bearing = math.atan2(up, across) - pose[2]
            ray = round(bearing * n_rays / (2.0 * math.pi)) % n_rays
            bound = min(seen[ray], wall[ray] - 0.5 * resolution)
            counts[row, column] += math.hypot(across, up) < bound
    return counts


def reach(costs, start):
    """Cost in cells of the cheapest way from a cell (row, column) to every cell."""
    found = np.full(costs.shape, np.inf)
    found[start] = 0.0
    while True:
        before = found.copy()
        for row, column in np.ndindex(*costs.shape):
            for up, across in np.ndindex(3, 3):
                other = row + up - 1, column + across - 1
                is_inside = 0 <= other[0] < costs.shape[0] and 0 <= other[1] < costs.shape[1]
                if is_inside and other != (row, column):
                    step = math.hypot(up - 1, across - 1) * 0.5 * (costs[row, column] + costs[other])
                    found[row, column] = min(found[row, column], found[other] + step)
        if np.array_equal(before, found):
            return found
