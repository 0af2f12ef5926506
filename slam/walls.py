"""The compact observation of a vertex: per ray the distance to the first wall, and how far the ray was seen free.

Rays are traced in the local map from the robot outwards, joined into curves and filtered as the thesis describes
(2.1): short curves dropped, curves that only a few empty rays part joined, the rest smoothed with a Gaussian.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.local_map import LocalMap
from slam.params import Params


class WallParams(Params):
    """How rays are traced and which curves are kept."""

    n_rays: int = Field(default=120, ge=8, le=3600)
    occupied: float = Field(default=0.6, gt=0.0)  # log odds above which a cell is a wall
    free: float = Field(default=-0.3, lt=0.0)  # log odds below which a cell was seen free
    thickness: float = Field(default=0.16, gt=0.0)  # m of an occupied run whose centroid is the wall
    unseen_gap: float = Field(default=0.08, ge=0.0)  # m of unknown that a free ray may cross
    join_rays: int = Field(default=4, ge=0)  # empty rays that a curve may bridge
    jump: float = Field(default=0.15, gt=0.0)  # m between neighbouring rays that part two curves
    shortest: int = Field(default=4, ge=1)  # rays of the shortest curve kept
    smoothing: float = Field(default=1.5, ge=0.0, le=100.0)  # rays, sigma of the Gaussian along a curve


class Walls(NamedTuple):
    """Ray i looks along 2 pi i / n in the robot's frame: `distances` (n,) m to the wall or inf, `free` (n,) m."""

    distances: np.ndarray
    free: np.ndarray


class Tracing(NamedTuple):
    """The parameters of a ray as the kernel takes them, and how far (m) it is followed."""

    reach: float
    occupied: float
    free: float
    thickness: float
    unseen_gap: float


@njit(cache=True)
def trace_rays(grid, pose, n_rays, tracing):
    """Distances (n_rays,) to the first wall, or inf, and distances (n_rays,) seen free.

    A wall is the centroid of an occupied run. `pose` is (x, y, theta) in the grid's frame.
    """
    cells, resolution = grid.cells, grid.resolution
    x, y, theta = pose[0] - grid.x, pose[1] - grid.y, pose[2]
    n = cells.shape[0]
    distances = np.full(n_rays, np.inf)
    free = np.zeros(n_rays)
    step = 0.5 * resolution
    for ray in range(n_rays):
        angle = theta + 2.0 * math.pi * ray / n_rays
        cos, sin = math.cos(angle), math.sin(angle)
        distance, is_open = 0.0, True
        while distance < tracing.reach:
            row, column = math.floor((y + distance * sin) / resolution), math.floor((x + distance * cos) / resolution)
            if row < 0 or column < 0 or row >= n or column >= n:
                break
            value = cells[row, column]
            if value > tracing.occupied:
                weight, moment, depth = 0.0, 0.0, distance
                while depth < distance + tracing.thickness:
                    row, column = math.floor((y + depth * sin) / resolution), math.floor((x + depth * cos) / resolution)
                    if row < 0 or column < 0 or row >= n or column >= n or cells[row, column] <= tracing.occupied:
                        break
                    weight += cells[row, column]
                    moment += cells[row, column] * depth
                    depth += step
                distances[ray] = moment / weight
                break
            if value < tracing.free:
                if is_open:
                    free[ray] = distance
            elif distance - free[ray] > tracing.unseen_gap:
                is_open = False
            distance += step
    return distances, free


@njit(cache=True)
def join_gaps(distances, join_rays, jump):
    """Bridge up to `join_rays` empty rays between ends that agree within `jump`, linearly (circular)."""
    n = distances.size
    joined = distances.copy()
    for ray in range(n):
        if not (math.isfinite(distances[ray]) and not math.isfinite(distances[(ray + 1) % n])):
            continue
        for gap in range(2, join_rays + 2):
            far = distances[(ray + gap) % n]
            if math.isfinite(far):
                if abs(far - distances[ray]) < jump:
                    for inner in range(1, gap):
                        joined[(ray + inner) % n] = distances[ray] + (far - distances[ray]) * inner / gap
                break
    return joined


@njit(cache=True)
def label_curves(distances, jump):
    """Number of the curve that each ray belongs to, from 1; 0 where there is no wall (circular)."""
    n = distances.size
    labels = np.zeros(n, np.int64)
    start = 0
    for ray in range(n):
        before = distances[ray - 1]
        if not (math.isfinite(before) and math.isfinite(distances[ray]) and abs(before - distances[ray]) <= jump):
            start = ray
            break
    curve = 0
    for turn in range(n):
        ray = (start + turn) % n
        if not math.isfinite(distances[ray]):
            continue
        before = distances[ray - 1]
        if turn == 0 or not math.isfinite(before) or abs(before - distances[ray]) > jump:
            curve += 1
        labels[ray] = curve
    return labels


@njit(cache=True)
def smooth_curves(distances, labels, jump, shortest, sigma):
    """Distances with short curves dropped and the others smoothed along themselves with a Gaussian of `sigma` rays."""
    n = distances.size
    lengths = np.zeros(labels.max() + 1, np.int64)
    for ray in range(n):
        lengths[labels[ray]] += 1
    smooth = np.full(n, np.inf)
    width = min(int(3.0 * sigma) + 1 if sigma > 0.0 else 0, n // 2 - 1)
    for ray in range(n):
        if labels[ray] == 0 or lengths[labels[ray]] < shortest:
            continue
        total, weight = distances[ray], 1.0
        for side in (-1, 1):
            before = ray
            for offset in range(1, width + 1):
                other = (ray + side * offset) % n
                if labels[other] == 0 or abs(distances[other] - distances[before]) > jump:
                    break  # the curve ends here, though its other end may lie beyond
                share = math.exp(-0.5 * (offset / sigma) ** 2)
                total += share * distances[other]
                weight += share
                before = other
        smooth[ray] = total / weight
    return smooth


def extract(local_map: LocalMap, pose: np.ndarray, params: WallParams) -> Walls:
    """The walls seen from `pose` (3,) in the odometry frame."""
    tracing = Tracing(local_map.reach, params.occupied, params.free, params.thickness, params.unseen_gap)
    distances, free = trace_rays(local_map.grid(), local_map.in_grid(pose), params.n_rays, tracing)
    joined = join_gaps(distances, params.join_rays, params.jump)
    labels = label_curves(joined, params.jump)
    return Walls(smooth_curves(joined, labels, params.jump, params.shortest, params.smoothing), free)


def curves(walls: Walls, jump: float = 0.15) -> list[np.ndarray]:
    """The walls as curves, each (k, 2) in the vertex's frame, counter-clockwise."""
    labels = label_curves(walls.distances, jump)
    n = labels.size
    angles = 2.0 * np.pi * np.arange(n) / n
    points = np.where(np.isfinite(walls.distances), walls.distances, 0.0)[:, None] * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )
    with np.errstate(invalid="ignore"):
        is_start = ~(np.abs(walls.distances - np.roll(walls.distances, 1)) <= jump)
    rays = np.roll(np.arange(n), -int(np.argmax(is_start)))  # a curve may cross ray 0
    borders = np.flatnonzero(np.diff(labels[rays])) + 1
    parts = np.split(rays, borders)
    return [points[part] for part in parts if labels[part[0]] > 0]
