"""Refine a laser's path where it comes back: least squares over scans that see the same walls from two visits.

Scans of neighbouring visits are aligned point-to-line from where the path has them (`slam.scan_matching`). In a
building with many like corners that also succeeds where it must not, so that an alignment counts only if neither scan
sees through the other's walls, and if the odometry can have drifted so far since, or the path need not move for it.
What is left, and the odometry between vertices, are the edges of a pose graph, under a kernel that lets wrong ones go.
Rounds begin wide, for paths that are off by metres, and end narrow. Uses its siblings `scan_agreement`,
`correlative_search`, `scan_matching`, `scan_pairs`, `wall_matching`, which chooses the pairs, `refinement`,
`pose_graph` and `pose_covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from slam.correlative_search import SearchParams, search
from slam.laser_scan import Scan
from slam.params import Params
from slam.pose import between
from slam.pose_covariance import Covariances
from slam.pose_graph import Border, LoopEdges, NormalEquations, Terms, descend
from slam.refinement import Beat
from slam.scan_agreement import AgreementParams
from slam.scan_matching import ScanMatchingParams
from slam.scan_pairs import Share, align_pairs, bound, by_itself, compare_pairs, do_pairs_agree
from slam.wall_matching import near_pairs

SURE = 3.0  # standard deviations of the odometry's drift that ends and walls may be apart
NONE = np.zeros(0)  # of the unknowns that all vertices share
LEAST_TURN = 0.05  # rad that a scan may be turned, however short the way was,
WITNESSES = 12  # earlier scans that tell whether a scan stands right, the nearest first
NARROWEST = 0.2  # and m that it may be moved,
MOST_SEARCHED = 400  # pairs
MOST_TURN = 0.35  # and rad that it may be turned: well below a right angle, by which rooms are alike


class DoubtParams(Params):
    """When loops are looked for once more, and how: as far as the odometry drifts where a laser sees little."""

    share: float = Field(default=0.9, ge=0.0, le=1.0)  # of ends that agree on revisits, below which loops were missed
    turn: float = Field(default=0.02, gt=0.0)  # rad that the odometry may err by between two vertices,
    distance: float = Field(default=0.03, gt=0.0)  # and m
    overlap: float = Field(default=0.1, ge=0.0)  # of the ends, in place of the agreement's
    search: SearchParams = SearchParams(most=2.0, most_turn=0.5)  # around where the path has a pair, at first


class ScanGraphParams(Params):
    """How scans of different visits are compared; `rounds = 0` switches it off."""

    rounds: int = Field(default=4, ge=0, le=100)  # pairs are chosen and aligned anew in each
    steps: int = Field(default=20, ge=1, le=1000)  # of the search in a round, at most
    range: float = Field(default=4.0, gt=0.0)  # m between scans that are aligned in the first round,
    last_range: float = Field(default=1.5, gt=0.0)  # m, and in the last
    gate: float = Field(default=2.0, gt=0.0)  # m between an end and its wall before, at most, at first,
    last_gate: float = Field(default=0.5, gt=0.0)  # m, and in the end
    visits: int = Field(default=6, ge=1, le=1000)  # earlier visits that a scan is compared with, the nearest first
    gap: int = Field(default=20, ge=1)  # vertices that must lie between them
    distance: float = Field(default=0.02, gt=0.0)  # m by which the odometry errs between two vertices,
    turn: float = Field(default=0.005, gt=0.0)  # and rad
    trust: float = Field(default=0.02, gt=0.0, le=1.0)  # in a match's information, for its ends err together
    kernel: float = Field(default=10.0, gt=0.0)  # sigmas from which an edge counts less and less, at first,
    last_kernel: float = Field(default=3.0, gt=0.0)  # and in the end
    matching: ScanMatchingParams = ScanMatchingParams(enough=0.3)  # but for its gate
    agreement: AgreementParams = AgreementParams()
    doubt: DoubtParams = DoubtParams()

    def doubting(self) -> ScanGraphParams:
        """The same with what is believed in doubt."""
        doubt = self.doubt
        agreement = self.agreement.model_copy(update={"overlap": min(doubt.overlap, self.agreement.overlap)})
        errors = {"turn": max(self.turn, doubt.turn), "distance": max(self.distance, doubt.distance)}
        return self.model_copy(update={**errors, "agreement": agreement})


class ScanGraph:
    """The graph of vertices that stand at `odometry` (n, 3) and took `scans`."""

    def __init__(
        self, odometry: np.ndarray, scans: Sequence[Scan], params: ScanGraphParams, share: Share = by_itself,
        in_doubt: bool = False,
    ):  # fmt: skip
        """`share` runs tasks on all threads that there are; `in_doubt` the odometry may have drifted far."""
        self.params = params = params.doubting() if in_doubt else params
        self.in_doubt = in_doubt
        self.scans, self.sheaf, self.odometry, self.share = scans, bound(scans), odometry, share
        n = len(scans)
        motions = between(odometry[:-1], odometry[1:])
        precision = np.diag(np.array([params.distance, params.distance, params.turn]) ** -2.0)
        chain = np.column_stack([np.arange(n - 1), np.arange(1, n)])
        self.chain = LoopEdges(chain, motions, np.tile(precision, (n - 1, 1, 1)))
        self.ways = np.concatenate([[0.0], np.cumsum(np.hypot(motions[:, 0], motions[:, 1]))])
        self.loops = no_edges()

    def refine(self, path: np.ndarray, rounds: int | None = None, beat: Beat = lambda: None) -> np.ndarray:
        """A better path (n, 3), in the last few `rounds` if not in all; `beat` is called now and then."""
        path, last = np.array(path, float), self.params.rounds
        for round_ in range(0 if rounds is None else max(0, last - rounds), last if len(path) > 1 else 0):
            self.associate(path, round_ / max(1, last - 1), beat)
            path, *_ = descend(self, path, NONE, self.params.steps)
            beat()
        return path

    def associate(self, path: np.ndarray, done: float, beat: Beat = lambda: None) -> None:
        """Find the loops at a path (n, 3); bounds have narrowed by the share `done` of the rounds."""
        params, odometry = self.params, self.odometry
        reach = params.range * (params.last_range / params.range) ** done
        widest = params.gate * (params.last_gate / params.gate) ** done
        kernel = params.kernel * (params.last_kernel / params.kernel) ** done
        pairs = np.empty((len(path) * params.visits, 2), np.int64)
        pairs = pairs[: near_pairs(path, reach, params.visits, params.gap, pairs)]
        guesses = between(path[pairs[:, 0]], path[pairs[:, 1]])
        off, turned = self.drift(pairs)
        gates = np.minimum(widest, np.maximum(NARROWEST, SURE * off))
        sigmas = np.column_stack([gates, gates, SURE * np.maximum(LEAST_TURN, turned)])
        priors = np.eye(3) / sigmas[:, None] ** 2  # they only bound the search
        if self.in_doubt and done == 0.0:
            guesses = self.searched(pairs, guesses, sigmas / SURE, beat)
        matches = align_pairs(self.sheaf, pairs, guesses, priors, gates, params.matching, self.share, beat)
        drifted = between(between(odometry[pairs[:, 0]], odometry[pairs[:, 1]]), matches.poses)
        # a search may walk from wall to wall, into another of many like cells
        is_near = is_within(between(guesses, matches.poses), NARROWEST) | is_within(drifted, SURE * off)
        rows = np.flatnonzero(is_near & (matches.shares >= params.matching.enough))
        counts = compare_pairs(self.sheaf, pairs[rows], matches.poses[rows], params.agreement, self.share, beat)
        rows = rows[do_pairs_agree(self.sheaf, pairs[rows], counts, params.agreement)]
        precisions = params.trust * (matches.information[rows] - priors[rows]) + 1e-6 * np.eye(3)
        self.loops = LoopEdges(pairs[rows], matches.poses[rows], precisions, kernel)

    def searched(self, pairs: np.ndarray, guesses: np.ndarray, sigmas: np.ndarray, beat: Beat) -> np.ndarray:
        """The likeliest poses (m, 3) of second scans about guesses (m, 3) with deviations `sigmas` (m, 3).

        Of many pairs a part is enough to draw the others after it in the next round.
        """
        found = np.array(guesses)
        within = self.params.doubt.search
        for row in np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), MOST_SEARCHED)).astype(int)):
            first, second = pairs[row]
            found[row] = search(self.scans[second], self.scans[first], guesses[row], sigmas[row], within)
            beat()
        return found

    def drift(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much (m,) m and (m,) rad the odometry errs between vertices `pairs` (m, 2), as its steps add up.

        A turn's error shifts what comes after it, on average by a quarter of the way between them.
        """
        params, roots = self.params, np.sqrt(pairs[:, 1] - pairs[:, 0])
        levers = 0.25 * (self.ways[pairs[:, 1]] - self.ways[pairs[:, 0]])
        return roots * np.hypot(params.distance, params.turn * levers), roots * params.turn

    def linearize(self, poses: np.ndarray, shared: np.ndarray) -> tuple[float, Terms, Border]:
        """Cost at poses (n, 3), which share no unknowns (0,), and its derivatives."""
        parts = [edges.terms(poses) for edges in (self.chain, self.loops)]
        terms = Terms(*(np.concatenate(columns) for columns in zip(*(part[1] for part in parts), strict=True)))
        return sum(part[0] for part in parts), terms, Border.zeros(len(poses), shared.size)

    def agreement_along(self, path: np.ndarray, beat: Beat = lambda: None, gap: int = 1) -> float:
        """The share of ends that agree, of those that speak, over all scans that a path (n, 3) puts near each other.

        `gap` vertices at least lie between them; nan where no end speaks. `beat` is called now and then.
        """
        params = self.params
        pairs = np.empty((len(path) * WITNESSES, 2), np.int64)
        pairs = pairs[: near_pairs(path, params.last_range, WITNESSES, gap, pairs)]
        poses = between(path[pairs[:, 0]], path[pairs[:, 1]])
        agree, through = compare_pairs(self.sheaf, pairs, poses, params.agreement, self.share, beat).sum(axis=(0, 1))
        return float(agree / (agree + through)) if agree + through else math.nan

    def covariances(self, path: np.ndarray) -> Covariances:
        """How certain the poses of a path (n, 3) are that came of the last round."""
        _, terms, border = self.linearize(path, NONE)
        return Covariances(NormalEquations(path, terms, border))


def is_within(moved: np.ndarray, metres: np.ndarray | float) -> np.ndarray:
    """Whether poses (m, 3) are so near, and turned by little."""
    return (np.hypot(moved[:, 0], moved[:, 1]) < metres) & (np.abs(moved[:, 2]) < MOST_TURN)


def no_edges() -> LoopEdges:
    """Of no loop."""
    return LoopEdges(np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))
