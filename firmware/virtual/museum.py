"""A seeded museum: halls of all shapes in a loop, walls at any angle, joined by straight and bent passages."""

from __future__ import annotations

import math

import numpy as np

from firmware.virtual.buildings import Site, circle, drive, pillars, resampled
from firmware.virtual.floorplan import Box, Disc, Floor

FROM_WALL = 0.75  # m that a visitor keeps from a hall's wall


def hall(floor: Floor, rng: np.random.Generator, x: float, y: float) -> float:
    """Carve a round hall, a box or two crossed boxes around (x, y); the radius that is free in it for sure."""
    kind = rng.integers(3)
    if kind == 0:
        radius = rng.uniform(1.9, 2.6)
        floor.carve(Disc(x, y, radius))
        return radius
    angle, length, width = rng.uniform(0.0, math.pi), rng.uniform(4.0, 5.2), rng.uniform(3.6, 4.4)
    floor.carve(Box(x, y, angle, length, width))
    if kind == 2:
        floor.carve(Box(x, y, angle + rng.uniform(0.4, 1.2), length, 0.6 * width))
    return 0.5 * width


def bent(a: np.ndarray, b: np.ndarray, bow: float) -> np.ndarray:
    """Points (n, 2) from a (2,) to b (2,) on a parabola that leaves the chord by `bow` m."""
    share = np.linspace(0.0, 1.0, 40)[:, None]
    aside = np.array([a[1] - b[1], b[0] - a[0]]) / math.hypot(*(b - a))
    return resampled(a + share * (b - a) + 4.0 * bow * share * (1.0 - share) * aside)


def museum(seed: int) -> Site:
    """Eight to ten halls in a loop of 60 to 100 m that is walked twice, past cases and pillars at any angle."""
    rng = np.random.default_rng([seed, 0xB2])
    n_halls = int(rng.integers(8, 11))
    bearings = 2.0 * math.pi * (np.arange(n_halls) + rng.uniform(-0.12, 0.12, n_halls)) / n_halls
    distances = 1.15 * n_halls + rng.uniform(-1.0, 1.0, n_halls)
    centres = np.column_stack([distances * np.cos(bearings), distances * np.sin(bearings)])
    floor = Floor()
    free = np.array([hall(floor, rng, *centre) for centre in centres])
    passages = []
    for i in range(n_halls):
        passage = bent(centres[i], centres[(i + 1) % n_halls], rng.choice([0.0, rng.uniform(-0.9, 0.9)]))
        width = rng.uniform(1.1, 1.5)
        for x, y in passage:
            floor.carve(Disc(x, y, 0.5 * width))
        passages.append(passage)
    ways = []
    for i in range(n_halls):
        into, out = passages[i - 1], passages[i]
        turn = free[i] - FROM_WALL
        into = into[np.hypot(*(into - centres[i]).T) > turn]
        into = into[np.hypot(*(into - centres[i - 1]).T) > free[i - 1] - FROM_WALL]
        away = out[np.argmax(np.hypot(*(out - centres[i]).T) > turn)] - centres[i]
        near = into[-1] - centres[i]
        begin, end = math.atan2(near[1], near[0]), math.atan2(away[1], away[0])
        round_left = (end - begin) % (2.0 * math.pi)
        end = begin + (round_left if rng.random() < 0.5 else round_left - 2.0 * math.pi)
        ways += [into, centres[i] + circle(turn, begin, end)]
    loop = np.vstack(ways)
    pillars(floor, rng, centres, loop, 6, 1.8)
    plan = drive(np.vstack([loop, loop, loop[: len(loop) // 8]]), rng, f"museum-{seed}", 0.08, 0.2)
    return Site(floor.world(plan, plan.name), plan)
