"""Refine a laser's path where it comes back: least squares over scans that see the same walls from two visits.

Scans of neighbouring visits are aligned point-to-line from where the path has them (`slam.scan_matching`). In a
building with many like corners that also succeeds where it must not, so that an alignment counts only if neither scan
sees through the other's walls, and if the odometry can have drifted so far since, or the path need not move for it.
What is left, and the odometry between vertices, are the edges of a pose graph, under a kernel that lets wrong ones go.
Rounds begin wide, for paths that are off by metres, and end narrow. Uses its siblings `scan_agreement`,
`scan_matching`, `wall_matching`, which chooses the pairs, `refinement`, `pose_graph` and `pose_covariance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from slam.laser_scan import Scan
from slam.params import Params
from slam.pose import between
from slam.pose_covariance import Covariances
from slam.pose_graph import Border, LoopEdges, NormalEquations, Terms, descend
from slam.refinement import Beat
from slam.scan_agreement import AgreementParams, do_agree, views_of
from slam.scan_matching import ScanMatchingParams, match_scans
from slam.wall_matching import near_pairs

SURE = 3.0  # standard deviations of the odometry's drift that ends and walls may be apart
NONE = np.zeros(0)  # of the unknowns that all vertices share
LEAST_TURN = 0.05  # rad that a scan may be turned, however short the way was,
WITNESSES = 12  # earlier scans that tell whether a scan stands right, the nearest first
NARROWEST = 0.2  # and m that it may be moved,
MOST_TURN = 0.35  # and rad that it may be turned: well below a right angle, by which rooms are alike


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


class ScanGraph:
    """The graph of vertices that stand at `odometry` (n, 3) and took `scans`."""

    def __init__(self, odometry: np.ndarray, scans: Sequence[Scan], params: ScanGraphParams):
        self.params = params
        self.scans, self.odometry = scans, odometry
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
        found = []
        for row, (first, second) in enumerate(pairs):
            scan, other = self.scans[second], self.scans[first]
            off, turned = self.drift(int(first), int(second))
            gate = min(widest, max(NARROWEST, SURE * off))
            farthest = SURE * max(LEAST_TURN, turned)
            prior = np.diag(np.array([gate, gate, farthest]) ** -2.0)  # it only bounds the search
            matching = params.matching.model_copy(update={"gate": gate})
            match = match_scans(scan, other, guesses[row], prior, matching)
            drifted = between(between(odometry[first], odometry[second]), match.pose)
            if not (is_within(between(guesses[row], match.pose), NARROWEST) or is_within(drifted, SURE * off)):
                continue  # a search may walk from wall to wall, into another of many like cells
            if match.share >= matching.enough and do_agree(scan, other, match.pose, params.agreement):
                found.append((row, match.pose, params.trust * (match.information - prior) + 1e-6 * np.eye(3)))
            if row % 256 == 0:
                beat()
        if not found:
            self.loops = no_edges()
            return
        rows, motions, precisions = (np.array(column) for column in zip(*found, strict=True))
        self.loops = LoopEdges(pairs[rows], motions, precisions, kernel)

    def drift(self, first: int, second: int) -> tuple[float, float]:
        """By how much (m, rad) the odometry errs between two vertices, as its steps add up.

        A turn's error shifts what comes after it, on average by a quarter of the way between them.
        """
        params, root = self.params, math.sqrt(second - first)
        lever = 0.25 * float(self.ways[second] - self.ways[first])
        return root * math.hypot(params.distance, params.turn * lever), root * params.turn

    def linearize(self, poses: np.ndarray, shared: np.ndarray) -> tuple[float, Terms, Border]:
        """Cost at poses (n, 3), which share no unknowns (0,), and its derivatives."""
        parts = [edges.terms(poses) for edges in (self.chain, self.loops)]
        terms = Terms(*(np.concatenate(columns) for columns in zip(*(part[1] for part in parts), strict=True)))
        return sum(part[0] for part in parts), terms, Border.zeros(len(poses), shared.size)

    def agreement_along(self, path: np.ndarray, beat: Beat = lambda: None) -> float:
        """The share of ends that agree, of those that speak, over all scans that a path (n, 3) puts near each other.

        `beat` is called now and then.
        """
        params = self.params
        pairs = np.empty((len(path) * WITNESSES, 2), np.int64)
        pairs = pairs[: near_pairs(path, params.last_range, WITNESSES, 1, pairs)]
        agree, through = 0, 0
        for row, (first, second) in enumerate(pairs):
            if row % 256 == 0:
                beat()
            pose = between(path[first], path[second])
            for counts in views_of(self.scans[second], self.scans[first], pose, params.agreement):
                agree, through = agree + counts[0], through + counts[1]
        return agree / max(1, agree + through)

    def covariances(self, path: np.ndarray) -> Covariances:
        """How certain the poses of a path (n, 3) are that came of the last round."""
        _, terms, border = self.linearize(path, NONE)
        return Covariances(NormalEquations(path, terms, border))


def is_within(moved: np.ndarray, metres: float) -> bool:
    """Whether a pose (3,) is so near, and turned by little."""
    return math.hypot(moved[0], moved[1]) < metres and abs(moved[2]) < MOST_TURN


def no_edges() -> LoopEdges:
    """Of no loop."""
    return LoopEdges(np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))
