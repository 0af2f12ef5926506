"""Crunch's particle filter over paths (thesis, 2.7): extend, weigh where a path meets itself, resample when needed.

A particle is a whole path. Each new vertex extends all of them by the motion model; where a particle's path comes back
near itself the walls seen there are compared, and the affinity goes into its weight. Maps belong to vertices and are
shared by all particles. Random numbers are functions of the seed, the vertex or the resampling, and the particle, so
that threads change nothing.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.affinity import wall_direction
from slam.comparison import ComparisonParams, Observations, keep_nearest, pair_affinity
from slam.counter_random import uniform
from slam.motion import OFFSET, SCALE_BIAS, SCALE_JITTER, TURN_BIAS, TURN_JITTER, MotionParams, draw_biases, propagate
from slam.params import Params
from slam.path_tree import PathTree, ancestor, attach
from slam.pose import between
from slam.resampling import effective_particles, normalize, systematic
from slam.uncertainty import Uncertainty, uncertainty
from slam.walls import Walls


class DirectionParams(Params):
    """The wall-direction prior: buildings have two wall directions, mostly; where not, the outliers' share rules."""

    gain: float = Field(default=2.0, ge=0.0)  # 0 switches it off
    memory: float = Field(default=0.98, ge=0.0, le=1.0)  # of the particle's own wall directions, per vertex
    outliers: float = Field(default=0.15, ge=0.0, le=1.0)  # share of vertices whose walls obey no common direction


class PathFilterParams(Params):
    """Size of the filter and when it resamples; how paths are extended and compared."""

    particles: int = Field(default=5000, ge=1, le=2_000_000)
    threshold: float = Field(default=0.5, ge=0.0, le=1.0)  # share of effective particles below which it resamples
    reach: float = Field(default=1.0, gt=0.0)  # m, how far the walls were looked for: the local map's
    motion: MotionParams = MotionParams()
    comparison: ComparisonParams = ComparisonParams()
    direction: DirectionParams = DirectionParams()


class PathEstimate(NamedTuple):
    """Best path (v, 3), the tree's profile (v,), some newest poses (m, 3), and the filter's figures."""

    path: np.ndarray
    profile: np.ndarray
    particles: np.ndarray
    fixed_depth: int
    n_particles: int
    effective_particles: float
    resamplings: int
    affinity: float
    plausibility: float


@njit(cache=True, nogil=True)
def weigh(nodes, leaves, runs, labels, segments, rule, low, high, affinities):
    """Affinity of particles low..high's newest vertex with the nearest earlier ones on their own paths.

    `runs` (r, 2) are ranges of depths, deepest first, that may lie near; labels and segments are indexed by depth.
    """
    near = np.empty(rule.neighbours)
    where = np.empty(rule.neighbours, np.int64)
    for p in range(low, high):
        leaf = leaves[p]
        x, y, theta = nodes.poses[leaf, 0], nodes.poses[leaf, 1], nodes.poses[leaf, 2]
        found = 0
        node = leaf
        for run in range(runs.shape[0]):
            node = ancestor(nodes, node, runs[run, 1])
            while node >= 0 and nodes.depth[node] >= runs[run, 0]:
                dx, dy = nodes.poses[node, 0] - x, nodes.poses[node, 1] - y
                square = dx * dx + dy * dy
                if square < rule.range * rule.range:
                    found = keep_nearest(near, where, found, square, node)
                node = nodes.parent[node]
        total = 0.0
        for place in range(found):
            other = where[place]
            total += pair_affinity(
                labels, segments, rule, nodes.depth[leaf], x, y, theta,
                nodes.depth[other], nodes.poses[other, 0], nodes.poses[other, 1], nodes.poses[other, 2],
            )  # fmt: skip
        affinities[p] = total


@njit(cache=True, nogil=True)
def weigh_direction(nodes, leaves, seen, gain, memory, outliers, sums, log_densities):
    """Log density of the walls' direction `seen` (cos, sin of 4 angles, times its strength) under each particle's own.

    `sums` (n, 2) is each particle's running resultant in its world frame; it takes the new direction up.
    """
    strength = math.hypot(seen[0], seen[1])
    for p in range(leaves.size):
        theta = nodes.poses[leaves[p], 2]
        cos, sin = math.cos(4.0 * theta), math.sin(4.0 * theta)
        x, y = cos * seen[0] - sin * seen[1], sin * seen[0] + cos * seen[1]
        length = math.hypot(sums[p, 0], sums[p, 1])
        log_densities[p] = 0.0
        if length > 1e-6 and strength > 0.0:
            sharpness = gain * strength * min(1.0, length)
            agreement = (x * sums[p, 0] + y * sums[p, 1]) / (length * strength)
            log_densities[p] = math.log(
                (1.0 - outliers) * math.exp(sharpness * (agreement - 1.0)) + outliers * math.exp(-sharpness)
            )
        sums[p, 0], sums[p, 1] = memory * sums[p, 0] + x, memory * sums[p, 1] + y


@njit(cache=True, nogil=True)
def attach_all(nodes, fresh, leaves, moved):
    """Hang each particle's fresh node under its leaf at the pose it moved to."""
    for p in range(leaves.size):
        attach(nodes, fresh[p], leaves[p])
        for axis in range(3):
            nodes.poses[fresh[p], axis] = moved[p, axis]


def near_runs(boxes: np.ndarray, newest: np.ndarray, last: int, margin: float) -> np.ndarray:
    """(r, 2) ranges of depths 0..last, deepest first, whose boxes come within `margin` of the box `newest` (4,)."""
    old = boxes[: last + 1]
    apart = np.maximum(old[:, :2] - newest[2:], newest[:2] - old[:, 2:]).clip(min=0.0)
    near = np.flatnonzero(np.hypot(apart[:, 0], apart[:, 1]) <= margin)
    if near.size == 0:
        return np.empty((0, 2), np.int64)
    breaks = np.flatnonzero(np.diff(near) > 1)
    starts = near[np.concatenate([[0], breaks + 1])]
    ends = near[np.concatenate([breaks, [near.size - 1]])]
    return np.stack([starts, ends], axis=1)[::-1].copy()


class PathFilter:
    """The filter: `extend` by a vertex, `estimate` when asked."""

    def __init__(self, params: PathFilterParams, seed: int = 0, threads: int = 1):
        n = params.particles
        motion = params.motion
        self.params = params
        self.seed = seed
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.noise = np.array([motion.turn_noise, motion.distance_noise, motion.rotation_noise])
        self.observations = Observations(params.comparison, params.reach)
        self.vertices = 0
        self.odometry = np.zeros(3)
        self.tree: PathTree | None = None
        self.log_weights = np.zeros(n)
        self.affinities = np.zeros(n)
        self.plausibilities = np.zeros(n)
        self.turn_biases = draw_biases(motion.turn_bias, seed, 0, TURN_BIAS, n)
        self.scale_biases = draw_biases(motion.scale_bias, seed, 0, SCALE_BIAS, n)
        self.directions = np.zeros((n, 2))
        self.effective = float(n)
        self.resamplings = 0

    @property
    def n_particles(self) -> int:
        """How many particles there are now."""
        return self.log_weights.size

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Add a vertex at `pose` (3,) of the odometry frame that saw `walls`, `travelled` m after the last one."""
        self.observations.add(walls)
        if self.tree is None:
            self.tree = PathTree(self.n_particles, np.asarray(pose, float))
        else:
            motion = between(self.odometry, pose)
            self.move(self.tree, motion, float(np.hypot(*motion[:2])) if travelled is None else travelled)
            self.compare(self.tree)
        self.align(self.tree, walls)
        self.odometry = np.array(pose, float)
        self.vertices += 1
        self.resample_if_needed()

    def move(self, tree: PathTree, motion: np.ndarray, travelled: float) -> None:
        """Extend every path by the motion model."""
        fresh = tree.grow()
        moved = np.empty((self.n_particles, 3))
        propagate(
            tree.nodes.poses[tree.leaves], motion, travelled, self.noise, self.turn_biases, self.scale_biases,
            self.seed, self.vertices, moved, self.plausibilities,
        )  # fmt: skip
        attach_all(tree.nodes, fresh, tree.leaves, moved)
        tree.settle(fresh)

    def compare(self, tree: PathTree) -> None:
        """Add the affinity of the newest vertex with earlier ones to the weights."""
        rule, observations = self.observations.rule, self.observations
        last = self.vertices - rule.gap
        if last < 0:
            return
        runs = near_runs(tree.boxes, tree.boxes[self.vertices], last, rule.range)
        if runs.size == 0:
            return
        gained = np.zeros(self.n_particles)
        self.in_parts(
            lambda low, high: weigh(
                tree.nodes, tree.leaves, runs, observations.labels, observations.segments, rule, low, high, gained
            )
        )
        self.log_weights += gained
        self.affinities += gained

    def align(self, tree: PathTree, walls: Walls) -> None:
        """Weigh each particle's heading by the building's dominant wall directions, as far as it has any."""
        direction = self.params.direction
        if direction.gain == 0.0:
            return
        seen = wall_direction(walls)
        gained = np.zeros(self.n_particles)
        weigh_direction(
            tree.nodes, tree.leaves, np.array([seen.real, seen.imag]), direction.gain, direction.memory,
            direction.outliers, self.directions, gained,
        )  # fmt: skip
        self.log_weights += gained
        self.affinities += gained

    def in_parts(self, task) -> None:
        """Run task(low, high) over all particles, on as many threads as there are."""
        if self.pool is None:
            task(0, self.n_particles)
            return
        edges = np.linspace(0, self.n_particles, self.threads + 1).astype(int)
        list(self.pool.map(task, edges[:-1], edges[1:]))

    def resample_if_needed(self) -> None:
        """Resample when the effective particles fall below the threshold (thesis, 2.7)."""
        weights = normalize(self.log_weights)
        self.effective = effective_particles(weights)
        fewest = self.params.threshold * self.n_particles
        if self.effective < fewest * (1.0 - 1e-9):  # 2^H of equal weights may round to a little less than their number
            self.resample(weights, self.n_particles)

    def resample(self, weights: np.ndarray, n_particles: int) -> None:
        """Draw `n_particles` by systematic resampling; biases are jittered so that they can still be learned."""
        motion = self.params.motion
        ancestors = systematic(weights, uniform(self.seed, self.resamplings, 0, OFFSET), n_particles)
        if self.tree is not None:
            self.tree.resample(ancestors)
        self.affinities = self.affinities[ancestors]
        self.plausibilities = self.plausibilities[ancestors]
        self.directions = self.directions[ancestors]
        self.turn_biases = self.turn_biases[ancestors] + draw_biases(
            motion.jitter * motion.turn_bias, self.seed, self.resamplings, TURN_JITTER, n_particles
        )
        self.scale_biases = self.scale_biases[ancestors] + draw_biases(
            motion.jitter * motion.scale_bias, self.seed, self.resamplings, SCALE_JITTER, n_particles
        )
        self.log_weights = np.zeros(n_particles)
        self.resamplings += 1

    def resize(self, n_particles: int) -> None:
        """Change the number of particles, keeping the distribution."""
        if n_particles != self.n_particles:
            self.resample(normalize(self.log_weights), n_particles)
            self.effective = float(n_particles)

    def best(self) -> int:
        """The particle of greatest affinity and plausibility."""
        return int(np.argmax(self.affinities + self.plausibilities))

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain each vertex is; RuntimeError before the first one."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        return uncertainty(self.tree, normalize(self.log_weights), n_leaves)

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What is known now; RuntimeError before the first vertex."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        best = self.best()
        shown = np.linspace(0, self.n_particles - 1, min(max_particles, self.n_particles)).astype(int)
        return PathEstimate(
            self.tree.path(best), self.tree.profile(), self.tree.nodes.poses[self.tree.leaves[shown]].astype(float),
            self.tree.fixed_depth(), self.n_particles, self.effective, self.resamplings,
            float(self.affinities[best]), float(self.plausibilities[best]),
        )  # fmt: skip
