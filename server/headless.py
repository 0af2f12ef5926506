"""Maze Runner's host side in simulated time, without loop, page or worker: its session, its estimator, an explorer.

What lives at the other end of the lines is handed in, and met through its bytes alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from server.config import Config, navigation_of
from server.explorer import Explorer
from server.filter_worker import estimate_of
from server.messages import Drive, Effect, Goal, Keyframe, Message, Stop
from server.robots.kinds import LASER, mouse_lines
from server.robots.maze_runner import MazeRunner, make_estimator
from server.session import Sink, session_of
from slam.refined_grid_filter import RefinedGridFilter

BOARD = "link0"
STEP = 0.02  # s between two looks at the lines
REPEAT = 5  # such steps between two repetitions of a driver's wish
SETTINGS = Config()


class Lines(Protocol):
    """A robot with a motor board, a laser, and perhaps mice; `firmware.virtual.VirtualMazeRunner` is one."""

    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
        ...

    def advance(self, seconds: float) -> bytes:
        """Lives on for some time; what the board said meanwhile."""
        ...

    def write(self, data: bytes) -> None:
        """Bytes to the board."""
        ...

    def take_laser(self) -> bytes:
        """What the laser has said since this was asked last."""
        ...

    def write_laser(self, data: bytes) -> None:
        """Bytes to the laser."""
        ...

    @property
    def mice(self) -> Sequence[object]:
        """Its mice."""
        ...

    def take_mouse(self, number: int) -> bytes:
        """What a mouse has said since this was asked last."""
        ...


class Headless:
    """The host's side of a robot; `sink` gets what a recording of the session keeps."""

    def __init__(self, virtual: Lines, seed: int = 0, settings: Config = SETTINGS, sink: Sink | None = None):
        self.virtual = virtual
        self.mouse_lines = mouse_lines(len(virtual.mice))
        params = settings.maze_runner
        self.robot = MazeRunner(params)
        self.session = session_of("maze_runner", self.robot, params, sink)
        self.estimator = make_estimator(params, seed)
        self.explorer = Explorer(settings.explorer, navigation_of(settings, "maze_runner"))
        self.keyframes: list[Keyframe] = []
        self.told = 0  # keyframes that the newest estimate knows

    def run(self, seconds: float, wish: Drive | None = None) -> None:
        """Let time pass; a wish is said again ten times a second."""
        for beat in range(round(seconds / STEP)):
            if wish is not None and beat % REPEAT == 0:
                self.tell(wish)
            data = self.virtual.advance(STEP)
            self.receive(BOARD, data)
            self.receive(LASER, self.virtual.take_laser())
            for number, link_id in enumerate(self.mouse_lines):
                self.receive(link_id, self.virtual.take_mouse(number))
            for request in self.session.requests(self.virtual.time).values():
                self.virtual.write_laser(request)

    def receive(self, link_id: str, data: bytes) -> None:
        """What came over a line."""
        if data:
            self.obey(self.session.receive(link_id, data, self.virtual.time))

    def tell(self, message: Message) -> None:
        """Somebody's word to the robot."""
        assert isinstance(message, (Drive, Goal, Stop))
        self.obey(self.session.command(message, self.virtual.time))

    def obey(self, effects: list[Effect]) -> None:
        """Do what the robot decided."""
        for effect in effects:
            if isinstance(effect, Keyframe):
                self.keyframes.append(effect)
                self.estimator.extend(effect.pose, effect.walls, effect.travelled)
            else:
                self.virtual.write(self.session.encode(effect))

    def believe(self) -> None:
        """Tell the robot what the estimator knows, if there is anything new."""
        if len(self.keyframes) == self.told:
            return
        self.told = len(self.keyframes)
        if isinstance(self.estimator, RefinedGridFilter):
            self.estimator.refine(is_quick=True)
        self.obey(self.robot.step(estimate_of(self.estimator, self.virtual.time, 10)))

    def explore(self, longest: float = 900.0, told: Callable[[], object] = lambda: None) -> Explorer:
        """Drive until the map is closed, or so many seconds; then the robot stands. `told` is called now and then."""
        self.run(0.5)
        self.explorer.autopilot = True
        while self.explorer.autopilot and self.virtual.time < longest:
            self.believe()
            for message in self.explorer.tick(self.virtual.time, self.robot.snapshot):
                self.tell(message)
            self.run(0.1)
            told()
        self.tell(Stop(self.virtual.time))
        return self.explorer

    def wall_points(self) -> np.ndarray:
        """The map's walls (n, 2), in the frame that the robot began in, its path refined."""
        if isinstance(self.estimator, RefinedGridFilter):
            self.estimator.refine()
        path = self.estimator.estimate(1).path.astype(float)
        self.robot.step(estimate_of(self.estimator, self.virtual.time, 1))
        curves = self.robot.walls_along(path)
        return np.concatenate([np.empty((0, 2)), *(curve for curve in curves if len(curve) > 1)])
