"""Seeded buildings in which an estimator might lose itself, each with a drive that comes back to where it was.

`slanted_wings` and `round_corridor` have no one pair of wall directions; `museum` and `lanes` hold the others. Every
seed is another building and another drive. All lengths in metres.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware.virtual.corridor import smooth
from firmware.virtual.floorplan import Box, Disc, Floor, Ring, Shape, side
from firmware.virtual.plans import Plan
from firmware.virtual.worlds import World

STEP = 0.1  # m between points of a drive
KINDS = ("door", "pillar", "alcove", "flush door")
SHARES = (0.45, 0.25, 0.15, 0.15)
FROM_CORNER = 0.9  # m of plain wall beside a corner
WIDTHS = (1.5, 1.8, 2.1)  # of corridors, in turn


class Site(NamedTuple):
    """A building and the drive through it."""

    world: World
    plan: Plan


def resampled(points: np.ndarray, step: float = STEP) -> np.ndarray:
    """Points (m, 2) every `step` along a polyline (n, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, along[-1], step)
    return np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])


def drive(points: np.ndarray, rng: np.random.Generator, name: str, wobble: float = 0.12, most: float = 0.3) -> Plan:
    """Plan along a polyline (n, 2): corners rounded over half a metre, wandering `wobble`, at `most`, to both sides."""
    points = resampled(points)
    window = np.ones(7) / 7.0
    for _ in range(2):
        padded = np.pad(points, ((3, 3), (0, 0)), mode="edge")
        points = np.column_stack([np.convolve(padded[:, axis], window, mode="valid") for axis in (0, 1)])
    tangents = np.gradient(points, axis=0)
    tangents /= np.hypot(*tangents.T).clip(1e-6)[:, None]
    knots = np.arange(0.0, len(points) * STEP + 4.0, 2.0)
    offsets = smooth(np.arange(len(points)) * STEP, knots, rng.normal(0.0, wobble, len(knots)).clip(-most, most))
    return Plan.through(points + np.column_stack([-tangents[:, 1], tangents[:, 0]]) * offsets[:, None], name=name)


def furnish(floor: Floor, rng: np.random.Generator, line: np.ndarray, width: float, room: tuple[float, float]) -> None:
    """Doors, pillars and alcoves along both walls of a corridor around `line` (n, 2), points STEP apart.

    `room` is how deep a recess may be on the left and on the right.
    """
    tangents = np.gradient(line, axis=0)
    tangents /= np.hypot(*tangents.T)[:, None]
    length = STEP * len(line)
    for hand, deepest in ((1.0, room[0]), (-1.0, room[1])):
        along = FROM_CORNER + rng.uniform(0.0, 1.0)
        while True:
            wide, deep = fitting(rng, deepest)
            if along + wide > length - FROM_CORNER:
                break
            row = round((along + 0.5 * wide) / STEP)
            outward = hand * np.array([-tangents[row, 1], tangents[row, 0]])
            angle = math.atan2(tangents[row, 1], tangents[row, 0])
            if deep > 0.0:  # a recess begins well within the corridor, so that round walls leave no sill
                x, y = line[row] + outward * (0.25 * width + 0.5 * deep)
                floor.carve(Box(x, y, angle, wide, 0.5 * width + deep))
            else:
                x, y = line[row] + outward * (0.5 * width + 0.5 * deep + 0.05)
                floor.build(Box(x, y, angle, wide, -deep + 0.1))
            along += wide + rng.uniform(0.8, 3.2)


def fitting(rng: np.random.Generator, deepest: float) -> tuple[float, float]:
    """Width and depth (into the wall) of the next thing in it."""
    kind = rng.choice(KINDS, p=SHARES)
    if kind == "pillar":
        return rng.choice([0.3, 0.45]), -rng.choice([0.10, 0.15, 0.20])
    if kind == "alcove":
        return rng.uniform(0.9, 1.8), min(rng.uniform(0.4, 0.9), deepest)
    return 0.9, min(0.03 if kind == "flush door" else rng.choice([0.08, 0.12, 0.18]), deepest)


def corridors(floor: Floor, rng: np.random.Generator, corners: np.ndarray, width: float, room: float) -> None:
    """Corridors of `width` along a closed polygon of corners (n, 2), mitred where they meet, furnished."""
    ahead = np.roll(corners, -1, axis=0) - corners
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    for i in range(len(corners)):
        turns = [abs(math.remainder(headings[i] - headings[j % len(corners)], 2.0 * math.pi)) for j in (i - 1, i + 1)]
        beyond = 0.5 * width * math.tan(0.5 * min(turns))
        floor.carve(side(corners[i], corners[(i + 1) % len(corners)], width, beyond))
    for i in range(len(corners)):
        furnish(floor, rng, resampled(corners[[i, (i + 1) % len(corners)]]), width, (room, room))


def slanted_wings(seed: int) -> Site:
    """A ring of corridors with a bend of 30 to 50 degrees in the middle and a corridor across it there.

    Both wings are driven around once, then again in one loop, in two, or in two of which one is reversed.
    """
    rng = np.random.default_rng([seed, 0xB0])
    bend, width = math.radians(rng.uniform(30.0, 50.0)), WIDTHS[seed % 3]
    first, second, across = rng.uniform(9.0, 14.0), rng.uniform(9.0, 14.0), rng.uniform(5.0, 7.0)
    along, aside = np.array([math.cos(bend), math.sin(bend)]), np.array([-math.sin(bend), math.cos(bend)])
    knee = np.array([first, 0.0])
    inner_knee = knee + across * np.array([-math.tan(0.5 * bend), 1.0])
    end = knee + second * along
    corners = np.array([[0.0, 0.0], knee, end, end + across * aside, inner_knee, [0.0, across]])
    floor = Floor()
    corridors(floor, rng, corners, width, 0.4 * (across - width))
    floor.carve(side(knee, inner_knee, width))
    start = np.array([0.5 * first, 0.0])
    around = [*corners[1:], corners[0], start]
    near, far = [knee, inner_knee, corners[5], corners[0]], [knee, *corners[2:4], inner_knee]
    back = [knee, corners[0], corners[5], inner_knee, knee]
    again = (around, [*near, *far, knee], [*far, *back])[rng.integers(3)]
    way = np.array([start, *around, *again])
    plan = drive(way, rng, f"slanted-{seed}")
    return Site(floor.world(plan, plan.name), plan)


def circle(radius: float, begin: float, end: float) -> np.ndarray:
    """Points (n, 2) on a circle around the origin from angle `begin` to `end`."""
    angles = np.linspace(begin, end, max(2, math.ceil(abs(end - begin) * radius / STEP)))
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def round_corridor(seed: int) -> Site:
    """A corridor around a circle, driven 2.2 times; every other seed crosses a round hall with pillars in between."""
    rng = np.random.default_rng([seed, 0xB1])
    radius, width = rng.uniform(6.5, 9.0), WIDTHS[seed % 3]
    has_hall = seed % 2 == 1
    floor = Floor()
    floor.carve(Ring(0.0, 0.0, radius, width))
    lap = circle(radius, 0.0, 2.0 * math.pi)
    furnish(floor, rng, lap, width, (0.8, 0.8))
    begin = rng.uniform(0.0, 2.0 * math.pi)
    way = circle(radius, begin, begin + 4.4 * math.pi)
    if has_hall:
        hall = rng.uniform(2.2, 3.0)
        floor.carve(Disc(0.0, 0.0, hall))
        gates = begin + 2.0 * math.pi + rng.uniform(0.5, 1.5) + np.array([0.0, rng.uniform(1.8, 3.6)])
        for gate in gates:
            direction = np.array([math.cos(gate), math.sin(gate)])
            floor.carve(side(0.0 * direction, radius * direction, 1.5))
        way = np.vstack([
            circle(radius, begin, gates[0]), circle(hall - 0.7, gates[0], gates[1]),
            circle(radius, gates[1], gates[1] + 2.2 * math.pi),
        ])  # fmt: skip
        floor.build(Disc(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(0.5, 0.8)))
        pillars(floor, rng, np.zeros((1, 2)), way, 6, hall)
    plan = drive(way, rng, f"round-{seed}", most=0.2 if has_hall else 0.3)
    return Site(floor.world(plan, plan.name), plan)


def pillars(
    floor: Floor, rng: np.random.Generator, places: np.ndarray, way: np.ndarray, count: int, most: float
) -> None:
    """Up to `count` pillars and cases, at any angle, within `most` of each place (n, 2), 0.5 m off the way (m, 2)."""
    for place in places:
        for _ in range(count):
            x, y = place + rng.uniform(-most, most, 2)
            shape: Shape = Disc(x, y, rng.uniform(0.12, 0.3))
            if rng.random() < 0.5:
                shape = Box(x, y, rng.uniform(0.0, math.pi), rng.uniform(0.3, 0.9), rng.uniform(0.15, 0.4))
            if shape.distances(way[:, 0], way[:, 1]).min() > 0.5:
                floor.build(shape)
