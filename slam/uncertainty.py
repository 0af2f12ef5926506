"""How certain each stretch of the path is: the particles' spread at every vertex, and the tree's main branches.

Taken over a systematic sample of the particles. Moments of the leaves are summed up the path tree, so that what
particles share is computed once. A spread is the root of a covariance's trace, in metres.
"""

from __future__ import annotations

import cmath
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.path_tree import PathTree
from slam.resampling import systematic

SAMPLE = 500  # particles that spreads are taken over, which makes them 3% uncertain
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
    """Spread (v,) in m of each vertex in the world and as seen from the newest vertex, and the tree's main branches."""

    spread: np.ndarray
    revisit_spread: np.ndarray
    branches: Branches | None


@njit(cache=True, inline="always")
def place_of(nodes, node):
    """Where a node lies, as a complex number in double precision: variances are small differences of squares."""
    return complex(np.float64(nodes.poses[node, 0]), np.float64(nodes.poses[node, 1]))


@njit(cache=True)
def spreads(nodes, leaves, weights):
    """Spread (v,) of each vertex in the world, and the same in the frames of the particles' newest vertices.

    Places are complex numbers. A vertex at p, seen from a leaf (l, theta), lies at exp(-i theta) (p - l); the leaves'
    moments that its mean and variance need do not depend on p, and add up from children to their parent.
    """
    n_levels = nodes.depth[leaves[0]] + 1
    variances = np.zeros((2, n_levels))
    row = np.full(nodes.parent.size, -1, np.int32)  # of the level's nodes that were met
    here, above = np.empty(leaves.size, np.int32), np.empty(leaves.size, np.int32)
    sums = np.zeros((leaves.size, 5), np.complex128)  # of w, w l, w |l|^2, w exp(-i theta), w exp(-i theta) l
    n_here = 0
    for p in range(leaves.size):
        leaf = leaves[p]
        if row[leaf] < 0:
            row[leaf] = n_here
            here[n_here] = leaf
            n_here += 1
        place = place_of(nodes, leaf)
        turned = weights[p] * cmath.exp(-1j * np.float64(nodes.poses[leaf, 2]))
        sums[row[leaf], 0] += weights[p]
        sums[row[leaf], 1] += weights[p] * place
        sums[row[leaf], 2] += weights[p] * abs(place) ** 2
        sums[row[leaf], 3] += turned
        sums[row[leaf], 4] += turned * place
    for level in range(n_levels - 1, -1, -1):
        mean, seen_mean, square, seen_square = 0j, 0j, 0.0, 0.0
        sums_above = np.zeros((n_here, 5), np.complex128)
        n_above = 0
        for k in range(n_here):
            node, moments = here[k], sums[k]
            place = place_of(nodes, node)
            own = moments[0].real * abs(place) ** 2
            mean += moments[0] * place
            square += own
            seen_mean += place * moments[3] - moments[4]
            seen_square += own - 2.0 * (place.conjugate() * moments[1]).real + moments[2].real
            parent = nodes.parent[node]
            if parent < 0:
                continue
            if row[parent] < 0:
                row[parent] = n_above
                above[n_above] = parent
                n_above += 1
            sums_above[row[parent]] += moments
        variances[0, level] = square - abs(mean) ** 2
        variances[1, level] = seen_square - abs(seen_mean) ** 2
        here, above = above, here
        n_here, sums = n_above, sums_above
    return np.sqrt(np.maximum(variances, 0.0))


@njit(cache=True)
def lineages(nodes, leaves):
    """Nodes (k,) on the ways from some leaves to the root, the root first, and each one's parent as a row (k,) of them.

    A parent stands before its children.
    """
    n_levels = nodes.depth[leaves[0]] + 1
    found = np.empty(leaves.size * n_levels, np.int32)
    row = np.full(nodes.parent.size, -1, np.int32)
    n_found = 0
    for p in range(leaves.size):
        if row[leaves[p]] < 0:
            row[leaves[p]] = n_found
            found[n_found] = leaves[p]
            n_found += 1
    k = 0
    while k < n_found:  # level by level, since all leaves lie at one depth
        parent = nodes.parent[found[k]]
        if parent >= 0 and row[parent] < 0:
            row[parent] = n_found
            found[n_found] = parent
            n_found += 1
        k += 1
    members = found[:n_found][::-1].copy()
    parents = np.full(n_found, -1, np.int32)
    for k in range(1, n_found):
        parents[k] = n_found - 1 - row[nodes.parent[members[k]]]
    return members, parents


def branches(tree: PathTree, weights: np.ndarray, n_leaves: int) -> Branches:
    """The paths of about `n_leaves` particles, drawn systematically by their weights (n_particles,)."""
    drawn = systematic(weights, MIDDLE, n_leaves)
    members, parents = lineages(tree.nodes, tree.leaves[drawn])
    return Branches(tree.nodes.poses[members], parents, tree.nodes.depth[members])


def uncertainty(tree: PathTree, weights: np.ndarray, n_leaves: int) -> Uncertainty:
    """Spreads of the particles of the given weights (n_particles,), and the branches of about `n_leaves` of them."""
    drawn = tree.leaves[systematic(weights, MIDDLE, SAMPLE)]
    spread, revisit_spread = spreads(tree.nodes, drawn, np.full(SAMPLE, 1.0 / SAMPLE))
    return Uncertainty(spread, revisit_spread, branches(tree, weights, n_leaves))
