"""The cost of a path's motions from the model's own words, without any derivative."""

from __future__ import annotations

import math

import numpy as np

from slam.pose import between, wrap


def cost(poses, motions, travelled, sigmas, biases):
    """Half the sum of squares of turn, length and slip in standard deviations, less what the biases explain."""
    total = 0.0
    for v in range(1, len(poses)):
        x, y, theta = between(poses[v - 1], poses[v])
        turn = float(wrap(theta - motions[v][2]))
        distance, direction = math.hypot(*motions[v][:2]), math.atan2(motions[v][1], motions[v][0])
        along, aside = np.array(
            [[math.cos(direction + turn / 2), math.sin(direction + turn / 2)],
             [-math.sin(direction + turn / 2), math.cos(direction + turn / 2)]]
        ) @ (x, y)  # fmt: skip
        errors = turn - biases[0] * travelled[v], along - distance * (1.0 + biases[1]), aside
        total += 0.5 * sum((error / sigma) ** 2 for error, sigma in zip(errors, sigmas[v], strict=True))
    return total
