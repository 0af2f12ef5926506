"""Maze Runner's odometry from optical mice that look at the floor, and from its motors where the mice are not sound.

Counts are gathered over a step, for what a mouse tells within one packet is too little to be judged, and some come
late. Whoever was not heard lately is left out; where all tell much less than the motors drove, all look at a floor that
they do not see, or at none, and the motors are believed.
"""

from __future__ import annotations

import math

import numpy as np

from server.messages import MiceHealth, MouseCounts
from slam.mouse_odometry import MouseOdometry, MouseOdometryParams
from slam.pose import between, compose

STEP = 0.1  # s over which counts are gathered and judged,
LONGEST = 0.2  # and until which a step that is not sound waits for counts that came late
PATIENCE = 0.3  # s after which a mouse that says nothing, while others count, is left out
DRIVEN = 0.006  # m that the motors say a mouse has gone in a step, from which on it should have counted,
LEAST = 0.4  # and the least share of them that is believed


class Mice:
    """The pose (3,) that mice lead to. `count` what they tell, and `step` whenever the motors' odometry is new."""

    def __init__(self, params: MouseOdometryParams):
        self.odometry = MouseOdometry(params)
        self.places = self.odometry.equations
        n = len(params.mice)
        self.pose = np.zeros(3)
        self.counts = np.zeros((n, 2))  # since the step began
        self.is_broken = np.zeros(n, bool)  # some of the step's counts were lost
        self.heard = np.full(n, -math.inf)
        self.began: float | None = None  # s, the step,
        self.start = np.zeros(3)  # from this pose,
        self.start_by_motors = np.zeros(3)  # which is this one by the motors
        self.was_sound = True  # the step before: while one is short, nothing else tells whether it will be
        self.steps = self.filled_in = 0
        self.left_out = np.zeros(n, int)  # steps, of each mouse

    @property
    def health(self) -> MiceHealth:
        """How they do."""
        return MiceHealth(self.steps, self.filled_in, tuple(self.left_out.tolist()))

    def count(self, message: MouseCounts) -> None:
        """Take a mouse's counts up; those of a mouse that the settings do not have are nobody's."""
        if message.mouse < len(self.counts):
            self.counts[message.mouse] += (message.x, message.y)
            self.is_broken[message.mouse] |= not message.is_whole
            self.heard[message.mouse] = message.t

    def step(self, t: float, by_motors: np.ndarray) -> np.ndarray:
        """The pose (3,) at a time (s) at which the motors' odometry is `by_motors` (3,)."""
        if self.began is None:
            self.begin(t, by_motors)
            return self.pose
        driven = between(self.start_by_motors, by_motors)
        told = self.odometry.step(self.counts, self.seen(t))
        is_sound = told.is_sound and self.is_likely(told.motion, driven)
        is_whole = not 0.0 <= t - self.began < (STEP if is_sound else LONGEST)
        is_trusted = is_sound and (is_whole or self.was_sound)
        self.pose = compose(self.start, chord_of(told.motion) if is_trusted else driven)
        if is_whole:
            self.was_sound = is_sound
            self.steps += 1
            self.filled_in += not is_sound
            self.left_out += ~told.believed
            self.begin(t, by_motors)
        return self.pose

    def begin(self, t: float, by_motors: np.ndarray) -> None:
        """A step begins here; what was counted before is no part of it, nor a mouse that comes back within it."""
        self.began, self.start, self.start_by_motors = t, self.pose, by_motors
        self.counts = np.zeros_like(self.counts)
        silent = t - self.heard >= PATIENCE
        self.is_broken = silent & ~np.all(silent)  # all are where the robot stands

    def seen(self, t: float) -> np.ndarray:
        """Which mice (mice,) are to be asked: all where none counts, for then the robot may stand."""
        if not np.any(self.counts):
            return ~self.is_broken
        return ~self.is_broken & (t - self.heard < PATIENCE)

    def is_likely(self, motion: np.ndarray, driven: np.ndarray) -> bool:
        """Whether a motion (3,) is not far less than the motors' (3,), by the ways that the mice would have gone."""
        told, expected = (float(np.max(np.linalg.norm(self.places @ each, axis=1))) for each in (motion, driven))
        return expected < DRIVEN or told > LEAST * expected


def chord_of(motion: np.ndarray) -> np.ndarray:
    """Where a short arc (3,) leads, whose way was told in the robot's own axes as they turned."""
    half = 0.5 * motion[2]
    cos, sin = math.cos(half), math.sin(half)
    return np.array([cos * motion[0] - sin * motion[1], sin * motion[0] + cos * motion[1], motion[2]])
