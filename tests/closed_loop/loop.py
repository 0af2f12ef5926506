"""Virtual robot, session and fold in a circle, without a clock or a task."""

from __future__ import annotations

import math

from firmware.virtual import VirtualCrunch
from server import config
from server.messages import Arm, Drive, Effect, Estimate, Goal, Keyframe, Stop
from server.robots.crunch import Crunch, make_estimator
from server.session import Session

STEP = 0.02  # s


class Loop:
    """The circle, and how near its robot has come to a wall."""

    def __init__(self, robot: VirtualCrunch):
        params = config.load({"crunch": {"filter": {"particles": 200}}}).crunch
        self.robot, self.fold = robot, Crunch(params)
        self.session = Session(self.fold, params.calibration)
        self.path_filter = make_estimator(params)
        self.nearest_wall = math.inf

    def say(self, message: Drive | Goal | Stop | Arm) -> None:
        """A person's command, now."""
        self.obey(self.session.command(message, self.robot.time))

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / STEP)):
            self.obey(self.session.receive("radio", self.robot.advance(STEP), self.robot.time))
            room = float(self.robot.world.clearances(self.robot.pose[None, :2], 1.0)[0])
            self.nearest_wall = min(self.nearest_wall, room)

    def reach(self, seconds: float) -> bool:
        """Go on until the goal is reached; whether it was."""
        for _ in range(round(seconds / STEP)):
            self.run(STEP)
            if self.fold.goal is None:
                return True
        return False

    def obey(self, effects: list[Effect]) -> None:
        """Commands to the robot, keyframes to the filter, its answers to the fold."""
        for effect in effects:
            if isinstance(effect, Keyframe):
                self.path_filter.extend(effect.pose, effect.walls, effect.travelled)
                self.fold.step(Estimate(effect.t, **self.path_filter.estimate()._asdict()))
            else:
                self.robot.write(self.session.encode(effect))
