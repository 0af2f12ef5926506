"""Greedy local search over one path (Crunch thesis, 2.6): perturb, evaluate, keep what is better.

The path is its corrections to the odometry, two per vertex: angle and distance, in standard deviations of the motion
model. Likelihood is the plausibility of the corrections plus the affinity of the map with itself (2.4). A set number of
perturbations is tried at every vertex, so that the same input gives the same path whatever the machine's speed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.comparison import ComparisonParams, Observations, path_affinity
from slam.counter_random import gaussian, uniform
from slam.motion import MotionParams, moved_pose, step_of
from slam.params import Params
from slam.path_filter import PathEstimate, checked_pose
from slam.pose import between
from slam.uncertainty import NOT_KNOWN, Uncertainty
from slam.walls import Walls

WHERE, SIZE, ANGLE_STEP, DISTANCE_STEP = 16, 17, 18, 19  # streams of random numbers, apart from the filter's


class LocalSearchParams(Params):
    """How long the search tries, and how boldly."""

    perturbations: int = Field(default=100, ge=0, le=10_000)  # tried after each new vertex
    smallest: float = Field(
        default=0.05, gt=0.0
    )  # standard deviations of a perturbation, drawn log-uniformly between these
    largest: float = Field(default=2.0, gt=0.0)
    reach: float = Field(default=1.0, gt=0.0)  # m, how far the walls were looked for: the local map's
    motion: MotionParams = MotionParams()
    comparison: ComparisonParams = ComparisonParams()


@njit(cache=True)
def place_path(poses, first, motions, travelled, corrections, noise):
    """Recompute `poses` (n, 3) from vertex `first` on, from motions (n, 3), distances (n,) and corrections (n, 2)."""
    for vertex in range(max(first, 1), poses.shape[0]):
        x, y, theta = moved_pose(
            poses[vertex - 1, 0], poses[vertex - 1, 1], poses[vertex - 1, 2],
            step_of(motions[vertex], travelled[vertex], noise),
            corrections[vertex, 0], corrections[vertex, 1], 0.0, 0.0,
        )  # fmt: skip
        poses[vertex, 0], poses[vertex, 1], poses[vertex, 2] = x, y, theta


@njit(cache=True, nogil=True)
def search(poses, motions, travelled, corrections, noise, seen, rule, tries, sizes, seed):
    """Improve `corrections` and `poses` in place; how many of the perturbations `tries` (first, end) were kept."""
    n = poses.shape[0]
    trial = poses.copy()
    kept = 0
    for attempt in range(tries[0], tries[1]):
        vertex = 1 + int(uniform(seed, n, attempt, WHERE) * (n - 1))
        size = sizes[0] * (sizes[1] / sizes[0]) ** uniform(seed, n, attempt, SIZE)
        old_angle, old_distance = corrections[vertex, 0], corrections[vertex, 1]
        angle = old_angle + size * gaussian(seed, n, attempt, ANGLE_STEP)
        distance = old_distance + size * gaussian(seed, n, attempt, DISTANCE_STEP)
        gain = 0.5 * (old_angle**2 + old_distance**2 - angle**2 - distance**2)
        corrections[vertex, 0], corrections[vertex, 1] = angle, distance
        place_path(trial, vertex, motions, travelled, corrections, noise)
        gain += path_affinity(trial, vertex, seen, rule)
        gain -= path_affinity(poses, vertex, seen, rule)
        if gain > 0.0:
            poses[vertex:] = trial[vertex:]
            kept += 1
        else:
            corrections[vertex, 0], corrections[vertex, 1] = old_angle, old_distance
            trial[vertex:] = poses[vertex:]
    return kept


class LocalSearch:
    """One path, searched a little after every vertex; the same face as the path filter."""

    def __init__(self, params: LocalSearchParams, seed: int = 0):
        motion = params.motion
        self.params = params
        self.seed = seed
        self.noise = np.array([motion.turn_noise, motion.distance_noise, motion.rotation_noise])
        self.sizes = np.array([params.smallest, params.largest])
        self.observations = Observations(params.comparison, params.reach)
        self.odometry = np.zeros(3)
        self.poses = np.empty((0, 3))
        self.motions = np.empty((0, 3))
        self.travelled = np.empty(0)
        self.corrections = np.empty((0, 2))
        self.accepted = 0
        self.tried = 0  # perturbations since the newest vertex

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Add a vertex at `pose` (3,) of the odometry frame, `travelled` m after the last one, and search.

        ValueError for a pose or way that is no number, or a way back in time; nothing is added then.
        """
        pose = checked_pose(len(self.poses), pose, travelled)
        self.observations.add(walls)
        self.tried = 0
        is_first = self.poses.shape[0] == 0
        motion = np.zeros(3) if is_first else between(self.odometry, pose)
        way = math.hypot(motion[0], motion[1]) if travelled is None else travelled
        self.motions = np.vstack([self.motions, motion])
        self.travelled = np.append(self.travelled, way)
        self.corrections = np.vstack([self.corrections, np.zeros(2)])
        self.poses = np.vstack([self.poses, pose])
        self.odometry = pose
        if not is_first:
            place_path(self.poses, len(self.poses) - 1, self.motions, self.travelled, self.corrections, self.noise)
            self.search(self.params.perturbations)

    def search(self, n_tries: int) -> int:
        """Try `n_tries` perturbations; how many were improvements."""
        if len(self.poses) < 2:
            return 0  # there is nothing to correct yet
        seen = self.observations
        kept = search(
            self.poses, self.motions, self.travelled, self.corrections, self.noise, seen.seen, seen.rule,
            (self.tried, self.tried + n_tries), self.sizes, self.seed,
        )  # fmt: skip
        self.tried += n_tries
        self.accepted += kept
        return kept

    @property
    def n_particles(self) -> int:
        """One path."""
        return 1

    def resize(self, n_particles: int) -> None:
        """One path stays one path."""

    def plausibility(self) -> float:
        """Log density of the corrections under the motion model, up to a constant (thesis, 2.4)."""
        return -0.5 * float(np.sum(self.corrections**2))

    def affinity(self) -> float:
        """How well the map agrees with itself."""
        seen = self.observations
        return float(path_affinity(self.poses, 0, seen.seen, seen.rule))

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """One path knows nothing of others."""
        return NOT_KNOWN

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """The path as one particle; RuntimeError before the first vertex."""
        n = len(self.poses)
        if n == 0:
            raise RuntimeError("the search has seen no vertex yet")
        return PathEstimate(
            self.poses.copy(), np.ones(n), self.poses[-1:][:max_particles].copy(), n - 1, 1, 1.0, 0,
            self.affinity(), self.plausibility(),
        )  # fmt: skip
