"""Small drives with known truth: laps of a corridor, walls by exact intersection, odometry that drifts."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from slam.pose import between, compose
from slam.walls import Walls
from tests.naive.walls import cast, rectangle

SPACING, REACH, N_RAYS = 0.5, 1.2, 72


class Drive(NamedTuple):
    """True poses (n, 3), odometry (n, 3), walls by vertex, metres of path before each vertex, vertices per lap."""

    truth: np.ndarray
    odometry: np.ndarray
    walls: list[Walls]
    travelled: np.ndarray
    lap: int


def laps(n_laps=2.0, width=6.0, height=4.0, turn_bias=0.0, scale_bias=0.0, seed=0, noise=0.3):
    """Laps along a rectangle in the middle of a corridor 1.5 m wide, with an alcove; odometry errs as told.

    `noise` is a share of 4% of the root of the distance; biases are rad/m and a share of the distance.
    """
    lap = round(2.0 * (width + height) / SPACING)
    truth = np.array([on_rectangle(k * SPACING, width, height) for k in range(round(n_laps * lap) + 1)])
    world = np.vstack(
        [
            rectangle(width / 2, height / 2, width + 1.5, height + 1.5),
            rectangle(width / 2, height / 2, width - 1.5, height - 1.5),
            rectangle(width / 3, -0.7, 0.4, 0.3),  # a cupboard
        ]
    )
    walls = [cast(pose, world, N_RAYS, REACH) for pose in truth]
    odometry = drifting(truth, turn_bias, scale_bias, noise, np.random.default_rng(seed))
    return Drive(truth, odometry, walls, np.r_[0.0, np.full(len(truth) - 1, SPACING)], lap)


def on_rectangle(way, width, height):
    """Pose (3,) after `way` m counter-clockwise from the corner (0, 0)."""
    way %= 2.0 * (width + height)
    for x, y, heading, side in (
        (0.0, 0.0, 0.0, width), (width, 0.0, 0.5 * math.pi, height),
        (width, height, math.pi, width), (0.0, height, -0.5 * math.pi, height),
    ):  # fmt: skip
        if way < side:
            return np.array([x + way * math.cos(heading), y + way * math.sin(heading), heading])
        way -= side
    return np.zeros(3)


def drifting(truth, turn_bias, scale_bias, noise, rng):
    """Odometry (n, 3) of a true path."""
    poses = [truth[0]]
    for a, b in itertools.pairwise(truth):
        motion = between(a, b)
        motion[:2] *= 1.0 + scale_bias + noise * 0.04 / math.sqrt(SPACING) * rng.normal()
        motion[2] += turn_bias * SPACING + noise * 0.04 * math.sqrt(SPACING) * rng.normal()
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def revisit_errors(path, drive):
    """Metres (m,) by which each place of a later lap misses the same place one lap before, relative to the truth."""
    found = between(path[: -drive.lap], path[drive.lap :])
    true = between(drive.truth[: -drive.lap], drive.truth[drive.lap :])
    return np.hypot(*(found[:, :2] - true[:, :2]).T)
