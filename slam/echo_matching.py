"""Which echoes of thin beams came from one wall, and how they pull at the places they were seen from.

An echo alone has no normal: it is that of the echoes around it, however they were come by. Echoes with like normals are
one wall; each is drawn onto the other's wall line under Geman and McClure's kernel. All work is done on echoes sorted
by square cells of the plane, so that it grows with their number and their density, not with the map.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.echoes import Echoes
from slam.pose import transform
from slam.pose_graph import Terms
from slam.wall_matching import seen_from

ROW = 1 << 32  # cells between two rows of the plane, more than any map is wide
FEWEST = 4  # echoes that make a wall
SHORTEST = 0.05  # m, least standard deviation of a wall's echoes along it
FLATTEST = 0.4  # of it, greatest standard deviation across
SAME_SIDE = 0.3  # cosine between the views of echoes that may be of one side of a wall


class Sorted(NamedTuple):
    """Points by square cells: `order` (m,) sorts them by `keys` (m,), which ascend; `cell` is a cell's width (m)."""

    order: np.ndarray
    keys: np.ndarray
    cell: float


def sort_cells(points: np.ndarray, cell: float) -> Sorted:
    """Sort points (m, 2) by cells of the plane."""
    columns, rows = np.floor(points / cell).astype(np.int64).T
    keys = rows * ROW + columns
    order = np.argsort(keys, kind="stable")
    return Sorted(order, keys[order], cell)


@njit(cache=True, inline="always")
def cell_range(cells, x, y, row):
    """First and one past the last place in `cells.order` of what lies in the three cells of a row next to (x, y)."""
    key = (math.floor(y / cells.cell) + row) * ROW + math.floor(x / cells.cell)
    return np.searchsorted(cells.keys, key - 1), np.searchsorted(cells.keys, key + 2)


@njit(cache=True)
def wall_normals(points, views, nodes, cells, radius, window):
    """Normals (m, 2), towards the sensor, of the walls that points in the world lie on; zeros where they make none.

    A wall is what at least `FEWEST` echoes within `radius` make, seen from the same side and from nodes at most
    `window` apart, if they lie along a line.
    """
    normals = np.zeros_like(points)
    for p in range(points.shape[0]):
        n, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(-1, 2):
            first, last = cell_range(cells, points[p, 0], points[p, 1], row)
            for place in range(first, last):
                q = cells.order[place]
                dx, dy = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]
                if (
                    dx * dx + dy * dy > radius * radius
                    or abs(nodes[q] - nodes[p]) > window
                    or views[p, 0] * views[q, 0] + views[p, 1] * views[q, 1] <= SAME_SIDE
                ):
                    continue
                n += 1
                sx, sy, sxx, sxy, syy = sx + dx, sy + dy, sxx + dx * dx, sxy + dx * dy, syy + dy * dy
        if n < FEWEST:
            continue
        xx, xy, yy = sxx / n - (sx / n) ** 2, sxy / n - sx * sy / n**2, syy / n - (sy / n) ** 2
        middle, swing = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        if middle + swing < SHORTEST**2 or middle - swing > FLATTEST**2 * (middle + swing):
            continue
        along = 0.5 * math.atan2(2.0 * xy, xx - yy)
        x, y = -math.sin(along), math.cos(along)
        side = -1.0 if x * views[p, 0] + y * views[p, 1] > 0.0 else 1.0
        normals[p, 0], normals[p, 1] = side * x, side * y
    return normals


@njit(cache=True)
def count_like(points, normals, nodes, cells, gate, like, counts):
    """Fill `counts` (m,): how many echoes of other nodes lie within `gate` of each and have a like normal."""
    for p in range(points.shape[0]):
        counts[p] = 0
        if normals[p, 0] == 0.0 and normals[p, 1] == 0.0:
            continue
        for row in range(-1, 2):
            first, last = cell_range(cells, points[p, 0], points[p, 1], row)
            for place in range(first, last):
                counts[p] += is_like(points, normals, nodes, p, cells.order[place], gate, like)


@njit(cache=True, inline="always")
def is_like(points, normals, nodes, p, q, gate, like):
    """Whether two echoes of different nodes may be of one wall."""
    dx, dy = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]
    return (
        nodes[q] != nodes[p]
        and dx * dx + dy * dy <= gate * gate
        and normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] > like
    )


@njit(cache=True)
def choose_partners(points, normals, nodes, cells, gate, like, counts, partners):
    """Fill `partners` (m, k) with up to k of the echoes that `count_like` counted, or -1.

    They are evenly spread over all there are: the nearest would mostly be those whose error is its own.
    """
    most = partners.shape[1]
    for p in range(points.shape[0]):
        partners[p] = -1
        seen, chosen = 0, 0
        if counts[p] == 0:
            continue
        for row in range(-1, 2):
            first, last = cell_range(cells, points[p, 0], points[p, 1], row)
            for place in range(first, last):
                q = cells.order[place]
                if is_like(points, normals, nodes, p, q, gate, like):
                    if chosen < most and seen * most >= chosen * counts[p]:
                        partners[p, chosen] = q
                        chosen += 1
                    seen += 1


@njit(cache=True)
def pull(poses, points, normals, nodes, echoes, partners, slots, sigma, kernel, gradients, hessians):
    """Add what `echoes` (r,) and their `partners` (r,) pull at the pose of the one's node as seen from the other's.

    `slots` (r,) say where in `gradients` (k, 3) and `hessians` (k, 3, 3); returns the cost. Points and normals are in
    their nodes' frames; `sigma` (m) is a residual's, from `kernel` standard deviations on it counts less and less.
    """
    cost = 0.0
    jacobian = np.empty(3)
    for i in range(echoes.size):
        p, q = echoes[i], partners[i]
        x, y, theta = seen_from(poses[nodes[q]], poses[nodes[p]])
        cos, sin = math.cos(theta), math.sin(theta)
        px, py = cos * points[p, 0] - sin * points[p, 1], sin * points[p, 0] + cos * points[p, 1]
        nx, ny = normals[q, 0] / sigma, normals[q, 1] / sigma
        residual = nx * (px + x - points[q, 0]) + ny * (py + y - points[q, 1])
        share = kernel * kernel / (kernel * kernel + residual * residual)
        cost += 0.5 * residual * residual * share
        jacobian[0], jacobian[1], jacobian[2] = nx, ny, ny * px - nx * py
        for r in range(3):
            gradients[slots[i], r] += share * share * residual * jacobian[r]
            for c in range(3):
                hessians[slots[i], r, c] += share * share * jacobian[r] * jacobian[c]
    return cost


class EchoMatches:
    """The echoes' part of a least-squares problem: which of them are one wall, and how they pull."""

    def __init__(self, echoes: Echoes, sigma: float, partners: int):
        self.echoes = echoes
        self.sigma = sigma
        self.most = partners
        self.normals = np.zeros_like(echoes.points)
        self.kernel = math.inf
        self.first = self.second = self.slots = self.matched = self.partners = np.empty(0, np.int64)

    def associate(self, poses: np.ndarray, radius: float, window: int, gate: float, like: float, kernel: float) -> None:
        """Find the walls at these poses (n, 3), and the echoes that are one wall; `kernel` in m."""
        echoes = self.echoes
        seats = poses[echoes.nodes]
        turns = seats * np.array([0.0, 0.0, 1.0])
        points, views = transform(seats, echoes.points), transform(turns, echoes.views)
        cells = sort_cells(points, max(radius, gate))
        normals = wall_normals(points, views, echoes.nodes, cells, radius, window)
        counts = np.empty(len(points), np.int64)
        count_like(points, normals, echoes.nodes, cells, gate, like, counts)
        partners = np.empty((len(points), self.most), np.int64)
        choose_partners(points, normals, echoes.nodes, cells, gate, like, counts, partners)
        self.normals = transform(-turns, normals)
        self.kernel = kernel / self.sigma
        self.matched, place = np.nonzero(partners >= 0)
        self.partners = partners[self.matched, place]
        pairs = echoes.nodes[self.partners] * len(poses) + echoes.nodes[self.matched]
        distinct, self.slots = np.unique(pairs, return_inverse=True)
        self.first, self.second = np.divmod(distinct, len(poses))

    @property
    def unmatched_cost(self) -> float:
        """What the matches would cost if nothing matched: the most that the kernel lets each cost."""
        return 0.5 * self.kernel**2 * len(self.matched) if len(self.matched) else 0.0

    def terms(self, poses: np.ndarray) -> tuple[float, Terms]:
        """Cost and derivatives at poses (n, 3)."""
        gradients, hessians = np.zeros((len(self.first), 3)), np.zeros((len(self.first), 3, 3))
        cost = pull(
            poses, self.echoes.points, self.normals, self.echoes.nodes, self.matched, self.partners, self.slots,
            self.sigma, self.kernel, gradients, hessians,
        )  # fmt: skip
        return cost, Terms(self.first, self.second, gradients, hessians)
