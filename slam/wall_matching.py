"""Wall points of two nodes that are the same wall: nearest points with like normals, and their pull on the poses.

Nodes are anything that carries wall points with normals in its own frame: a vertex with its walls, or one laser scan.
The residual of a matched point is its distance to the other's wall line (point to line: Chen and Medioni 1992;
Censi 2008), under Geman and McClure's kernel, which forgets what is far off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.pose_graph import Terms
from slam.walls import Walls, label_curves


class WallPoints(NamedTuple):
    """Wall points of n nodes, each node's in its own frame: rows starts[v] .. starts[v + 1] are node v's.

    `points` (m, 2) in m, `normals` (m, 2) of length 1 towards where they were seen from, `starts` (n + 1,) int64.
    """

    points: np.ndarray
    normals: np.ndarray
    starts: np.ndarray


class Matching(NamedTuple):
    """How points are matched: within `gate` m, normals within an angle of this `cos`; noise and kernel width in m."""

    gate: float
    cos: float
    sigma: float
    kernel: float


class Nearness(NamedTuple):
    """Which nodes are compared: each with the nearest of its `visits` earlier visits (see `near_pairs`)."""

    range: float
    visits: int
    gap: int


def wall_points(observations: Sequence[Walls], jump: float = 0.15, span: int = 2, trim: int = 2) -> WallPoints:
    """Points and normals of vertices' walls; a normal is taken over `span` rays to both sides within a curve.

    `trim` rays at both ends of a curve are left out: where a wall ends depends on where it is seen from.
    """
    points, normals, starts = [], [], [0]
    for walls in observations:
        distances = np.asarray(walls.distances, float)
        n = distances.size
        labels = label_curves(distances, jump)
        angles = 2.0 * np.pi * np.arange(n) / n
        places = np.where(labels > 0, distances, 0.0)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        low, high = np.arange(n), np.arange(n)
        for _ in range(span):
            low = np.where(labels[low - 1] == labels, (low - 1) % n, low)
            high = np.where(labels[(high + 1) % n] == labels, (high + 1) % n, high)
        inner = labels > 0
        for shift in range(1, trim + 1):
            inner &= (np.roll(labels, shift) == labels) & (np.roll(labels, -shift) == labels)
        chords = places[high] - places[low]
        lengths = np.hypot(chords[:, 0], chords[:, 1])
        kept = np.flatnonzero(inner & (lengths > 1e-6))
        points.append(places[kept])
        normals.append(np.stack([-chords[kept, 1], chords[kept, 0]], axis=1) / lengths[kept, None])
        starts.append(starts[-1] + kept.size)
    if not points:
        return WallPoints(np.empty((0, 2)), np.empty((0, 2)), np.zeros(1, np.int64))
    return WallPoints(np.concatenate(points), np.concatenate(normals), np.array(starts, np.int64))


@njit(cache=True)
def near_pairs(poses, reach, visits, gap, pairs):
    """Fill `pairs` (n * visits, 2) with each node and the nearest of every earlier visit; how many there are.

    A visit is a run of nodes that are all less than `reach` m away, and `gap` nodes or more before; the nearest few
    visits count. More pairs of one visit would say the same again, and what bends walls with the distance they are
    seen from would bend the map.
    """
    near, where = np.empty(visits), np.empty(visits, np.int64)
    n_pairs = 0
    for node in range(gap, poses.shape[0]):
        found = 0
        nearest, best = math.inf, -1
        for other in range(node - gap, -2, -1):
            square = math.inf
            if other >= 0:
                square = (poses[other, 0] - poses[node, 0]) ** 2 + (poses[other, 1] - poses[node, 1]) ** 2
            if square < reach * reach:
                if square < nearest:
                    nearest, best = square, other
                continue
            if best >= 0 and (found < visits or nearest < near[found - 1]):
                found = min(found + 1, visits)
                place = found - 1
                while place > 0 and near[place - 1] > nearest:
                    near[place], where[place] = near[place - 1], where[place - 1]
                    place -= 1
                near[place], where[place] = nearest, best
            nearest, best = math.inf, -1
        for place in range(found):
            pairs[n_pairs, 0], pairs[n_pairs, 1] = where[place], node
            n_pairs += 1
    return n_pairs


@njit(cache=True)
def match(walls, a, b, x, y, theta, matching, partners):
    """Nearest point of node a for each of node b's, b being at (x, y, theta) in a's frame: fill `partners`, or -1."""
    cos, sin = math.cos(theta), math.sin(theta)
    low = walls.starts[b]
    for p in range(low, walls.starts[b + 1]):
        px, py = walls.points[p, 0], walls.points[p, 1]
        px, py = cos * px - sin * py + x, sin * px + cos * py + y
        nx, ny = walls.normals[p, 0], walls.normals[p, 1]
        nx, ny = cos * nx - sin * ny, sin * nx + cos * ny
        nearest, best = matching.gate**2, -1
        for q in range(walls.starts[a], walls.starts[a + 1]):
            dx, dy = px - walls.points[q, 0], py - walls.points[q, 1]
            square = dx * dx + dy * dy
            if square < nearest and nx * walls.normals[q, 0] + ny * walls.normals[q, 1] > matching.cos:
                nearest, best = square, q
        partners[p - low] = best


@njit(cache=True)
def pull(walls, b, x, y, theta, matching, partners, gradient, hessian):
    """Add the matched points' derivatives by (x, y, theta) to `gradient` (3,) and `hessian` (3, 3); their cost.

    Geman-McClure: cost c^2/2 r^2 / (c^2 + r^2), which is r^2/2 for small r and never more than c^2/2.
    """
    cos, sin = math.cos(theta), math.sin(theta)
    low = walls.starts[b]
    kernel = (matching.kernel / matching.sigma) ** 2
    cost = 0.0
    jacobian = np.empty(3)
    for p in range(low, walls.starts[b + 1]):
        q = partners[p - low]
        if q < 0:
            continue
        px, py = walls.points[p, 0], walls.points[p, 1]
        rx, ry = cos * px - sin * py, sin * px + cos * py
        nx, ny = walls.normals[q, 0] / matching.sigma, walls.normals[q, 1] / matching.sigma
        residual = nx * (rx + x - walls.points[q, 0]) + ny * (ry + y - walls.points[q, 1])
        share = kernel / (kernel + residual * residual)
        cost += 0.5 * residual * residual * share
        weight = share * share
        jacobian[0], jacobian[1], jacobian[2] = nx, ny, nx * -ry + ny * rx
        for r in range(3):
            gradient[r] += weight * residual * jacobian[r]
            for c in range(3):
                hessian[r, c] += weight * jacobian[r] * jacobian[c]
    return cost


@njit(cache=True)
def match_all(poses, walls, pairs, matching, offsets, partners):
    """Match every pair (a, b) of `pairs` (k, 2) at these world poses; `partners` from offsets[k] on are pair k's."""
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        x, y, theta = seen_from(poses[a], poses[b])
        match(walls, a, b, x, y, theta, matching, partners[offsets[k] : offsets[k + 1]])


@njit(cache=True)
def pull_all(poses, walls, pairs, matching, offsets, partners, gradients, hessians):
    """Derivatives (k, 3) and (k, 3, 3) of all pairs' matched points by the pair's relative pose; the sum of costs."""
    total = 0.0
    for k in range(pairs.shape[0]):
        x, y, theta = seen_from(poses[pairs[k, 0]], poses[pairs[k, 1]])
        total += pull(
            walls, pairs[k, 1], x, y, theta, matching, partners[offsets[k] : offsets[k + 1]], gradients[k], hessians[k]
        )
    return total


class WallMatches:
    """The walls' part of a refinement: which nodes are compared, and which of their points are one wall."""

    def __init__(self, walls: WallPoints):
        self.walls = walls
        self.pairs = np.empty((0, 2), np.int64)
        self.offsets = np.zeros(1, np.int64)
        self.partners = np.empty(0, np.int64)

    def associate(self, poses: np.ndarray, nearness: Nearness, matching: Matching) -> None:
        """Choose the pairs and match their points at these poses (n, 3)."""
        found = np.empty((len(poses) * nearness.visits, 2), np.int64)
        pairs = found[: near_pairs(poses, nearness.range, nearness.visits, nearness.gap, found)]
        self.matching = matching
        self.pairs = np.concatenate([pairs, pairs[:, ::-1]])  # each of the two is looked for in the other
        n_points = np.diff(self.walls.starts)[self.pairs[:, 1]]
        self.offsets = np.concatenate([[0], np.cumsum(n_points)]).astype(np.int64)
        self.partners = np.full(int(self.offsets[-1]), -1, np.int64)
        match_all(poses, self.walls, self.pairs, matching, self.offsets, self.partners)

    def terms(self, poses: np.ndarray) -> tuple[float, Terms]:
        """Cost and derivatives of the matched points at poses (n, 3)."""
        gradients, hessians = np.zeros((len(self.pairs), 3)), np.zeros((len(self.pairs), 3, 3))
        cost = pull_all(
            poses, self.walls, self.pairs, self.matching, self.offsets, self.partners, gradients, hessians
        )  # fmt: skip
        return cost, Terms(self.pairs[:, 0], self.pairs[:, 1], gradients, hessians)


@njit(cache=True, inline="always")
def seen_from(pose_a, pose_b):
    """The pose of b in a's frame."""
    cos, sin = math.cos(pose_a[2]), math.sin(pose_a[2])
    dx, dy = pose_b[0] - pose_a[0], pose_b[1] - pose_a[1]
    return cos * dx + sin * dy, cos * dy - sin * dx, pose_b[2] - pose_a[2]
