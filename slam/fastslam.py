"""FastSLAM on occupancy grids as Maze Runner's authors have it: their algorithms (3), (4) and (5), but for one thing.

Every particle is moved at random, weighed by how its scan fits its own map, draws the scan into that map, and is drawn
again at every step with a probability that is its weight. It is what `slam.grid_filter` is measured against. Where the
paper leaves a step to its reference (Thrun, Burgard and Fox, Probabilistic Robotics, 2006): the measurement model is
the likelihood field (table 6.3), and in (3) the map belongs to the particle, whose symbol the paper swaps with that of
the weight. Its sigma mixes metres and radians, as it stands there.

The one thing: in (5) a beam that met nothing, whose range is z_max, frees all cells up to there. Here ranges of z_max
and more are infinite and tell of no cell, for a wall may be too dark to be seen (`slam.laser_scan.walls_of`), so that
the condition z < z_max of (5) always holds.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.counter_random import gaussian, uniform
from slam.grid import Grid
from slam.params import Params
from slam.path_filter import PathEstimate, checked_pose, estimate_of
from slam.path_tree import PathTree
from slam.pose import between
from slam.resampling import effective_particles, normalize, systematic
from slam.uncertainty import Uncertainty, uncertainty
from slam.walls import Walls

OFFSET = 2  # stream of random numbers; the streams before it are of the way and of the turn
MARGIN = 40  # cells by which maps grow beyond what is seen
SMALLEST = 200  # cells along a side at first


class FastSlamParams(Params):
    """The constants of the three algorithms."""

    resolution: float = Field(default=0.05, gt=0.0)  # m per cell
    max_range: float = Field(default=8.0, gt=0.0)  # m, z_max
    noise: float = Field(default=1.0, ge=0.0)  # times sqrt(v^2 + omega^2), the deviation of a step's way and turn
    thickness: float = Field(default=0.1, gt=0.0)  # m of walls, alpha
    width_deg: float = Field(default=1.0, gt=0.0)  # of a beam, beta
    occupied: float = 0.9  # log odds, l_occ,
    free: float = -0.4  # and l_free; l_0 is 0
    hit_sigma: float = Field(default=0.1, gt=0.0)  # m of an end off the nearest wall
    random: float = Field(default=0.05, gt=0.0, lt=1.0)  # share of ends that tell of no wall
    every: int = Field(default=6, ge=1)  # of the beams, one of so many weighs, for neighbours err together


@njit(cache=True)
def sample_motion(pose, distance, turn, sigma, seed, step, particle):
    """Move a pose (3,) by a way and a turn, each with a deviation of `sigma` (Maze Runner, Sensor Suite)."""
    way = distance + sigma * gaussian(seed, step, particle, 0)
    angle = turn + sigma * gaussian(seed, step, particle, 1)
    heading = pose[2] + 0.5 * angle
    pose[0] += way * math.cos(heading)
    pose[1] += way * math.sin(heading)
    pose[2] = (pose[2] + angle + math.pi) % (2.0 * math.pi) - math.pi


@njit(cache=True)
def measurement_model(cells, x, y, resolution, pose, distances, every, sigma, random, reach):
    """Log likelihood of a scan in a map (rows, columns) that begins at (x, y): how near its ends lie to walls."""
    n = distances.size
    width = math.ceil(3.0 * sigma / resolution)
    total = 0.0
    for ray in range(0, n, every):
        if not distances[ray] < reach:
            continue
        angle = pose[2] + 2.0 * math.pi * ray / n
        u = (pose[0] + distances[ray] * math.cos(angle) - x) / resolution
        v = (pose[1] + distances[ray] * math.sin(angle) - y) / resolution
        nearest = math.inf
        for row in range(max(0, int(v) - width), min(cells.shape[0], int(v) + width + 1)):
            for column in range(max(0, int(u) - width), min(cells.shape[1], int(u) + width + 1)):
                if cells[row, column] > 0.0:
                    nearest = min(nearest, math.hypot(column + 0.5 - u, row + 0.5 - v) * resolution)
        hit = math.exp(-0.5 * (nearest / sigma) ** 2) if nearest < math.inf else 0.0
        total += math.log((1.0 - random) * hit + random)
    return total


@njit(cache=True)
def inverse_sensor_model(u, v, pose, distances, thickness, width, occupied, free, reach):
    """What a scan says about the cell whose centre is at (u, v): algorithm (5), but nothing by an infinite range."""
    n = distances.size
    r = math.hypot(u - pose[0], v - pose[1])
    phi = math.atan2(v - pose[1], u - pose[0]) - pose[2]
    k = round(phi * n / (2.0 * math.pi)) % n
    off = (phi - 2.0 * math.pi * k / n + math.pi) % (2.0 * math.pi) - math.pi
    z = distances[k]
    if not z < math.inf or r > min(reach, z + 0.5 * thickness) or abs(off) > 0.5 * width:
        return 0.0
    if z < reach and abs(r - z) < 0.5 * thickness:
        return occupied
    return free if r <= z else 0.0


@njit(cache=True)
def occupancy_grid_mapping(cells, x, y, resolution, pose, distances, thickness, width, occupied, free, reach):
    """Add what a scan says to every cell in its perceptual field: algorithm (4)."""
    cells_reach = math.ceil(reach / resolution)
    u, v = int((pose[0] - x) / resolution), int((pose[1] - y) / resolution)
    for row in range(max(0, v - cells_reach), min(cells.shape[0], v + cells_reach + 1)):
        for column in range(max(0, u - cells_reach), min(cells.shape[1], u + cells_reach + 1)):
            cells[row, column] += inverse_sensor_model(
                x + (column + 0.5) * resolution, y + (row + 0.5) * resolution, pose, distances, thickness, width,
                occupied, free, reach,
            )  # fmt: skip


class FastSlam:
    """The filter, with the face of `slam.grid_filter.GridFilter`; a vertex is a step of its own."""

    def __init__(self, params: FastSlamParams, n_particles: int = 30, seed: int = 0):
        self.params = params
        self.seed = seed
        n = n_particles
        self.poses = np.zeros((n, 3))
        self.scores = np.zeros(n)
        self.maps = np.zeros((n, SMALLEST, SMALLEST), np.float32)
        self.x = self.y = -0.5 * SMALLEST * params.resolution  # of the corner of all maps
        self.tree: PathTree | None = None
        self.odometry = np.zeros(3)
        self.vertices = 0
        self.effective = float(n)

    @property
    def n_particles(self) -> int:
        """How many particles there are now."""
        return len(self.poses)

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Algorithm (3): a step to `pose` (3,) of the odometry frame, where the laser saw `walls`.

        ValueError for a pose or way that is no number, or a way back in time.
        """
        pose = checked_pose(self.vertices, pose, travelled)
        distances = np.where(walls.distances < self.params.max_range, walls.distances, np.inf)
        if self.tree is None:
            self.poses[:] = pose
            self.tree = PathTree(self.n_particles, pose)
            self.make_room()
            self.draw(distances)
        else:
            self.step(self.tree, between(self.odometry, pose), distances)
        self.odometry = pose
        self.vertices += 1

    def step(self, tree: PathTree, motion: np.ndarray, distances: np.ndarray) -> None:
        """Move, weigh and draw every particle, then draw particles by their weights."""
        params = self.params
        distance, turn = math.copysign(math.hypot(motion[0], motion[1]), motion[0]), float(motion[2])
        sigma = params.noise * math.hypot(distance, turn)
        log_weights = np.empty(self.n_particles)
        for particle, pose in enumerate(self.poses):
            sample_motion(pose, distance, turn, sigma, self.seed, self.vertices, particle)
        self.make_room()
        for particle, pose in enumerate(self.poses):
            log_weights[particle] = measurement_model(
                self.maps[particle], self.x, self.y, params.resolution, pose, distances, params.every,
                params.hit_sigma, params.random, params.max_range,
            )  # fmt: skip
        self.draw(distances)
        leaves, start = tree.leaves, tree.grow()
        tree.nodes.poses[start : tree.n_nodes] = self.poses
        tree.nodes.parents[start : tree.n_nodes] = leaves
        tree.settle()
        self.scores += log_weights
        weights = normalize(log_weights)
        self.effective = effective_particles(weights)
        self.resample(weights, self.n_particles)

    def draw(self, distances: np.ndarray) -> None:
        """Draw a scan into every particle's map."""
        params = self.params
        for particle, pose in enumerate(self.poses):
            occupancy_grid_mapping(
                self.maps[particle], self.x, self.y, params.resolution, pose, distances, params.thickness,
                math.radians(params.width_deg), params.occupied, params.free, params.max_range,
            )  # fmt: skip

    def resample(self, weights: np.ndarray, n_particles: int) -> None:
        """Draw particles with probabilities that are their weights."""
        ancestors = systematic(weights, uniform(self.seed, self.vertices, 0, OFFSET), n_particles)
        if self.tree is not None:
            self.tree.resample(ancestors)
        self.poses, self.scores, self.maps = self.poses[ancestors], self.scores[ancestors], self.maps[ancestors]

    def resize(self, n_particles: int) -> None:
        """Change the number of particles; ValueError for none."""
        if n_particles < 1:
            raise ValueError(f"{n_particles} particles: a filter has one at least")
        if n_particles != self.n_particles:
            self.resample(np.full(self.n_particles, 1.0 / self.n_particles), n_particles)

    def make_room(self) -> None:
        """Let the maps reach as far as the laser sees from every particle."""
        params = self.params
        reach = params.max_range + params.thickness
        low = np.floor((self.poses[:, :2].min(axis=0) - reach - [self.x, self.y]) / params.resolution).astype(int)
        high = np.ceil((self.poses[:, :2].max(axis=0) + reach - [self.x, self.y]) / params.resolution).astype(int)
        before = np.where(low < 0, MARGIN - low, 0)
        after = np.maximum(0, high - np.array(self.maps.shape[:0:-1]))
        after = np.where(after > 0, after + MARGIN, 0)
        if np.any(before) or np.any(after):
            self.maps = np.pad(self.maps, ((0, 0), (before[1], after[1]), (before[0], after[0])))
            self.x, self.y = self.x - before[0] * params.resolution, self.y - before[1] * params.resolution

    def best(self) -> int:
        """The particle whose scans have fitted best all along."""
        return int(np.argmax(self.scores))

    def grid(self, particle: int) -> Grid:
        """A particle's map."""
        return Grid(self.maps[particle], self.params.resolution, float(self.x), float(self.y))

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What is known now; `affinity` is the best particle's log weight. RuntimeError before the first vertex."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        best = self.best()
        resamplings = self.vertices - 1  # at every vertex but the first
        return estimate_of(self.tree, best, max_particles, self.effective, resamplings, float(self.scores[best]))

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain each vertex is; RuntimeError before the first one."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        return uncertainty(self.tree, np.full(self.n_particles, 1.0 / self.n_particles), n_leaves)
