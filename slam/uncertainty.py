"""How certain each vertex of the path is, by refinement or by the particles, and the path tree's main branches.

What particles say is taken over a systematic sample of them. Moments of the leaves are summed up the path tree, so that
what particles share is computed once. A spread is the root of a place's covariance's trace, in metres.
"""

from __future__ import annotations

import cmath
import math
from typing import Literal, NamedTuple

import numpy as np
from numba import njit

from slam.path_tree import PathTree
from slam.resampling import systematic

SAMPLE = 500  # particles that spreads are taken over, which makes them 3% uncertain
LEAST_LENGTH = 1e-9  # of a mean direction: headings that stand anyhow deviate by 6 rad, not without bound
MIDDLE = 0.5  # offset of systematic samples: no chance is spent on what is only shown


class Branches(NamedTuple):
    """The part of the path tree that some of the particles hang on.

    `poses` is (k, 3) in the world; `parents` (k,) int32 are rows of it, -1 for the root, always smaller than the row
    itself; `depths` (k,) int32 are vertices.
    """

    poses: np.ndarray
    parents: np.ndarray
    depths: np.ndarray


class Uncertainty(NamedTuple):
    """Standard deviations (v, 3) of x, y (m) and heading (rad) of each vertex in the world, which begins at the first.

    `source` says whose they are: the refinement's covariances, or the particles' differences; of "none" there is no
    row. `revisit_spread` (v,) in m is as seen from the newest vertex, `branches` are the tree's main ones.
    """

    deviations: np.ndarray
    revisit_spread: np.ndarray
    branches: Branches | None
    source: Literal["refinement", "particles", "none"]

    @property
    def spread(self) -> np.ndarray:
        """Spread (v,) in m of each vertex in the world."""
        return spread_of(self.deviations)


NOT_KNOWN = Uncertainty(np.zeros((0, 3)), np.zeros(0), None, "none")


def deviations_of(covariances: np.ndarray) -> np.ndarray:
    """Standard deviations (n, 3) of x, y (m) and heading (rad), given covariances (n, 3, 3)."""
    return np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))


def spread_of(deviations: np.ndarray) -> np.ndarray:
    """Spread (n,) in m of places, given their standard deviations (n, 3)."""
    return np.hypot(deviations[:, 0], deviations[:, 1])


@njit(cache=True)
def particle_deviations(nodes, n_levels, leaves, weights):
    """Standard deviations (v, 4) of each vertex: x, y and heading in the world, place as seen from the newest vertices.

    `leaves` (k,) are rows of the newest level, ascending. Places are complex numbers in double precision, for variances
    are small differences of squares. A vertex at p, seen from a leaf (l, theta), lies at exp(-i theta) (p - l); the
    leaves' moments that its mean and variance need do not depend on p, and add up from children to their parent. The
    heading's is the circular standard deviation, sqrt(-2 log |mean of exp(i theta)|).
    """
    deviations = np.zeros((n_levels, 4))
    rows = np.empty(leaves.size, np.int32)  # of the level's nodes on the way of any leaf
    sums = np.zeros((leaves.size, 5), np.complex128)  # of w, w l, w |l|^2, w exp(-i theta), w exp(-i theta) l
    n = 0
    for p in range(leaves.size):
        if p == 0 or leaves[p] != leaves[p - 1]:
            rows[n] = leaves[p]
            n += 1
        node = nodes.starts[n_levels - 1] + leaves[p]
        place = complex(np.float64(nodes.poses[node, 0]), np.float64(nodes.poses[node, 1]))
        turned = weights[p] * cmath.exp(-1j * np.float64(nodes.poses[node, 2]))
        sums[n - 1, 0] += weights[p]
        sums[n - 1, 1] += weights[p] * place
        sums[n - 1, 2] += weights[p] * abs(place) ** 2
        sums[n - 1, 3] += turned
        sums[n - 1, 4] += turned * place
    for level in range(n_levels - 1, -1, -1):
        mean, seen_mean, ahead, square_x, square_y, seen_square = 0j, 0j, 0j, 0.0, 0.0, 0.0
        n_above, last = 0, -1
        for k in range(n):
            node = nodes.starts[level] + rows[k]
            weight = sums[k, 0].real
            place = complex(np.float64(nodes.poses[node, 0]), np.float64(nodes.poses[node, 1]))
            mean += weight * place
            square_x += weight * place.real**2
            square_y += weight * place.imag**2
            ahead += weight * cmath.exp(1j * np.float64(nodes.poses[node, 2]))
            seen_mean += place * sums[k, 3] - sums[k, 4]
            seen_square += weight * abs(place) ** 2 - 2.0 * (place.conjugate() * sums[k, 1]).real + sums[k, 2].real
            parent = nodes.parents[node]
            if k > 0 and parent == last:
                sums[n_above - 1] += sums[k]
            else:
                sums[n_above] = sums[k]
                rows[n_above] = last = parent
                n_above += 1
        deviations[level, 0] = math.sqrt(max(square_x - mean.real**2, 0.0))
        deviations[level, 1] = math.sqrt(max(square_y - mean.imag**2, 0.0))
        deviations[level, 2] = math.sqrt(max(-2.0 * math.log(max(abs(ahead), LEAST_LENGTH)), 0.0))
        deviations[level, 3] = math.sqrt(max(seen_square - abs(seen_mean) ** 2, 0.0))
        n = n_above
    return deviations


def branches(tree: PathTree, weights: np.ndarray, n_leaves: int) -> Branches:
    """The paths of about `n_leaves` particles, drawn systematically by their weights (n_particles,)."""
    rows = np.unique(tree.leaves[systematic(weights, MIDDLE, n_leaves)])
    poses, parents, depths = [], [], []
    for level in range(tree.n_levels - 1, -1, -1):
        nodes = tree.nodes.starts[level] + rows
        rows, above = np.unique(tree.nodes.parents[nodes], return_inverse=True)
        poses.append(tree.nodes.poses[nodes])
        parents.append(above)
        depths.append(np.full(nodes.size, level, np.int32))
    firsts = np.cumsum([0] + [len(level) for level in poses[::-1]])  # row of each level's first node
    offsets = np.concatenate([[0], firsts[:-2]])[::-1]
    rows_above = [above + offset for above, offset in zip(parents, offsets, strict=True)]
    found = np.concatenate(rows_above[::-1]).astype(np.int32)
    found[0] = -1
    return Branches(np.concatenate(poses[::-1]), found, np.concatenate(depths[::-1]))


def uncertainty(tree: PathTree, weights: np.ndarray, n_leaves: int) -> Uncertainty:
    """How particles of weights (n_particles,) differ, and the branches of about `n_leaves` of them."""
    drawn = tree.leaves[systematic(weights, MIDDLE, SAMPLE)]
    found = particle_deviations(tree.nodes, tree.n_levels, drawn, np.full(SAMPLE, 1.0 / SAMPLE))
    return Uncertainty(found[:, :3], found[:, 3], branches(tree, weights, n_leaves), "particles")
