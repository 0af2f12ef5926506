"""A measured place as sums over a grid of offsets: every test point looked up in the world, nothing reused."""

from __future__ import annotations

import itertools
import math

import numpy as np

from tests.naive.affinity import look_up


def score(labels_a, labels_b, motion, middle, points, cell, scores):
    """Mean score of the test points, which lie around `middle` (2,) of a's frame, when b is at `motion`."""
    total = 0.0
    for x, y in points:
        place = (middle[0] + x * cell, middle[1] + y * cell)
        a, b = look_up(labels_a, cell, (0.0, 0.0, 0.0), place), look_up(labels_b, cell, motion, place)
        if a != 0 and b != 0:
            total += scores[2] if a != b else scores[0] if a < 0 else scores[1]
    return total / len(points)


def moments(labels_a, labels_b, motion, points, cell, scores, window, steps, sharpness):
    """Mean (3,) and covariance (3, 3) of the offset, in units of the window."""
    middle = (0.5 * motion[0], 0.5 * motion[1])
    offsets, weights = [], []
    for numbers in itertools.product(range(-steps, steps + 1), repeat=3):
        offset = 0.5 * np.array(numbers)
        moved = np.asarray(motion) + offset * window
        found = score(labels_a, labels_b, moved, middle, points, cell, scores)
        offsets.append(offset)
        weights.append(math.exp(sharpness * found - 0.5 * offset @ offset))
    weights = np.array(weights) / sum(weights)
    mean = weights @ np.array(offsets)
    away = np.array(offsets) - mean
    return mean, (weights[:, None] * away).T @ away
