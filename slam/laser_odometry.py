"""Odometry by a laser: each scan is laid onto what was seen on the last few metres.

A motion told by wheels, motor commands or nothing is bettered by the scan before (`slam.scan_motion`), then by a local
map (`slam.map_matching`), so that errors grow with the way and not with the scans. The frame drifts slowly: only the
newest metres are remembered, and nothing is closed. Two maps take turns, each begun half-way through the other's life,
so that there is always one that has seen enough. Uses its siblings `scan_motion`, `laser_maps` and `map_matching`.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from slam.grid import Grid
from slam.laser_maps import LaserMapParams, LaserMaps
from slam.laser_scan import Scan
from slam.map_matching import LayParams, lay
from slam.params import Params
from slam.pose import between, compose, wrap
from slam.scan_motion import ScanMotionParams, in_world, motion_between


class LaserOdometryParams(Params):
    """How far it remembers, and how scans are laid."""

    is_on: bool = True  # else the odometry is believed, and the map is drawn along it
    has_map: bool = True  # else only the scan before counts
    is_alone: bool = False  # whether none is: the last motion is thought to go on,
    unrest: tuple[float, float, float] = (0.1, 0.1, 0.15)  # m, m, rad that it may differ by from one scan to the next
    span: float = Field(default=8.0, gt=0.0)  # m of path after which a new map is begun
    turn: float = Field(default=20.0, gt=0.0)  # rad turned that are as long a life
    step: float = Field(default=0.03, ge=0.0)  # m after which a scan is drawn, so that standing still counts once,
    step_turn: float = Field(default=0.03, ge=0.0)  # or rad
    motion: ScanMotionParams = ScanMotionParams()
    lay: LayParams = LayParams()
    map: LaserMapParams = LaserMapParams()


class LaserOdometry:
    """Follows a laser: `step` takes what its odometry and a scan tell, and gives its pose (3,)."""

    def __init__(self, params: LaserOdometryParams):
        self.params = params
        self.pose = np.zeros(3)
        self.motion = np.zeros(3)  # since the scan before
        self.maps: list[LaserMaps] = []  # the older one first
        self.age = 0.0  # of the newest map, in spans
        self.last: tuple[Scan, np.ndarray] | None = None  # scan, and the odometry's pose where it was taken
        self.drawn = np.zeros(3)  # pose of the newest scan in the maps

    def step(self, odometry: np.ndarray, scan: Scan) -> np.ndarray:
        """The pose of a scan that the odometry has at the pose (3,); ValueError for one that is no number."""
        odometry = np.array(odometry, float)
        if not np.all(np.isfinite(odometry)):
            raise ValueError(f"the odometry's pose must be numbers, not {odometry}")
        if self.last is None:
            self.pose = odometry
            self.draw(scan)
        else:
            before, stood = self.last
            self.move(before, scan, between(stood, odometry))
        self.last = scan, odometry
        return self.pose

    def move(self, before: Scan, scan: Scan, told: np.ndarray) -> None:
        """Go on by a motion that the odometry has told."""
        params = self.params
        pose = self.laid(before, scan, told) if params.is_on else compose(self.pose, told)
        pose[2] = wrap(pose[2])
        self.motion = between(self.pose, pose)
        self.age += life_of(self.motion, params)
        self.pose = pose
        moved = between(self.drawn, pose)
        if math.hypot(moved[0], moved[1]) >= params.step or abs(moved[2]) >= params.step_turn:
            self.draw(scan)

    def laid(self, before: Scan, scan: Scan, told: np.ndarray) -> np.ndarray:
        """The pose (3,) at which a scan lies best upon the one before and the map, given a motion that was told."""
        params = self.params
        if params.is_alone:
            motion = motion_between(before, scan, self.motion, params.motion, np.diag(np.array(params.unrest) ** -2.0))
        else:
            motion = motion_between(before, scan, told, params.motion)
        pose = compose(self.pose, motion.pose)
        if params.has_map:
            prior = in_world(motion.information, self.pose[2:])[0]
            lay(self.maps[0].cells, 0, scan, pose, prior, params.lay.rule(), np.empty((3, 3)))
        return pose

    def draw(self, scan: Scan) -> None:
        """Take a scan up into the maps; the newest one's life may end here, and with it the older one."""
        if not self.maps or self.age >= 1.0:
            self.maps = [*self.maps[-1:], LaserMaps(1, self.params.map)]
            self.age = 0.0
        for local in self.maps:
            local.draw(scan, self.pose[None])
        self.drawn = self.pose

    def grid(self) -> Grid:
        """Log odds of what is remembered, in the frame of `pose`; of no cells before the first scan."""
        return self.maps[0].grid(0) if self.maps else Grid(np.zeros((0, 0), np.float32), 1.0, 0.0, 0.0)


def life_of(motion: np.ndarray, params: LaserOdometryParams) -> float:
    """How much of a map's life a motion (3,) takes."""
    return math.hypot(motion[0], motion[1]) / params.span + abs(float(motion[2])) / params.turn
