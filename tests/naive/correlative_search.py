"""The best pose of a lattice about a guess, each looked up by itself."""

import itertools
import math

import numpy as np

from slam.pose import transform


def score(points, others, pose, resolution, gain):
    """What the ends at a pose are worth: those in a cell with an end of the other's, and those in a cell beside one."""
    walls = {(math.floor(x / resolution), math.floor(y / resolution)) for x, y in others}
    total = 0.0
    for x, y in transform(pose, points):
        column, row = math.floor(x / resolution), math.floor(y / resolution)
        beside = any((column + c, row + r) in walls for c, r in itertools.product((-1, 0, 1), repeat=2))
        total += gain * (1.0 if (column, row) in walls else 0.4 if beside else 0.0)
    return total


def best_score(points, others, guess, sigmas, turns, shifts, resolution, turn, gain):
    """The greatest log density on the lattice."""
    found = -math.inf
    for heading, up, right in itertools.product(
        range(-turns, turns + 1), range(-shifts, shifts + 1), range(-shifts, shifts + 1)
    ):
        off = np.array([right * resolution, up * resolution, heading * turn])
        found = max(
            found, score(points, others, guess + off, resolution, gain) - 0.5 * float(np.sum((off / sigmas) ** 2))
        )
    return found
