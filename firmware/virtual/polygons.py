"""Rooms that are polygons, made at random, for a cart with a bumper; and walls that are segments joined to outlines."""

from __future__ import annotations

import math

import numpy as np

from firmware.virtual.worlds import World, WorldError

SIDE = 1.5  # m, the longer one of a room's bounding box
LEAST_WALL = 0.3  # m
LEAST_ANGLE = math.radians(50.0)  # of a corner, so that the cart gets out of it
LEAST_WIDTH = 0.25  # m from a corner to a wall that does not end there
JOINED = 1e-6  # m


def polygon(seed: int) -> World:
    """A room of 5 to 8 walls: convex for even seeds; for odd ones it has a corner at least that points inward."""
    rng = np.random.default_rng([seed, 0x9017])
    while True:
        corners = convex(rng) if seed % 2 == 0 else star(rng)
        corners *= SIDE / np.ptp(corners, axis=0).max()
        corners -= corners.min(axis=0)
        has_reflex = bool(np.any(turns(corners) < 0.0))
        if is_roomy(corners) and has_reflex == bool(seed % 2):
            break
    segments = np.column_stack([corners, np.roll(corners, -1, axis=0)])
    middle = inner_place(segments)
    return World(segments, (*middle, 0.0), f"polygon-{seed}")


def polygon_named(name: str) -> World:
    """The room `polygon:SEED`, as in polygon:3; WorldError."""
    seed = name.partition(":")[2]
    if not seed.isdecimal():
        raise WorldError(f"{name}: names no polygon; write polygon:3, with any whole number as its seed")
    return polygon(int(seed))


def convex(rng: np.random.Generator) -> np.ndarray:
    """Corners (n, 2) on an ellipse at random bearings, counter-clockwise."""
    bearings = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(5, 8)))
    across = rng.uniform(0.65, 1.0)
    return np.column_stack([np.cos(bearings), across * np.sin(bearings)])


def star(rng: np.random.Generator) -> np.ndarray:
    """Corners (n, 2) that all see one place, near and far from it, counter-clockwise."""
    n = int(rng.integers(6, 9))
    bearings = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * (2.0 * math.pi / n)
    return rng.uniform(0.45, 1.0, (n, 1)) * np.column_stack([np.cos(bearings), np.sin(bearings)])


def turns(corners: np.ndarray) -> np.ndarray:
    """Angle (n,) by which a walk along the walls turns left at each corner (n, 2)."""
    ahead = np.roll(corners, -1, axis=0) - corners
    behind = np.roll(ahead, 1, axis=0)
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    return np.arctan2(cross, np.sum(behind * ahead, axis=1))


def is_roomy(corners: np.ndarray) -> bool:
    """Whether no wall is short, no corner sharp, and no place between two walls narrow."""
    ahead = np.roll(corners, -1, axis=0) - corners
    if np.hypot(*ahead.T).min() < LEAST_WALL or np.ptp(corners, axis=0).min() < 0.6 * SIDE:
        return False
    turned = turns(corners)
    if abs(turned.sum() - 2.0 * math.pi) > 1e-6 or turned.max() > math.pi - LEAST_ANGLE or turned.min() < -1.5:
        return False
    n = len(corners)
    pairs = [(i, j) for i in range(n) for j in range(n) if (j - i) % n not in (0, n - 1)]  # a corner, a wall elsewhere
    return min(distance(corners[i], corners[j], corners[(j + 1) % n]) for i, j in pairs) >= LEAST_WIDTH


def distance(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Of a point (2,) from the stretch between two."""
    along = end - start
    share = np.clip((point - start) @ along / (along @ along), 0.0, 1.0)
    return float(np.hypot(*(start + share * along - point)))


def inner_place(segments: np.ndarray) -> tuple[float, float]:
    """The place farthest from all walls (n, 4), of those on a grid of 5 cm."""
    world = World(segments)
    left, bottom, right, top = world.bounds
    x, y = np.meshgrid(np.arange(left, right, 0.05), np.arange(bottom, top, 0.05))
    places = np.column_stack([x.ravel(), y.ravel()])
    clear = np.where(inside(segments, places), world.clearances(places, SIDE), -1.0)
    best = places[int(np.argmax(clear))]
    return float(best[0]), float(best[1])


def inside(segments: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points (n, 2) are in free space: a ray from there crosses an odd number of the walls (m, 4)."""
    x1, y1, x2, y2 = segments.T[..., None]
    x, y = points.T
    spans = (y1 > y) != (y2 > y)
    rise = np.where(y2 == y1, 1.0, y2 - y1)
    return np.count_nonzero(spans & (x1 + (y - y1) / rise * (x2 - x1) > x), axis=0) % 2 == 1


def closed_outlines(segments: np.ndarray, name: str) -> list[np.ndarray]:
    """Walls (m, 4) joined end to end into outlines (n, 2) of their corners, that of the largest area first.

    Raises WorldError where a wall's end does not meet exactly one other wall's.
    """
    left = {number: (start, end) for number, (start, end) in enumerate(segments.reshape(-1, 2, 2))}
    outlines = []
    while left:
        first, place = left.pop(min(left))
        corners = [first]
        while np.hypot(*(place - first)) > JOINED:
            corners.append(place)
            ends = [(number, k) for number, pair in left.items() for k in (0, 1) if is_same(pair[k], place)]
            if len(ends) != 1:
                raise WorldError(
                    f"{name}: {len(ends)} walls go on at ({place[0]:.3f}, {place[1]:.3f}), where exactly one must: "
                    "only closed outlines can be a map for a bumper"
                )
            number, k = ends[0]
            place = left.pop(number)[1 - k]
        outlines.append(np.array(corners))
    return sorted(outlines, key=lambda corners: -abs(area(corners)))


def is_same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two corners (2,) are one."""
    return bool(np.hypot(*(a - b)) <= JOINED)


def area(corners: np.ndarray) -> float:
    """Of an outline (n, 2), m2; positive counter-clockwise."""
    (x, y), (u, v) = corners.T, np.roll(corners, -1, axis=0).T
    return 0.5 * float(np.sum(x * v - u * y))
