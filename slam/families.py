"""Families: particles whose paths are so alike that a map's cells cannot tell them apart, and that share one map.

Particles of a good laser stand within a centimetre or two of each other, and their maps, drawn apart, would be alike
cell by cell. A family's map is drawn from where its head stands; the others go on relative to it. So memory, and the
time for drawing, are what the families take. Uses its sibling `path_tree`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.params import Params
from slam.path_tree import PathTree, climb


class FamilyParams(Params):
    """How near a head others stand; `near = 0` gives every particle a map of its own."""

    near: float = Field(default=0.02, ge=0.0)  # m now, half a cell at most,
    turn: float = Field(default=0.01, ge=0.0)  # and rad
    before: float = Field(default=3.0, ge=1.0)  # times as far at earlier vertices


@njit(cache=True)
def join(histories, near, turn, before, families, heads):
    """Put each of `histories` (n, lags, 3), the newest pose first, into the family (n,) of the first head it is like.

    The heads' rows are filled in; how many there are is returned.
    """
    n_heads = 0
    for p in range(histories.shape[0]):
        found = -1
        for h in range(n_heads):
            head, is_like = heads[h], True
            for lag in range(histories.shape[1]):
                wide = 1.0 if lag == 0 else before
                dx = histories[p, lag, 0] - histories[head, lag, 0]
                dy = histories[p, lag, 1] - histories[head, lag, 1]
                off = histories[p, lag, 2] - histories[head, lag, 2]
                off -= 2.0 * math.pi * round(off / (2.0 * math.pi))
                if dx * dx + dy * dy > (wide * near) ** 2 or abs(off) > wide * turn:
                    is_like = False
                    break
            if is_like:
                found = h
                break
        if found < 0:
            heads[n_heads] = p
            found = n_heads
            n_heads += 1
        families[p] = found
    return n_heads


@njit(cache=True)
def look_back(nodes, leaves, n_levels, lags, histories):
    """Fill in the poses (n, lags, 3) of leaves (n,) so many `lags` (lags,) ascending levels up."""
    rows = leaves.copy()
    level = n_levels - 1
    for k in range(lags.size):
        goal = max(0, n_levels - 1 - lags[k])
        climb(nodes, rows, rows.size, level, goal)
        level = goal
        start = nodes.starts[level]
        for p in range(rows.size):
            for axis in range(3):
                histories[p, k, axis] = nodes.poses[start + rows[p], axis]


def families_of(tree: PathTree, params: FamilyParams) -> tuple[np.ndarray, np.ndarray]:
    """The family (n,) of each particle, and the particles (m,) that are the families' heads.

    Paths are compared at the newest vertex and 1, 2, 4, ... vertices before it, back to the first that all share.
    """
    n = len(tree.leaves)
    if params.near == 0.0:
        return np.arange(n), np.arange(n)
    open_levels = tree.n_levels - 1 - tree.fixed_depth()
    lags = np.array([0, *(2**k for k in range(max(0, open_levels).bit_length()))])
    histories = np.empty((n, len(lags), 3), np.float32)
    look_back(tree.nodes, tree.leaves, tree.n_levels, lags, histories)
    families, heads = np.empty(n, np.int64), np.empty(n, np.int64)
    return families, heads[: join(histories, params.near, params.turn, params.before, families, heads)]
