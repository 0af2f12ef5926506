"""A filter of grids whose estimate is its best path with its loops closed by the scan graph.

The filter itself goes on undisturbed. `refine` takes a second or two for a thousand vertices, and is called when there
is time for it; `estimate` hangs vertices that came since on the refined path's end. Uses its siblings `grid_filter`,
`refined_filter`, for what a correction is, and `scan_graph`.
"""

from __future__ import annotations

import numpy as np

from slam.grid_filter import GridFilter
from slam.path_filter import PathEstimate
from slam.refined_filter import (
    SHARE,
    Correction,
    corrected,
    corrected_estimate,
    corrected_uncertainty,
    correction_by,
)
from slam.refinement import Beat
from slam.scan_graph import ScanGraph, ScanGraphParams, no_edges
from slam.uncertainty import Uncertainty
from slam.walls import Walls

QUICK = 1  # round of a quick refinement
FOLDED = 0.01  # by which the share of ends that agree falls where loops fold a map


class RefinedGridFilter:
    """Extends a filter of grids by `refine`; the rest of its face stays the same."""

    def __init__(self, path_filter: GridFilter, params: ScanGraphParams):
        self.path_filter = path_filter
        self.params = params
        self.odometry: list[np.ndarray] = []
        self.correction: Correction | None = None
        self.n_refined = 0  # vertices that the last refinement knew
        self.is_quick = False  # whether it was a quick one
        self.dropped = 0  # loops that it did not believe, for they would have folded the map

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
        self.odometry.append(np.array(pose, float))

    @property
    def is_rough(self) -> bool:
        """Whether `refine` would tell more than the last refinement did."""
        if self.params.rounds == 0:
            return False
        return len(self.odometry) > max(1, self.n_refined) or self.is_quick

    @property
    def is_due(self) -> bool:
        """Whether enough vertices came since the last refinement that a quick one pays."""
        n = len(self.odometry)
        return self.is_rough and n - self.n_refined > SHARE * n

    def refine(self, is_quick: bool = False, beat: Beat = lambda: None) -> None:
        """Bring the refined path up to date: a function of the vertices alone, whatever was refined before.

        A quick one goes on from the last, and looks for loops once. `beat` is called now and then.
        """
        if not self.is_rough:
            return
        before = self.path_filter.estimate(1).path.astype(float)
        is_fresh = not is_quick or self.correction is None
        start = before if is_fresh or self.correction is None else corrected(self.correction, before)
        graph = self.graph()
        after = self.chosen(graph, graph.refine(start, None if is_fresh else QUICK, beat), before, beat)
        if is_fresh:
            graph, after = self.doubted(graph, after, before, beat)
        self.correction = correction_by(graph.covariances(after), before, after)
        self.n_refined, self.is_quick = len(self.odometry), not is_fresh

    def graph(self, in_doubt: bool = False) -> ScanGraph:
        """The scans along the odometry."""
        return ScanGraph(np.array(self.odometry), self.path_filter.scans, self.params, self.path_filter.share, in_doubt)

    def doubted(
        self, graph: ScanGraph, refined: np.ndarray, filtered: np.ndarray, beat: Beat
    ) -> tuple[ScanGraph, np.ndarray]:
        """Graph and path (n, 3), unless those of a worse odometry lay scans of different visits better upon each other.

        Looking so wide at first would take corridors that are alike for each other. Where too few ends agree, though,
        loops were missed: the laser saw little, and its odometry drifted farther than it does as a rule.
        """
        known = graph.agreement_along(refined, beat, self.params.gap)
        if not known < self.params.doubt.share:
            return graph, refined
        dropped, wide = self.dropped, self.graph(in_doubt=True)
        path = self.chosen(wide, wide.refine(filtered, None, beat), filtered, beat)
        if wide.agreement_along(path, beat, self.params.gap) > known + FOLDED:
            return wide, path
        self.dropped = dropped
        return graph, refined

    def chosen(self, graph: ScanGraph, refined: np.ndarray, filtered: np.ndarray, beat: Beat) -> np.ndarray:
        """The refined path (n, 3), unless its loops fold the map: then the odometry's, or the filter's.

        Loops that agree with one another may all be wrong, where one room is like the next; then scans that the folded
        path puts side by side see through each other's walls, and did not before.
        """
        self.dropped = 0
        if not len(graph.loops.pairs):
            return refined
        ways = (refined, np.array(self.odometry), filtered)
        shares = np.nan_to_num([graph.agreement_along(path, beat) for path in ways])
        best = int(np.argmax(shares))
        if shares[best] - shares[0] < FOLDED:
            return refined
        self.dropped, graph.loops = len(graph.loops.pairs), no_edges()
        return ways[best]

    def prepare(self) -> None:
        """Compile or load every kernel that any call needs, so that the first takes no longer than others."""
        params = self.path_filter.params.model_copy(update={"particles": 2, "threshold": 1.0})
        small = RefinedGridFilter(GridFilter(params), self.params.model_copy(update={"gap": 1}))
        walls = Walls(np.full(64, 1.0), np.full(64, 1.0))
        for step in range(20):
            small.extend(np.array([0.02 * step, 0.0, 0.0]), walls, 0.02)
        small.refine()
        small.estimate()
        small.uncertainty(1)

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
