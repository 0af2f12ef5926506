"""A path filter whose estimate is its best path refined, so that the map people see is the refined one.

The filter itself goes on undisturbed, except that the island whose refined path scores best is the one that is told.
`refine` may take a second for a thousand vertices and island, and is called when there is time for it; `estimate` costs
nothing more than the filter's, and hangs vertices that came since on the refined path's end. Uses its siblings
`islands`, `local_search`, `path_filter` and `refinement`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slam.comparison import path_affinity
from slam.islands import Islands
from slam.local_search import LocalSearch
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.path_filter import PathEstimate, PathFilter, PathFilterParams
from slam.pose import between, compose
from slam.pose_covariance import Covariances
from slam.refinement import Beat, Refinement, RefinementParams
from slam.uncertainty import Uncertainty
from slam.wall_matching import WallPoints, wall_points
from slam.walls import Walls

JUMP = 0.3  # m by which the filter's best path must differ from the one refined last for a fresh start
SHARE = 0.05  # of the vertices that may come before it is due again


class Correction(NamedTuple):
    """The filter's path (m, 3) that was refined, what became of it, and how certain that is.

    `spread` and `revisit_spread` (m,) are as in `Uncertainty`.
    """

    before: np.ndarray
    after: np.ndarray
    covariances: Covariances
    spread: np.ndarray
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
        self.odometry: list[np.ndarray] = []
        self.travelled: list[float] = []
        self.points: list[WallPoints] = []
        self.correction: Correction | None = None
        self.n_refined = 0  # vertices that the last refinement knew
        self.is_quick = False  # whether it was a quick one

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
        if self.params.rounds == 0:
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

        A quick one is of the believed island alone, and goes on from the last, in a single round, where the filter
        still thinks alike of the past.
        `beat` is called now and then.
        """
        if not self.is_rough:
            return
        n = self.n_refined = len(self.odometry)
        self.is_quick = is_quick
        plain, squared = self.refinement(is_square=False), self.refinement(is_square=True)
        if is_quick:
            best = self.path_filter.estimate(1).path.astype(float)
            start, rounds = best, None
            if self.correction is not None and is_like(self.correction.before, best):
                start, rounds = self.correction.apply(best, best, np.arange(n)), 1
        else:
            best, start = self.best_of_islands(plain, squared, beat)
            rounds = None
        refinement = squared if squareness(start, plain, squared) > 0.0 else plain
        refined = refinement.run(start, rounds, beat)
        if self.score(refinement, refined.path) <= self.score(refinement, best):
            self.correction = None
            return
        covariances = refinement.covariances(refined)
        marginals = covariances.marginals()
        seen = covariances.seen_from(n - 1, marginals)
        self.correction = Correction(best, refined.path, covariances, spread_of(marginals), spread_of(seen))

    def best_of_islands(self, plain: Refinement, squared: Refinement, beat: Beat) -> tuple[np.ndarray, np.ndarray]:
        """The path (n, 3), and the same refined, of the island whose refined path scores best; it is believed."""
        if not isinstance(self.path_filter, Islands):
            best = self.path_filter.estimate(1).path.astype(float)
            return best, plain.run(best, None, beat).path
        paths = self.path_filter.candidates()
        refined = self.scored(paths, plain, squared, beat)
        best = int(np.argmax([score for score, _ in refined]))
        self.path_filter.believe(best)
        return paths[best], refined[best][1]

    def scored(
        self, paths: list[np.ndarray], plain: Refinement, squared: Refinement, beat: Beat = lambda: None
    ) -> list[tuple[float, np.ndarray]]:
        """What each path (n, 3) scores once refined, and what it has become.

        Whether the building is square is left open: the likelier of both counts.
        """
        refined = [plain.run(path, None, beat).path for path in paths]
        return [(self.score(plain, path) + max(0.0, squareness(path, plain, squared)), path) for path in refined]

    def refinement(self, is_square: bool) -> Refinement:
        """The problem of all vertices so far, with the building's wall directions or without."""
        chain = Chain(Chain.along(np.array(self.odometry)).motions, np.array(self.travelled))
        directions = np.array(self.path_filter.observations.directions) if is_square else None
        return Refinement(chain, joined(self.points), self.motion, self.params, directions)

    def prepare(self) -> None:
        """Compile or load every kernel that `refine` needs, so that its first call takes no longer than others."""
        near = self.path_filter.params.comparison
        small = RefinedFilter(PathFilter(PathFilterParams(particles=8, comparison=near)), self.motion, self.params)
        for step in range(3):
            small.extend(np.array([0.5 * step, 0.0, 0.0]), Walls(np.full(16, 0.8), np.full(16, 0.8)))
        small.refine()

    def score(self, refinement: Refinement, path: np.ndarray) -> float:
        """Affinity and plausibility of a path (n, 3), and of the walls' directions where the problem has them."""
        seen = self.path_filter.observations
        return float(path_affinity(path, 0, seen.seen, seen.rule)) + refinement.prior.log_density(path)

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What is known now, the path as refined last; RuntimeError before the first vertex."""
        now = self.path_filter.estimate(max_particles)
        if self.correction is None:
            return now
        depths = np.arange(len(now.path))
        newest = np.full(len(now.particles), depths[-1])
        return now._replace(
            path=self.correction.apply(now.path, now.path, depths),
            particles=self.correction.apply(now.path, now.particles, newest),
        )

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain the refined path's vertices are, and the tree's branches where they lie about it."""
        now = self.path_filter.uncertainty(n_leaves)
        if self.correction is None:
            return now
        best = self.path_filter.estimate(1).path
        n_new = len(best) - len(self.correction.after)
        branches = now.branches
        if branches is not None:
            branches = branches._replace(poses=self.correction.apply(best, branches.poses, branches.depths))
        return Uncertainty(
            np.pad(self.correction.spread, (0, n_new), "edge"),
            np.pad(self.correction.revisit_spread, (0, n_new), "edge"),
            branches,
        )


def squareness(path: np.ndarray, plain: Refinement, squared: Refinement) -> float:
    """By how much likelier (log) walls along a path (n, 3) stand in two directions at right angles than anyhow."""
    return squared.prior.log_density(path) - plain.prior.log_density(path)


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


def spread_of(covariances: np.ndarray) -> np.ndarray:
    """Root of the trace (n,) in m of the places' covariances, given (n, 3, 3)."""
    return np.sqrt(np.maximum(covariances[:, 0, 0] + covariances[:, 1, 1], 0.0))
