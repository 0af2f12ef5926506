"""What particles carry beside their paths, and one vertex for all of them in one pass over blocks that stay in cache.

A block is moved, its walk up the path tree is made level by level (only levels that come near the block, and could be
reached from those looked at before, are looked at, the others are jumped over), and its near pairs are compared: each
particle, node and test point is touched once.
Loops run over particles inside and levels outside, so that what one particle branches on its neighbour mostly does too.
Nothing is allocated within the loop over blocks. Uses its siblings `comparison`, `motion`, `path_tree` and
`wall_direction`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.comparison import pair_affinity, points_pair_affinity, room_for_cells
from slam.counter_random import gaussian_of
from slam.motion import SCALE_JITTER, TURN_JITTER, propagate
from slam.path_tree import climb
from slam.wall_direction import fresh_directions

BLOCK = 64  # particles: neighbours, that mostly lie together and stay in the first cache
ROUNDING = 1e-3  # m by which distances are trusted less than they say


class Particles(NamedTuple):
    """State of n particles: (n,) each, `directions` as of `slam.wall_direction`."""

    log_weights: np.ndarray
    affinities: np.ndarray
    plausibilities: np.ndarray
    turn_biases: np.ndarray
    scale_biases: np.ndarray
    directions: np.ndarray


def equal_particles(turn_biases: np.ndarray, scale_biases: np.ndarray) -> Particles:
    """Particles (n,) of these biases that nothing is known of yet."""
    n = turn_biases.size
    return Particles(np.zeros(n), np.zeros(n), np.zeros(n), turn_biases, scale_biases, fresh_directions(n))


@njit(cache=True, inline="always")
def box_of(poses, low, high):
    """min x, min y, max x, max y of rows low..high."""
    min_x, min_y, max_x, max_y = poses[low, 0], poses[low, 1], poses[low, 0], poses[low, 1]
    for p in range(low + 1, high):
        min_x, max_x = min(min_x, poses[p, 0]), max(max_x, poses[p, 0])
        min_y, max_y = min(min_y, poses[p, 1]), max(max_y, poses[p, 1])
    return min_x, min_y, max_x, max_y


@njit(cache=True, inline="always")
def is_near(box, other, margin):
    """Whether two boxes come within `margin`."""
    dx = max(0.0, max(box[0] - other[2], other[0] - box[2]))
    dy = max(0.0, max(box[1] - other[3], other[1] - box[3]))
    return dx * dx + dy * dy <= margin * margin


def weigher(score):
    """A kernel that weighs by this affinity of a pair."""

    @njit(cache=True, nogil=True)
    def weigh(nodes, vertex, poses, particles, seen, rule, first, end, where, cells):
        """Add the affinity of the newest vertex with the nodes found to the weights of particles first..end."""
        for p in range(first, end):
            total = 0.0
            for place in range(rule.neighbours):
                found = where[place, p - first]
                if found < 0:
                    break
                level = found >> 32
                node = nodes.starts[level] + (found & 0xFFFFFFFF)
                total += score(
                    seen, rule, vertex, poses[p, 0], poses[p, 1], poses[p, 2],
                    level, nodes.poses[node, 0], nodes.poses[node, 1], nodes.poses[node, 2], cells,
                )  # fmt: skip
            particles.log_weights[p] += total
            particles.affinities[p] += total

    return weigh


weigh_by_points = weigher(points_pair_affinity)
weigh_by_any = weigher(pair_affinity)


@njit(cache=True, nogil=True)
def extend(nodes, leaves, vertex, particles, step, key, seen, rule, low, high):
    """Add the level `vertex` to the paths of particles low..high: move them, and weigh them where they come back."""
    start, above = nodes.starts[vertex], nodes.starts[vertex - 1]
    poses, parents = nodes.poses[start : nodes.starts[vertex + 1]], nodes.parents[start : nodes.starts[vertex + 1]]
    rows, squares = np.empty(BLOCK, np.int32), np.empty(BLOCK)
    near, where = np.empty((rule.neighbours, BLOCK)), np.empty((rule.neighbours, BLOCK), np.int64)
    cells = room_for_cells(rule)
    for first in range(low, high, BLOCK):
        end = min(first + BLOCK, high)
        propagate(
            nodes.poses[above:start], leaves, step, key, particles.turn_biases, particles.scale_biases, first, end,
            poses, particles.plausibilities,
        )  # fmt: skip
        for p in range(first, end):
            parents[p] = rows[p - first] = leaves[p]
        if not find_near(nodes, rows, vertex, poses, rule, first, end, squares, near, where):
            continue
        if rule.by_points and rule.pattern.early_exit == -math.inf:
            weigh_by_points(nodes, vertex, poses, particles, seen, rule, first, end, where, cells)
        else:
            weigh_by_any(nodes, vertex, poses, particles, seen, rule, first, end, where, cells)


@njit(cache=True, nogil=True)
def find_near(nodes, rows, vertex, poses, rule, first, end, squares, near, where):
    """Find the earlier nodes that lie nearest the newest of particles first..end on their own paths; whether any may.

    `rows` (n,) are the parents' and are walked up. `where` (k, n) holds levels (high word) and rows (low), -1 for none.
    """
    n = end - first
    box = box_of(poses, first, end)
    level, goal, is_any = vertex - 1, vertex - rule.gap, False
    last = near[near.shape[0] - 1]
    while goal >= 0:
        if not is_near(box, nodes.boxes[goal], rule.range):
            goal -= 1
            continue
        if not is_any:
            near[:, :n], where[:, :n] = rule.range * rule.range, -1
            is_any = True
        climb(nodes, rows, n, level, goal)
        level, start = goal, nodes.starts[goal]
        n_nearer, nearest = 0, math.inf
        for k in range(n):
            node = start + rows[k]
            dx = nodes.poses[node, 0] - poses[first + k, 0]
            dy = nodes.poses[node, 1] - poses[first + k, 1]
            squares[k] = dx * dx + dy * dy
            n_nearer += squares[k] < last[k]
            nearest = min(nearest, squares[k])
        if n_nearer > 0:
            insert(near, where, squares, np.int64(goal) << 32, rows, n)
        goal = next_goal(nodes.ways, goal, math.sqrt(nearest) - rule.range)
    return is_any


@njit(cache=True, inline="always")
def next_goal(ways, goal, margin):
    """The next older level at which a path may be near that keeps `margin` (m) at level `goal`; -1 if there is none."""
    last = ways[goal] - margin + ROUNDING  # a path that comes near from so far takes that long
    goal -= 1
    while goal >= 0 and ways[goal] > last:
        goal -= 1
    return goal


@njit(cache=True, nogil=True)
def insert(near, where, squares, level, rows, n):
    """Insert each particle's node of a level at its squared distance into its ascending column of `near` (k, n).

    Choices instead of branches, place by place from the last: so that many particles are done at once.
    """
    for place in range(near.shape[0] - 1, -1, -1):
        here, found = near[place], where[place]
        if place == 0:
            for k in range(n):
                is_here = squares[k] < here[k]
                found[k] = level + rows[k] if is_here else found[k]
                here[k] = squares[k] if is_here else here[k]
            break
        before, found_before = near[place - 1], where[place - 1]
        for k in range(n):
            is_here, is_before = squares[k] < here[k], squares[k] < before[k]
            chosen = found_before[k] if is_before else level + rows[k]
            found[k] = chosen if is_here else found[k]
            square = before[k] if is_before else squares[k]
            here[k] = square if is_here else here[k]


@njit(cache=True, nogil=True)
def inherit(particles, ancestors, kept, turn_jitter, scale_jitter, key, children, low, high):
    """Make `children` low..high of their `ancestors` (n,); of one weight, biases `kept` in part and jittered."""
    for p in range(low, high):
        parent = ancestors[p]
        children.log_weights[p] = 0.0
        children.affinities[p] = particles.affinities[parent]
        children.plausibilities[p] = particles.plausibilities[parent]
        children.directions[p] = particles.directions[parent]
        turn, scale = kept * particles.turn_biases[parent], kept * particles.scale_biases[parent]
        if turn_jitter > 0.0:
            turn += turn_jitter * gaussian_of(key, p, TURN_JITTER)
        if scale_jitter > 0.0:
            scale += scale_jitter * gaussian_of(key, p, SCALE_JITTER)
        children.turn_biases[p], children.scale_biases[p] = turn, scale
