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
