"""A path filter whose estimate is its best path refined, so that the map people see is the refined one.

The filter itself goes on undisturbed, except that the island whose refined path scores best is the one that is told.
`refine` may take a few seconds for a thousand vertices, and is called when there is time for it; `estimate` costs
nothing more than the filter's, and hangs vertices that came since on the refined path's end. Uses its siblings
`islands`, `local_search`, `path_filter` and `refinement`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slam.comparison import path_affinity
from slam.hypotheses import Hypothesis
from slam.islands import Islands
from slam.local_search import LocalSearch, LocalSearchParams
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.path_filter import PathEstimate, PathFilter
from slam.path_tree import STRIDE
from slam.pose import between, compose
from slam.pose_covariance import Covariances
from slam.refinement import Beat, Refined, Refinement, RefinementParams
from slam.uncertainty import Uncertainty, deviations_of, spread_of
from slam.wall_matching import WallPoints, wall_points
from slam.walls import Walls

JUMP = 0.3  # m by which the filter's best path must differ from the one refined last for a fresh start
SHARE = 0.05  # of the vertices that may come before it is due again
CHALLENGERS = 3  # islands that a quick refinement compares with the believed one


class Correction(NamedTuple):
    """The filter's path (m, 3) that was refined, what became of it, and how certain that is.

    `deviations` (m, 3) and `revisit_spread` (m,) are as in `Uncertainty`.
    """

    before: np.ndarray
    after: np.ndarray
    covariances: Covariances
    deviations: np.ndarray
    revisit_spread: np.ndarray

    def apply(self, best: np.ndarray, poses: np.ndarray, depths: np.ndarray) -> np.ndarray:
        """Poses (k, 3) of vertices `depths` (k,), moved as the filter's best path (n, 3) is moved at these vertices."""
        known = np.minimum(depths, len(self.after) - 1)
        return compose(self.after[known], between(best[known], poses))


class RefinedFilter:
    """Extends a filter, or a local search, by `refine`; the rest of its face stays the same."""

    def __init__(self, path_filter: Islands | PathFilter | LocalSearch, motion: MotionParams, params: RefinementParams):
        self.path_filter = path_filter
        self.motion = motion
        self.params = params
        n_islands = len(path_filter.filters) if isinstance(path_filter, Islands) else 1
        self.is_idle = params.rounds == 0 and n_islands == 1  # nothing to refine, and no island to choose
        self.odometry: list[np.ndarray] = []
        self.travelled: list[float] = []
        self.points: list[WallPoints] = []
        self.correction: Correction | None = None
        self.hypotheses: list[Hypothesis] = []  # of the islands, as refined last, unless quickly
        self.n_refined = 0  # vertices that the last refinement knew
        self.is_quick = False  # whether it was a quick one
        self.turn = 0  # of the islands that quick ones compare with

    @property
    def n_particles(self) -> int:
        """How many particles there are now."""
        return self.path_filter.n_particles

    def resize(self, n_particles: int) -> None:
        """Go on with another number of particles."""
        self.path_filter.resize(n_particles)

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Add a vertex at `pose` (3,) of the odometry frame that saw `walls`, `travelled` m after the last one."""
        self.path_filter.extend(pose, walls, travelled)
        if self.is_idle:
            return
        moved = np.hypot(*between(self.odometry[-1], pose)[:2]) if self.odometry else 0.0
        self.odometry.append(np.array(pose, float))
        self.travelled.append(float(moved) if travelled is None else travelled)
        self.points.append(wall_points([walls]))

    @property
    def is_rough(self) -> bool:
        """Whether `refine` would tell more than the last refinement did."""
        return len(self.odometry) > max(1, self.n_refined) or self.is_quick

    @property
    def is_due(self) -> bool:
        """Whether enough vertices came since the last refinement that a quick one pays."""
        n = len(self.odometry)
        return self.is_rough and n - self.n_refined > SHARE * n

    def refine(self, is_quick: bool = False, beat: Beat = lambda: None) -> None:
        """Bring the refined path up to date: a function of the vertices alone, whatever was refined before.

        A quick one goes on from the last where the filter still thinks alike of the past, and compares the believed
        island with a few others only, which take turns. `beat` is called now and then.
        """
        if not self.is_rough:
            return
        self.n_refined = len(self.odometry)
        self.is_quick = is_quick
        refinement = self.refinement()
        starts = self.starts(is_quick)
        refined = {island: refinement.refine(path, beat).path for island, path in starts.items()}
        scores = {island: self.score(refinement, path) for island, path in refined.items()}
        best = max(scores, key=scores.__getitem__)
        if not is_quick:
            self.hypotheses = [Hypothesis(scores[island], path) for island, path in refined.items()]
        if isinstance(self.path_filter, Islands):
            self.path_filter.believe(best)
        before = self.path_filter.estimate(1).path.astype(float)
        # once more, for the covariances are of the path that ran last
        after = refinement.run(refined[best], 1, beat, refinement.squareness(refined[best]) > 0.0)
        if self.score(refinement, after.path) <= self.score(refinement, before):
            self.correction = None
            return
        self.correction = correction_of(refinement, before, after)

    def starts(self, is_quick: bool) -> dict[int, np.ndarray]:
        """The paths (n, 3) that are refined, by island."""
        if not isinstance(self.path_filter, Islands):
            believed, starts = 0, {0: self.path_filter.estimate(1).path.astype(float)}
        else:
            believed, paths = self.path_filter.believed, self.path_filter.candidates()
            others = [island for island in range(len(paths)) if island != believed]
            if is_quick and others:
                first = self.turn % len(others)
                others = [*others[first:], *others[:first]][:CHALLENGERS]
                self.turn += CHALLENGERS
            starts = {island: paths[island] for island in (believed, *others)}
        best = starts[believed]
        if is_quick and self.correction is not None and is_like(self.correction.before, best):
            starts[believed] = corrected(self.correction, best)
        return starts

    def refinement(self) -> Refinement:
        """The problem of all vertices so far."""
        chain = Chain(Chain.along(np.array(self.odometry)).motions, np.array(self.travelled))
        directions = np.array(self.path_filter.observations.directions)
        return Refinement(chain, joined(self.points), self.motion, self.params, directions)

    def prepare(self) -> None:
        """Compile or load every kernel that any call needs, so that the first takes no longer than others."""
        small = RefinedFilter(self.rehearsal(), self.motion, self.params)
        small.is_idle = self.is_idle
        for step in range(2 * STRIDE):
            ranges = np.where(np.arange(16) % 4 < 2 + step % 2, 0.8, 0.6)
            small.extend(np.array([0.1 * step, 0.0, 0.0]), Walls(ranges, ranges))
        small.refine()
        if self.params.rounds > 0:  # though it may not have paid
            refinement, path = small.refinement(), small.path_filter.estimate(1).path
            small.correction = correction_of(refinement, path, refinement.run(path))
        small.estimate()
        small.uncertainty(1)

    def rehearsal(self) -> PathFilter | LocalSearch:
        """A small estimator with the kernels of this one's, which compares and resamples at every vertex.

        A single filter has the kernels of all islands once it takes chance off as the measure does that they share.
        """
        params = self.path_filter.params
        chance = self.path_filter.observations.rule.chance
        near = params.comparison.model_copy(update={"gap": 1, "chance": chance})
        if isinstance(params, LocalSearchParams):
            return LocalSearch(params.model_copy(update={"perturbations": 1, "comparison": near}))
        return PathFilter(params.model_copy(update={"particles": 8, "threshold": 1.0, "comparison": near}))

    def score(self, refinement: Refinement, path: np.ndarray) -> float:
        """Affinity and plausibility of a path (n, 3), in a square building or not, whichever is likelier."""
        seen = self.path_filter.observations
        affinity = float(path_affinity(path, 0, seen.seen, seen.rule))
        return affinity + refinement.log_density(path) + max(0.0, refinement.squareness(path))

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What is known now, the path as refined last; RuntimeError before the first vertex."""
        now = self.path_filter.estimate(max_particles)
        return now if self.correction is None else corrected_estimate(self.correction, now)

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain the refined path's vertices are, and the tree's branches where they lie about it."""
        now = self.path_filter.uncertainty(n_leaves)
        if self.correction is None:
            return now
        return corrected_uncertainty(self.correction, now, self.path_filter.estimate(1).path)


def corrected(correction: Correction, path: np.ndarray) -> np.ndarray:
    """The filter's best path (n, 3), as corrected."""
    return correction.apply(path, path, np.arange(len(path)))


def corrected_estimate(correction: Correction, now: PathEstimate) -> PathEstimate:
    """What the filter knows now, its path and particles as corrected."""
    newest = np.full(len(now.particles), len(now.path) - 1)
    return now._replace(
        path=corrected(correction, now.path), particles=correction.apply(now.path, now.particles, newest)
    )


def corrected_uncertainty(correction: Correction, now: Uncertainty, best: np.ndarray) -> Uncertainty:
    """How certain the corrected path's vertices are; the tree's branches move as the filter's best path (n, 3)."""
    n_new = len(best) - len(correction.after)
    branches = now.branches
    if branches is not None:
        branches = branches._replace(poses=correction.apply(best, branches.poses, branches.depths))
    return Uncertainty(
        np.pad(correction.deviations, ((0, n_new), (0, 0)), "edge"),
        np.pad(correction.revisit_spread, (0, n_new), "edge"),
        branches,
        "refinement",
    )


def correction_of(refinement: Refinement, before: np.ndarray, after: Refined) -> Correction:
    """What becomes of the filter's path `before` (n, 3) by the refinement's last run, with its certainty."""
    return correction_by(refinement.covariances(after), before, after.path)


def correction_by(covariances: Covariances, before: np.ndarray, after: np.ndarray) -> Correction:
    """What becomes of the filter's path `before` (n, 3), with the certainty of what did."""
    marginals = covariances.marginals()
    seen = covariances.seen_from(len(before) - 1, marginals)
    return Correction(before, after, covariances, deviations_of(marginals), spread_of(deviations_of(seen)))


def is_like(before: np.ndarray, best: np.ndarray) -> bool:
    """Whether the best path (n, 3) goes where the one before (m, 3) went."""
    apart = best[: len(before), :2] - before[:, :2]
    return float(np.max(np.hypot(apart[:, 0], apart[:, 1]))) < JUMP


def joined(parts: list[WallPoints]) -> WallPoints:
    """The wall points of single nodes as those of all."""
    starts = np.concatenate([[0], np.cumsum([len(part.points) for part in parts])])
    return WallPoints(
        np.concatenate([part.points for part in parts]), np.concatenate([part.normals for part in parts]), starts
    )
