"""Ways to align two scans, and pairs of scans of which the relative pose is known, for `bench.basin`.

In mazes the truth is the simulation's. In logs of real lasers nobody knows it: there it is where point-to-line ICP ends
from the odometry's motion, weighed with it, and only pairs count whose scans then agree. That is a truth of our own
making for which ICP has an advantage; what is compared is whether the same place is found from afar. A bare corridor
tells nothing of the way along it, so that not all such pairs can be aligned.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from bench.recordings import data_folder
from firmware.virtual.mazes import CELL, SIZES, maze
from firmware.virtual.urg import FIRST, LAST, VirtualUrg
from server.formats.logs import read_log
from server.mapping import with_sensors
from server.messages import Odometry, Ranges
from server.robots.maze_runner import MazeRunnerParams
from server.scip import LEAST
from slam.grid_filter import GridFilterParams
from slam.laser_odometry import LaserOdometryParams
from slam.laser_scan import LaserParams, Scan, ScanParams, rays_of, scan_of, walls_of
from slam.pose import between, compose, transform, wrap
from slam.scan_agreement import do_agree
from slam.scan_matching import SETTLED, ScanMatchingParams, match_scans
from slam.scan_motion import ScanMotionParams, motion_between

LEAST_MOTION = 0.03  # m or rad between the scans of a log's pair, so that something is to be found
ASIDE, TURNED = 0.1, 0.2  # m off a cell's middle, and rad between the headings, at most, of a pair in a maze
BLIND = np.diag([1e-3, 1e-3, 1e-3])  # information on a guess of which nothing is known
WIDE = (0.5, 0.5, 0.5)  # m, m, rad: standard deviations of the guess for the wide search

Align = Callable[[Scan, Scan, np.ndarray], np.ndarray]


class Pair(NamedTuple):
    """Two scans, and the pose (3,) of the first in the frame of the other."""

    scan: Scan
    other: Scan
    pose: np.ndarray


def maze_pairs(count: int, seed: int) -> list[Pair]:
    """Pairs of what the robot's laser, at rest, sees from two places in a cell of a random maze."""
    rng, (columns, rows) = np.random.default_rng([seed, 0xBA51]), SIZES["medium"]
    world, laser = maze("medium", seed), LaserParams()
    places = [np.zeros(3)]
    urg = VirtualUrg(world, lambda t: places[0], seed)

    def seen(pose: np.ndarray) -> Scan:
        places[0] = pose
        millimetres = urg.sweep(0.0)[FIRST : LAST + 1]
        return scan_at(np.where(millimetres < LEAST, np.nan, 1e-3 * millimetres), laser)

    pairs = []
    for _ in range(count):
        middle = CELL * np.array([rng.integers(columns), rng.integers(rows)])
        heading = rng.uniform(-math.pi, math.pi)
        first, second = (
            np.array([*(middle + rng.uniform(-ASIDE, ASIDE, 2)), wrap(heading + turn)])
            for turn in (0.0, rng.uniform(-TURNED, TURNED))
        )
        pairs.append(Pair(seen(second), seen(first), between(first, second)))
    return pairs


def scan_at(ranges: np.ndarray, laser: LaserParams) -> Scan:
    """The scan of a laser's ranges (n,)."""
    return scan_of(walls_of(ranges, rays_of(laser.bearings), ScanParams()), GridFilterParams().jump)


def log_pairs(path: str, count: int, seed: int) -> list[Pair]:
    """Pairs of consecutive scans of a log below the folder of recordings, drawn at random."""
    scans, poses, laser = scans_of(path)
    motion = ScanMotionParams()
    pairs: list[Pair] = []
    for row in np.random.default_rng([seed, 0x106]).permutation(len(scans) - 1):
        if len(pairs) == count:
            break
        told = between(poses[row], poses[row + 1])
        if max(math.hypot(told[0], told[1]), abs(told[2])) < LEAST_MOTION:
            continue
        scan, other = scan_at(scans[row + 1], laser), scan_at(scans[row], laser)
        match = match_scans(scan, other, told, motion.odometry.information(told), motion.matching)
        if match.share >= motion.matching.enough and do_agree(scan, other, match.pose, motion.agreement):
            pairs.append(Pair(scan, other, match.pose))
    return pairs


@functools.cache
def scans_of(path: str) -> tuple[np.ndarray, np.ndarray, LaserParams]:
    """The scans (n, beams) of a log in metres, the odometry's poses (n, 3) of the laser, and the laser."""
    data = data_folder()
    assert data is not None
    log = read_log(data / path, robot="maze_runner")
    laser: LaserParams = with_sensors(MazeRunnerParams(), log).laser
    scans, poses, pose = [], [], None
    for message in log.messages():
        if isinstance(message, Odometry):
            pose = compose(np.array([message.x, message.y, message.theta]), laser.mount)
        elif isinstance(message, Ranges) and pose is not None:
            scans.append(message.ranges)
            poses.append(pose)
    return np.array(scans), np.array(poses), laser


def by_lines(scan: Scan, other: Scan, guess: np.ndarray) -> np.ndarray:
    """Point to line alone, which knows nothing of its guess."""
    return match_scans(scan, other, guess, BLIND, ScanMatchingParams()).pose


def by_points(scan: Scan, other: Scan, guess: np.ndarray) -> np.ndarray:
    """Point to point: the rigid motion between nearest neighbours, within a gate that narrows as that of the lines."""
    params, pose = ScanMatchingParams(), guess
    tree, gate = KDTree(other.points), params.gate
    for _ in range(4 * params.rounds):  # it converges more slowly
        ends = transform(pose, scan.points)
        apart, nearest = map(np.asarray, tree.query(ends))
        near = apart < gate
        if np.count_nonzero(near) < 2:
            break
        step = rigid(ends[near], other.points[nearest[near]])
        pose = compose(step, pose)
        if gate <= params.last_gate and max(math.hypot(step[0], step[1]), abs(step[2])) < SETTLED:
            break
        gate = max(params.last_gate, 0.7 * gate)
    return pose


def rigid(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The motion (3,) that lays points (n, 2) onto others with the least squares."""
    middle, other = points.mean(axis=0), others.mean(axis=0)
    here, there = points - middle, others - other
    theta = math.atan2(np.sum(here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]), np.sum(here * there))
    return np.array([*(other - transform(np.array([0.0, 0.0, theta]), middle)), theta])


def searched(scan: Scan, other: Scan, guess: np.ndarray) -> np.ndarray:
    """As the odometry by the laser alone does it: its search, within its idea of how far off a guess may be."""
    params = LaserOdometryParams()
    prior = np.diag(np.array(params.unrest) ** -2.0)
    return motion_between(other, scan, guess, params.motion, prior).pose


def searched_widely(scan: Scan, other: Scan, guess: np.ndarray) -> np.ndarray:
    """The same, of a guess that may be off by a metre and a radian."""
    params = ScanMotionParams()
    search = params.search.model_copy(update={"most": 1.0, "most_turn": 1.05})
    params = params.model_copy(update={"search": search})
    prior = np.diag(np.array(WIDE) ** -2.0)
    return motion_between(other, scan, guess, params, prior).pose
