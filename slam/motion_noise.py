"""How badly an odometry errs between two scans, learned from motions that a laser has measured: maximum likelihood.

The laser's own odometry errs by millimetres where one by wheels, or by what motors were told, errs by centimetres, so
that the differences are the latter's errors. They are Gaussian with the variances of `slam.scan_motion.OdometryNoise`;
sizes are searched as logarithms, and intervals are where the profile of the likelihood ends. What errs always the same
way is a scale, not noise. Uses its siblings `scan_motion` and `variance_components`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize, root_scalar

from slam.pose import wrap
from slam.scan_motion import LEAST
from slam.variance_components import CHI_SQUARE

Cost = Callable[[np.ndarray], tuple[float, np.ndarray]]  # and its gradient

LEARNED = ("distance", "turn", "rotation")  # fields of OdometryNoise
LEAST_MOTIONS = 20  # below which nothing is learned
SMALLEST, LARGEST = math.log(1e-4), math.log(10.0)  # sizes beyond which one is called absent or unbounded


class MotionNoise(NamedTuple):
    """Estimates (3,) of `LEARNED`, their 95 % intervals (3, 2), and what an odometry tells always too little of.

    True ways are `way_scale` times the told ones, true turns `turn_scale` times, and `veer` rad/m more. `gain` is in
    log likelihood over the present sizes.
    """

    values: np.ndarray
    intervals: np.ndarray
    way_scale: float
    turn_scale: float
    veer: float
    gain: float


def learn_noise(told: np.ndarray, true: np.ndarray, present: np.ndarray) -> MotionNoise:
    """The noise of motions told (n, 3) that were truly so (n, 3), and `present` (3,) is what it is taken for.

    ValueError where there are too few of them, or none that moves.
    """
    ways = np.hypot(told[:, 0], told[:, 1])
    if len(told) < LEAST_MOTIONS or not np.any(ways > 0.0):
        raise ValueError(f"{len(told)} motions tell nothing: {LEAST_MOTIONS} that move are needed at least")
    off = np.column_stack([true[:, :2] - told[:, :2], wrap(true[:, 2] - told[:, 2])])
    along = np.einsum("ij,ij->i", true[:, :2], told[:, :2])
    way_scale = float(along.sum() / (ways**2).sum())
    turns = np.column_stack([told[:, 2], ways])
    (turn_more, veer), *_ = np.linalg.lstsq(turns, off[:, 2], rcond=None)

    def cost(log_sizes: np.ndarray) -> tuple[float, np.ndarray]:
        return cost_of(log_sizes, off, ways, np.abs(told[:, 2]))

    bounds = [(SMALLEST, LARGEST)] * len(LEARNED)
    starts = (np.log(present), np.full(len(LEARNED), math.log(0.05)))
    best = min((minimize(cost, start, jac=True, bounds=bounds) for start in starts), key=lambda run: run.fun)
    intervals = np.exp([interval(cost, best.x, float(best.fun), row) for row in range(len(LEARNED))])
    intervals[intervals <= math.exp(SMALLEST)] = 0.0
    intervals[intervals >= math.exp(LARGEST)] = math.inf
    gain = cost(np.log(present))[0] - float(best.fun)
    return MotionNoise(np.exp(best.x), intervals, way_scale, 1.0 + float(turn_more), float(veer), gain)


def cost_of(log_sizes: np.ndarray, off: np.ndarray, ways: np.ndarray, turns: np.ndarray) -> tuple[float, np.ndarray]:
    """Less the log likelihood of errors (n, 3) after ways (n,) in m and turns (n,) in rad, and its gradient (3,).

    Left out is what is the same for all sizes (3,).
    """
    of_way, of_turn, of_rotation = np.exp(2.0 * log_sizes)[:, None] * np.stack([ways, ways, turns**2])
    place, heading = of_way + LEAST[0] ** 2, of_turn + of_rotation + LEAST[2] ** 2
    squares = np.sum(off[:, :2] ** 2, axis=1)
    cost = np.sum(np.log(place) + 0.5 * squares / place) + 0.5 * np.sum(np.log(heading) + off[:, 2] ** 2 / heading)
    by_place, by_heading = 2.0 / place - squares / place**2, 1.0 / heading - off[:, 2] ** 2 / heading**2
    return float(cost), np.array([of_way @ by_place, of_turn @ by_heading, of_rotation @ by_heading])


def interval(cost: Cost, best: np.ndarray, least: float, row: int) -> tuple[float, float]:
    """Where the profile of a cost (n,) rises by what 95 % allow above its `least`, below and above its best place."""
    others = np.arange(len(best)) != row

    def rise(place: float) -> float:
        def held(free: np.ndarray) -> tuple[float, np.ndarray]:
            here = np.array(best)
            here[row], here[others] = place, free
            value, gradient = cost(here)
            return value, gradient[others]

        bounds = [(SMALLEST, LARGEST)] * int(np.sum(others))
        return float(minimize(held, best[others], jac=True, bounds=bounds).fun) - least - 0.5 * CHI_SQUARE

    low = root_scalar(rise, bracket=(SMALLEST, best[row])).root if rise(SMALLEST) > 0.0 else SMALLEST
    high = root_scalar(rise, bracket=(best[row], LARGEST)).root if rise(LARGEST) > 0.0 else LARGEST
    return float(low), float(high)
