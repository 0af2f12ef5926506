"""A live session without clock and network: the virtual robot, the bridge and an inline filter, advanced by hand."""

from typing import Any

import numpy as np

from firmware.virtual import VirtualCrunch, World
from server.bridge import Bridge
from server.control import Control, ControlParams
from server.estimator import InlineEstimator
from server.robots.crunch import Crunch, CrunchParams
from server.session import Session
from slam.path_filter import PathFilter, PathFilterParams

STEP = 0.02  # s
PARAMS = CrunchParams(filter=PathFilterParams(particles=100))


class HandLink:
    """A link whose time passes only when the test says so."""

    speed = 1.0

    def __init__(self, robot: VirtualCrunch):
        self.robot = robot
        self.time = 100.0
        self.spec = "virtual:room"
        self.is_connected = True
        self.reconnects = 0
        self.error = ""

    def now(self) -> float:
        """The test's time."""
        return self.time

    def write(self, data: bytes) -> bool:
        """To the robot's radio."""
        self.robot.write(data)
        return True

    async def run(self, receive: Any) -> None:
        """Not used: the test advances."""

    def summary(self) -> dict:
        """Not used."""
        return {}


class HandSession:
    """The whole of a live session but asyncio."""

    def __init__(self, autopilot: bool | None = None, width: float = 6.0, height: float = 4.0):
        x, y = width / 2.0, height / 2.0
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
        world = World(np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1), np.zeros(3))
        self.virtual = VirtualCrunch(world, seed=1, drift="low")
        self.link = HandLink(self.virtual)
        robot = self.make_robot()
        session = Session(robot, PARAMS.calibration)
        control = Control(ControlParams(), autopilot)
        self.bridge = Bridge(robot, session, {"link0": self.link}, control, {"crunch": PARAMS.model_dump(mode="json")})
        self.bridge.estimator = InlineEstimator(lambda: PathFilter(PARAMS.filter_params(), 0, 1), self.bridge.believe)

    def make_robot(self) -> Crunch:
        """The robot; another session may have another."""
        return Crunch(PARAMS)

    def advance(self, seconds: float) -> None:
        """Let time pass for robot and host alike."""
        for _ in range(round(seconds / STEP)):
            self.link.time += STEP
            data = self.virtual.advance(STEP)
            if data:
                self.bridge.receive("link0", data, self.link.time)
            self.bridge.tick()
