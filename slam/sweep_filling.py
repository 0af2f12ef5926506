"""What thin beams would have met between two sweeps that were taken far apart.

Few beams that sweep every half metre leave a local map of dots, between which no ray finds a wall. Where a beam met one
wall in both sweeps, it would have met it between them too; where it met nothing in either, there is nothing between.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from slam.pose import between, compose, transform

NEAREST = 0.1  # m that beams' ends move between sweeps; nearer ones leave no gap in a wall
FARTHEST = 1.5  # m between sweeps; farther ones see different walls
WIDEST = 1.0  # rad between them, likewise
SLACK = 0.05  # m that the ends of a beam may always lie apart, for noise
ARM = 1.5  # m, how far off walls are taken to be at most where the robot turns
MOST = 40  # sweeps between two


def sweeps_between(
    bearings: np.ndarray, before: tuple[np.ndarray, np.ndarray], now: tuple[np.ndarray, np.ndarray], bridge: float,
    step: float,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Poses (3,) and ranges (n,) every `step` m between two sweeps, each a pose (3,) and ranges (n,), inf for no echo.

    There are none where no end of a beam moved by `NEAREST`: a robot that sweeps often leaves no gaps.
    The ends of a beam are of one wall if they lie no farther apart than `bridge` times what the robot's motion made of
    them; a beam whose ends are not, or that met a wall only once, measures nothing in between: nan.
    """
    (pose, first), (end, second) = before, now
    if math.hypot(end[0] - pose[0], end[1] - pose[1]) + ARM * abs(end[2] - pose[2]) < NEAREST:
        return  # most sweeps of a robot that sweeps often, for which this is all that it costs
    motion = between(pose, end)
    way, turn = math.hypot(motion[0], motion[1]), abs(float(motion[2]))
    is_open = np.isinf(first) & np.isinf(second)
    is_wall = np.isfinite(first) & np.isfinite(second)
    ends = np.where(is_wall, first, 0.0), np.where(is_wall, second, 0.0)
    moved = way + min(ARM, float(np.max(ends))) * turn
    if moved < NEAREST or way > FARTHEST or turn > WIDEST:
        return
    n = min(MOST, math.ceil(moved / step))
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    apart = transform(motion, ends[1][:, None] * rays) - ends[0][:, None] * rays
    reach = bridge * (way + np.minimum(*ends) * turn) + SLACK
    is_wall &= np.hypot(apart[:, 0], apart[:, 1]) <= reach
    for i in range(1, n):
        ranges = np.where(is_wall, ends[0] + i / n * (ends[1] - ends[0]), np.where(is_open, np.inf, np.nan))
        yield compose(pose, i / n * motion), ranges
