"""Seeded buildings whose corridors run side by side, less than two metres apart, and are all driven, twice."""

from __future__ import annotations

import numpy as np

from firmware.virtual.buildings import FROM_CORNER, Site, drive, fitting
from firmware.virtual.floorplan import Box, Floor, side
from firmware.virtual.plans import Plan


def furnish_lane(floor: Floor, rng: np.random.Generator, a: np.ndarray, b: np.ndarray, width: float) -> None:
    """Pillars, flush doors and shelves on both walls of the lane from a (2,) to b (2,): its walls are thin."""
    length = float(np.hypot(*(b - a)))
    along = (b - a) / length
    for hand in (1.0, -1.0):
        outward = hand * np.array([-along[1], along[0]])
        at = FROM_CORNER + rng.uniform(0.0, 1.0)
        while True:
            wide, deep = fitting(rng, 0.03)
            if deep > 0.0 and rng.random() < 0.3:
                wide, deep = rng.uniform(0.8, 1.6), -0.15  # a shelf
            if at + wide > length - FROM_CORNER:
                break
            x, y = a + along * (at + 0.5 * wide) + outward * (0.5 * width + 0.5 * deep)
            box = Box(x, y, float(np.arctan2(along[1], along[0])), wide, abs(deep))
            (floor.carve if deep > 0.0 else floor.build)(box)
            at += wide + rng.uniform(0.8, 3.2)


def parallel_corridors(seed: int) -> Site:
    """Lanes 1.2 to 1.75 m apart: rows between two end corridors, or every other seed two rings, one in the other."""
    return rows(seed) if seed % 2 == 0 else rings(seed)


def rows(seed: int) -> Site:
    """Four lanes up and down in turn, and back to the first one; 2.2 times."""
    rng = np.random.default_rng([seed, 0xB3])
    width, length = rng.uniform(1.05, 1.3), rng.uniform(9.0, 13.0)
    apart = width + rng.uniform(0.12, 0.45)
    floor = Floor()
    ends = np.array([[[apart * lane, 0.0], [apart * lane, length]] for lane in range(4)])
    for bottom, top in ends:
        floor.carve(side(bottom, top, width))
    for end in (0, 1):
        floor.carve(side(ends[0, end], ends[-1, end], 1.3, 0.5 * width))
    is_bare = rng.random() < 0.25
    for bottom, top in ends:
        if not is_bare:
            furnish_lane(floor, rng, bottom, top, width)
    lap = np.vstack([lane if i % 2 == 0 else lane[::-1] for i, lane in enumerate(ends)])
    plan = drive(np.vstack([lap, lap, lap[:2]]), rng, f"rows-{seed}", 0.08, 0.2)
    return site(floor, plan)


def rings(seed: int) -> Site:
    """A ring of corridors around another: once around the outer, once around the inner, then the outer again."""
    rng = np.random.default_rng([seed, 0xB4])
    width, wide, high = rng.uniform(1.05, 1.3), rng.uniform(12.0, 15.0), rng.uniform(8.0, 10.0)
    apart = width + rng.uniform(0.12, 0.45)
    floor = Floor()
    corners = []
    for inset in (0.0, apart):
        left, bottom, right, top = inset, inset, wide - inset, high - inset
        ring = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
        for i in range(4):
            floor.carve(side(ring[i], ring[(i + 1) % 4], width, 0.5 * width))
        corners.append(ring)
    is_bare = rng.random() < 0.25
    for ring in corners:
        for i in range(4):
            if not is_bare:
                furnish_lane(floor, rng, ring[i], ring[(i + 1) % 4], width)
    outer, inner = corners
    gate = np.array([0.5 * wide, 0.0])
    through = gate + np.array([0.0, apart])
    floor.carve(side(gate, through, 1.0))
    lap = np.vstack([gate, outer[1:], outer[:1], gate])
    way = np.vstack([lap, through, inner[1:], inner[:1], through, lap])
    plan = drive(way, rng, f"rings-{seed}", 0.08, 0.2)
    return site(floor, plan)


def site(floor: Floor, plan: Plan) -> Site:
    """The building with its drive."""
    return Site(floor.world(plan, plan.name), plan)
