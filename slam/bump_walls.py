"""From the lines that bumps felt to walls as curves: stretches as far as they were felt, joined where they meet.

Between two stretches whose ends nearly meet the corner is taken to be where their lines cross: a bumper, wide as it is,
cannot feel into it. A round wall becomes a curve of many short stretches.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from slam.bump_swarm import BEYOND, HIGH, HITS, LOW, PHI, X, Y

BRIDGE = 0.25  # m by which a stretch may be drawn out to a corner
LEAST_BUMPS = 2  # that make a wall


def stretches(lines: np.ndarray, least: int = LEAST_BUMPS) -> np.ndarray:
    """Ends (m, 4) as x1 y1 x2 y2 of the lines (n, 10) that so many bumps felt, as far as they felt them."""
    lines = lines[lines[:, HITS] >= least]
    outward = np.column_stack([np.cos(lines[:, PHI]), np.sin(lines[:, PHI])])
    along = np.column_stack([-outward[:, 1], outward[:, 0]])
    base = lines[:, [X, Y]] + lines[:, BEYOND, None] * outward
    return np.hstack([base + lines[:, LOW, None] * along, base + lines[:, HIGH, None] * along])


def walls_of(lines: np.ndarray, bridge: float = BRIDGE) -> list[np.ndarray]:
    """Walls as curves, each the points (k, 2) of a chain of straight stretches; a closed one ends where it begins."""
    ends = stretches(lines).reshape(-1, 2, 2)
    corners = corners_of(ends, bridge)
    for (i, end), (j, other), point in corners:
        ends[i, end] = ends[j, other] = point
    curves = []
    for chain in chains_of(len(ends), corners):
        points = [ends[i, end] for i, end in chain[:1]]
        points += [ends[i, 1 - end] for i, end in chain]
        curves.append(np.array(points))
    return curves


def chains_of(
    n: int, corners: Sequence[tuple[tuple[int, int], tuple[int, int], np.ndarray]]
) -> list[list[tuple[int, int]]]:
    """Chains of n stretches that corners link: each one's number, and the end at which a walk along it begins."""
    links = {}
    for one, two, _ in corners:
        links[one], links[two] = two, one
    free = [(i, end) for i in range(n) for end in (0, 1) if (i, end) not in links]
    starts = [*free, *((i, 0) for i in range(n))]  # what has no free end is closed
    chains, seen = [], set()
    for start in starts:
        if start[0] in seen:
            continue
        i, end = start
        chain = []
        while i not in seen:
            seen.add(i)
            chain.append((i, end))
            if (i, 1 - end) not in links:
                break
            i, end = links[(i, 1 - end)]
        chains.append(chain)
    return chains


def corners_of(ends: np.ndarray, bridge: float) -> list[tuple[tuple[int, int], tuple[int, int], np.ndarray]]:
    """Pairs of ends of stretches (m, 2, 2) that meet in a corner, and the corner; the least drawn out first."""
    found = []
    for i in range(len(ends)):
        for j in range(i + 1, len(ends)):
            point = crossing(ends[i], ends[j])
            if point is None:
                continue
            one, two = (int(np.argmin(np.hypot(*(ends[k] - point).T))) for k in (i, j))
            ways = [float(np.hypot(*(ends[k, end] - point))) for k, end in ((i, one), (j, two))]
            if max(ways) < bridge:
                found.append((sum(ways), (i, one), (j, two), point))
    taken: set[tuple[int, int]] = set()
    corners = []
    for _, one, two, point in sorted(found, key=lambda each: each[0]):
        if one not in taken and two not in taken:
            taken |= {one, two}
            corners.append((one, two, point))
    return corners


def crossing(one: np.ndarray, two: np.ndarray) -> np.ndarray | None:
    """Where the lines through two stretches (2, 2) cross; none where they are as good as parallel."""
    first, second = one[1] - one[0], two[1] - two[0]
    area = float(first[0] * second[1] - first[1] * second[0])
    if abs(area) < 0.17 * float(np.hypot(*first) * np.hypot(*second)):  # ten degrees
        return None
    away = two[0] - one[0]
    return one[0] + (away[0] * second[1] - away[1] * second[0]) / area * first


def points_on(walls: list[np.ndarray], spacing: float = 0.01) -> np.ndarray:
    """Points (n, 2) on curves, at most `spacing` m from one to the next."""
    found = [np.zeros((0, 2))]
    for wall in walls:
        for start, end in itertools.pairwise(wall):
            n = 2 + int(np.hypot(*(end - start)) / spacing)
            found.append(start + np.linspace(0.0, 1.0, n)[:, None] * (end - start))
    return np.concatenate(found)


def distances(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Distance (n,) of each point (n, 2) from the nearest of segments (m, 4); inf where there are none."""
    if not len(segments):
        return np.full(len(points), np.inf)
    start, along = segments[None, :, :2], segments[None, :, 2:] - segments[None, :, :2]
    squares = np.maximum(np.sum(along * along, axis=-1), 1e-12)
    away = points[:, None] - start
    at = np.clip(np.sum(away * along, axis=-1) / squares, 0.0, 1.0)
    off = away - at[..., None] * along
    return np.sqrt(np.min(np.sum(off * off, axis=-1), axis=1))


def map_error(segments: np.ndarray, points: np.ndarray, true: np.ndarray, near: float = 0.05) -> tuple[float, float]:
    """Mean distance of points (n, 2) on mapped walls from true ones (m, 4), and the share of these that are mapped.

    A true wall is mapped where one of the map's `segments` (k, 4) is within `near` of it.
    """
    if not len(points):
        return math.inf, 0.0
    lengths = np.hypot(*(true[:, 2:] - true[:, :2]).T)
    spots = np.concatenate([
        start + np.linspace(0.0, 1.0, 2 + int(length / 0.01))[:, None] * (end - start)
        for start, end, length in zip(true[:, :2], true[:, 2:], lengths, strict=True)
    ])  # fmt: skip
    return float(np.mean(distances(points, true))), float(np.mean(distances(spots, segments) < near))
