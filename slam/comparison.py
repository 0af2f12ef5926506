"""Which earlier vertices a new one is compared with, and what is kept of every vertex for it.

Affinity is additive over pairs of vertices (Crunch thesis, 2.7), so that it grows with the path: a vertex is compared
with the nearest few vertices that lie long enough before it. The path filter and the local search share this. Uses
its siblings `affinity`, `wall_direction` and `walls`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.affinity import (
    AffinityParams,
    Pattern,
    early_affinity,
    label_raster,
    pattern_of,
    point_affinity,
    segment_affinity,
    wall_segments,
)
from slam.params import Params
from slam.wall_direction import wall_direction
from slam.walls import Walls

COHORT = 24  # vertices, that stand for walls of elsewhere


class ComparisonParams(Params):
    """Which vertices are compared, and how."""

    neighbours: int = Field(default=3, ge=1, le=100)  # earlier vertices compared with a new one, the nearest first
    range: float = Field(default=0.8, gt=0.0)  # m between vertices that are compared
    gap: int = Field(default=8, ge=1)  # vertices that must lie between them, for neighbours share the same readings
    chance: float = Field(default=0.0, ge=0.0, le=1.0)  # share of what a vertex's points score elsewhere, taken off
    affinity: AffinityParams = AffinityParams()


class Rule(NamedTuple):
    """What the kernels need of the parameters."""

    neighbours: int
    range: float
    gap: int
    gain: float
    by_points: bool
    segment_scale: float
    chance: float
    pattern: Pattern


class Seen(NamedTuple):
    """What the kernels need of the vertices' walls: label rasters one after the other (flat), or segments (v, k, 5).

    `chances` (v,) is what vertices score with walls of elsewhere, where a share of it is taken off.
    """

    labels: np.ndarray
    size: int
    segments: np.ndarray
    chances: np.ndarray


@njit(cache=True, inline="always")
def keep_nearest(near, where, place, square, item):
    """Insert `item` at squared distance `square` into row `place` of the ascending lists `near`, `where` (n, k).

    A list that is not full ends in places of what would just not be near any more.
    """
    last = near.shape[1] - 1
    if square >= near[place, last]:
        return
    while last > 0 and near[place, last - 1] > square:
        near[place, last], where[place, last] = near[place, last - 1], where[place, last - 1]
        last -= 1
    near[place, last], where[place, last] = square, item


@njit(cache=True, inline="always")
def pair_affinity(seen, rule, a, xa, ya, theta_a, b, xb, yb, theta_b, cells):
    """Log weight of vertices a and b, at these poses, for agreeing; `cells` two (m,) int32 to work in."""
    if not rule.by_points:
        first, second = seen.segments[a], seen.segments[b]
        return rule.gain * segment_affinity(first, second, xa, ya, theta_a, xb, yb, theta_b, rule.segment_scale)
    if rule.pattern.early_exit > -math.inf:
        score = early_affinity(seen.labels, seen.size, a, b, xa, ya, theta_a, xb, yb, theta_b, rule.pattern, cells)
    else:
        score = point_affinity(seen.labels, seen.size, a, b, xa, ya, theta_a, xb, yb, theta_b, rule.pattern, cells)
    return rule.gain * (score - rule.chance * seen.chances[a])


@njit(cache=True, inline="always")
def points_pair_affinity(seen, rule, a, xa, ya, theta_a, b, xb, yb, theta_b, cells):
    """The same where all test points are looked at: without the other cases beside it the loop is faster by a third."""
    score = point_affinity(seen.labels, seen.size, a, b, xa, ya, theta_a, xb, yb, theta_b, rule.pattern, cells)
    return rule.gain * (score - rule.chance * seen.chances[a])


@njit(cache=True, inline="always")
def room_for_cells(rule):
    """What comparing a pair needs to work in."""
    return np.empty(rule.pattern.x.size, np.int32), np.empty(rule.pattern.x.size, np.int32)


@njit(cache=True, nogil=True)
def chance_score(seen, rule, newest, others, cells):
    """What vertex `newest` scores with walls of elsewhere: the median over `others` (n,), each laid on it well.

    They are laid where a path along the same passage would have them: abreast, aside by up to 0.3 m, one way or the
    other round. Wherever a building looks like itself this is high, and likeness proves little.
    """
    best = np.full(others.size, -math.inf)
    for k in range(others.size):
        for theta in (0.0, math.pi):
            for aside in range(-2, 3):
                score = point_affinity(
                    seen.labels, seen.size, newest, others[k], 0.0, 0.0, 0.0, 0.0, 0.15 * aside, theta, rule.pattern,
                    cells,
                )  # fmt: skip
                best[k] = max(best[k], score)
    return max(0.0, np.median(best))  # walls unlike any others are no more likely to be met


@njit(cache=True, nogil=True)
def path_affinity(poses, first, seen, rule):
    """Affinity of one path (n, 3): the sum over its vertices from `first` on, each with its nearest earlier ones."""
    near = np.empty((1, rule.neighbours))
    where = np.empty((1, rule.neighbours), np.int64)
    cells = room_for_cells(rule)
    total = 0.0
    for newest in range(max(first, rule.gap), poses.shape[0]):
        near[:], where[:] = rule.range * rule.range, -1
        x, y = poses[newest, 0], poses[newest, 1]
        for other in range(newest - rule.gap, -1, -1):
            dx, dy = poses[other, 0] - x, poses[other, 1] - y
            square = dx * dx + dy * dy
            if square < near[0, -1]:  # most are not, and are passed over five times as fast
                keep_nearest(near, where, 0, square, other)
        for other in where[0]:
            if other >= 0:
                total += pair_affinity(
                    seen, rule, newest, x, y, poses[newest, 2],
                    other, poses[other, 0], poses[other, 1], poses[other, 2], cells,
                )  # fmt: skip
    return total


def rule_of(params: ComparisonParams, reach: float) -> Rule:
    """What the kernels need of the parameters, for local maps of this reach (m)."""
    affinity = params.affinity
    by_points = affinity.kind == "points"
    return Rule(
        params.neighbours, params.range, params.gap, affinity.gain if by_points else affinity.segment_gain, by_points,
        affinity.segment_scale, params.chance, pattern_of(affinity, reach),
    )  # fmt: skip


class Observations:
    """What is kept of every vertex's walls, by vertex.

    What the affinity looks at, `labels` (capacity, size, size) int8 or `segments` (capacity, k, 5), and the dominant
    `directions` as of `slam.wall_direction.wall_direction`.
    """

    def __init__(self, params: ComparisonParams, reach: float):
        affinity = params.affinity
        self.affinity = affinity
        self.reach = reach
        self.size = 2 * (math.ceil((reach + affinity.wall_thickness) / affinity.label_cell) + 1)
        self.n_vertices = 0
        self.labels = np.zeros((64, self.size, self.size) if affinity.kind == "points" else (1, 1, 1), np.int8)
        self.segments = np.zeros((1, 1, 5))
        self.chances = np.zeros(64)
        self.directions: list[complex] = []
        self.rule = rule_of(params, reach)

    @property
    def seen(self) -> Seen:
        """The same as the kernels take it."""
        return Seen(self.labels.reshape(-1), self.size, self.segments, self.chances)

    def add(self, walls: Walls) -> None:
        """Keep what will be compared of the next vertex's walls; nothing of walls that cannot be."""
        direction = wall_direction(walls)
        if self.affinity.kind == "points":
            if self.n_vertices == self.labels.shape[0]:
                self.labels = np.concatenate([self.labels, np.zeros_like(self.labels)])
            self.labels[self.n_vertices] = label_raster(
                walls.distances, walls.free, self.size, self.affinity.label_cell, self.affinity.wall_thickness,
                self.affinity.states, self.reach,
            )  # fmt: skip
            self.find_chance()
        else:
            rows = wall_segments(walls)
            if self.n_vertices == 0:
                self.segments = np.zeros((64, *rows.shape))
            elif self.n_vertices == self.segments.shape[0]:
                self.segments = np.concatenate([self.segments, np.zeros_like(self.segments)])
            self.segments[self.n_vertices] = rows
        self.directions.append(direction)
        self.n_vertices += 1

    def find_chance(self) -> None:
        """Work out what the newest vertex scores with walls of elsewhere: vertices all along the path."""
        if self.n_vertices == self.chances.size:
            self.chances = np.concatenate([self.chances, np.zeros_like(self.chances)])
        n_earlier = self.n_vertices + 1 - self.rule.gap
        if self.rule.chance > 0.0 and n_earlier > 0:
            others = np.unique(np.linspace(0, n_earlier - 1, COHORT).astype(np.int64))
            self.chances[self.n_vertices] = chance_score(
                self.seen, self.rule, self.n_vertices, others, room_for_cells(self.rule)
            )
