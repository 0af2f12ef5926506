"""A cart's way in many small straight steps."""

from __future__ import annotations

import math


def arc(left, right, wheelbase, tick, steps=20_000):
    """Pose change (x, y, turn) of a stage whose wheels both turn evenly."""
    x = y = heading = 0.0
    way = tick * (left + right) / 2.0 / steps
    turn = tick * (right - left) / wheelbase / steps
    for _ in range(steps):
        x += way * math.cos(heading + turn / 2.0)
        y += way * math.sin(heading + turn / 2.0)
        heading += turn
    return x, y, heading
