"""FastSLAM on occupancy grids for a laser: every particle has a path and its family's map (Maze Runner, algorithm 3).

The paper moves particles at random, weighs them by their scans and draws these into their maps. Here a vertex's scan is
first aligned with the one before (point-to-line), which moves all particles alike; then each is laid onto its map,
drawn from how well map and motion together know the pose (Grisetti, Stachniss and Burgard, IEEE T-RO 23, 2007), and
weighed by how well the scan fits. Maps share patches along the path tree. Uses its siblings `families`,
`path_filter`, for the estimate's form, `path_tree`, `laser_maps`, `map_matching` and `scan_motion`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from slam.counter_random import gaussian, uniform
from slam.families import FamilyParams, families_of
from slam.laser_maps import LaserMapParams, LaserMaps
from slam.laser_scan import Scan, scan_of
from slam.map_matching import LayParams, lay
from slam.params import Params
from slam.path_filter import PathEstimate, checked_pose, estimate_of
from slam.path_tree import PathTree
from slam.pose import between, compose, wrap
from slam.resampling import effective_particles, normalize, systematic
from slam.scan_motion import OdometryNoise, in_world
from slam.uncertainty import Uncertainty, uncertainty
from slam.walls import Walls

OFFSET = 3  # stream of random numbers; the streams before it are of x, y and heading


class GridFilterParams(Params):
    """How many particles, how they move, are weighed, and draw their maps."""

    particles: int = Field(default=30, ge=1, le=100_000)
    threshold: float = Field(default=0.5, ge=0.0, le=1.0)  # share of effective particles below which it resamples
    jump: float = Field(default=0.15, gt=0.0)  # m between neighbouring ends of one wall
    odometry: OdometryNoise = OdometryNoise(distance=0.05, turn=0.02, rotation=0.02)  # a laser's own
    lay: LayParams = LayParams()
    map: LaserMapParams = LaserMapParams()
    families: FamilyParams = FamilyParams()  # of particles that share one map

    @model_validator(mode="after")
    def _families_stand_within_a_cell(self) -> GridFilterParams:
        most = 0.5 * self.map.resolution
        if self.families.near > most:
            raise ValueError(
                f"families.near is {self.families.near:g} m; cells of map.resolution allow {most:g} at most"
            )
        return self


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
def move_particles(cells, homes, scan, poses, priors, log_weights, rule, seed, step, first, end):
    """Lay a scan onto each particle's map from the guesses `poses` (n, 3), draw the poses, and weigh the particles.

    `homes` (n,) are the maps that the particles have.
    """
    hessian = np.empty((3, 3))
    for p in range(first, end):
        cost = lay(cells, homes[p], scan, poses[p], priors[p], rule, hessian)
        log_weights[p] -= cost + draw_pose(poses[p], hessian, seed, step, p)


class GridFilter:
    """The filter: `extend` by a vertex, which stands where the laser does; `estimate` when asked."""

    def __init__(self, params: GridFilterParams, seed: int = 0, threads: int = 1):
        self.params = params
        self.seed = seed
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.maps = LaserMaps(1, params.map)  # of families
        self.homes = np.zeros(params.particles, np.int64)  # which of them each particle has
        self.poses = np.zeros((params.particles, 3))
        self.log_weights = np.zeros(params.particles)
        self.scores = np.zeros(params.particles)  # log weights that no resampling takes away
        self.tree: PathTree | None = None
        self.odometry = np.zeros(3)
        self.scans: list[Scan] = []
        self.heads = np.zeros(1, np.int64)  # the particles that the maps are drawn from
        self.effective = float(params.particles)
        self.resamplings = 0

    @property
    def n_particles(self) -> int:
        """How many particles there are now."""
        return len(self.poses)

    @property
    def vertices(self) -> int:
        """How many vertices there are."""
        return len(self.scans)

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Add a vertex at `pose` (3,) of the odometry frame that saw `walls`, `travelled` m after the last one.

        ValueError for a pose or way that is no number, or a way back in time.
        """
        pose = checked_pose(self.vertices, pose, travelled)
        scan = scan_of(walls, self.params.jump)
        if self.tree is None:
            self.poses[:] = pose
            self.tree = PathTree(self.n_particles, pose)
        else:
            self.move(scan, between(self.odometry, pose))
            self.grow(self.tree)
            self.weigh()
        self.odometry = pose
        self.scans.append(scan)
        self.settle(self.known())
        self.maps.draw(scan, self.poses[self.heads], run=lambda task: self.share(len(self.heads), task))

    def move(self, scan: Scan, told: np.ndarray) -> None:
        """Move each particle to where its own map has the scan, by a motion that the odometry told, and weigh it."""
        poses = compose(self.poses, told)
        priors = in_world(self.params.odometry.information(told), self.poses[:, 2])
        before, rule = self.log_weights.copy(), self.params.lay.rule()
        self.share(self.n_particles, lambda first, end: move_particles(
            self.maps.cells, self.homes, scan, poses, priors, self.log_weights, rule, self.seed, self.vertices, first,
            end,
        ))  # fmt: skip
        self.scores += self.log_weights - before
        self.poses = np.column_stack([poses[:, :2], wrap(poses[:, 2])])

    def grow(self, tree: PathTree) -> None:
        """Add the new poses to the paths."""
        leaves = tree.leaves
        start = tree.grow()
        tree.nodes.poses[start : tree.n_nodes] = self.poses
        tree.nodes.parents[start : tree.n_nodes] = leaves
        tree.settle()

    def weigh(self) -> None:
        """Let likely particles have children where few carry most of the weight."""
        weights = normalize(self.log_weights)
        self.effective = effective_particles(weights)
        if self.effective < self.params.threshold * self.n_particles * (1.0 - 1e-9):
            self.resample(weights, self.n_particles)

    def resample(self, weights: np.ndarray, n_particles: int) -> None:
        """Draw `n_particles` by systematic resampling."""
        ancestors = systematic(weights, uniform(self.seed, self.resamplings, 0, OFFSET), n_particles)
        if self.tree is not None:
            self.tree.resample(ancestors)
        self.homes = self.homes[ancestors]
        self.poses, self.scores = self.poses[ancestors], self.scores[ancestors]
        self.log_weights = np.zeros(n_particles)
        self.effective = float(n_particles)
        self.resamplings += 1

    def resize(self, n_particles: int) -> None:
        """Change the number of particles, keeping the distribution; ValueError for none."""
        if n_particles < 1:
            raise ValueError(f"{n_particles} particles: a filter has one at least")
        if n_particles != self.n_particles:
            self.resample(normalize(self.log_weights), n_particles)

    def settle(self, tree: PathTree) -> None:
        """Find the families, each of which goes on with the map of its head."""
        families, self.heads = families_of(tree, self.params.families)
        self.maps.inherit(self.homes[self.heads])
        self.homes = families

    def share(self, n: int, task: Callable[[int, int], None]) -> None:
        """Run task(first, end) over n particles or maps, on as many threads as there are."""
        if self.pool is None:
            task(0, n)
            return
        borders = np.linspace(0, n, 4 * self.threads + 1).astype(int)
        list(self.pool.map(task, borders[:-1], borders[1:]))

    def best(self) -> int:
        """The particle whose scans have fitted best all along."""
        return int(np.argmax(self.scores))

    def known(self) -> PathTree:
        """The paths; RuntimeError before the first vertex."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        return self.tree

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What is known now; `affinity` is the best particle's log weight. RuntimeError before the first vertex."""
        tree, best = self.known(), self.best()
        return estimate_of(tree, best, max_particles, self.effective, self.resamplings, float(self.scores[best]))

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain each vertex is; RuntimeError before the first one."""
        return uncertainty(self.known(), normalize(self.log_weights), n_leaves)
