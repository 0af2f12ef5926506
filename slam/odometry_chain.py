"""Odometry as terms of a least-squares problem: how likely the motions between consecutive poses are.

The model is that of `slam.motion`: a motion errs in its turn and its length, and both have a bias that all motions
share. Its least squares know a third error, sideways: where on the way the turn's error happened.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.motion import MotionParams
from slam.pose import between

FLOOR = np.array([1e-3, 2e-3, 2e-3])  # rad, m, m: least standard deviations of turn, length and sideways slip


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


def motion_sigmas(chain: Chain, params: MotionParams) -> np.ndarray:
    """(n, 3) standard deviations of the turn (rad), the length and the sideways slip (m) of each motion.

    Sideways a pose is off since it is not known where on the way the turn's error happened: sigma d / sqrt(12).
    """
    root = np.sqrt(chain.travelled)
    turn = np.hypot(params.turn_noise * root, params.rotation_noise * chain.motions[:, 2])
    distance = np.hypot(chain.motions[:, 0], chain.motions[:, 1])
    sigmas = np.stack([turn, params.distance_noise * root, turn * distance / math.sqrt(12.0)], axis=1)
    return np.hypot(sigmas, FLOOR)


def seat_covariances(poses: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """(n, 3, 3) how far poses (n, 3) may stand off the walls seen from there, in the world; `sigmas` as above.

    A node's walls were seen on the way to it and from it, and lie to each other as the odometry had it: a pose errs
    against them about as much as a motion does. Walls that are matched say nothing of it.
    """
    steps = sigmas[1:] ** 2
    squares = 0.5 * (np.concatenate([steps[:1], steps]) + np.concatenate([steps, steps[-1:]]))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    axes = np.zeros((len(poses), 3, 3))  # of which columns are the heading, along it and beside it
    axes[:, 2, 0] = 1.0
    axes[:, 0, 1], axes[:, 1, 1], axes[:, 0, 2], axes[:, 1, 2] = cos, sin, -sin, cos
    return np.einsum("nik,nk,njk->nij", axes, squares, axes)


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
