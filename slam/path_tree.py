"""Paths of all particles as a common-prefix tree (Crunch thesis, 2.7): what two particles share is stored once.

A node holds the pose of one path vertex and points to the node of the vertex before it. Its reference count says how
many children and particles point to it; at zero it is freed, and its parent loses a reference. Every node also keeps a
jump pointer to an older ancestor (skew-binary, after Myers 1983, *An applicative random-access stack*), so that the
ancestor at any depth is found in a logarithmic number of steps; the jump pointer needs no count, for an ancestor
lives as long as its descendants.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

NONE = -1


class Nodes(NamedTuple):
    """Node arrays of one capacity: parent, jump, depth, references (all int32); poses (capacity, 3) float32."""

    parent: np.ndarray
    jump: np.ndarray
    depth: np.ndarray
    references: np.ndarray
    poses: np.ndarray


def empty_nodes(capacity: int) -> Nodes:
    """Room for `capacity` nodes, all of them free."""
    return Nodes(
        np.full(capacity, NONE, np.int32),
        np.full(capacity, NONE, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros((capacity, 3), np.float32),
    )


@njit(cache=True, inline="always")
def attach(nodes, node, parent):
    """Hang `node` under `parent`, whose particle's reference becomes its child's."""
    nodes.parent[node] = parent
    nodes.depth[node] = nodes.depth[parent] + 1
    nodes.references[node] = 1
    older = nodes.jump[parent]
    if older >= 0 and nodes.jump[older] >= 0:
        first = nodes.depth[parent] - nodes.depth[older]
        second = nodes.depth[older] - nodes.depth[nodes.jump[older]]
        nodes.jump[node] = nodes.jump[older] if first == second else parent
    else:
        nodes.jump[node] = parent


@njit(cache=True, inline="always")
def ancestor(nodes, node, depth):
    """The node at `depth` on the path to `node`."""
    while nodes.depth[node] > depth:
        jump = nodes.jump[node]
        node = jump if jump >= 0 and nodes.depth[jump] >= depth else nodes.parent[node]
    return node


@njit(cache=True)
def reassign(nodes, leaves, ancestors, free, n_free):
    """Leaves (n,) after resampling: particle i takes over the leaf of `ancestors[i]`; returns them and the new n_free.

    Nodes that nobody refers to any more are pushed on the stack `free`.
    """
    chosen = np.empty(ancestors.size, leaves.dtype)
    for i in range(ancestors.size):
        chosen[i] = leaves[ancestors[i]]
        nodes.references[chosen[i]] += 1
    for i in range(leaves.size):
        node = leaves[i]
        while node >= 0:
            nodes.references[node] -= 1
            if nodes.references[node] > 0:
                break
            free[n_free] = node
            n_free += 1
            node = nodes.parent[node]
    return chosen, n_free


@njit(cache=True)
def count_levels(nodes, depths):
    """Number of live nodes at each of `depths` levels."""
    counts = np.zeros(depths, np.int64)
    for node in range(nodes.references.size):
        if nodes.references[node] > 0:
            counts[nodes.depth[node]] += 1
    return counts


@njit(cache=True)
def bound_levels(nodes, boxes):
    """Fill `boxes` (depths, 4) with min x, min y, max x, max y of the live nodes of each level."""
    boxes[:, :2] = np.inf
    boxes[:, 2:] = -np.inf
    for node in range(nodes.references.size):
        if nodes.references[node] > 0:
            depth = nodes.depth[node]
            for axis in range(2):
                boxes[depth, axis] = min(boxes[depth, axis], nodes.poses[node, axis])
                boxes[depth, 2 + axis] = max(boxes[depth, 2 + axis], nodes.poses[node, axis])


class PathTree:
    """The tree and the leaves (n_particles,) of its particles; all start at one root, whose pose is given (3,)."""

    def __init__(self, n_particles: int, root: np.ndarray):
        capacity = 4 * n_particles + 64
        self.nodes: Nodes = empty_nodes(capacity)
        self.free = np.arange(capacity - 1, -1, -1, dtype=np.int32)
        self.n_free = capacity - 1
        self.nodes.poses[0] = root
        self.nodes.references[0] = n_particles
        self.leaves: np.ndarray = np.zeros(n_particles, np.int32)
        self.n_levels = 1
        self.boxes = np.zeros((64, 4), np.float32)
        bound_levels(self.nodes, self.boxes[:1])

    def grow(self) -> np.ndarray:
        """One fresh node (n_particles,) for every particle, still unattached; the caller attaches and places them."""
        wanted = self.leaves.size
        if self.n_free < wanted:
            self.enlarge(self.n_free + self.nodes.parent.size + wanted)
        if self.n_levels == self.boxes.shape[0]:
            self.boxes = np.concatenate([self.boxes, np.zeros_like(self.boxes)])
        self.n_free -= wanted
        self.n_levels += 1
        return self.free[self.n_free : self.n_free + wanted][::-1].copy()

    def enlarge(self, n_more: int) -> None:
        """Add `n_more` free nodes."""
        capacity = self.nodes.parent.size
        self.nodes = Nodes(*(np.concatenate(pair) for pair in zip(self.nodes, empty_nodes(n_more), strict=True)))
        fresh = np.arange(capacity + n_more - 1, capacity - 1, -1, dtype=np.int32)
        room = np.zeros(capacity + n_more, np.int32)
        room[:n_more] = fresh
        room[n_more : n_more + self.n_free] = self.free[: self.n_free]
        self.free = room
        self.n_free += n_more

    def settle(self, leaves: np.ndarray) -> None:
        """Take the attached nodes as the particles' leaves and bound their level."""
        self.leaves = leaves
        newest = self.nodes.poses[leaves, :2]
        self.boxes[self.n_levels - 1, :2] = newest.min(axis=0)
        self.boxes[self.n_levels - 1, 2:] = newest.max(axis=0)

    def resample(self, ancestors: np.ndarray) -> None:
        """Give particle i the path of particle `ancestors[i]`; their number may change."""
        self.leaves, self.n_free = reassign(self.nodes, self.leaves, ancestors, self.free, self.n_free)
        bound_levels(self.nodes, self.boxes[: self.n_levels])

    def profile(self) -> np.ndarray:
        """Nodes at each depth divided by the number of particles (thesis, 3)."""
        return count_levels(self.nodes, self.n_levels) / self.leaves.size

    def fixed_depth(self) -> int:
        """The deepest depth with a single node: up to it all particles share one path (thesis, 3)."""
        return int(np.flatnonzero(count_levels(self.nodes, self.n_levels) == 1)[-1])

    def path(self, particle: int) -> np.ndarray:
        """Poses (n_levels, 3) of one particle from the root to its leaf."""
        poses = np.empty((self.n_levels, 3))
        node = int(self.leaves[particle])
        for level in range(self.n_levels - 1, -1, -1):
            poses[level] = self.nodes.poses[node]
            node = int(self.nodes.parent[node])
        return poses
