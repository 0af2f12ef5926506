"""Which earlier vertices a new one is compared with, and what is kept of every vertex for it.

Affinity is additive over pairs of vertices (Crunch thesis, 2.7), so that it grows with the path: a vertex is compared
with the nearest few vertices that lie long enough before it. The path filter and the local search share this.
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
    gaussian_points,
    label_raster,
    point_affinity,
    segment_affinity,
    wall_segments,
)
from slam.params import Params
from slam.walls import Walls


class ComparisonParams(Params):
    """Which vertices are compared, and how."""

    neighbours: int = Field(default=3, ge=1, le=100)  # earlier vertices compared with a new one, the nearest first
    range: float = Field(default=0.8, gt=0.0)  # m between vertices that are compared
    gap: int = Field(default=8, ge=1)  # vertices that must lie between them, for neighbours share the same readings
    affinity: AffinityParams = AffinityParams()


class Rule(NamedTuple):
    """What the kernels need of the parameters."""

    neighbours: int
    range: float
    gap: int
    gain: float
    by_points: bool
    segment_scale: float
    pattern: Pattern


@njit(cache=True, inline="always")
def keep_nearest(near, where, found, square, item):
    """Insert `item` at squared distance `square` into the ascending list `near`, `where`; how many it holds now."""
    if found == near.size and square >= near[found - 1]:
        return found
    found = min(found + 1, near.size)
    place = found - 1
    while place > 0 and near[place - 1] > square:
        near[place], where[place] = near[place - 1], where[place - 1]
        place -= 1
    near[place], where[place] = square, item
    return found


@njit(cache=True, inline="always")
def pair_affinity(labels, segments, rule, a, xa, ya, theta_a, b, xb, yb, theta_b):
    """Log weight of vertices a and b, at these poses, for agreeing."""
    if rule.by_points:
        return rule.gain * point_affinity(labels[a], labels[b], xa, ya, theta_a, xb, yb, theta_b, rule.pattern)
    return rule.gain * segment_affinity(segments[a], segments[b], xa, ya, theta_a, xb, yb, theta_b, rule.segment_scale)


@njit(cache=True, nogil=True)
def path_affinity(poses, first, labels, segments, rule):
    """Affinity of one path (n, 3): the sum over its vertices from `first` on, each with its nearest earlier ones."""
    near = np.empty(rule.neighbours)
    where = np.empty(rule.neighbours, np.int64)
    total = 0.0
    for newest in range(max(first, rule.gap), poses.shape[0]):
        found = 0
        x, y = poses[newest, 0], poses[newest, 1]
        for other in range(newest - rule.gap, -1, -1):
            dx, dy = poses[other, 0] - x, poses[other, 1] - y
            square = dx * dx + dy * dy
            if square < rule.range * rule.range:
                found = keep_nearest(near, where, found, square, other)
        for place in range(found):
            other = where[place]
            total += pair_affinity(
                labels, segments, rule, newest, x, y, poses[newest, 2],
                other, poses[other, 0], poses[other, 1], poses[other, 2],
            )  # fmt: skip
    return total


class Observations:
    """What the affinity looks at, by vertex: `labels` (capacity, size, size) int8, or `segments` (capacity, k, 5)."""

    def __init__(self, params: ComparisonParams, reach: float):
        affinity = params.affinity
        self.affinity = affinity
        self.reach = reach
        self.size = 2 * math.ceil((reach + affinity.wall_thickness) / affinity.label_cell)
        self.n_vertices = 0
        self.labels = np.zeros((64, self.size, self.size) if affinity.kind == "points" else (1, 1, 1), np.int8)
        self.segments = np.zeros((1, 1, 5))
        self.rule = Rule(
            params.neighbours,
            params.range,
            params.gap,
            affinity.gain if affinity.kind == "points" else affinity.segment_gain,
            affinity.kind == "points",
            affinity.segment_scale,
            Pattern(
                gaussian_points(affinity.n_points, affinity.spread * reach),
                affinity.label_cell,
                affinity.both_free,
                affinity.both_wall,
                affinity.differ,
                affinity.early_exit,
            ),
        )

    def add(self, walls: Walls) -> None:
        """Keep what will be compared of the next vertex's walls."""
        if self.affinity.kind == "points":
            if self.n_vertices == self.labels.shape[0]:
                self.labels = np.concatenate([self.labels, np.zeros_like(self.labels)])
            self.labels[self.n_vertices] = label_raster(
                walls.distances, walls.free, self.size, self.affinity.label_cell, self.affinity.wall_thickness,
                self.affinity.states, self.reach,
            )  # fmt: skip
        else:
            rows = wall_segments(walls)
            if self.n_vertices == 0:
                self.segments = np.zeros((64, *rows.shape))
            elif self.n_vertices == self.segments.shape[0]:
                self.segments = np.concatenate([self.segments, np.zeros_like(self.segments)])
            self.segments[self.n_vertices] = rows
        self.n_vertices += 1
