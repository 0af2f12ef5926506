"""How much a logged way is worth, by numerical integration; and where particles go, one at a time."""

from __future__ import annotations

import math


def moved(pose, way, turn, steps=2000):
    """A pose after an arc, in small steps."""
    x, y, heading = pose
    for _ in range(steps):
        x += way / steps * math.cos(heading + 0.5 * turn / steps)
        y += way / steps * math.sin(heading + 0.5 * turn / steps)
        heading += turn / steps
    return x, y, heading


def enough_particles(n_bins, error, quantile):
    """Half the chi-square quantile over the error, by Wilson and Hilferty."""
    degrees = n_bins - 1
    if degrees < 1:
        return 1
    third = 2.0 / (9.0 * degrees)
    return math.ceil(degrees * (1.0 - third + quantile * math.sqrt(third)) ** 3 / (2.0 * error))
