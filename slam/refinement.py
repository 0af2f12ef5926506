"""Refine a path by least squares: odometry's motions against the walls that were seen twice.

`refine` moves n nodes (poses in the plane) so that the motions between them stay likely under the motion model, whose
turn and scale bias are unknowns of all nodes, and wall points that nearby nodes share fall onto each other. Nodes may
be a path's vertices (`slam.wall_matching.wall_points`) or single laser scans: whatever has points with normals.

    walls = wall_points(observations)                      # or WallPoints(points, normals, starts) of your own
    chain = Chain(motions, travelled)                      # odometry between consecutive nodes
    refined = refine(poses, chain, walls, motion_params, RefinementParams(range=3.0, gap=20))
    refined.path, refined.cost, refined.pairs

The search is Levenberg's and Marquardt's; points are matched anew in every round. It is deterministic and draws on
nothing but its arguments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit
from pydantic import Field

from slam.motion import MotionParams
from slam.params import Params
from slam.pose import between, wrap
from slam.pose_graph import Border, NormalEquations, Terms
from slam.wall_matching import Matching, Nearness, WallMatches, WallPoints

FLOOR = np.array([1e-3, 2e-3, 2e-3])  # rad, m, m: least standard deviations of turn, length and sideways slip


class RefinementParams(Params):
    """How a path is refined; `rounds = 0` switches it off."""

    rounds: int = Field(default=6, ge=0, le=100)  # points are matched anew in each
    steps: int = Field(default=8, ge=1, le=1000)  # of the search in a round, at most
    range: float = Field(default=0.7, gt=0.0)  # m between nodes whose walls are compared
    visits: int = Field(default=3, ge=1, le=1000)  # earlier visits that a node is compared with, the nearest first
    gap: int = Field(default=8, ge=1)  # nodes that must lie between them, for neighbours share the same readings
    gate: float = Field(default=0.4, gt=0.0)  # m, farther points are not matched in the first round
    last_gate: float = Field(default=0.2, gt=0.0)  # m, nor in the last
    like: float = Field(default=0.9, ge=-1.0, le=1.0)  # cosine between the normals of points that may match
    sigma: float = Field(default=0.2, gt=0.0)  # m of a matched point; large, as the points of a pair err together
    kernel: float = Field(default=0.1, gt=0.0)  # m beyond which a match counts less and less, in the last round
    direction: float = Field(default=2.0, ge=0.0)  # gain of the walls' directions; 0 switches them off
    outliers: float = Field(default=0.15, gt=0.0, lt=1.0)  # share of nodes whose walls obey no common direction


class Chain(NamedTuple):
    """Odometry between consecutive nodes: row v holds the motion (3,) from node v - 1 to v and the metres travelled.

    Row 0 means nothing.
    """

    motions: np.ndarray
    travelled: np.ndarray

    @classmethod
    def along(cls, odometry: np.ndarray, travelled: np.ndarray | None = None) -> Chain:
        """From poses (n, 3) in the odometry frame."""
        motions = np.zeros((len(odometry), 3))
        motions[1:] = between(odometry[:-1], odometry[1:])
        return cls(motions, np.hypot(motions[:, 0], motions[:, 1]) if travelled is None else np.asarray(travelled))


class Refined(NamedTuple):
    """Path (n, 3), shared unknowns (turn bias, scale bias, building's direction), cost, pairs (k, 2) compared."""

    path: np.ndarray
    shared: np.ndarray
    cost: float
    pairs: np.ndarray


def motion_sigmas(chain: Chain, params: MotionParams) -> np.ndarray:
    """(n, 3) standard deviations of the turn (rad), the length and the sideways slip (m) of each motion.

    Sideways a pose is off since it is not known where on the way the turn's error happened: sigma d / sqrt(12).
    """
    root = np.sqrt(chain.travelled)
    turn = np.hypot(params.turn_noise * root, params.rotation_noise * chain.motions[:, 2])
    distance = np.hypot(chain.motions[:, 0], chain.motions[:, 1])
    sigmas = np.stack([turn, params.distance_noise * root, turn * distance / math.sqrt(12.0)], axis=1)
    return np.hypot(sigmas, FLOOR)


@njit(cache=True)
def motion_terms(poses, motions, travelled, sigmas, biases, gradients, hessians, mixed, shared_gradient, shared):
    """Derivatives of the motions' cost by relative poses (n - 1, 3), (n - 1, 3, 3), and with the biases; the cost.

    The residual is the correction of turn, length and slip in standard deviations, less what the biases explain; half
    of the turn's error acts before the translation, as in `slam.motion.moved_pose`. `mixed` (n, 3, 2) gets the second
    derivatives by a world pose and a bias, `shared_gradient` (2,) and `shared` (2, 2) those by the biases alone.
    """
    cost = 0.0
    jacobian = np.zeros((3, 3))
    by_bias = np.zeros((3, 2))
    residual = np.empty(3)
    for v in range(1, poses.shape[0]):
        cos, sin = math.cos(poses[v - 1, 2]), math.sin(poses[v - 1, 2])
        dx, dy = poses[v, 0] - poses[v - 1, 0], poses[v, 1] - poses[v - 1, 1]
        x, y = cos * dx + sin * dy, cos * dy - sin * dx
        turn = poses[v, 2] - poses[v - 1, 2] - motions[v, 2]
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        distance = math.hypot(motions[v, 0], motions[v, 1])
        heading = 0.5 * turn + (math.atan2(motions[v, 1], motions[v, 0]) if distance > 1e-9 else 0.0)
        ahead_x, ahead_y = math.cos(heading), math.sin(heading)
        along, aside = x * ahead_x + y * ahead_y, y * ahead_x - x * ahead_y
        residual[0] = (turn - biases[0] * travelled[v]) / sigmas[v, 0]
        residual[1] = (along - distance * (1.0 + biases[1])) / sigmas[v, 1]
        residual[2] = aside / sigmas[v, 2]
        jacobian[0, 2] = 1.0 / sigmas[v, 0]
        jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = (
            ahead_x / sigmas[v, 1], ahead_y / sigmas[v, 1], 0.5 * aside / sigmas[v, 1],
        )  # fmt: skip
        jacobian[2, 0], jacobian[2, 1], jacobian[2, 2] = (
            -ahead_y / sigmas[v, 2], ahead_x / sigmas[v, 2], -0.5 * along / sigmas[v, 2],
        )  # fmt: skip
        by_bias[0, 0], by_bias[1, 1] = -travelled[v] / sigmas[v, 0], -distance / sigmas[v, 1]
        for m in range(3):
            cost += 0.5 * residual[m] ** 2
            for r in range(3):
                gradients[v - 1, r] += jacobian[m, r] * residual[m]
                for c in range(3):
                    hessians[v - 1, r, c] += jacobian[m, r] * jacobian[m, c]
            for g in range(2):
                shared_gradient[g] += by_bias[m, g] * residual[m]
                shared[g, g] += by_bias[m, g] ** 2
        for g in range(2):  # row g of the residual is the only one that bias g moves
            px, py, pt = jacobian[g, 0] * by_bias[g, g], jacobian[g, 1] * by_bias[g, g], jacobian[g, 2] * by_bias[g, g]
            wx, wy = cos * px - sin * py, sin * px + cos * py
            mixed[v, 0, g] += wx
            mixed[v, 1, g] += wy
            mixed[v, 2, g] += pt
            mixed[v - 1, 0, g] -= wx
            mixed[v - 1, 1, g] -= wy
            mixed[v - 1, 2, g] += px * y - py * x - pt
    return cost


class Source(Protocol):
    """Something that pulls at relative poses: walls seen twice, or loop edges."""

    def terms(self, poses: np.ndarray) -> tuple[float, Terms]:
        """Cost and derivatives at poses (n, 3)."""
        ...


class Problem:
    """What pulls at the nodes: the odometry with its biases, the building's directions, and any other sources.

    Shared unknowns are the odometry's turn bias (rad/m) and scale bias, and the building's direction (rad).
    `directions` (n,) are complex as of `slam.affinity.wall_direction`, times their gain; `outliers` is the share of
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

        A node's log density is that of the filter: a share 1 - outliers of exp(k cos 4 delta) and the rest of a
        constant, so that what obeys no common direction is let go.
        """
        delta = 4.0 * (poses[:, 2] - shared[2]) + np.angle(self.directions)
        sharpness = np.abs(self.directions)
        obeys = (1.0 - self.outliers) * np.exp(sharpness * (np.cos(delta) - 1.0))
        strays = self.outliers * np.exp(-sharpness)
        weights = sharpness * obeys / (obeys + strays)
        gradients, hessians = 4.0 * weights * np.sin(delta), 16.0 * weights
        border.pose_gradients[:, 2] += gradients
        border.pose_hessians[:, 2, 2] += hessians
        border.mixed[:, 2, 2] -= hessians
        border.gradient[2] -= np.sum(gradients)
        border.hessian[2, 2] += np.sum(hessians)
        return -float(np.sum(np.log(obeys + strays)))


def refine(
    poses: np.ndarray,
    chain: Chain,
    walls: WallPoints,
    motion: MotionParams,
    params: RefinementParams,
    directions: np.ndarray | None = None,
) -> Refined:
    """Refine `poses` (n, 3), which are a good guess already; `directions` (n,) as of `slam.affinity.wall_direction`."""
    poses = np.array(poses, float)
    seen = np.zeros(len(poses), complex) if directions is None else params.direction * directions
    matches = WallMatches(walls)
    problem = Problem(chain, motion, [matches], seen, params.outliers)
    shared, cost = problem.start(poses), 0.0
    nearness = Nearness(params.range, params.visits, params.gap)
    for round_ in range(params.rounds if len(poses) > 1 else 0):
        matches.associate(poses, nearness, matching_of(params, round_))
        poses, shared, cost = descend(problem, poses, shared, params.steps)
    return Refined(poses, shared, cost, matches.pairs)


def matching_of(params: RefinementParams, round_: int) -> Matching:
    """Gates and kernels narrow from the first round to the last."""
    left = 1.0 - round_ / max(1, params.rounds - 1)
    scale = (params.gate / params.last_gate) ** left
    return Matching(params.last_gate * scale, params.like, params.sigma, params.kernel * scale)


def descend(
    problem: Problem, poses: np.ndarray, shared: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Poses (n, 3), shared unknowns and cost after at most `steps` of Levenberg and Marquardt.

    Damping grows after a step that did not help and shrinks after one that did; the cost never rises.
    """
    damping = 1e-6
    cost, terms, border = problem.linearize(poses, shared)
    for _ in range(steps):
        moved, change = NormalEquations(poses, terms, border).step(damping)
        trial = poses + moved
        trial[:, 2] = wrap(trial[:, 2])
        found, terms_there, border_there = problem.linearize(trial, shared + change)
        if not found < cost:
            damping = max(1e-3, damping) * 10.0
            continue
        gain = cost - found
        poses, shared, cost, terms, border = trial, shared + change, found, terms_there, border_there
        damping *= 0.1
        if gain < 1e-4 * cost:
            break
    return poses, shared, cost
