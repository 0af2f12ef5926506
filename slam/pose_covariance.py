"""How certain the poses of a pose graph are: covariances from the factor of its normal equations, without an inverse.

Marginal covariances need those entries of the inverse only where the factor has any, and Takahashi's recursion
(Takahashi, Fagan and Chin 1973) finds them from the last column back. What all nodes share (biases) adds to them by
Schur's complement. Directions that nothing measures, such as along a bare corridor, come out long.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slam.pose_graph import NormalEquations, relative_jacobians


@njit(cache=True)
def entry(starts, rows, values, row, column):
    """Entry of the symmetric inverse; nan where the factor has none."""
    if row < column:
        row, column = column, row
    low, high = starts[column], starts[column + 1]
    while low < high:
        middle = (low + high) // 2
        if rows[middle] < row:
            low = middle + 1
        else:
            high = middle
    return values[low] if low < starts[column + 1] and rows[low] == row else np.nan


@njit(cache=True)
def takahashi(starts, rows, factor, pivots, inverse):
    """Fill `inverse` (m,) with (L D L')^-1 where L, compressed by columns with its unit diagonal first, has entries.

    `pivots` (n,) is D. An entry that the recursion needs but L lacks makes the result nan.
    """
    for column in range(pivots.size - 1, -1, -1):
        low, high = starts[column], starts[column + 1]
        for at in range(high - 1, low - 1, -1):
            total = 1.0 / pivots[column] if at == low else 0.0
            for k in range(low + 1, high):
                total -= factor[k] * entry(starts, rows, inverse, rows[at], rows[k])
            inverse[at] = total


@njit(cache=True)
def diagonal_blocks(starts, rows, inverse, places, blocks):
    """Fill `blocks` (n, 3, 3) of the inverse, unknown i standing at row places[i] of the factor."""
    for node in range(blocks.shape[0]):
        for r in range(3):
            for c in range(3):
                blocks[node, r, c] = entry(starts, rows, inverse, places[3 * node + r], places[3 * node + c])


@njit(cache=True)
def relative_covariances(poses, viewer, own, theirs, mixed, covariances):
    """Fill `covariances` (n, 3, 3) of all poses as seen from node `viewer`.

    `own` (3, 3) is the viewer's covariance, `theirs` (n, 3, 3) the others', `mixed` (n, 3, 3) theirs with the viewer's.
    """
    by_a, by_b = np.empty((3, 3)), np.empty((3, 3))
    for node in range(poses.shape[0]):
        relative_jacobians(poses[viewer], poses[node], by_a, by_b)
        for r in range(3):
            for c in range(3):
                total = 0.0
                for m in range(3):
                    for q in range(3):
                        total += by_a[r, m] * own[m, q] * by_a[c, q] + by_b[r, m] * theirs[node, m, q] * by_b[c, q]
                        total += by_b[r, m] * mixed[node, m, q] * by_a[c, q]
                        total += by_a[r, m] * mixed[node, q, m] * by_b[c, q]
                covariances[node, r, c] = total


class Covariances:
    """Covariances (x, y, theta in the world) of the poses at which the normal equations were made.

    Node 0, which stands still there, has none, but for `seats` (n, 3, 3): an error of each pose by itself that no
    equation knows of.
    """

    def __init__(self, equations: NormalEquations, seats: np.ndarray | None = None):
        self.poses = equations.poses
        self.seats = np.zeros((len(self.poses), 3, 3)) if seats is None else seats
        self.factor = equations.factor()
        self.against = self.factor.solve(equations.mixed)  # A^-1 B
        complement = equations.border.hessian - equations.mixed.T @ self.against
        self.shared = np.linalg.inv(complement)  # covariance of what all nodes share

    def marginals(self) -> np.ndarray:
        """(n, 3, 3) covariance of each pose."""
        lower = self.factor.L.tocsc()
        lower.sort_indices()
        inverse = np.full(lower.nnz, np.nan)
        takahashi(lower.indptr, lower.indices, lower.data, self.factor.U.diagonal(), inverse)
        blocks = np.zeros((len(self.poses), 3, 3))
        diagonal_blocks(lower.indptr, lower.indices, inverse, self.factor.perm_r, blocks[1:])
        against = self.against.reshape(len(self.poses) - 1, 3, self.shared.shape[0])
        blocks[1:] += np.einsum("nig,gh,njh->nij", against, self.shared, against)
        return blocks + self.seats

    def with_node(self, node: int) -> np.ndarray:
        """(n, 3, 3) covariances between each pose (rows) and that of one node (columns)."""
        blocks = np.zeros((len(self.poses), 3, 3))
        blocks[node] = self.seats[node]
        if node == 0:
            return blocks
        rows = slice(3 * (node - 1), 3 * node)
        unit = np.zeros((self.against.shape[0], 3))
        unit[rows] = np.eye(3)
        columns = self.factor.solve(unit) + self.against @ self.shared @ self.against[rows].T
        blocks[1:] += columns.reshape(-1, 3, 3)
        return blocks

    def seen_from(self, viewer: int, marginals: np.ndarray) -> np.ndarray:
        """(n, 3, 3) covariance of each pose in the frame of node `viewer`, given all marginals."""
        covariances = np.empty_like(marginals)
        relative_covariances(
            self.poses, viewer, marginals[viewer], marginals, self.with_node(viewer), covariances
        )  # fmt: skip
        return covariances
