"""Crunch: the balancing robot with eight sonars and eight infra-red rangefinders. What it is and what it does.

Logs of other robots are mapped by the same estimator: their odometry comes integrated, their rings of sensors differ.
Uses its siblings `foldback`, `odometry` and `pilot`.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Literal

import numpy as np
from pydantic import Field

from server.channels import Calibration
from server.commands import ArmCommand, DriveCommand, StopCommand
from server.messages import (
    Arm,
    Balance,
    Drive,
    Effect,
    Estimate,
    Goal,
    Keyframe,
    LastWords,
    Message,
    Odometry,
    Power,
    Ranges,
    Snapshot,
    Status,
    Stop,
    Wheels,
    nothing_known,
    shown_of,
)
from server.robots.foldback import TieBreaker
from server.robots.odometry import WheelOdometry
from server.robots.pilot import SIGHT, Pilot, Reins
from slam.bundle import BundleParams
from slam.echoes import Sweep
from slam.islands import Islands
from slam.local_map import LocalMap, LocalMapParams
from slam.local_search import LocalSearch, LocalSearchParams
from slam.params import Params
from slam.path_filter import PathFilterParams
from slam.pose import between, compose, transform
from slam.rangefinder import RingParams, crunch_sensors
from slam.refined_filter import RefinedFilter
from slam.refinement import RefinementParams
from slam.vfh import Vfh, VfhParams
from slam.walls import WallParams, Walls, curves, extract


class CrunchParams(Params):
    """Everything that makes this robot this robot."""

    sensors: dict[str, RingParams] = Field(default_factory=crunch_sensors, min_length=1, max_length=16)
    calibration: Calibration = Field(default_factory=Calibration)
    track: float = Field(default=0.19, gt=0.0)  # m between the wheels
    vertex_spacing: float = Field(default=0.5, ge=0.05, le=2.0)  # m of path between vertices (thesis, 2.3)
    hindsight: int = Field(
        default=2, ge=0, le=10
    )  # vertices driven on before a vertex's walls are taken, so that both sides were seen
    goal_radius: float = Field(default=0.2, gt=0.0)  # m from the goal that count as there
    look_ahead: float = Field(default=0.6, gt=0.0)  # m along a planned way to the point that is steered to
    turn_gain: float = Field(default=2.0, gt=0.0)  # rad/s per rad of steering
    max_turn: float = Field(default=1.5, gt=0.0)  # rad/s
    local_map: LocalMapParams = LocalMapParams()
    walls: WallParams = WallParams()
    vfh: VfhParams = VfhParams()
    estimator: Literal["filter", "search"] = "filter"  # particles, or local search on one path (thesis, 2.6)
    perturbations: int = Field(default=100, ge=0, le=10_000)  # that the local search tries at every vertex
    filter: PathFilterParams = PathFilterParams()
    restarts: int = Field(
        default=4, ge=0, le=100
    )  # of all islands with other seeds over a whole log, while no path leads those that go elsewhere
    refinement: RefinementParams = RefinementParams()  # of the filter's best path, for what is shown and written
    bundle: BundleParams = BundleParams()

    def filter_params(self) -> PathFilterParams:
        """The path filter's parameters, with the local map's reach filled in."""
        reach = LocalMap(self.local_map, self.sensors).reach
        return self.filter.model_copy(update={"reach": reach})


def make_estimator(params: CrunchParams, seed: int = 0, threads: int = 1) -> RefinedFilter:
    """The estimator of paths that the parameters choose, its path to be refined."""
    return RefinedFilter(make_filter(params, seed, threads), params.filter.motion, params.refinement)


def make_filter(params: CrunchParams, seed: int = 0, threads: int = 1) -> Islands | LocalSearch:
    """The path filters, or the local search, that the parameters choose; both have one face."""
    chosen = params.filter_params()
    if params.estimator == "filter":
        return Islands(chosen, seed, threads)
    search = LocalSearchParams(
        perturbations=params.perturbations, reach=chosen.reach, motion=chosen.motion, comparison=chosen.comparison
    )
    return LocalSearch(search, seed)


class Crunch:
    """The robot as a fold: `step(message)` gives effects, `snapshot()` what a viewer needs."""

    def __init__(self, params: CrunchParams):
        self.params = params
        self.calibration = params.calibration
        self.local_map = LocalMap(params.local_map, params.sensors, border=params.hindsight * params.vertex_spacing)
        self.tie_breaker = TieBreaker(params.sensors)
        self.vfh = Vfh(params.vfh)
        self.pilot = Pilot(self.vfh, Reins(params.goal_radius, params.look_ahead, params.turn_gain, params.max_turn))
        self.wheels = WheelOdometry(params.track, params.calibration.wheel_radius)
        self.t = 0.0
        self.odometry = np.zeros(3)
        self.tilt = 0.0
        self.travelled = 0.0  # m since the last vertex
        self.distance = 0.0
        self.has_odometry = False
        self.has_seen = False
        self.looked = -math.inf  # when a sweep came last
        self.vertices: list[np.ndarray] = []
        self.times: list[float] = []  # of the vertices
        self.pending: deque[tuple[float, int, float]] = deque()  # vertices whose walls are still to be taken
        self.observations: list[Walls] = []
        self.curves: list[list[np.ndarray]] = []
        self.estimate: Estimate | None = None
        self.best_walls: list[np.ndarray] = []  # the map of the estimate
        self.last_ranges: dict[str, np.ndarray] = {}
        self.sweep: Sweep | None = None  # that was fused last
        self.balance: Balance | None = None
        self.power: Power | None = None
        self.boards: dict[str, Status] = {}
        self.last_words: LastWords | None = None

    def step(self, message: Message) -> list[Effect]:
        """Take one message up; what follows from it."""
        match message:
            case Wheels():
                return self.roll(message)
            case Odometry():
                return self.follow(message)
            case Ranges():
                return self.look(message)
            case Estimate():
                self.estimate = message
                self.best_walls = self.walls_along(message.path)
            case Drive(shared=True):
                self.pilot.follow(message)
                return self.steer() or [DriveCommand(0.0, 0.0)]
            case Drive():
                self.pilot.rest()
                return [DriveCommand(message.speed, message.turn)]
            case Goal(place=tuple()):
                self.pilot.aim(message, self.pose())
            case Goal() | Stop():
                self.pilot.rest()
                return [StopCommand()]
            case Arm():
                return [ArmCommand(message.armed)]
            case Balance():
                self.balance = message
            case Power():
                self.power = message
            case Status():
                self.boards[message.board] = message
            case LastWords():
                self.last_words = message
        return []

    def roll(self, wheels: Wheels) -> list[Effect]:
        """Integrate the wheels."""
        moved = self.wheels.roll(wheels)
        self.odometry = np.array([self.wheels.x, self.wheels.y, self.wheels.theta])
        self.tilt = wheels.tilt
        return self.advance(wheels.t, abs(moved))

    def follow(self, odometry: Odometry) -> list[Effect]:
        """Take over a pose that the robot integrated itself."""
        pose = np.array([odometry.x, odometry.y, odometry.theta])
        moved = math.hypot(pose[0] - self.odometry[0], pose[1] - self.odometry[1]) if self.has_odometry else 0.0
        self.odometry = pose
        return self.advance(odometry.t, moved)

    def advance(self, t: float, moved: float) -> list[Effect]:
        """Account for `moved` metres; every half metre is a vertex."""
        self.t = t
        self.has_odometry = True
        self.travelled += moved
        self.distance += moved
        if not self.has_seen or (self.vertices and self.travelled < self.params.vertex_spacing):
            return []
        self.pending.append((t, len(self.vertices), self.travelled))
        self.vertices.append(self.odometry)
        self.times.append(t)
        self.travelled = 0.0
        return [self.observe()] if len(self.pending) > self.params.hindsight else []

    def observe(self) -> Keyframe:
        """Take the walls of the oldest pending vertex from the local map as it is now."""
        t, index, travelled = self.pending.popleft()
        pose = self.vertices[index]
        self.local_map.move(self.odometry)
        walls = extract(self.local_map, pose, self.params.walls)
        self.observations.append(walls)
        self.curves.append(curves(walls, self.params.walls.jump))
        return Keyframe(t, index, pose, walls, travelled)

    def finish(self) -> list[Keyframe]:
        """The log or the session ends here: hand over the vertices that still wait."""
        return [self.observe() for _ in range(len(self.pending))]

    def look(self, message: Ranges) -> list[Effect]:
        """Fuse a sweep where the robot was when it was taken, and steer if there is something to steer for."""
        before = self.last_ranges.get(message.sensor, message.ranges)
        self.last_ranges[message.sensor] = np.where(np.isnan(message.ranges), before, message.ranges)
        believed = self.tie_breaker.believed(message.sensor, message.ranges)
        if not self.has_odometry or message.sensor not in self.local_map.rings:
            return []
        pose, tilt = self.odometry, self.tilt
        if self.wheels.history:
            x, y, theta, tilt = self.wheels.at(message.t)
            pose = np.array([x, y, theta])
        self.local_map.move(self.odometry)
        self.local_map.fuse(message.sensor, believed, pose, tilt)
        self.sweep = Sweep(message.sensor, self.params.sensors[message.sensor], believed, pose, tilt)
        self.has_seen, self.looked = True, self.t
        return self.steer()

    def steer(self) -> list[Effect]:
        """One step towards the goal, or of what a person wishes; nothing that has not been looked at moves it."""
        if self.t - self.looked > SIGHT:
            return []
        if self.pilot.is_resting:
            return []
        command = self.pilot.steer(self.pose(), float(self.odometry[2]), self.densities)
        return [] if command is None else [command]

    @property
    def goal(self) -> Goal | None:
        """Where it goes to."""
        return self.pilot.goal

    @property
    def stop_reason(self) -> str | None:
        """Why the drive board stood still last, in its own word; None before its first."""
        drive = self.balance or self.boards.get("drive")
        return drive.reason if drive else None

    def densities(self, limit: float = math.inf) -> np.ndarray:
        """The polar histogram (sectors,) around the robot now, of obstacles nearer than `limit` m."""
        return self.vfh.histogram(self.local_map.grid(), np.array(self.local_map.in_grid(self.odometry)), limit)

    def pose(self) -> np.ndarray:
        """The best estimate (3,) of where the robot is now, in the world."""
        if self.estimate is None:
            return self.odometry
        newest = len(self.estimate.path) - 1
        return compose(self.estimate.path[newest], between(self.vertices[newest], self.odometry))

    def snapshot(self) -> Snapshot:
        """The robot as a viewer sees it now."""
        estimate = self.estimate or nothing_known(self.t, self.odometry, self.params.filter.particles)
        known = len(self.estimate.path) if self.estimate else 0
        densities = self.densities()
        grid = self.local_map.grid()
        pose = self.pose()
        here = extract(self.local_map, self.odometry, self.params.walls) if self.has_seen else None
        return Snapshot(
            t=self.t,
            robot="crunch",
            pose=pose,
            odometry=self.odometry,
            tilt=self.tilt,
            distance=self.distance,
            local_map=grid.cells.copy(),  # the map goes on, a snapshot stays
            local_resolution=grid.resolution,
            local_origin=np.array([grid.x, grid.y]),
            local_pose=np.array(self.local_map.in_grid(self.odometry)),
            beams=self.beams(),
            curves=curves(here, self.params.walls.jump) if here is not None else [],
            densities=densities,
            threshold=self.params.vfh.threshold,
            valleys=self.vfh.valleys(densities),
            walls=self.best_walls,
            vertex_curves=self.curves[:known],
            observations=self.observations[:known],
            vertex_times=np.array(self.times[:known]),
            vertex_odometry=np.array(self.vertices[:known]).reshape(-1, 3),
            balance=self.balance,
            power=self.power,
            looked=self.looked,
            boards=dict(self.boards),
            last_words=self.last_words,
            **self.pilot.shown(pose),
            **shown_of(estimate),
        )

    def beams(self) -> dict[str, dict]:
        """Each ring's geometry and its last ranges."""
        return {
            name: {
                "bearings": ring.bearings,
                "offsets": np.full(len(ring.bearings_deg), ring.offset),
                "half_angle": ring.half_angle,
                "max_range": ring.max_range,
                "ranges": self.last_ranges.get(name, np.full(len(ring.bearings_deg), np.nan)),
            }
            for name, ring in self.params.sensors.items()
        }

    def walls_along(self, path: np.ndarray) -> list[np.ndarray]:
        """Wall curves (k, 2) in the world when the vertices stand at `path` (n, 3)."""
        return [transform(pose, curve) for pose, seen in zip(path, self.curves, strict=False) for curve in seen]
