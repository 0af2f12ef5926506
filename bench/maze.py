"""Maze Runner in random plywood mazes: does it explore them without touching a wall, and is the map right?

The robot begins in a corner and knows nothing; a seed is another maze, other motors, another floor and another filter.
*Right*: every piece of wall in the map is within 0.2 m of a true one, and 95 % of the true walls that can be seen have
a piece of the map's within 0.2 m (the paper's one maze matched a measuring tape within 200 mm). The map lies where the
robot began, and is not aligned.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from bench.benchmark import Bench, Column, Record, each, failed, figures, middle, runs, share
from firmware.virtual.maze_body import Drift
from firmware.virtual.maze_runner import VirtualMazeRunner
from firmware.virtual.mazes import CELL, SIZES, maze
from server import config
from server.headless import Headless
from slam.pose import inverse, transform, wrap

NEAR = 0.2  # m
SEEN = 0.95  # of the true walls
LONGEST = 900.0  # s
SWEEP = 0.1  # s that the laser takes
SPACING = 0.03  # m between points of the true walls
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "": {},
    "without scan matching": {
        "odometry": {"is_on": False}, "filter": {"odometry": {"distance": 0.1, "turn": 0.1, "rotation": 0.1}},
    },
    "the laser alone, no odometry": {"odometry": {"is_alone": True}},
}  # fmt: skip


class Case(NamedTuple):
    """A size of maze, how bad motors and floor are, and the settings of robot and explorer, as in config.toml."""

    size: str
    drift: Drift
    settings: Mapping[str, Any]


CASES = {
    ", ".join(filter(None, (size, variant))): Case(size, "medium", {"maze_runner": settings})
    for variant, settings in VARIANTS.items()
    for size in SIZES
} | {"medium, drift high": Case("medium", "high", {})}


def run(case: Case, seed: int) -> Record:
    """One maze."""
    settings = config.load(case.settings)
    world = maze(case.size, seed)
    virtual = VirtualMazeRunner(world, seed=seed, drift=case.drift)
    loop, start = Headless(virtual, seed, settings), virtual.pose
    explorer = loop.explore(LONGEST)
    body = virtual.body
    points = loop.wall_points()
    true = visible(case.size, seed)
    off = KDTree(transform(inverse(start), true)).query(points)[0] if len(points) else np.array([math.inf])
    missed = KDTree(points).query(transform(inverse(start), true))[0] if len(points) else np.array([math.inf])
    seen = float(np.mean(missed < NEAR))
    return {
        "seed": seed,
        "explored": explorer.state == "done" and not explorer.left_alone and body.bumps == 0 and seen >= SEEN,
        "bumps": body.bumps,
        "left_alone": len(explorer.left_alone),
        "right": bool(np.max(off) < NEAR and seen >= SEEN),
        "worst": float(np.max(off)),
        "median": float(np.median(off)),
        "seen": seen,
        "seconds": virtual.time,
        "metres": body.distance,
        "vertices": len(loop.keyframes),
        "turned": fast_turns(*virtual.truth()),
    }


def fast_turns(times: np.ndarray, poses: np.ndarray) -> float:
    """The 99th percentile of the rates (rad/s) at which a robot at poses (n, 3) at times (n,) turned during sweeps."""
    rows = np.arange(0, len(times), max(1, round(SWEEP / float(times[1] - times[0]))))
    return float(np.quantile(np.abs(wrap(np.diff(poses[rows, 2]))) / np.diff(times[rows]), 0.99))


def visible(size: str, seed: int) -> np.ndarray:
    """Points (n, 2) on the walls of a maze that somebody in the middle of some cell sees."""
    world, (columns, rows) = maze(size, seed), SIZES[size]
    bearings = np.arange(720) * (2.0 * math.pi / 720.0)
    found = []
    for x in range(columns):
        for y in range(rows):
            ranges = world.cast(CELL * x, CELL * y, bearings, 10.0)
            ends = np.stack([CELL * x + ranges * np.cos(bearings), CELL * y + ranges * np.sin(bearings)], axis=1)
            found.append(ends[np.isfinite(ranges)])
    points = np.round(np.concatenate(found) / SPACING).astype(int)
    return np.unique(points, axis=0) * SPACING


BENCH = Bench(
    name="maze",
    about="Maze Runner explores random mazes: without touching a wall, and are the maps right?",
    rows=each(run, CASES),
    columns=(
        Column("mazes", runs),
        Column("explored, nothing touched (95 %)", share("explored")),
        Column("right maps (95 %)", share("right")),
        Column("walls off: median (m)", figures("median", 3, 0.5)),
        Column("a map's worst piece of wall off: median / p90 / worst (m)", figures("worst", 2, 0.5, 0.9, 1.0)),
        Column("of the walls mapped: median / least", figures("seen", 3, 0.5, 0.0)),
        Column("seconds driven", middle("seconds", 0)),
        Column("way (m)", middle("metres", 1)),
        Column("vertices", middle("vertices", 0)),
        Column("not explored", failed("explored")),
        Column("not right", failed("right")),
    ),
    seeds=20,
    minutes=30,
    heading="maze",
)
