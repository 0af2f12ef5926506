"""FastSLAM on occupancy grids for a laser: every particle has a path and a map of its own (Maze Runner, algorithm 3).

The paper moves particles at random, weighs them by their scans and draws these into their maps. Here a scan is first
aligned with the one before (point-to-line), which moves all particles alike; every half metre or so each is laid onto
its own map, drawn from how well map and motion together know the pose (Grisetti, Stachniss and Burgard, IEEE T-RO 23,
2007), and weighed by how well the scan fits. In between, the best particle's map corrects the motion of all. Maps share
patches along the path tree. Uses its siblings `path_tree`, `tree_map`, `map_matching` and `scan_matching`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam import map_matching, tree_map
from slam.counter_random import gaussian, uniform
from slam.laser_scan import Scan, scan_of
from slam.map_matching import lay
from slam.params import Params
from slam.path_tree import PathTree
from slam.pose import between, compose, transform, wrap
from slam.resampling import effective_sample_size, normalize, systematic
from slam.scan_matching import ScanMatchingParams, match_scans, turned
from slam.tree_map import TreeMaps, clear, hit

OFFSET = 3  # stream of random numbers; the streams before it are of x, y and heading
LEAST = np.array([0.01, 0.01, 0.005])  # m, m, rad: standard deviations of an odometry that did not move
COARSEST = 64  # beams, of which one clears the cells next to the laser


class OdometryNoise(Params):
    """Standard deviations of the odometry between two scans."""

    distance: float = Field(default=0.1, ge=0.0)  # m per root metre
    turn: float = Field(default=0.1, ge=0.0)  # rad per root metre
    rotation: float = Field(default=0.2, ge=0.0)  # rad per rad turned


class LayParams(Params):
    """How scans are laid onto maps."""

    rounds: int = Field(default=12, ge=1, le=1000)  # of finding walls and solving, at most
    first_reach: float = Field(default=4.0, gt=0.0)  # cells around an end that its wall is looked for in, at first
    last_reach: float = Field(default=2.5, gt=0.0)  # cells, in the end
    sigma: float = Field(default=0.15, gt=0.0)  # m of an end off its wall; large, for a wall's ends err together
    kernel: float = Field(default=0.15, gt=0.0)  # m off a wall from which an end counts less
    unknown: float = Field(default=0.25, ge=0.0)  # nats that an end costs where nothing was seen yet


class GridFilterParams(Params):
    """How many particles, how they move, are weighed, and draw their maps."""

    particles: int = Field(default=30, ge=1, le=100_000)
    resolution: float = Field(default=0.05, gt=0.0)  # m per cell
    max_range: float = Field(default=20.0, gt=0.0)  # m; farther ends are not looked at
    free_range: float = Field(default=8.0, gt=0.0)  # m up to which beams clear cells
    jump: float = Field(default=0.15, gt=0.0)  # m between neighbouring ends of one wall
    step: float = Field(default=0.5, ge=0.0)  # m after which particles are weighed again,
    step_turn: float = Field(default=0.5, ge=0.0)  # or rad
    trust: float = Field(default=0.02, gt=0.0, le=1.0)  # in a scan match's information, for its ends err together
    slack: tuple[float, float, float] = (0.1, 0.1, 0.05)  # m, m, rad that a match may be off however sure it is
    threshold: float = Field(
        default=0.5, ge=0.0, le=1.0
    )  # effective sample size, of the particles, below which they resample
    free: float = Field(default=0.4, ge=0.0)  # log odds that a beam takes from a cell it passes,
    occupied: float = Field(default=0.9, ge=0.0)  # and adds to the one it ends in,
    most: float = Field(default=4.0, gt=0.0)  # up to this
    memory: float = Field(default=500.0, ge=1.0)  # ends that a cell's wall is the mean of
    odometry: OdometryNoise = OdometryNoise()
    matching: ScanMatchingParams = ScanMatchingParams()
    lay: LayParams = LayParams()


class Motion(NamedTuple):
    """A motion (3,) and the information (3, 3) on it."""

    pose: np.ndarray
    information: np.ndarray


@njit(cache=True, inline="always")
def draw_pose(pose, hessian, seed, step, particle):
    """Move a pose (3,) at random, by the information (3, 3) on it; the logarithm of that one's root determinant."""
    a = math.sqrt(hessian[0, 0])
    b, c = hessian[1, 0] / a, hessian[2, 0] / a
    d = math.sqrt(hessian[1, 1] - b * b)
    e = (hessian[2, 1] - b * c) / d
    f = math.sqrt(hessian[2, 2] - c * c - e * e)
    z = gaussian(seed, step, particle, 2) / f  # from the transposed Cholesky factor upwards
    y = (gaussian(seed, step, particle, 1) - e * z) / d
    x = (gaussian(seed, step, particle, 0) - b * y - c * z) / a
    pose[0], pose[1], pose[2] = pose[0] + x, pose[1] + y, pose[2] + z
    return math.log(a * d * f)


@njit(cache=True, nogil=True)
def move_particles(cells, scan, poses, priors, log_weights, rule, seed, step, first, end):
    """Lay a scan onto each particle's map from the guesses `poses` (n, 3), draw the poses, and weigh the particles."""
    hessian = np.empty((3, 3))
    for p in range(first, end):
        cost = lay(cells, p, scan, poses[p], priors[p], rule, hessian)
        log_weights[p] -= cost + draw_pose(poses[p], hessian, seed, step, p)


@njit(cache=True, nogil=True)
def draw_maps(cells, scan, cleared, mount, poses, rule, spacing, first, end):
    """Take a scan up into each particle's map: `cleared` (k, 2) are how far beams clear cells, `spacing` rad apart.

    Near the laser neighbours cross the same cells, so that only every second, fourth, ... of them clears these.
    """
    for p in range(first, end):
        cos, sin = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        dx, dy = turned(cos, sin, mount[0], mount[1])
        x, y = poses[p, 0] + dx, poses[p, 1] + dy
        for k in range(cleared.shape[0]):
            dx, dy = turned(cos, sin, cleared[k, 0], cleared[k, 1])
            fellows = k & -k if k > 0 else COARSEST
            begin = 0.5 * cells.resolution / (spacing * fellows) if fellows < COARSEST else 0.0
            clear(cells, p, x, y, poses[p, 0] + dx, poses[p, 1] + dy, begin, rule)
        for k in range(scan.points.shape[0]):
            dx, dy = turned(cos, sin, scan.points[k, 0], scan.points[k, 1])
            nx, ny = turned(cos, sin, scan.normals[k, 0], scan.normals[k, 1])
            hit(cells, p, poses[p, 0] + dx, poses[p, 1] + dy, nx, ny, rule)


class GridFilter:
    """The filter of a laser that looks to `bearings` (n,), ascending, from `mount` (3,) on the robot."""

    def __init__(
        self, params: GridFilterParams, bearings: np.ndarray, mount: np.ndarray, seed: int = 0, threads: int = 1
    ):
        self.params = params
        self.bearings = np.asarray(bearings, float)
        self.spacing = float(np.median(np.diff(self.bearings))) if len(self.bearings) > 1 else 1.0  # rad
        self.mount = np.asarray(mount, float)
        self.seed = seed
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.maps = TreeMaps(params.particles, params.resolution)
        self.poses = np.zeros((params.particles, 3))
        self.log_weights = np.zeros(params.particles)
        self.scores = np.zeros(params.particles)  # log weights that no resampling takes away
        self.tree: PathTree | None = None
        self.last: tuple[Scan, np.ndarray] | None = None  # scan, and the odometry's pose where it was taken
        self.travelled = self.turned = 0.0  # since particles were weighed last
        self.effective = float(params.particles)
        self.resamplings = 0

    @property
    def n_scans(self) -> int:
        """How many scans were taken up."""
        return self.tree.n_levels if self.tree else 0

    def extend(self, odometry: np.ndarray, ranges: np.ndarray) -> None:
        """Take up a scan of `ranges` (n,) at the odometry's pose (3,); ValueError for one that is no number."""
        odometry = np.array(odometry, float)
        if not np.all(np.isfinite(odometry)):
            raise ValueError(f"the odometry's pose must be numbers, not {odometry}")
        params = self.params
        scan = scan_of(ranges, self.bearings, self.mount, params.max_range, params.jump)
        if self.tree is None:
            self.poses[:] = odometry
            self.tree = PathTree(params.particles, odometry)
            is_weighed = True
        else:
            motion = self.motion(scan, odometry)
            self.travelled += math.hypot(motion.pose[0], motion.pose[1])
            self.turned += abs(float(motion.pose[2]))
            is_weighed = self.travelled >= params.step or self.turned >= params.step_turn
            self.weigh(scan, motion) if is_weighed else self.follow(scan, motion)
            self.grow(self.tree)
            self.resample(self.tree)
        self.last = scan, odometry
        self.take_up(scan, ranges, is_weighed)

    def motion(self, scan: Scan, odometry: np.ndarray) -> Motion:
        """How the robot moved since the last scan, by the odometry and by that scan."""
        assert self.last is not None
        before, stood = self.last
        params, motion = self.params, between(stood, odometry)
        root, turn = math.sqrt(math.hypot(motion[0], motion[1])), abs(float(motion[2]))
        noise = params.odometry
        sigmas = np.array(
            [noise.distance * root, noise.distance * root, math.hypot(noise.turn * root, noise.rotation * turn)]
        )
        prior = np.diag(np.hypot(sigmas, LEAST) ** -2.0)
        match = match_scans(scan, before, motion, prior, params.matching)
        if match.share < params.matching.enough:
            return Motion(motion, prior)
        slack = np.diag(np.square(params.slack))
        return Motion(match.pose, np.linalg.inv(np.linalg.inv(params.trust * match.information) + slack))

    def guess(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Where a motion takes the particles (n, 3), and the information (n, 3, 3) on that in the world."""
        turns = np.zeros((len(self.poses), 3, 3))
        cos, sin = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1], turns[:, 2, 2] = cos, -sin, sin, cos, 1.0
        return compose(self.poses, motion.pose), turns @ motion.information @ turns.transpose(0, 2, 1)

    def rule(self) -> map_matching.Rule:
        """The parameters of laying a scan, for the kernel."""
        chosen = self.params.lay
        return map_matching.Rule(
            chosen.rounds, chosen.first_reach, chosen.last_reach, chosen.sigma, chosen.kernel, chosen.unknown
        )

    def weigh(self, scan: Scan, motion: Motion) -> None:
        """Move each particle to where its own map has the scan, and weigh it."""
        poses, priors = self.guess(motion)
        before = self.log_weights.copy()
        self.on_all(lambda first, end: move_particles(
            self.maps.cells, scan, poses, priors, self.log_weights, self.rule(), self.seed, self.n_scans, first, end
        ))  # fmt: skip
        self.scores += self.log_weights - before
        self.poses = np.column_stack([poses[:, :2], wrap(poses[:, 2])])
        self.travelled = self.turned = 0.0

    def follow(self, scan: Scan, motion: Motion) -> None:
        """Move all particles as the best one's map has it."""
        poses, priors = self.guess(motion)
        best = self.best()
        pose, hessian = poses[best], np.empty((3, 3))
        lay(self.maps.cells, best, scan, pose, priors[best], self.rule(), hessian)
        self.poses = compose(self.poses, between(self.poses[best], pose))

    def grow(self, tree: PathTree) -> None:
        """Add the new poses to the paths."""
        leaves = tree.leaves
        start = tree.grow()
        tree.nodes.poses[start : tree.n_nodes] = self.poses
        tree.nodes.parents[start : tree.n_nodes] = leaves
        tree.settle()

    def resample(self, tree: PathTree) -> None:
        """Let likely particles have children where few carry most of the weight."""
        n = len(self.poses)
        weights = normalize(self.log_weights)
        self.effective = effective_sample_size(weights)
        if self.effective >= self.params.threshold * n:
            return
        ancestors = systematic(weights, uniform(self.seed, self.n_scans, 0, OFFSET))
        tree.resample(ancestors)
        self.maps.inherit(ancestors)
        self.poses, self.scores = self.poses[ancestors], self.scores[ancestors]
        self.log_weights = np.zeros(n)
        self.effective = float(n)
        self.resamplings += 1

    def take_up(self, scan: Scan, ranges: np.ndarray, is_weighed: bool) -> None:
        """Draw a scan into all maps; only scans that weigh the particles clear what lies before the walls."""
        params = self.params
        reach = np.nan_to_num(np.asarray(ranges, float), nan=0.0, posinf=0.0)  # no return may be a wall too dark to see
        clears = (reach > 0.0) & is_weighed
        angles = self.mount[2] + self.bearings[clears]
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        cleared = self.mount[:2] + np.minimum(reach[clears], params.free_range)[:, None] * ways
        poses = self.poses[:, None, :]
        self.maps.prepare(
            transform(self.poses, self.mount[:2]), transform(poses, cleared), transform(poses, scan.points)
        )
        rule = tree_map.Rule(params.free, params.occupied, params.most, params.memory)
        self.on_all(lambda first, end: draw_maps(
            self.maps.cells, scan, cleared, self.mount, self.poses, rule, self.spacing, first, end
        ))  # fmt: skip

    def on_all(self, task: Callable[[int, int], None]) -> None:
        """Run task(first, end) over all particles, on as many threads as there are."""
        borders = np.linspace(0, len(self.poses), 4 * self.threads + 1).astype(int)
        list(
            map(task, borders[:-1], borders[1:])
            if self.pool is None
            else self.pool.map(task, borders[:-1], borders[1:])
        )

    def best(self) -> int:
        """The particle whose scans have fitted best all along."""
        return int(np.argmax(self.scores))

    def path(self) -> np.ndarray:
        """Poses (scans, 3) of the best particle; RuntimeError before the first scan."""
        if self.tree is None:
            raise RuntimeError("no scan has been taken up yet")
        return self.tree.path(self.best())
