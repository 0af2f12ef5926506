"""Maze Runner in a virtual maze, byte by byte and faster than real time: robot, host's side, and an explorer."""

from __future__ import annotations

import numpy as np

from firmware.virtual.maze_body import Drift
from firmware.virtual.maze_runner import AHEAD, VirtualMazeRunner
from firmware.virtual.worlds import World
from server import channels, scip
from server.explorer import Explorer, ExplorerParams
from server.filter_worker import estimate_of
from server.messages import Drive, Effect, Goal, Keyframe, Stop
from server.navigator import NavigatorParams
from server.robots.maze_runner import MazeRunner, MazeRunnerParams, make_estimator
from server.session import Session
from slam.cost_grid import CostParams
from slam.laser_scan import LaserParams
from slam.refined_grid_filter import RefinedGridFilter

STEP = 0.02  # s between two looks at the lines
REPEAT = 5  # such steps between two repetitions of a driver's wish
PARAMS = MazeRunnerParams(laser=LaserParams(x=AHEAD))
NAVIGATION = NavigatorParams(  # of ways as narrow as a maze's
    cost=CostParams(resolution=0.03, clearance=0.16, comfort=0.26, margin=0.5)
)


class MazeLoop:
    """A virtual robot, and the host's side of its two lines."""

    def __init__(self, world: World, seed: int = 0, drift: Drift = "medium", params: MazeRunnerParams = PARAMS):
        self.virtual = VirtualMazeRunner(world, seed=seed, drift=drift)
        self.robot = MazeRunner(params)
        beams = params.laser.beams
        self.session = Session(self.robot, self.robot.calibration, boards=(channels.MOTOR,), lasers={"laser": beams})
        self.estimator = make_estimator(params, seed)
        self.keyframes: list[Keyframe] = []
        self.told = 0  # keyframes that the newest estimate knows
        self.virtual.write_laser(scip.start(44, 725))

    def run(self, seconds: float, wish: Drive | None = None) -> None:
        """Let time pass; a wish is said again ten times a second."""
        for beat in range(round(seconds / STEP)):
            if wish is not None and beat % REPEAT == 0:
                self.tell(wish)
            data = self.virtual.advance(STEP)
            self.obey(self.session.receive("board", data, self.virtual.time))
            self.obey(self.session.receive("laser", self.virtual.take_laser(), self.virtual.time))

    def tell(self, message: Drive | Goal | Stop) -> None:
        """Somebody's word to the robot."""
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

    def explore(self, longest: float = 900.0) -> Explorer:
        """Drive until the map is closed, or so many seconds."""
        explorer = Explorer(ExplorerParams(), NAVIGATION)
        self.run(0.5)
        while explorer.state != "done" and self.virtual.time < longest:
            self.believe()
            for message in explorer.tick(self.virtual.time, self.robot.snapshot()):
                assert isinstance(message, (Drive, Goal, Stop))
                self.tell(message)
            self.run(0.1)
        return explorer

    def wall_points(self) -> np.ndarray:
        """The map's walls (n, 2), in the frame that the robot began in, its path refined."""
        if isinstance(self.estimator, RefinedGridFilter):
            self.estimator.refine()
        path = self.estimator.estimate(1).path.astype(float)
        self.robot.step(estimate_of(self.estimator, self.virtual.time, 1))
        curves = self.robot.walls_along(path)
        return np.concatenate([np.empty((0, 2)), *(curve for curve in curves if len(curve) > 1)])
