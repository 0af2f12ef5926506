"""Along a wall at a distance from it, by the nearest point of it that is seen; and whether one has come around.

The nearest point of a wall that is followed on the right lies straight to the right, at the distance that is wanted.
Where it lies farther ahead, a wall or a corner comes up and the robot turns away from it; where it lies farther back,
the wall ends and the robot turns around its end. Knows of no map.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from slam.params import Params
from slam.pose import wrap

CORNER = 1.0  # rad that the nearest point is off its place at which the robot drives at its slowest,
SLOWEST = 0.25  # of its speed
APART = 0.1  # m between the poses that a lap remembers


class WallFollowingParams(Params):
    """On which side the wall is, how near, and how the robot drives."""

    side: Literal["right", "left"] = "right"
    distance: float = Field(default=0.26, gt=0.0)  # m from the middle of the axle to the wall
    reach: float = Field(default=2.0, gt=0.0)  # m up to which a wall is one to go to
    speed: float = Field(default=0.15, gt=0.0)  # m/s
    max_turn: float = Field(default=0.8, gt=0.0)  # rad/s
    turn_gain: float = Field(default=1.6, gt=0.0)  # rad/s per rad that the nearest point is off its place
    distance_gain: float = Field(default=4.0, gt=0.0)  # rad of that place per m that the wall is too near or too far
    stop: float = Field(default=0.19, gt=0.0)  # m ahead at which it only turns
    half_width: float = Field(default=0.15, gt=0.0)  # m of the robot, for what is ahead of it
    back: float = Field(default=0.15, gt=0.0)  # m from where it was before within which it has come around,
    least: float = Field(default=2.0, gt=0.0)  # m of way ago at least


def follow(points: np.ndarray, params: WallFollowingParams) -> tuple[float, float]:
    """Speed (m/s) and turn rate (rad/s) along the wall whose points (n, 2) are seen, in the robot's frame.

    Straight on where no wall is near, and nowhere where nothing at all is seen; points behind the robot on the other
    side do not count.
    """
    if not len(points):
        return 0.0, 0.0
    sign = -1.0 if params.side == "right" else 1.0
    ahead = points[(np.abs(points[:, 1]) < params.half_width) & (points[:, 0] > 0.0)]
    room = float(ahead[:, 0].min()) if len(ahead) else math.inf
    bearings = sign * np.arctan2(points[:, 1], points[:, 0])  # 90 degrees is where the wall belongs
    ranges = np.hypot(*points.T)
    is_followed = (bearings > -0.25 * math.pi) & (ranges < params.reach)
    if not np.any(is_followed):
        return params.speed, 0.0
    nearest = int(np.argmin(np.where(is_followed, ranges, np.inf)))
    too_far = float(np.clip(ranges[nearest] - params.distance, -0.2, 0.2))
    off = float(wrap(bearings[nearest] - 0.5 * math.pi)) + params.distance_gain * too_far
    turn = sign * float(np.clip(params.turn_gain * off, -params.max_turn, params.max_turn))
    if room < params.stop:
        return 0.0, -sign * params.max_turn
    return params.speed * max(SLOWEST, 1.0 - abs(off) / CORNER), turn


class Lap:
    """Notices when a robot that follows a wall is where it was before, heading the same way."""

    def __init__(self, params: WallFollowingParams):
        self.params = params
        self.poses: list[np.ndarray] = []  # one each decimetre
        self.ways: list[float] = []  # m driven up to them
        self.way = 0.0
        self.last: np.ndarray | None = None

    def step(self, pose: np.ndarray) -> bool:
        """Take up where the robot is (3,); whether it was there long enough ago."""
        if self.last is not None:
            self.way += math.dist(self.last[:2], pose[:2])
        self.last = np.array(pose, float)
        if not self.ways or self.way - self.ways[-1] >= APART:
            self.poses.append(self.last)
            self.ways.append(self.way)
        old = np.array(self.poses)[np.array(self.ways) <= self.way - self.params.least]
        near = np.hypot(*(old[:, :2] - self.last[:2]).T) < self.params.back
        return bool(np.any(near & (np.abs(wrap(old[:, 2] - self.last[2])) < 0.25 * math.pi)))
