"""A seeded corridor cycle, the shape of the thesis's Figure 5: a rectangle with doors, pillars and alcoves."""

from __future__ import annotations

import numpy as np

from firmware.virtual.plans import Plan
from firmware.virtual.worlds import World

ASPECT = (0.32, 0.18)  # sides of the centre line per metre of its length: 16 x 9 m for 50 m
KINDS = ("door", "pillar", "alcove", "opening", "flush door")
SHARES = (0.45, 0.25, 0.10, 0.05, 0.15)
FROM_CORNER = 0.9  # m of plain wall beside a corner
OPENING_FROM_CORNER = 2.8  # so that two openings never meet behind an inner corner
CORNER_RADIUS = 0.6  # m, of the way driven


def sides_of(length: float) -> tuple[float, float]:
    """Length and height of the centre line's rectangle."""
    return ASPECT[0] * length, ASPECT[1] * length


def feature(rng: np.random.Generator, room: float, along: float, side: float) -> tuple[float, float]:
    """Width and depth (away from the corridor) of the next thing in a wall, `along` from its beginning."""
    kind = rng.choice(KINDS, p=SHARES)
    if kind == "opening" and not OPENING_FROM_CORNER < along < side - OPENING_FROM_CORNER - 1.4:
        kind = "door"
    if kind == "door":
        return 0.9, rng.choice([0.08, 0.12, 0.18])
    if kind == "flush door":
        return 0.9, 0.03
    if kind == "pillar":
        return rng.choice([0.3, 0.45]), -rng.choice([0.10, 0.15, 0.20])
    if kind == "alcove":
        return rng.uniform(0.9, 1.8), min(rng.uniform(0.4, 0.9), room)
    return 1.4, min(2.5, room)


def wall(rng: np.random.Generator, start: np.ndarray, end: np.ndarray, outward: np.ndarray, room: float) -> np.ndarray:
    """Segments (n, 4) of one wall; recesses go along `outward`, at most `room` deep."""
    side = float(np.hypot(*(end - start)))
    direction = (end - start) / side
    points = [start]
    along = FROM_CORNER + rng.uniform(0.0, 1.0)
    while True:
        width, depth = feature(rng, room, along, side)
        if along + width > side - FROM_CORNER:
            break
        near, far = start + direction * along, start + direction * (along + width)
        points += [near, near + outward * depth, far + outward * depth, far]
        along += width + rng.uniform(0.8, 3.2)
    points.append(end)
    return np.hstack([points[:-1], points[1:]])


def corridor_cycle(seed: int, length: float = 50.0, width: float = 1.8) -> World:
    """Corridors `width` wide around a rectangle whose centre line is `length` long; starts on its lower side."""
    sx, sy = sides_of(length)
    if not 0.8 <= width < 0.6 * sy:
        raise ValueError(f"width {width} m does not fit a cycle of {length} m; use 0.8 to {0.6 * sy:.1f} m")
    rng = np.random.default_rng([seed, 0xC0])
    half = 0.5 * width
    walls = []
    for grow, room in ((half, 2.5), (-half, 0.38 * (sy - width))):
        left, bottom, right, top = -grow, -grow, sx + grow, sy + grow
        corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
        for i, normal in enumerate(((0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0))):
            outward = np.array(normal) * np.sign(grow)
            walls.append(wall(rng, corners[i], corners[(i + 1) % 4], outward, room))
    return World(np.vstack(walls), (0.4 * sx, 0.0, 0.0), f"corridor-{length:g}-{width:g}-{seed}")


def centre_line(length: float, step: float) -> np.ndarray:
    """Points (n, 2) every `step` once around, corners rounded, from the middle of the lower side on."""
    sx, sy = sides_of(length)
    r = CORNER_RADIUS
    quarter = np.linspace(0.0, 0.5 * np.pi, max(2, int(0.5 * np.pi * r / step)))
    corners = [(sx - r, r, -0.5), (sx - r, sy - r, 0.0), (r, sy - r, 0.5), (r, r, 1.0)]
    arcs = [
        np.column_stack([x + r * np.cos(np.pi * a + quarter), y + r * np.sin(np.pi * a + quarter)])
        for x, y, a in corners
    ]
    start = np.array([[0.4 * sx, 0.0]])
    corner_points = np.vstack([start, *arcs, start])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corner_points, axis=0).T))])
    at = np.arange(0.0, along[-1], step)
    return np.column_stack([np.interp(at, along, corner_points[:, i]) for i in range(2)])


def corridor_plan(
    seed: int, length: float = 50.0, laps: float = 2.2, speed: float = 0.3, wobble: float = 0.12, reverse: bool = False
) -> Plan:
    """Plan of so many laps of the cycle, wandering to both sides with a standard deviation of `wobble` (m) over 2 m.

    With `reverse`, the robot turns around after the first lap. 2.2 laps of 50 m are 357 s at 0.3 m/s, as measured upon.
    """
    step = 0.1
    lap = centre_line(length, step)
    rng = np.random.default_rng([seed, 0xC1])
    count = int(len(lap) * laps)
    order = np.arange(count)
    if reverse:
        order = np.where(order < len(lap), order, 2 * len(lap) - 1 - order)
    order %= len(lap)
    tangents = np.roll(lap, -1, axis=0) - np.roll(lap, 1, axis=0)
    tangents /= np.hypot(*tangents.T)[:, None]
    knots = np.arange(0.0, count * step + 4.0, 2.0)
    offsets = smooth(np.arange(count) * step, knots, np.clip(rng.normal(0.0, wobble, len(knots)), -0.3, 0.3))
    tangents = tangents[order]
    points = lap[order] + np.column_stack([-tangents[:, 1], tangents[:, 0]]) * offsets[:, None]
    return Plan.through(points, speed, name=f"corridor-{laps:g}-laps-{seed}")


def smooth(at: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values between knots with a level tangent at each (cosine steps)."""
    index = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    part = (at - knots[index]) / (knots[index + 1] - knots[index])
    blend = 0.5 - 0.5 * np.cos(np.pi * part)
    return values[index] * (1.0 - blend) + values[index + 1] * blend
