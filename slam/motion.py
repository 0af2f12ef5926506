"""How a path may differ from its odometry: Gaussian errors of distance and angle, and each particle's own bias.

The thesis (2.7) has uncorrelated Gaussian angle and distance errors with hard-coded variances. Real odometry also errs
in one direction for minutes, so that a particle carries a turn bias and a scale bias besides.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.counter_random import gaussian
from slam.params import Params

ANGLE, DISTANCE, TURN_BIAS, SCALE_BIAS, TURN_JITTER, SCALE_JITTER, OFFSET = range(7)  # streams of random numbers


class MotionParams(Params):
    """Standard deviations of odometry's errors; noise grows with the root of the distance, biases with the distance."""

    turn_noise: float = Field(default=0.040, ge=0.0)  # rad per root metre
    distance_noise: float = Field(default=0.055, ge=0.0)  # m per root metre
    rotation_noise: float = Field(default=0.05, ge=0.0)  # rad per rad turned
    turn_bias: float = Field(default=0.03, ge=0.0)  # rad/m, spread of the particles' biases at the start
    scale_bias: float = Field(default=0.03, ge=0.0)  # share of the distance, likewise
    jitter: float = Field(default=0.1, ge=0.0)  # of the biases at each resampling, as a share of their first spread


@njit(cache=True, inline="always")
def moved_pose(x, y, theta, motion, travelled, noise, angle_error, distance_error, turn_bias, scale_bias):
    """Pose after `motion` (3,) over `travelled` m with errors in standard deviations; `noise` as in `propagate`.

    Half the angle error acts before the translation and half after it.
    """
    root = math.sqrt(travelled)
    turn = turn_bias * travelled + math.hypot(noise[0] * root, noise[2] * motion[2]) * angle_error
    distance = math.hypot(motion[0], motion[1])
    direction = math.atan2(motion[1], motion[0]) if distance > 1e-9 else 0.0
    length = distance * (1.0 + scale_bias) + noise[1] * root * distance_error
    heading = theta + direction + 0.5 * turn
    new_theta = theta + motion[2] + turn
    new_theta -= 2.0 * math.pi * math.floor((new_theta + math.pi) / (2.0 * math.pi))
    return x + length * math.cos(heading), y + length * math.sin(heading), new_theta


@njit(cache=True)
def propagate(poses, motion, travelled, noise, turn_biases, scale_biases, seed, vertex, moved, plausibilities):
    """Move all particles by the motion model: `moved` (n, 3) from `poses` (n, 3); add to their log densities.

    `motion` (3,) is the odometry's, in the older vertex's frame, over `travelled` metres; `noise` is (turn, distance,
    rotation) of the parameters. The density is that of the corrections to the odometry under its noise (thesis, 2.4), a
    particle's biases being part of its corrections.
    """
    root = math.sqrt(travelled)
    turn_sigma = max(1e-9, math.hypot(noise[0] * root, noise[2] * motion[2]))
    distance_sigma = max(1e-9, noise[1] * root)
    distance = math.hypot(motion[0], motion[1])
    for p in range(poses.shape[0]):
        angle_error, distance_error = gaussian(seed, vertex, p, ANGLE), gaussian(seed, vertex, p, DISTANCE)
        moved[p, 0], moved[p, 1], moved[p, 2] = moved_pose(
            poses[p, 0], poses[p, 1], poses[p, 2], motion, travelled, noise, angle_error, distance_error,
            turn_biases[p], scale_biases[p],
        )  # fmt: skip
        angle = angle_error + turn_biases[p] * travelled / turn_sigma
        stretch = distance_error + scale_biases[p] * distance / distance_sigma
        plausibilities[p] -= 0.5 * (angle * angle + stretch * stretch)


@njit(cache=True)
def draw_biases(spread, seed, vertex, stream, n):
    """(n,) Gaussian biases of standard deviation `spread`."""
    biases = np.empty(n)
    for p in range(n):
        biases[p] = spread * gaussian(seed, vertex, p, stream)
    return biases
