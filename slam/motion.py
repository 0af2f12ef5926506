"""How a path may differ from its odometry: Gaussian errors of distance and angle, and each particle's own bias.

The thesis (2.7) has uncorrelated Gaussian angle and distance errors with hard-coded variances. Real odometry also errs
in one direction for minutes, so that a particle carries a turn bias and a scale bias besides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.counter_random import gaussian, gaussian_of
from slam.params import Params

ANGLE, DISTANCE, TURN_BIAS, SCALE_BIAS, TURN_JITTER, SCALE_JITTER, OFFSET = range(7)  # streams of random numbers


class MotionParams(Params):
    """Standard deviations of odometry's errors; noise grows with the root of the distance, biases with the distance."""

    turn_noise: float = Field(default=0.040, ge=0.0)  # rad per root metre
    distance_noise: float = Field(default=0.055, ge=0.0)  # m per root metre
    rotation_noise: float = Field(default=0.05, ge=0.0)  # rad per rad turned
    turn_bias: float = Field(default=0.03, ge=0.0)  # rad/m, spread of the particles' biases at the start
    scale_bias: float = Field(default=0.03, ge=0.0)  # share of the distance, likewise
    jitter: float = Field(
        default=0.1, ge=0.0, le=1.0
    )  # of the biases at each resampling, as a share of their first spread


class Step(NamedTuple):
    """A motion of the odometry and its errors' standard deviations, as every particle takes it.

    `distance` m in the `direction` rad of the older vertex's frame, `rotation` rad, over `travelled` m.
    """

    distance: float
    direction: float
    rotation: float
    travelled: float
    turn_sigma: float
    distance_sigma: float


@njit(cache=True)
def step_of(motion, travelled, noise):
    """The step of a `motion` (3,) over `travelled` m; `noise` is (turn, distance, rotation) of the parameters."""
    root = math.sqrt(travelled)
    distance = math.hypot(motion[0], motion[1])
    return Step(
        distance,
        math.atan2(motion[1], motion[0]) if distance > 1e-9 else 0.0,
        motion[2],
        travelled,
        math.hypot(noise[0] * root, noise[2] * motion[2]),
        noise[1] * root,
    )


@njit(cache=True, inline="always")
def moved_pose(x, y, theta, step, angle_error, distance_error, turn_bias, scale_bias):
    """Pose after a step with errors in standard deviations. Half the turn's error acts before the way, half after."""
    turn = turn_bias * step.travelled + step.turn_sigma * angle_error
    length = step.distance * (1.0 + scale_bias) + step.distance_sigma * distance_error
    heading = theta + step.direction + 0.5 * turn
    new_theta = theta + step.rotation + turn
    new_theta -= 2.0 * math.pi * math.floor((new_theta + math.pi) / (2.0 * math.pi))
    return x + length * math.cos(heading), y + length * math.sin(heading), new_theta


@njit(cache=True, inline="always")
def step_plausibility(step, angle_error, distance_error, turn_bias, scale_bias):
    """Log density, up to a constant, of the corrections to a step (thesis, 2.4), biases being part of them."""
    angle = angle_error + turn_bias * step.travelled / max(1e-9, step.turn_sigma)
    stretch = distance_error + scale_bias * step.distance / max(1e-9, step.distance_sigma)
    return -0.5 * (angle * angle + stretch * stretch)


@njit(cache=True, nogil=True)
def propagate(poses, rows, step, key, turn_biases, scale_biases, low, high, moved, plausibilities):
    """Move particles low..high by the motion model: `moved` (n, 3) from `poses[rows]`; add to their log densities.

    `key` is the seed's and the vertex's (`counter_random.vertex_key`).
    """
    for p in range(low, high):
        row = rows[p]
        angle_error, distance_error = gaussian_of(key, p, ANGLE), gaussian_of(key, p, DISTANCE)
        moved[p, 0], moved[p, 1], moved[p, 2] = moved_pose(
            poses[row, 0], poses[row, 1], poses[row, 2], step, angle_error, distance_error,
            turn_biases[p], scale_biases[p],
        )  # fmt: skip
        plausibilities[p] += step_plausibility(step, angle_error, distance_error, turn_biases[p], scale_biases[p])


@njit(cache=True)
def draw_biases(spread, seed, vertex, stream, n):
    """(n,) Gaussian biases of standard deviation `spread`."""
    biases = np.empty(n)
    for p in range(n):
        biases[p] = spread * gaussian(seed, vertex, p, stream)
    return biases
