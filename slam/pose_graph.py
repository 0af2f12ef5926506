"""Sparse nonlinear least squares over poses in the plane: normal equations, a damped step, and the descent.

A graph is a list of terms, each a quadratic in the relative pose of two nodes (motions, walls seen twice, loop edges),
and a few unknowns that all nodes share (biases of the odometry, the direction of the building). Node 0 stands still.
The sparse part is factored by SuperLU; the shared unknowns are a dense border, removed by Schur's complement, so that
they do not fill the factor.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit
from scipy import sparse
from scipy.sparse.linalg import splu

from slam.pose import between, wrap

LEAST_GAIN = 1e-4  # of the cost; a step that gains less is the last one of its descent


class Terms(NamedTuple):
    """Quadratics in the pose of node `second` (k,) as seen from node `first` (k,), at the present poses.

    `gradients` (k, 3) and `hessians` (k, 3, 3) are of the cost (half the sum of squares) by that relative pose.
    """

    first: np.ndarray
    second: np.ndarray
    gradients: np.ndarray
    hessians: np.ndarray


class Border(NamedTuple):
    """What the g unknowns add that all nodes share.

    `mixed` (n, 3, g) is the second derivative of the cost by a pose and an unknown, `gradient` (g,) and `hessian`
    (g, g) those by the unknowns alone, `pose_gradients` (n, 3) and `pose_hessians` (n, 3, 3) of terms of one pose.
    """

    mixed: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    pose_gradients: np.ndarray
    pose_hessians: np.ndarray

    @classmethod
    def zeros(cls, n: int, g: int) -> Border:
        """To add to, for n nodes and g shared unknowns."""
        return cls(np.zeros((n, 3, g)), np.zeros(g), np.zeros((g, g)), np.zeros((n, 3)), np.zeros((n, 3, 3)))


class LoopEdges(NamedTuple):
    """Relative poses measured by other means: `motions` (k, 3) of node pairs[:, 1] as seen from node pairs[:, 0].

    `precisions` (k, 3, 3) are inverse covariances; beyond `kernel` standard deviations an edge counts less and less.
    """

    pairs: np.ndarray
    motions: np.ndarray
    precisions: np.ndarray
    kernel: float = math.inf

    def terms(self, poses: np.ndarray) -> tuple[float, Terms]:
        """Cost and derivatives at poses (n, 3), under Geman and McClure's kernel."""
        first, second = self.pairs[:, 0], self.pairs[:, 1]
        seen = between(poses[first], poses[second])
        errors = np.column_stack([seen[:, :2] - self.motions[:, :2], wrap(seen[:, 2] - self.motions[:, 2])])
        pulls = np.einsum("kij,kj->ki", self.precisions, errors)
        squares = np.einsum("ki,ki->k", errors, pulls)
        share = 1.0 / (1.0 + squares / self.kernel**2)
        weights = share**2
        terms = Terms(first, second, weights[:, None] * pulls, weights[:, None, None] * self.precisions)
        return 0.5 * float(np.sum(squares * share)), terms


@njit(cache=True)
def relative_jacobians(pose_a, pose_b, by_a, by_b):
    """Fill `by_a` and `by_b` (3, 3): derivatives of the pose of b as seen from a by the world poses of both."""
    cos, sin = math.cos(pose_a[2]), math.sin(pose_a[2])
    dx, dy = pose_b[0] - pose_a[0], pose_b[1] - pose_a[1]
    by_a[:] = 0.0
    by_b[:] = 0.0
    by_b[0, 0], by_b[0, 1], by_b[1, 0], by_b[1, 1], by_b[2, 2] = cos, sin, -sin, cos, 1.0
    by_a[0, 0], by_a[0, 1], by_a[1, 0], by_a[1, 1], by_a[2, 2] = -cos, -sin, sin, -cos, -1.0
    by_a[0, 2], by_a[1, 2] = cos * dy - sin * dx, -cos * dx - sin * dy


@njit(cache=True)
def assemble(poses, first, second, gradients, hessians, diagonal, off_diagonal, gradient):
    """Add terms to `gradient` (n, 3) and `diagonal` (n, 3, 3); write `off_diagonal` (k, 3, 3), rows by `first`."""
    by_a, by_b = np.empty((3, 3)), np.empty((3, 3))
    for k in range(first.size):
        a, b = first[k], second[k]
        relative_jacobians(poses[a], poses[b], by_a, by_b)
        for r in range(3):
            for m in range(3):
                gradient[a, r] += by_a[m, r] * gradients[k, m]
                gradient[b, r] += by_b[m, r] * gradients[k, m]
            for c in range(3):
                aa, ab, bb = 0.0, 0.0, 0.0
                for m in range(3):
                    left_a, left_b = 0.0, 0.0
                    for q in range(3):
                        left_a += by_a[q, r] * hessians[k, q, m]
                        left_b += by_b[q, r] * hessians[k, q, m]
                    aa += left_a * by_a[m, c]
                    ab += left_a * by_b[m, c]
                    bb += left_b * by_b[m, c]
                diagonal[a, r, c] += aa
                diagonal[b, r, c] += bb
                off_diagonal[k, r, c] = ab


class NormalEquations:
    """The normal equations at some poses (n, 3): `step` solves them."""

    def __init__(self, poses: np.ndarray, terms: Terms, border: Border):
        n = len(poses)
        diagonal, off_diagonal = border.pose_hessians.copy(), np.empty((len(terms.first), 3, 3))
        gradient = border.pose_gradients.copy()
        assemble(poses, terms.first, terms.second, terms.gradients, terms.hessians, diagonal, off_diagonal, gradient)
        n_free = 3 * (n - 1)  # node 0 stands still
        self.poses = poses
        self.border = border
        self.gradient = gradient[1:].reshape(-1)
        self.mixed = border.mixed[1:].reshape(n_free, -1)
        self.matrix = block_matrix(terms.first, terms.second, diagonal, off_diagonal)[3:, 3:]

    def factor(self, damping: float = 0.0):
        """SuperLU's factors of the poses' part, its diagonal grown by a share `damping`.

        Ordered for little fill, and pivoted on the diagonal only, since the matrix is symmetric and positive.
        """
        grown = self.matrix.copy()  # a sum would drop zeros, and with them the symmetry that the order relies on
        grown.setdiag(grown.diagonal() + (damping * grown.diagonal() + 1e-9))
        return splu(grown, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def step(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Change of the poses (n, 3) and of the shared unknowns (g,), with `damping` as a share of the diagonal."""
        against = self.factor(damping).solve(np.column_stack([self.gradient, self.mixed]))
        complement = self.border.hessian - self.mixed.T @ against[:, 1:]
        shared = -np.linalg.solve(complement, self.border.gradient - self.mixed.T @ against[:, 0])
        moved = -against[:, 0] - against[:, 1:] @ shared
        return np.concatenate([np.zeros(3), moved]).reshape(-1, 3), shared


def block_matrix(first, second, diagonal, off_diagonal) -> sparse.csc_array:
    """Symmetric matrix (3n, 3n) of blocks (n, 3, 3) on the diagonal and (k, 3, 3) at (first, second) and back."""
    n = len(diagonal)
    rows = np.concatenate([np.arange(n), first, second])
    columns = np.concatenate([np.arange(n), second, first])
    blocks = np.concatenate([diagonal, off_diagonal, off_diagonal.transpose(0, 2, 1)])
    inner_rows, inner_columns = np.repeat(np.arange(3), 3), np.tile(np.arange(3), 3)
    at = (3 * rows[:, None] + inner_rows).reshape(-1), (3 * columns[:, None] + inner_columns).reshape(-1)
    return sparse.coo_array((blocks.reshape(-1), at), shape=(3 * n, 3 * n)).tocsc()


class LeastSquares(Protocol):
    """What `descend` makes less."""

    def linearize(self, poses: np.ndarray, shared: np.ndarray) -> tuple[float, Terms, Border]:
        """Cost at poses (n, 3) and shared unknowns (g,), and its derivatives."""
        ...


def descend(
    problem: LeastSquares, poses: np.ndarray, shared: np.ndarray, steps: int
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
        if gain < LEAST_GAIN * cost:
            break
    return poses, shared, cost
