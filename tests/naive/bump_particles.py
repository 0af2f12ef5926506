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


def felt_share(closed, across, off, half_width):
    """Probability of closed switches, a set of names, where the wall is met `across` m to the left, `off` rad askew."""
    every = [{"left"}, {"middle"}, {"right"}, {"left", "right"}]
    if -0.02 < off < 0.02:
        likely, share = {"left", "right"}, 0.8
    else:
        likely = {["right", "middle", "left"][min(2, int((across + half_width) / (2.0 * half_width / 3.0)))]}
        share = 0.95
    others = [one for one in every if one != likely]
    return share if closed == likely else (1.0 - share) / len(others)
