"""Maze Runner: one laser, and an odometry that may be no more than what the motors were told.

Each scan is laid onto the last few metres (`slam.laser_odometry`), so that the odometry hardly matters; every half
metre or half a radian is a vertex that saw the whole scan. Vertices stand where the laser does.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from server.channels import Calibration
from server.formats.laser import SENSOR
from server.messages import Effect, Estimate, Keyframe, Message, Odometry, Ranges
from slam.fastslam import FastSlam, FastSlamParams
from slam.grid_filter import GridFilter, GridFilterParams
from slam.laser_odometry import LaserOdometry, LaserOdometryParams
from slam.laser_scan import LaserParams, ScanParams, rays_of, scan_of, walls_of
from slam.motor_curve import MotorParams
from slam.params import Params
from slam.pose import between, compose
from slam.refined_grid_filter import RefinedGridFilter
from slam.scan_graph import ScanGraphParams


class MazeRunnerParams(Params):
    """Everything that makes this robot this robot."""

    laser: LaserParams = LaserParams()
    motors: MotorParams = MotorParams()
    scan: ScanParams = ScanParams()
    vertex_spacing: float = Field(default=0.45, ge=0.05, le=5.0)  # m of path between vertices,
    vertex_turn: float = Field(default=0.4, ge=0.05, le=3.0)  # or rad
    odometry: LaserOdometryParams = LaserOdometryParams()
    estimator: Literal["grids", "paper"] = "grids"  # what we hold best, or literally what the robot's authors have
    filter: GridFilterParams = GridFilterParams()
    paper: FastSlamParams = FastSlamParams()
    graph: ScanGraphParams = ScanGraphParams()  # of the filter's best path, for what is shown and written


def make_estimator(params: MazeRunnerParams, seed: int = 0, threads: int = 1) -> RefinedGridFilter | FastSlam:
    """The estimator of paths that the parameters choose; ours has its path to be refined."""
    if params.estimator == "paper":
        return FastSlam(params.paper, params.filter.particles, seed)
    return RefinedGridFilter(GridFilter(params.filter, seed, threads), params.graph)


class MazeRunner:
    """The robot as a fold: `step(message)` gives effects."""

    def __init__(self, params: MazeRunnerParams):
        self.params = params
        self.calibration = Calibration()  # of boards that it does not have
        self.rays = rays_of(params.laser.bearings)
        self.mount = compose(params.laser.mount, np.array([0.0, 0.0, self.rays.offset]))
        self.follower = LaserOdometry(params.odometry)
        self.t = 0.0
        self.odometry = np.zeros(3)  # as it was told
        self.has_odometry = False
        self.travelled = 0.0  # m since the last vertex
        self.vertices: list[np.ndarray] = []
        self.times: list[float] = []  # of the vertices
        self.estimate: Estimate | None = None

    def step(self, message: Message) -> list[Effect]:
        """Take one message up; what follows from it."""
        match message:
            case Odometry():
                self.t = message.t
                self.odometry = np.array([message.x, message.y, message.theta])
                self.has_odometry = True
            case Ranges(sensor=sensor) if sensor == SENSOR and self.has_odometry:
                return self.look(message)
            case Estimate():
                self.estimate = message
        return []

    def look(self, message: Ranges) -> list[Effect]:
        """Follow a scan; it is a vertex's where the robot has moved on."""
        walls = walls_of(message.ranges, self.rays, self.params.scan)
        before = self.follower.pose
        pose = self.follower.step(compose(self.odometry, self.mount), scan_of(walls, self.params.filter.jump))
        if self.vertices:
            self.travelled += math.hypot(pose[0] - before[0], pose[1] - before[1])
            apart = between(self.vertices[-1], pose)
            is_near = math.hypot(apart[0], apart[1]) < self.params.vertex_spacing
            if is_near and abs(apart[2]) < self.params.vertex_turn:
                return []
        keyframe = Keyframe(message.t, len(self.vertices), pose, walls, self.travelled)
        self.vertices.append(pose)
        self.times.append(message.t)
        self.travelled = 0.0
        return [keyframe]

    def finish(self) -> list[Keyframe]:
        """The log or the session ends here; no vertex waits."""
        return []
