"""Refine a path by least squares: odometry's motions against the walls that were seen twice.

`refine` moves n nodes (poses in the plane) so that the motions between them stay likely under the motion model, whose
turn and scale bias are unknowns of all nodes, and wall points that nodes of different visits share fall onto each
other. Nodes may be a path's vertices (`slam.wall_matching.wall_points`) or single laser scans: whatever has points with
normals.

    walls = wall_points(observations)                      # or WallPoints(points, normals, starts) of your own
    chain = Chain.along(odometry)                          # or Chain(motions, travelled)
    refined = refine(poses, chain, walls, motion_params, RefinementParams(range=1.0, gap=20))
    refined.path, refined.cost, refined.pairs

The search is Levenberg's and Marquardt's; points are matched anew in every round. It is deterministic and draws on
nothing but its arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from pydantic import Field

from slam.motion import MotionParams
from slam.odometry_chain import Chain, motion_sigmas, motion_terms, seat_covariances
from slam.params import Params
from slam.pose_covariance import Covariances
from slam.pose_graph import Border, NormalEquations, Terms, descend
from slam.wall_direction import BLUR
from slam.wall_matching import Matching, Nearness, WallMatches, WallPoints

Beat = Callable[[], None]

SHARPNESS = BLUR**-2  # von Mises concentration of four times a wall's direction
PEAK = math.exp(SHARPNESS) / float(np.i0(SHARPNESS))  # density where it is greatest, relative to any direction's

DOUBT = 20.0  # nats by which walls must speak for a square building: ten vertices see the same wall, one tells of it


class RefinementParams(Params):
    """How a path is refined; `rounds = 0` switches it off."""

    rounds: int = Field(default=4, ge=0, le=100)  # points are matched anew in each
    steps: int = Field(default=3, ge=1, le=1000)  # of the search in a round, at most
    range: float = Field(default=0.7, gt=0.0)  # m between nodes whose walls are compared
    visits: int = Field(default=3, ge=1, le=1000)  # earlier visits that a node is compared with, the nearest first
    gap: int = Field(default=8, ge=1)  # nodes that must lie between them, for neighbours share the same readings
    gate: float = Field(default=0.4, gt=0.0)  # m, farther points are not matched in the first round
    last_gate: float = Field(default=0.2, gt=0.0)  # m, nor in the last
    like: float = Field(default=0.9, ge=-1.0, le=1.0)  # cosine between the normals of points that may match
    sigma: float = Field(default=0.2, gt=0.0)  # m of a matched point; large, as the points of a pair err together
    kernel: float = Field(default=0.1, gt=0.0)  # m beyond which a match counts less and less, in the last round
    direction: float = Field(default=0.5, ge=0.0)  # gain of the walls' directions, which neighbours share; 0: off
    outliers: float = Field(default=0.15, gt=0.0, lt=1.0)  # share of nodes whose walls obey no common direction


class Refined(NamedTuple):
    """Path (n, 3), shared unknowns (turn bias, scale bias, building's direction), cost, pairs (k, 2) compared."""

    path: np.ndarray
    shared: np.ndarray
    cost: float
    pairs: np.ndarray


class Source(Protocol):
    """Something that pulls at relative poses: walls seen twice, or loop edges."""

    def terms(self, poses: np.ndarray) -> tuple[float, Terms]:
        """Cost and derivatives at poses (n, 3)."""
        ...


class Problem:
    """What pulls at the nodes: the odometry with its biases, the building's directions, and any other sources.

    Shared unknowns are the odometry's turn bias (rad/m) and scale bias, and the building's direction (rad).
    `directions` (n,) are complex as of `slam.wall_direction`, times their gain; `outliers` is the share of
    nodes that obey none.
    """

    def __init__(
        self, chain: Chain, motion: MotionParams, sources: Sequence[Source], directions: np.ndarray, outliers: float
    ):
        self.chain = chain
        self.sources = sources
        self.directions = directions
        self.outliers = outliers
        self.sigmas = motion_sigmas(chain, motion)
        spreads = np.array([motion.turn_bias, motion.scale_bias, 1e3])
        self.precisions = 1.0 / np.maximum(1e-6, spreads) ** 2

    def start(self, poses: np.ndarray) -> np.ndarray:
        """First values of the shared unknowns (3,)."""
        return np.array([0.0, 0.0, 0.25 * np.angle(np.sum(self.directions * np.exp(4j * poses[:, 2])))])

    def linearize(self, poses: np.ndarray, shared: np.ndarray) -> tuple[float, Terms, Border]:
        """Cost at poses (n, 3) and shared unknowns (3,), and its derivatives."""
        n = len(poses)
        gradients, hessians = np.zeros((n - 1, 3)), np.zeros((n - 1, 3, 3))
        border = Border.zeros(n, shared.size)
        cost = motion_terms(
            poses, self.chain.motions, self.chain.travelled, self.sigmas, shared, gradients, hessians, border.mixed,
            border.gradient, border.hessian,
        )  # fmt: skip
        cost += self.add_prior(shared, border) + self.add_directions(poses, shared, border)
        parts = [Terms(np.arange(n - 1), np.arange(1, n), gradients, hessians)]
        for source in self.sources:
            more, terms = source.terms(poses)
            cost += more
            parts.append(terms)
        return cost, Terms(*(np.concatenate(columns) for columns in zip(*parts, strict=True))), border

    def add_prior(self, shared: np.ndarray, border: Border) -> float:
        """Add the shared unknowns' own spread to the border; its cost."""
        border.gradient[:] += self.precisions * shared
        border.hessian[:] += np.diag(self.precisions)
        return 0.5 * float(np.sum(self.precisions * shared**2))

    def add_directions(self, poses: np.ndarray, shared: np.ndarray, border: Border) -> float:
        """Add how the walls' directions agree with the building's; the cost.

        Walls stand about the building's direction, but for a share of outliers that stand anyhow and are let go. As in
        the filter, a node's log density counts as much as its direction is strong.
        """
        delta = 4.0 * (poses[:, 2] - shared[2]) + np.angle(self.directions)
        gains = np.abs(self.directions)
        obeys = (1.0 - self.outliers) * PEAK * np.exp(SHARPNESS * (np.cos(delta) - 1.0))
        weights = gains * SHARPNESS * obeys / (obeys + self.outliers)
        gradients, hessians = 4.0 * weights * np.sin(delta), 16.0 * weights
        border.pose_gradients[:, 2] += gradients
        border.pose_hessians[:, 2, 2] += hessians
        border.mixed[:, 2, 2] -= hessians
        border.gradient[2] -= np.sum(gradients)
        border.hessian[2, 2] += np.sum(hessians)
        return -float(np.sum(gains * np.log(obeys + self.outliers)))

    def log_density(self, poses: np.ndarray) -> float:
        """How likely poses (n, 3) are, up to a constant, under the best values of the shared unknowns."""
        shared = self.start(poses)
        for _ in range(3):  # Newton: the biases are found at once, the direction nearly
            _, _, border = self.linearize(poses, shared)
            shared = shared - np.linalg.solve(border.hessian, border.gradient)
        return -float(self.linearize(poses, shared)[0])


class Refinement:
    """The problem of one path: `run` it from a guess, ask for `covariances` and how likely a path is.

    `directions` (n,) are complex as of `slam.wall_direction`. They pull only where told to: in a building
    whose walls stand in two directions at right angles, of which a path's `squareness` is the evidence.
    """

    def __init__(
        self,
        chain: Chain,
        walls: WallPoints,
        motion: MotionParams,
        params: RefinementParams,
        directions: np.ndarray | None = None,
    ):
        none = np.zeros(len(chain.travelled), complex)
        seen = none if directions is None else params.direction * directions
        self.params = params
        self.matches = WallMatches(walls)
        self.priors = [Problem(chain, motion, [], pulling, params.outliers) for pulling in (none, seen)]
        self.problems = [Problem(chain, motion, [self.matches], pulling, params.outliers) for pulling in (none, seen)]
        self.problem = self.problems[0]  # that ran last

    def run(
        self, poses: np.ndarray, rounds: int | None = None, beat: Beat = lambda: None, is_square: bool = False
    ) -> Refined:
        """Refine `poses` (n, 3), which are a good guess already, in the last few `rounds` if not in all.

        `beat` is called after each, for those who wait.
        """
        poses = np.array(poses, float)
        self.problem = self.problems[is_square]
        shared, cost, last = self.problem.start(poses), 0.0, self.params.rounds
        for round_ in range(0 if rounds is None else max(0, last - rounds), last):
            self.associate(poses, round_)
            poses, shared, cost = descend(self.problem, poses, shared, self.params.steps)
            beat()
        return Refined(poses, shared, cost, self.matches.pairs)

    def refine(self, poses: np.ndarray, beat: Beat = lambda: None) -> Refined:
        """Refine `poses` (n, 3), which are a good guess already; as square where the building is so, now or then.

        From the guess on: a path that nothing keeps straight drifts onto the walls of the next corridor first.
        `beat` is as of `run`.
        """
        if self.squareness(poses) <= 0.0:
            refined = self.run(poses, None, beat)
            if self.squareness(refined.path) <= 0.0:
                return refined
        return self.run(poses, None, beat, is_square=True)

    def log_density(self, poses: np.ndarray) -> float:
        """How likely the motions of poses (n, 3) are, up to a constant."""
        return self.priors[0].log_density(poses)

    def squareness(self, poses: np.ndarray) -> float:
        """By how much likelier (log) walls along poses (n, 3) stand in two directions at right angles than anyhow.

        Less a doubt, for a building that is nearly square becomes so where a path is bent to make it so.
        """
        return float(self.priors[1].log_density(poses) - self.priors[0].log_density(poses)) - DOUBT

    def associate(self, poses: np.ndarray, round_: int) -> None:
        """Match points at `poses` (n, 3); gates and kernels narrow from the first round to the last."""
        params = self.params
        left = 1.0 - round_ / max(1, params.rounds - 1)
        scale = (params.gate / params.last_gate) ** left
        matching = Matching(params.last_gate * scale, params.like, params.sigma, params.kernel * scale)
        self.matches.associate(poses, Nearness(params.range, params.visits, params.gap), matching)

    def covariances(self, refined: Refined) -> Covariances:
        """How certain the poses of a path are that `run` gave last."""
        _, terms, border = self.problem.linearize(refined.path, refined.shared)
        seats = seat_covariances(refined.path, self.problem.sigmas)
        return Covariances(NormalEquations(refined.path, terms, border), seats)


def refine(
    poses: np.ndarray,
    chain: Chain,
    walls: WallPoints,
    motion: MotionParams,
    params: RefinementParams,
    directions: np.ndarray | None = None,
) -> Refined:
    """Refine `poses` (n, 3), which are a good guess already; with `directions`, where the building turns out square."""
    return Refinement(chain, walls, motion, params, directions).refine(poses)
