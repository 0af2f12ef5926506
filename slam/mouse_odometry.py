"""Odometry from optical mice that look at the floor (Maze Runner, *Sensor Suite and Odometry*; Bell 2011).

Each mouse tells how far the floor went by under it, in its own axes: two equations for the robot's motion (x, y, turn),
whose least squares are the Moore-Penrose inverse of all of them together. Two mice leave one equation to spare, by
which a slip shows; three leave enough to tell whose it is. A robot that cannot move sideways adds that as an equation,
so that a single mouse on a moment arm is enough. What no residual shows is a floor that fools all mice alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.params import Params


class MouseParams(Params):
    """Where a mouse sits on the robot, which way its own x axis points, and what it counts."""

    x: float = 0.1  # m ahead of the middle of the axle
    y: float = 0.0  # m to the left of it
    angle: float = 0.0  # rad, of the mouse's x axis from the robot's
    counts_per_metre: float = Field(default=31_500.0, gt=0.0)  # 800 an inch


class MouseOdometryParams(Params):
    """The mice, and when one of them is not believed."""

    mice: tuple[MouseParams, ...] = Field(default=(MouseParams(),), min_length=1, max_length=32)
    sideways: float = Field(default=0.002, gt=0.0)  # m that a step of the robot may slip sideways
    noise: float = Field(default=0.0005, gt=0.0)  # m of each axis of a mouse in a step,
    scale_noise: float = Field(default=0.02, ge=0.0)  # and as a share of the way it tells
    gate: float = Field(default=3.0, gt=0.0)  # root mean square of the residuals, in deviations, that is a slip


class MouseMotion(NamedTuple):
    """A motion (3,) of the robot, who was believed (mice,), and whether what was believed agrees.

    `misfit` is the root mean square of the residuals in deviations, 0 where no equation is to spare.
    """

    motion: np.ndarray
    believed: np.ndarray
    misfit: float
    is_sound: bool


class MouseOdometry:
    """Motions from the counts of a robot's mice."""

    def __init__(self, params: MouseOdometryParams):
        self.params = params
        self.scales = np.array([1.0 / mouse.counts_per_metre for mouse in params.mice])
        self.equations = np.array([equations_of(mouse) for mouse in params.mice])  # (mice, 2, 3)

    def step(self, counts: np.ndarray, seen: np.ndarray | None = None) -> MouseMotion:
        """The motion of a step in which the mice counted (mice, 2); those not `seen` (mice,) said nothing.

        Mice are left out one after the other, each time the one without which the others agree best, while they do not
        and one of them can be told. ValueError for counts that are not two numbers for each mouse.
        """
        ways = self.ways(counts)
        believed = np.ones(len(ways), bool) if seen is None else np.array(seen, bool)
        motion, misfit, spare = self.solve(ways, believed)
        while misfit > self.params.gate and spare > 2:
            trials = [(self.solve(ways, without(believed, int(mouse))), mouse) for mouse in np.flatnonzero(believed)]
            (motion, misfit, spare), mouse = min(trials, key=lambda trial: trial[0][1])
            believed = without(believed, int(mouse))
        is_sound = bool(np.any(believed)) and misfit <= self.params.gate
        return MouseMotion(motion, believed, misfit, is_sound)

    def ways(self, counts: np.ndarray) -> np.ndarray:
        """What the mice counted, in metres (mice, 2)."""
        counts = np.asarray(counts, float)
        if counts.shape != (len(self.scales), 2) or not np.all(np.isfinite(counts)):
            raise ValueError(f"{len(self.scales)} mice count two numbers each, not an array of {counts.shape}")
        return counts * self.scales[:, None]

    def solve(self, ways: np.ndarray, believed: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Motion (3,) by the believed mice and by not slipping sideways, its misfit, and the equations to spare."""
        params = self.params
        sigmas = np.hypot(params.noise, params.scale_noise * np.hypot(ways[:, 0], ways[:, 1]))[believed]
        rows = (self.equations[believed] / sigmas[:, None, None]).reshape(-1, 3)
        rows = np.concatenate([rows, [[0.0, 1.0 / params.sideways, 0.0]]])
        told = np.concatenate([(ways[believed] / sigmas[:, None]).reshape(-1), [0.0]])
        motion = np.linalg.pinv(rows) @ told
        spare = len(told) - int(np.linalg.matrix_rank(rows))
        residuals = told - rows @ motion
        return motion, math.sqrt(float(residuals @ residuals) / spare) if spare > 0 else 0.0, spare


def equations_of(mouse: MouseParams) -> np.ndarray:
    """(2, 3) what a mouse's axes tell of a motion: its own place moves by (x - turn y_m, y + turn x_m).

    The paper's matrix has the same rows with the place in polar coordinates.
    """
    cos, sin = math.cos(mouse.angle), math.sin(mouse.angle)
    return np.array([[cos, sin], [-sin, cos]]) @ np.array([[1.0, 0.0, -mouse.y], [0.0, 1.0, mouse.x]])


def without(believed: np.ndarray, mouse: int) -> np.ndarray:
    """The believed mice (mice,) but for one."""
    others = believed.copy()
    others[mouse] = False
    return others


def moment_arm(arm: float, **changes: float) -> Sequence[MouseParams]:
    """The paper's first robot: one mouse `arm` m ahead of the axle; the turn is its sideways way over the arm."""
    return (MouseParams(x=arm, **changes),)
