"""Maze Runner: one laser, and an odometry that may be no more than what the motors were told.

Each scan is laid onto the last few metres (`slam.laser_odometry`), so that the odometry hardly matters; every half
metre or half a radian is a vertex that saw the whole scan. Vertices stand where the laser does. Where optical
mice look at the floor, the odometry is theirs. Uses its siblings `mice` and `pilot`.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Literal

import numpy as np
from pydantic import Field

from server.channels import Calibration
from server.commands import DriveCommand, PowersCommand, StopCommand
from server.formats.laser import SENSOR
from server.messages import (
    Arm,
    Drive,
    Effect,
    Estimate,
    Goal,
    Keyframe,
    Message,
    Motors,
    MouseCounts,
    Odometry,
    Ranges,
    Snapshot,
    Status,
    Stop,
    nothing_known,
    shown_of,
)
from server.robots.mice import Mice
from server.robots.pilot import SIGHT, Pilot, Reins
from slam.cost_grid import CostParams
from slam.fastslam import FastSlam, FastSlamParams
from slam.grid import Grid
from slam.grid_filter import GridFilter, GridFilterParams
from slam.laser_odometry import LaserOdometry, LaserOdometryParams
from slam.laser_scan import LaserParams, ScanParams, rays_of, scan_of, walls_of
from slam.motor_curve import MotorOdometry, MotorParams
from slam.mouse_odometry import MouseOdometryParams
from slam.params import Params
from slam.pose import between, compose, inverse, transform
from slam.refined_grid_filter import RefinedGridFilter
from slam.scan_graph import ScanGraphParams
from slam.vfh import Vfh, VfhParams
from slam.walls import Walls, curves

REMEMBERED = 1.0  # s of odometry, for scans that come late


class MazeRunnerParams(Params):
    """Everything that makes this robot this robot."""

    laser: LaserParams = LaserParams(x=0.05)
    laser_delay: float = Field(
        default=0.05, ge=0.0, le=1.0
    )  # s from the middle of a sweep to when the laser tells it, at least
    motors: MotorParams = MotorParams()
    mice: MouseOdometryParams | None = None  # optical ones on the floor: docs/maze-runner.md
    scan: ScanParams = ScanParams()
    vertex_spacing: float = Field(default=0.45, ge=0.05, le=5.0)  # m of path between vertices,
    vertex_turn: float = Field(default=0.4, ge=0.05, le=3.0)  # or rad
    deadline: float = Field(default=0.5, gt=0.05, le=1.0)  # s after which the motors stop unless told again
    goal_radius: float = Field(default=0.15, gt=0.0)  # m from the goal that count as there
    look_ahead: float = Field(default=0.4, gt=0.0)  # m along a planned way to the point that is steered to
    turn_gain: float = Field(default=2.0, gt=0.0)  # rad/s per rad of steering
    max_turn: float = Field(default=0.8, gt=0.0)  # rad/s; faster turns bend what the laser sees
    battery_low: float = Field(default=10.5, ge=0.0)  # V of three cells that should be charged,
    battery_empty: float = Field(default=9.9, ge=0.0)  # and that are empty
    shown_reach: float = Field(default=2.0, gt=0.0)  # m of the local map around the robot that viewers get
    floor: CostParams = CostParams(
        resolution=0.03, clearance=0.16, comfort=0.26, margin=0.5
    )  # for planning, in place of navigator.cost: a maze's ways are narrow
    tight_clearance: float = Field(default=0.135, gt=0.0)  # m, in place of navigator.tight_clearance
    vfh: VfhParams = VfhParams(robot_radius=0.13, clearance=0.06, max_speed=0.2)
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
    """The robot as a fold: `step(message)` gives effects, `snapshot()` what a viewer needs.

    Odometry comes integrated, as in logs, or is that of its mice, or is reckoned from what the motors are given.
    """

    def __init__(self, params: MazeRunnerParams):
        self.params = params
        self.calibration = Calibration()  # of boards that it does not have
        self.rays = rays_of(params.laser.bearings)
        self.mount = compose(params.laser.mount, np.array([0.0, 0.0, self.rays.offset]))
        self.follower = LaserOdometry(params.odometry)
        self.reckoning = MotorOdometry(params.motors)
        self.mice = Mice(params.mice) if params.mice else None
        self.vfh = Vfh(params.vfh)
        self.pilot = Pilot(self.vfh, Reins(params.goal_radius, params.look_ahead, params.turn_gain, params.max_turn))
        self.t = 0.0
        self.odometry = np.zeros(3)  # as it was told, or reckoned
        self.has_odometry = False
        self.history: deque[tuple[float, np.ndarray]] = deque()  # of the odometry, with its times
        self.seen_at = np.zeros(3)  # the odometry when the newest scan was taken
        self.looked = self.taken = -math.inf  # when a scan came last, and when it was taken
        self.travelled = self.distance = 0.0  # m since the last vertex, and since the start,
        self.passed = np.zeros(3)  # up to this pose
        self.vertices: list[np.ndarray] = []
        self.times: list[float] = []  # of the vertices
        self.told: list[np.ndarray] = []  # odometry of the laser at the vertices
        self.observations: list[Walls] = []
        self.curves: list[list[np.ndarray]] = []
        self.estimate: Estimate | None = None
        self.best_walls: list[np.ndarray] = []  # the map of the estimate
        self.last_ranges = np.full(params.laser.beams, np.nan)
        self.walls: Walls | None = None  # of the newest scan
        self.motors: Motors | None = None
        self.boards: dict[str, Status] = {}

    def step(self, message: Message) -> list[Effect]:
        """Take one message up; what follows from it."""
        match message:
            case Motors():
                self.reckoning.step(message.t, (message.left, message.right), message.battery_volts)
                self.motors = message
                reckoned = self.reckoning.pose
                self.roll(message.t, self.mice.step(message.t, reckoned) if self.mice else reckoned)
            case MouseCounts():
                if self.mice:
                    self.mice.count(message)
            case Odometry():
                self.roll(message.t, np.array([message.x, message.y, message.theta]))
            case Ranges(sensor=sensor) if sensor == SENSOR and self.has_odometry:
                return self.look(message)
            case Estimate():
                self.estimate = message
                self.best_walls = self.walls_along(message.path)
            case Drive(shared=True):
                self.pilot.follow(message)
                return self.steer() or [self.powers(0.0, 0.0)]
            case Drive():
                self.pilot.rest()
                return [self.powers(message.speed, message.turn)]
            case Goal(place=tuple()):
                self.pilot.aim(message, self.pose())
            case Goal() | Stop() | Arm(armed=False):
                self.pilot.rest()
                return [StopCommand()]
            case Status():
                self.boards[message.board] = message
        return []

    def roll(self, t: float, pose: np.ndarray) -> None:
        """Take the newest odometry up; in logs times go back now and then, and what came last is believed."""
        self.t, self.odometry, self.has_odometry = t, pose, True
        while self.history and self.history[-1][0] >= t:
            self.history.pop()
        self.history.append((t, pose))
        while t - self.history[0][0] > REMEMBERED:
            self.history.popleft()

    def odometry_at(self, t: float) -> np.ndarray:
        """The odometry (3,) at a time of the last moments; the oldest or the newest beyond them."""
        after = next((row for row, (then, _) in enumerate(self.history) if then >= t), len(self.history) - 1)
        if after == 0 or self.history[after][0] <= t:
            return self.history[after][1]
        (before, start), (then, _) = self.history[after - 1], self.history[after]
        moved = between(start, self.history[after][1])
        return compose(start, (t - before) / (then - before) * moved)

    def look(self, message: Ranges) -> list[Effect]:
        """Follow a scan, and steer by it; it is a vertex's where the robot has moved on."""
        walls = walls_of(message.ranges, self.rays, self.params.scan)
        self.taken = message.t - self.params.laser_delay
        told = self.odometry_at(self.taken)
        pose = self.follower.step(compose(told, self.mount), scan_of(walls, self.params.filter.jump))
        self.last_ranges, self.walls = message.ranges, walls
        self.seen_at, self.looked = told, self.t
        effects: list[Effect] = list(self.steer())
        if self.vertices:
            moved = math.hypot(pose[0] - self.passed[0], pose[1] - self.passed[1])
            if moved >= self.params.odometry.step:  # less may be what a scan errs by
                self.passed = pose
                self.travelled += moved
                self.distance += moved
            apart = between(self.vertices[-1], pose)
            is_near = math.hypot(apart[0], apart[1]) < self.params.vertex_spacing
            if is_near and abs(apart[2]) < self.params.vertex_turn:
                return effects
        keyframe = Keyframe(self.taken, len(self.vertices), pose, walls, self.travelled)
        if not self.vertices:
            self.passed = pose
        self.vertices.append(pose)
        self.times.append(self.taken)
        self.told.append(compose(told, self.mount))
        self.observations.append(walls)
        self.curves.append(curves(walls, self.params.filter.jump))
        self.travelled = 0.0
        return [*effects, keyframe]

    def finish(self) -> list[Keyframe]:
        """The log or the session ends here; no vertex waits."""
        return []

    def steer(self) -> list[Effect]:
        """One step towards the goal, or of what a person wishes; nothing that has not been looked at moves it."""
        if self.pilot.is_resting or self.t - self.looked > SIGHT:
            return []
        command = self.pilot.steer(self.pose(), float(self.here()[2]), self.densities)
        match command:
            case DriveCommand(speed, turn):
                return [self.powers(speed, turn)]
            case StopCommand():
                return [command]
        return []

    def powers(self, speed: float, turn: float) -> PowersCommand:
        """What makes the motors drive so fast (m/s) and turn at such a rate (rad/s), as far as they can.

        Turns are bounded, for a laser that turns fast bends what it sees (Maze Runner, Discussion); where a wheel would
        have to be faster than it can be, both are slower.
        """
        motors = self.params.motors
        half = 0.5 * motors.track * max(-self.params.max_turn, min(self.params.max_turn, turn))
        wanted = np.array([speed - half, speed + half])
        wheels = list(zip(self.reckoning.curves, wanted, strict=True))
        share = min(1.0, *(curve.fastest / max(abs(each), 1e-9) for curve, each in wheels))
        volts = self.motors.battery_volts if self.motors is not None else 0.0
        factor = motors.nominal_volts / volts if volts > 0.5 * motors.nominal_volts else 1.0
        powers = [float(curve.command(share * each)) * factor for curve, each in wheels]
        left, right = (max(-1.0, min(1.0, power)) for power in powers)
        return PowersCommand(left, right, self.params.deadline)

    @property
    def fastest(self) -> tuple[float, float]:
        """How fast it goes (m/s) straight on, and turns (rad/s) on the spot, by its slower motor and its bound."""
        wheel = min(curve.fastest for curve in self.reckoning.curves)
        return wheel, min(self.params.max_turn, 2.0 * wheel / self.params.motors.track)

    @property
    def goal(self) -> Goal | None:
        """Where it goes to."""
        return self.pilot.goal

    @property
    def stop_reason(self) -> str | None:
        """Why the motor board stood still last, in its own word; None before its first."""
        board = self.motors or self.boards.get("motor")
        return board.reason if board else None

    def here(self) -> np.ndarray:
        """The robot's pose (3,) now, in the frame of the laser's own odometry."""
        laser = compose(
            self.follower.pose, between(compose(self.seen_at, self.mount), compose(self.odometry, self.mount))
        )
        return compose(laser, inverse(self.mount))

    def pose(self) -> np.ndarray:
        """The best estimate (3,) of where the robot is now, in the world."""
        if self.estimate is None:
            return self.here()
        newest = len(self.estimate.path) - 1
        return compose(self.estimate.path[newest], between(self.vertices[newest], self.here()))

    def densities(self, limit: float = math.inf) -> np.ndarray:
        """The polar histogram (sectors,) around the robot now, of obstacles nearer than `limit` m."""
        return self.vfh.histogram(self.follower.grid(), self.here(), limit)

    def walls_along(self, path: np.ndarray) -> list[np.ndarray]:
        """Wall curves (k, 2) in the world when the vertices stand at `path` (n, 3)."""
        return [transform(pose, curve) for pose, seen in zip(path, self.curves, strict=False) for curve in seen]

    def snapshot(self) -> Snapshot:
        """The robot as a viewer sees it now."""
        here = self.here()
        estimate = self.estimate or nothing_known(self.t, here, self.params.filter.particles)
        known = len(self.estimate.path) if self.estimate else 0
        pose, remembered = self.pose(), self.follower.grid()
        densities = self.vfh.histogram(remembered, here, math.inf)
        grid = window(remembered, here[:2], self.params.shown_reach)
        seen = curves(self.walls, self.params.filter.jump) if self.walls is not None else []
        scanned = between(here, self.follower.pose)
        return Snapshot(
            t=self.t,
            robot="maze_runner",
            pose=pose,
            odometry=self.odometry,
            tilt=math.nan,
            distance=self.distance,
            local_map=grid.cells,
            local_resolution=grid.resolution,
            local_origin=np.array([grid.x, grid.y]),
            local_pose=here,
            beams=self.beams(scanned),
            curves=[transform(scanned, curve) for curve in seen],
            densities=densities,
            threshold=self.params.vfh.threshold,
            valleys=self.vfh.valleys(densities),
            walls=self.best_walls,
            vertex_curves=self.curves[:known],
            observations=self.observations[:known],
            vertex_times=np.array(self.times[:known]),
            vertex_odometry=np.array(self.told[:known]).reshape(-1, 3),
            motors=self.motors,
            mice=self.mice.health if self.mice else None,
            battery_limits=(self.params.battery_low, self.params.battery_empty),
            fastest=self.fastest,
            looked=self.looked,
            boards=dict(self.boards),
            **self.pilot.shown(pose),
            **shown_of(estimate),
        )

    def beams(self, scanned: np.ndarray) -> dict[str, dict]:
        """What the laser saw last at `scanned` (3,), as if from the middle of the axle: where each beam ended."""
        laser = self.params.laser
        bearings = laser.bearings
        ends = self.last_ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
        seen = transform(scanned, np.where(np.isfinite(ends), ends, np.nan))
        return {
            SENSOR: {
                "bearings": np.where(np.isnan(seen[:, 0]), bearings + scanned[2], np.arctan2(seen[:, 1], seen[:, 0])),
                "offsets": np.zeros(laser.beams),
                "half_angle": 0.0,
                "max_range": laser.max_range,
                "ranges": np.hypot(seen[:, 0], seen[:, 1]),
            }
        }


def window(grid: Grid, middle: np.ndarray, reach: float) -> Grid:
    """What of a grid lies within `reach` m of a place (2,), straight up and across."""
    low = np.floor((middle - reach - [grid.x, grid.y]) / grid.resolution).astype(int).clip(0)
    high = np.ceil((middle + reach - [grid.x, grid.y]) / grid.resolution).astype(int).clip(0)
    cells = grid.cells[low[1] : high[1], low[0] : high[0]]
    x, y = grid.x + low[0] * grid.resolution, grid.y + low[1] * grid.resolution
    return Grid(cells.copy(), grid.resolution, float(x), float(y))
