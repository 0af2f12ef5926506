"""Walls ray by ray: from a grid by looking at every sample of a ray, from line segments by exact intersection."""

from __future__ import annotations

import itertools
import math

import numpy as np

from slam.walls import Walls
from tests.naive.local_map import cell_of


def cast(pose, segments, n_rays, reach):
    """Exact walls seen from `pose` among `segments` (k, 4) of ends; free up to the wall or the reach."""
    angles = pose[2] + 2.0 * np.pi * np.arange(n_rays) / n_rays
    distances = np.array([nearest_crossing(pose[:2], angle, segments) for angle in angles])
    return Walls(np.where(distances <= reach, distances, np.inf), np.minimum(distances, reach))


def nearest_crossing(start, angle, segments):
    """Distance along a ray to the first segment, or inf."""
    direction = np.array([math.cos(angle), math.sin(angle)])
    edges = segments[:, 2:] - segments[:, :2]
    offsets = segments[:, :2] - np.asarray(start)
    across = direction[0] * edges[:, 1] - direction[1] * edges[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offsets[:, 0] * edges[:, 1] - offsets[:, 1] * edges[:, 0]) / across
        share = (offsets[:, 0] * direction[1] - offsets[:, 1] * direction[0]) / across
    hits = along[(along > 0.0) & (share >= 0.0) & (share <= 1.0)]
    return float(hits.min()) if hits.size else math.inf


def rectangle(x, y, width, height):
    """The four sides (4, 4) of a rectangle whose middle is (x, y)."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [0.5 * width, 0.5 * height] + [x, y]
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def trace_ray(grid, pose, angle, tracing):
    """Distance to the first wall and distance seen free along one ray, from all its samples."""
    step = 0.5 * grid.resolution

    def value_at(distance):
        place = cell_of(grid, pose[0] + distance * math.cos(angle), pose[1] + distance * math.sin(angle))
        return None if place is None else float(grid.cells[place])

    def samples(start, end):
        """(distance, value) up to `end` or the border."""
        found, distance = [], start
        while distance < end and (value := value_at(distance)) is not None:
            found.append((distance, value))
            distance += step
        return found

    seen = samples(0.0, tracing.reach)
    first = next((i for i, (_, value) in enumerate(seen) if value > tracing.occupied), len(seen))
    wall = math.inf
    if first < len(seen):
        behind = samples(seen[first][0], seen[first][0] + tracing.thickness)
        run = list(itertools.takewhile(lambda sample: sample[1] > tracing.occupied, behind))
        wall = sum(d * value for d, value in run) / sum(value for _, value in run)
    free = 0.0
    for distance, value in seen[:first]:
        if value < tracing.free:
            free = distance
        elif distance - free > tracing.unseen_gap:
            break
    return wall, free


def trace_rays(grid, pose, n_rays, tracing):
    """All rays."""
    rays = [trace_ray(grid, pose, pose[2] + 2.0 * math.pi * i / n_rays, tracing) for i in range(n_rays)]
    return np.array([wall for wall, _ in rays]), np.array([free for _, free in rays])


def join_gaps(distances, join_rays, jump):
    """Every pair of rays with only empty ones between."""
    n = len(distances)
    joined = np.array(distances)
    for first in range(n):
        for gap in range(2, min(join_rays + 2, n)):
            last = (first + gap) % n
            inner = [(first + k) % n for k in range(1, gap)]
            if math.isinf(distances[first]) or not all(math.isinf(distances[ray]) for ray in inner):
                continue
            if abs(distances[first] - distances[last]) < jump:
                joined[inner] = np.linspace(distances[first], distances[last], gap + 1)[1:-1]
    return joined


def are_linked(distances, ray, jump):
    """Whether a ray and the next belong to one curve."""
    here, there = distances[ray], distances[(ray + 1) % len(distances)]
    return math.isfinite(here) and math.isfinite(there) and abs(here - there) <= jump


def curves_of(distances, jump):
    """The sets of rays that links connect, by merging."""
    n = len(distances)
    curves = [{ray} for ray in range(n) if math.isfinite(distances[ray])]
    for ray in range(n):
        if are_linked(distances, ray, jump):
            here = next(curve for curve in curves if ray in curve)
            there = next(curve for curve in curves if (ray + 1) % n in curve)
            if here is not there:
                curves.remove(there)
                here |= there
    return curves


def smooth_curves(distances, jump, shortest, sigma):
    """Each ray averaged with those that can be walked to along its curve."""
    n = len(distances)
    width = min(int(3.0 * sigma) + 1 if sigma > 0.0 else 0, n // 2 - 1)
    smooth = np.full(n, np.inf)
    for curve in curves_of(distances, jump):
        for ray in curve if len(curve) >= shortest else ():
            offsets = [0]
            for offset in range(width):
                if not are_linked(distances, (ray + offset) % n, jump):
                    break
                offsets.append(offset + 1)
            for offset in range(width):
                if not are_linked(distances, (ray - offset - 1) % n, jump):
                    break
                offsets.append(-offset - 1)
            shares = [math.exp(-0.5 * (offset / sigma) ** 2) if offset else 1.0 for offset in offsets]
            smooth[ray] = np.average([distances[(ray + offset) % n] for offset in offsets], weights=shares)
    return smooth


def random_walls(seed, n=120, reach=1.0):
    """Curves, gaps and free rays of no particular place."""
    rng = np.random.default_rng(seed)
    distances = np.where(np.repeat(rng.random(n // 6) < 0.6, 6), 0.7 + 0.02 * rng.normal(size=n).cumsum(), math.inf)
    distances = np.clip(distances, 0.15, math.inf)
    free = np.where(rng.random(n) < 0.8, np.minimum(distances, reach), 0.3)
    return Walls(distances, free)
