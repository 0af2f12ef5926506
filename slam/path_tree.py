"""Paths of all particles as a common-prefix tree (Crunch thesis, 2.7): what two particles share is stored once.

A node holds the pose of one path vertex and the row of the vertex before it in the level above the root side. Nodes
stand level by level (all vertices of one depth together), and in the order of the particles that they belong to.
Systematic resampling keeps that order, so that the parents of a level never descend: a level's survivors are found,
and the level is packed, in one streaming pass, without reference counts or lists of free nodes, and neighbouring
particles read neighbouring memory. Every 16th level also keeps its ancestors 16 levels up, so that old vertices are
reached in few steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

STRIDE = 16  # levels that a jump leads up
SPAN = 4096  # nodes that are walked up together, so that they stay in cache
LEVELS = 64  # room for as many at the start; what is not written takes no memory


class Nodes(NamedTuple):
    """Rows of nodes, level by level: level l is rows starts[l] to starts[l + 1].

    `poses` (capacity, 3) float32; `parents` and `jumps` (capacity,) int32 count rows within the level 1 and 16 above;
    `starts` (levels + 1,) int64; `boxes` (levels, 4) float32 are min x, min y, max x, max y of each level; between two
    levels no path is longer than their `ways` (levels,) in m differ.
    """

    poses: np.ndarray
    parents: np.ndarray
    jumps: np.ndarray
    starts: np.ndarray
    boxes: np.ndarray
    ways: np.ndarray


@njit(cache=True, inline="always")
def climb(nodes, rows, n, level, goal):
    """Turn the first `n` `rows` of a level into their ancestors' rows in the level `goal` above or at it."""
    while level > goal:
        start = nodes.starts[level]
        if level % STRIDE == 0 and level - STRIDE >= goal:
            for k in range(n):
                rows[k] = nodes.jumps[start + rows[k]]
            level -= STRIDE
        else:
            for k in range(n):
                rows[k] = nodes.parents[start + rows[k]]
            level -= 1


@njit(cache=True, nogil=True)
def fill_jumps(nodes, level):
    """Look up the ancestors 16 levels above a level; none for levels without."""
    if level % STRIDE != 0 or level == 0:
        return
    start, end = nodes.starts[level], nodes.starts[level + 1]
    rows = np.empty(min(SPAN, end - start), np.int32)
    for low in range(start, end, SPAN):
        n = min(SPAN, end - low)
        for k in range(n):
            rows[k] = nodes.parents[low + k]
        climb(nodes, rows, n, level - 1, level - STRIDE)
        for k in range(n):
            nodes.jumps[low + k] = rows[k]


@njit(cache=True, nogil=True)
def bound_level(nodes, level):
    """Find a level's box."""
    box = nodes.boxes[level]
    box[:2], box[2:] = np.inf, -np.inf
    for row in range(nodes.starts[level], nodes.starts[level + 1]):
        for axis in range(2):
            box[axis] = min(box[axis], nodes.poses[row, axis])
            box[2 + axis] = max(box[2 + axis], nodes.poses[row, axis])


@njit(cache=True, nogil=True)
def measure_level(nodes, level):
    """Find how long paths to a level may be: no step is longer than the longest, whoever survives."""
    start, above = nodes.starts[level], nodes.starts[level - 1]
    longest = 0.0
    for row in range(start, nodes.starts[level + 1]):
        parent = above + nodes.parents[row]
        dx = nodes.poses[row, 0] - nodes.poses[parent, 0]
        dy = nodes.poses[row, 1] - nodes.poses[parent, 1]
        longest = max(longest, dx * dx + dy * dy)
    nodes.ways[level] = nodes.ways[level - 1] + math.sqrt(longest)


@njit(cache=True, nogil=True)
def prune(nodes, n_levels, leaves):
    """Drop all nodes that lie on no path to `leaves` (n,), rows of the newest level in ascending order.

    The leaves become the rows that they then have. Levels are packed from the newest up to the first that loses
    nothing; then the gaps between them are closed.
    """
    kept = np.empty(nodes.starts[n_levels] - nodes.starts[n_levels - 1], np.int32)  # rows of the level that live
    n_kept, last = 0, -1
    for p in range(leaves.size):
        if leaves[p] != last:
            last = leaves[p]
            kept[n_kept] = last
            n_kept += 1
        leaves[p] = n_kept - 1
    counts = np.empty(n_levels, np.int64)
    level = n_levels - 1
    while level >= 0 and n_kept < nodes.starts[level + 1] - nodes.starts[level]:
        counts[level] = n_kept
        start = nodes.starts[level]
        n_above, last = 0, -1
        for k in range(n_kept):
            row = start + kept[k]
            for axis in range(3):
                nodes.poses[start + k, axis] = nodes.poses[row, axis]
            if nodes.parents[row] != last:
                last = nodes.parents[row]
                kept[n_above] = last  # never ahead of what is still to be read
                n_above += 1
            nodes.parents[start + k] = n_above - 1
        n_kept = n_above
        level -= 1
    oldest = level + 1
    close_gaps(nodes, counts, oldest, n_levels)
    for level in range(oldest, n_levels):
        bound_level(nodes, level)
        fill_jumps(nodes, level)


@njit(cache=True, nogil=True)
def close_gaps(nodes, counts, oldest, n_levels):
    """Move levels from `oldest` on together, of whose rows only the first `counts[level]` are nodes."""
    end = nodes.starts[oldest]
    for level in range(oldest, n_levels):
        start = nodes.starts[level]
        nodes.starts[level] = end
        if end < start:
            for k in range(counts[level]):
                nodes.parents[end + k] = nodes.parents[start + k]
                for axis in range(3):
                    nodes.poses[end + k, axis] = nodes.poses[start + k, axis]
        end += counts[level]
    nodes.starts[n_levels] = end


def reserved(n_rows: int, n_levels: int) -> Nodes:
    """Room for so many nodes and levels; the system gives memory only where it is written."""
    return Nodes(
        np.empty((n_rows, 3), np.float32),
        np.empty(n_rows, np.int32),
        np.empty(n_rows, np.int32),
        np.zeros(n_levels + 1, np.int64),
        np.empty((n_levels, 4), np.float32),
        np.zeros(n_levels),
    )


class PathTree:
    """The tree and the leaves (n_particles,) of its particles; all start at one root, whose pose is given (3,).

    Leaves are rows of the newest level and never descend.
    """

    def __init__(self, n_particles: int, root: np.ndarray):
        self.nodes = reserved(LEVELS * (n_particles + 1), LEVELS)
        self.nodes.poses[0] = root
        self.nodes.parents[0] = -1
        self.nodes.starts[1] = 1
        self.n_levels = 1
        self.leaves = np.zeros(n_particles, np.int32)
        bound_level(self.nodes, 0)

    @property
    def n_nodes(self) -> int:
        """How many nodes there are."""
        return int(self.nodes.starts[self.n_levels])

    def grow(self) -> int:
        """Add a level of a node for every particle; the first of its rows, which the caller fills and then settles."""
        start = self.n_nodes
        wanted = start + self.leaves.size
        rows, levels = self.nodes.parents.size, len(self.nodes.boxes)
        if self.n_levels == levels:  # nodes stay where they are: a million particles' would take a second to copy
            more = reserved(0, 2 * levels)
            more.starts[: levels + 1], more.boxes[:levels] = self.nodes.starts, self.nodes.boxes
            more.ways[:levels] = self.nodes.ways
            self.nodes = self.nodes._replace(starts=more.starts, boxes=more.boxes, ways=more.ways)
        if wanted > rows:
            room = reserved(max(2 * rows, wanted), 1)
            for field in ("poses", "parents", "jumps"):
                getattr(room, field)[:start] = getattr(self.nodes, field)[:start]
            self.nodes = self.nodes._replace(poses=room.poses, parents=room.parents, jumps=room.jumps)
        self.n_levels += 1
        self.nodes.starts[self.n_levels] = wanted
        return start

    def settle(self) -> None:
        """The newest level's poses and parents are there: its nodes are the leaves."""
        self.leaves = np.arange(self.leaves.size, dtype=np.int32)
        bound_level(self.nodes, self.n_levels - 1)
        measure_level(self.nodes, self.n_levels - 1)
        fill_jumps(self.nodes, self.n_levels - 1)

    def resample(self, ancestors: np.ndarray) -> None:
        """Give particle i the path of particle `ancestors[i]`, which never descend; their number may change."""
        self.leaves = self.leaves[ancestors]
        if np.any(np.diff(self.leaves) < 0):
            raise ValueError("ancestors must not descend: the tree keeps its nodes in the order of the particles")
        prune(self.nodes, self.n_levels, self.leaves)

    def profile(self) -> np.ndarray:
        """Nodes at each depth divided by the number of particles (thesis, 3)."""
        return np.diff(self.nodes.starts[: self.n_levels + 1]) / self.leaves.size

    def fixed_depth(self) -> int:
        """The deepest depth with a single node: up to it all particles share one path (thesis, 3)."""
        return int(np.flatnonzero(np.diff(self.nodes.starts[: self.n_levels + 1]) == 1)[-1])

    def newest(self, particles: np.ndarray) -> np.ndarray:
        """Poses (k, 3) of the newest vertex of some particles (k,)."""
        return self.nodes.poses[self.nodes.starts[self.n_levels - 1] + self.leaves[particles]].astype(float)

    def path(self, particle: int) -> np.ndarray:
        """Poses (n_levels, 3) of one particle from the root to its leaf."""
        poses = np.empty((self.n_levels, 3))
        row = int(self.leaves[particle])
        for level in range(self.n_levels - 1, -1, -1):
            node = self.nodes.starts[level] + row
            poses[level] = self.nodes.poses[node]
            row = int(self.nodes.parents[node])
        return poses
