"""Crunch's particle filter over paths (thesis, 2.7): extend, weigh where a path meets itself, resample when needed.

A particle is a whole path. Each new vertex extends all of them by the motion model; where a particle's path comes back
near itself the walls seen there are compared, and the affinity goes into its weight. Maps belong to vertices and are
shared by all particles. Random numbers are functions of the seed, the vertex or the resampling, and the particle, so
that threads change nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from slam import resampling
from slam.comparison import ComparisonParams, Observations, rule_of
from slam.counter_random import uniform, vertex_key
from slam.motion import OFFSET, SCALE_BIAS, TURN_BIAS, MotionParams, Step, draw_biases, step_of
from slam.params import Params
from slam.particles import BLOCK, equal_particles, extend, inherit
from slam.path_tree import PathTree
from slam.pose import between
from slam.pose_clusters import Belief
from slam.resampling import exponentials, normalize, systematic
from slam.uncertainty import Uncertainty, uncertainty
from slam.wall_direction import DirectionParams, align
from slam.walls import Walls

Task = Callable[[int, int], None]  # does its work for what lies from one number to another
PARTS = 4  # per thread, so that one that is held up leaves some to the others


class PathFilterParams(Params):
    """Size of the filter and when it resamples; how paths are extended and compared."""

    particles: int = Field(default=40_000, ge=1, le=2_000_000)
    islands: int = Field(default=32, ge=1, le=64)  # filters that never mix (`slam.islands`), of 1,250 particles or more
    beliefs: Literal["several", "one"] = "several"  # whether islands differ in what they hold true (`slam.islands`)
    threshold: float = Field(default=0.5, ge=0.0, le=1.0)  # share of effective particles below which it resamples
    reach: float = Field(default=1.0, gt=0.0)  # m, how far the walls were looked for: the local map's
    motion: MotionParams = MotionParams()
    comparison: ComparisonParams = ComparisonParams()
    direction: DirectionParams = DirectionParams()


class PathEstimate(NamedTuple):
    """Best path (v, 3), the tree's profile (v,), some newest poses (m, 3), and the filter's figures.

    Of an estimator that knows them: in which places the robot may be, and curves (k, 2) of a map that is not what the
    vertices saw.
    """

    path: np.ndarray
    profile: np.ndarray
    particles: np.ndarray
    fixed_depth: int
    n_particles: int
    effective_particles: float
    resamplings: int
    affinity: float
    plausibility: float
    belief: Belief | None = None
    walls: list[np.ndarray] | None = None


def estimate_of(
    tree: PathTree, best: int, max_particles: int, effective: float, resamplings: int, affinity: float,
    plausibility: float = 0.0,
) -> PathEstimate:  # fmt: skip
    """What a tree of paths tells, of which `best` is the best particle; newest poses of `max_particles` at most."""
    n = tree.leaves.size
    shown = np.linspace(0, n - 1, min(max_particles, n)).astype(int)
    return PathEstimate(
        tree.path(best), tree.profile(), tree.newest(shown), tree.fixed_depth(), n, effective, resamplings, affinity,
        plausibility,
    )  # fmt: skip


def checked_pose(vertex: int, pose: np.ndarray, travelled: float | None) -> np.ndarray:
    """A copy of the pose (3,) of a vertex to be, `travelled` m after the last one, before anything is changed for it.

    ValueError for a pose or way that is no number, or a way back in time.
    """
    pose = np.array(pose, float)
    if not np.all(np.isfinite(pose)) or not (travelled is None or 0.0 <= travelled < math.inf):
        raise ValueError(
            f"vertex {vertex}: pose {pose}, {travelled} m travelled: all must be finite, and no way negative"
        )
    return pose


class PathFilter:
    """The filter: `extend` by a vertex, `estimate` when asked."""

    def __init__(self, params: PathFilterParams, seed: int = 0, threads: int = 1, shared: Observations | None = None):
        """`shared` are observations that someone else keeps and adds to before each vertex."""
        n = params.particles
        motion = params.motion
        self.params = params
        self.seed = seed
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.noise = np.array([motion.turn_noise, motion.distance_noise, motion.rotation_noise])
        self.observations = shared or Observations(params.comparison, params.reach)
        self.rule = rule_of(params.comparison, params.reach)
        self.is_sharing = shared is not None
        self.vertices = 0
        self.odometry = np.zeros(3)
        self.tree: PathTree | None = None
        self.particles = equal_particles(
            draw_biases(motion.turn_bias, seed, 0, TURN_BIAS, n), draw_biases(motion.scale_bias, seed, 0, SCALE_BIAS, n)
        )
        self.known_directions = 0.0  # strength of the wall directions that the particles have learned from
        self.weights = np.empty(n)  # the newest, up to a factor
        self.effective = float(n)
        self.resamplings = 0

    @property
    def n_particles(self) -> int:
        """How many particles there are now."""
        return self.particles.log_weights.size

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Add a vertex at `pose` (3,) of the odometry frame that saw `walls`, `travelled` m after the last one.

        ValueError for a pose or way that is no number, or a way back in time.
        """
        pose = checked_pose(self.vertices, pose, travelled)
        if not self.is_sharing:
            self.observations.add(walls)
        if self.tree is None:
            self.tree = PathTree(self.n_particles, pose)
            newest = np.broadcast_to(self.tree.nodes.poses[:1], (self.n_particles, 3))
            self.in_parts(self.n_particles, self.alignment(newest))
        else:
            motion = between(self.odometry, pose)
            way = float(np.hypot(*motion[:2])) if travelled is None else travelled
            self.extend_paths(self.tree, step_of(motion, way, self.noise))
        self.odometry = pose
        self.vertices += 1
        self.resample_if_needed()

    def extend_paths(self, tree: PathTree, step: Step) -> None:
        """Extend every path by the motion model, and weigh it by what the newest vertex saw."""
        start = tree.grow()
        key = np.uint64(vertex_key(self.seed, self.vertices))
        seen, rule = self.observations.seen, self.rule
        align = self.alignment(tree.nodes.poses[start : tree.n_nodes])

        def task(low: int, high: int) -> None:
            extend(tree.nodes, tree.leaves, self.vertices, self.particles, step, key, seen, rule, low, high)
            align(low, high)

        self.in_parts(self.n_particles, task)
        tree.settle()

    def alignment(self, poses: np.ndarray) -> Task:
        """What weighs particles at `poses` (n, 3) by the building's dominant wall directions, as far as it has any."""
        params, seen = self.params.direction, self.observations.directions[-1]
        if params.gain == 0.0:
            return lambda low, high: None
        known = self.known_directions
        if abs(seen) > 0.0:  # a vertex without a direction teaches nothing, and makes nothing be forgotten
            self.known_directions = params.memory * known + abs(seen)
        return lambda low, high: align(
            poses, self.particles, (seen.real, seen.imag), known,
            params.gain, params.memory, params.prior, params.outliers, low, high,
        )  # fmt: skip

    def in_parts(self, n: int, task: Task) -> None:
        """Run task(low, high) over 0..n, on as many threads as there are."""
        if self.pool is None:
            task(0, n)
            return
        size = max(BLOCK, math.ceil(n / (PARTS * self.threads)))
        lows = range(0, n, size)
        list(self.pool.map(task, lows, [min(low + size, n) for low in lows]))

    def resample_if_needed(self) -> None:
        """Resample when the effective particles fall below the threshold (thesis, 2.7)."""
        total = self.weigh()
        fewest = self.params.threshold * self.n_particles
        if self.effective < fewest * (1.0 - 1e-9):  # 2^H of equal weights may round to a little less than their number
            self.resample(self.weights / total, self.n_particles)

    def weigh(self) -> float:
        """Take the weights out of their logarithms; their sum. Finds the effective particles, 2^H (thesis, 2.7)."""
        log_weights = self.particles.log_weights
        greatest = float(log_weights.max())
        if not math.isfinite(greatest):
            raise ValueError(f"log weights must be numbers; the greatest is {greatest}")
        n_blocks = math.ceil(log_weights.size / resampling.BLOCK)
        sums = np.empty((n_blocks, 2))
        self.in_parts(
            n_blocks, lambda low, high: exponentials(log_weights, greatest, self.weights, sums, low, high)
        )  # fmt: skip
        total, weighted = sums.sum(axis=0)
        self.effective = float(total * math.exp(-weighted / total))
        return float(total)

    def resample(self, weights: np.ndarray, n_particles: int) -> None:
        """Draw `n_particles` by systematic resampling; biases are jittered so that they can still be learned."""
        motion = self.params.motion
        ancestors = systematic(weights, uniform(self.seed, self.resamplings, 0, OFFSET), n_particles)
        if self.tree is not None:
            self.tree.resample(ancestors)
        children = equal_particles(np.empty(n_particles), np.empty(n_particles))
        jitters = motion.jitter * motion.turn_bias, motion.jitter * motion.scale_bias
        kept = math.sqrt(1.0 - motion.jitter**2)  # so that biases keep the spread that they have at first
        key, parents = np.uint64(vertex_key(self.seed, self.resamplings)), self.particles
        self.in_parts(
            n_particles, lambda low, high: inherit(parents, ancestors, kept, *jitters, key, children, low, high)
        )  # fmt: skip
        self.particles = children
        if self.weights.size != n_particles:
            self.weights = np.empty(n_particles)
        self.resamplings += 1

    def resize(self, n_particles: int) -> None:
        """Change the number of particles, keeping the distribution; ValueError for none."""
        if n_particles < 1:
            raise ValueError(f"{n_particles} particles: a filter has one at least")
        if n_particles != self.n_particles:
            self.resample(normalize(self.particles.log_weights), n_particles)
            self.effective = float(n_particles)

    def best(self) -> int:
        """The particle of greatest affinity and plausibility."""
        return int(np.argmax(self.particles.affinities + self.particles.plausibilities))

    def best_path(self) -> np.ndarray:
        """Its path (n, 3); RuntimeError before the first vertex."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        return self.tree.path(self.best())

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain each vertex is; RuntimeError before the first one."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        return uncertainty(self.tree, normalize(self.particles.log_weights), n_leaves)

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What is known now; RuntimeError before the first vertex."""
        if self.tree is None:
            raise RuntimeError("the filter has seen no vertex yet")
        best, particles = self.best(), self.particles
        scores = float(particles.affinities[best]), float(particles.plausibilities[best])
        return estimate_of(self.tree, best, max_particles, self.effective, self.resamplings, *scores)
