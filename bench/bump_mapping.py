"""The map of an unknown area from bumps alone: virtual carts in rooms of random walls, and real robots that bumped.

A room of 1.5 m has five to eight walls at any angles, every second one has a corner that points inward. The map is laid
on the true walls by the path (SE(2), of the poses at bumps), which is how dead reckoning's contacts are laid, too. Its
error is the mean distance of points along the mapped walls from the true ones; a true wall is covered where the map has
one within 5 cm. A seed is another room, cart, run and filter.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from bench.benchmark import Bench, Column, Crew, Record, Row, each, failed, figures, middle, plain, runs, share
from bench.recordings import data_folder
from firmware.virtual.bumper_cart import CartBuild, run_cart
from firmware.virtual.polygons import polygon
from server import config
from server.formats.cart_log import CartLog
from server.formats.laser import LaserLog
from server.formats.logs import read_log
from server.formats.neato import read_neato
from server.formats.roomba import read_roomba
from server.mapping import MazeMapper, with_sensors
from server.replay import run_mapper
from slam.bump_finding import Recording
from slam.bump_mapper import BumpMap, BumpMapper, BumpMapperParams, segments_of
from slam.bump_merging import merge
from slam.bump_walls import distances, map_error, points_on
from slam.cart_odometry import LEFT, RIGHT, CartParams, Stage, bumper_points, bumps_of, raw_path
from slam.evaluate import alignment
from slam.pose import compose, transform

FIRST_ROOM = 100  # rooms before were looked at while this was made
ROOMS = 10
GOOD = 0.05  # m
DRAWN = "100 bumps"  # the row of which a picture draws rooms
CARTS = (1, 3, 10, 30, 100)
CART_BUMPS = 100
CART_PARTICLES = 4000


class Case(NamedTuple):
    """How often a cart bumps, how badly its parts match, and the mapper's settings."""

    bumps: int
    drift: Any = "medium"
    params: BumpMapperParams = BumpMapperParams()


CASES = {
    "50 bumps": Case(50),
    "100 bumps": Case(100),
    "300 bumps": Case(300),
    "100 bumps, drift low": Case(100, "low"),
    "100 bumps, drift high": Case(100, "high"),
    "100 bumps, 4,000 particles": Case(100, params=BumpMapperParams(n_particles=4000)),
    "100 bumps, one island": Case(100, params=BumpMapperParams(n_islands=1)),
}


class Driven(NamedTuple):
    """A virtual cart's run: stages, true poses (s + 1, 3), and the rows of its bumps."""

    stages: list[Stage]
    truth: np.ndarray
    bumps: np.ndarray


def drive(room: int, seed: int, bumps: int, drift: Any = "medium") -> Driven:
    """A run in a room."""
    logged, truth = run_cart(polygon(room), seed, bumps, build=CartBuild(drift=drift))
    stages = [Stage(*stage) for stage in logged]
    return Driven(stages, truth, bumps_of(stages))


def laid(places: np.ndarray, true: np.ndarray, walls: list[np.ndarray]) -> list[np.ndarray]:
    """Walls moved as places (n, 2) must be to lie best on true ones."""
    return [transform(alignment(places, true), wall) for wall in walls]


def errors_of(found: BumpMap, driven: Driven, segments: np.ndarray) -> tuple[float, float]:
    """The map's error in m, and how much of the true walls (m, 4) it covers."""
    walls = laid(found.path[found.is_bump][:, :2], driven.truth[driven.bumps + 1, :2], found.walls)
    return map_error(segments_of(walls), points_on(walls), segments)


def run(case: Case, seed: int) -> Record:
    """One cart in one room."""
    room = FIRST_ROOM + seed % ROOMS
    segments = polygon(room).segments
    driven = drive(room, FIRST_ROOM + seed, case.bumps, case.drift)
    mapper = BumpMapper(CartParams(), case.params, seed)
    began = time.perf_counter()
    mapper.extend(driven.stages)
    filtered = time.perf_counter()
    live = mapper.estimate()
    refined = mapper.refine()
    ended = time.perf_counter()
    raw = mapper.raw()[driven.bumps + 1]
    contacts = laid(raw[:, :2], driven.truth[driven.bumps + 1, :2], [bumper_points(raw, CartParams())[:, 1]])[0]
    error, covered = errors_of(refined, driven, segments)
    live_error, live_covered = errors_of(live, driven, segments)
    is_drawn = case == CASES[DRAWN]
    walls = laid(refined.path[refined.is_bump][:, :2], driven.truth[driven.bumps + 1, :2], refined.walls)
    return {
        "seed": seed,
        "room": room,
        "walls": [np.round(wall, 3).tolist() for wall in walls] if is_drawn else None,
        "contacts": np.round(contacts, 3).tolist() if is_drawn else None,
        "error": error,
        "covered": covered,
        "good": error < GOOD,
        "missed": error >= GOOD and refined.is_sure,
        "needless": error < GOOD and not refined.is_sure,
        "arcs": len(refined.arcs),
        "live_error": live_error,
        "live_covered": live_covered,
        "live_good": live_error < GOOD,
        "raw_error": float(np.mean(distances(contacts, segments))),
        "bump_ms": 1e3 * (filtered - began) / len(driven.bumps),
        "refine_s": ended - filtered,
        "cost": refined.cost / len(driven.bumps),
    }


BENCH = Bench(
    name="bump-mapping",
    about="the map of an unknown room from bumps alone: how far off its walls are, beside dead reckoning",
    rows=each(run, CASES),
    columns=(
        Column("runs", runs),
        Column("refined map off: median / p90 / worst (m)", figures("error", 3, 0.5, 0.9, 1.0)),
        Column("below 5 cm (95 %)", share("good")),
        Column("covered: median / least", figures("covered", 2, 0.5, 0.0)),
        Column("not below 5 cm, yet called sure", share("missed")),
        Column("below 5 cm, yet called doubtful", share("needless")),
        Column("live map off: median / p90 / worst (m)", figures("live_error", 3, 0.5, 0.9, 1.0)),
        Column("below 5 cm (95 %) ", share("live_good")),
        Column("dead reckoning off: median / p90 (m)", figures("raw_error", 3, 0.5, 0.9)),
        Column("a bump (ms)", middle("bump_ms", 0)),
        Column("refined in (s)", middle("refine_s", 1)),
        Column("not below 5 cm", failed("good")),
    ),
    seeds=20,
    minutes=50,
    heading="medium drift unless told",
)


def mapped(room: int, cart: int, seed: int) -> tuple[Driven, BumpMap]:
    """One of many carts in a room, each of which makes a map of its own."""
    driven = drive(room, 1000 * seed + cart, CART_BUMPS)
    mapper = BumpMapper(CartParams(), BumpMapperParams(n_particles=CART_PARTICLES), cart)
    mapper.extend(driven.stages)
    return driven, mapper.refine()


def merge_rows(crew: Crew) -> Iterator[Row]:
    """The same carts' maps, more and more of them merged."""
    rooms = [FIRST_ROOM + seed for seed in range(crew.seeds)]
    names = {f"{n} carts" if n > 1 else "1 cart": n for n in CARTS}
    wanted = [n for name, n in names.items() if crew.wants(name, names)]
    if not wanted:
        return
    jobs = [(room, cart, seed) for seed, room in enumerate(rooms) for cart in range(max(wanted))]
    found = crew.map(mapped, jobs, "carts")
    per_room = [found[row * max(wanted) : (row + 1) * max(wanted)] for row in range(len(rooms))]
    for name, n in names.items():
        if n in wanted:
            records = [
                merged(room, seed, own[:n]) for seed, (room, own) in enumerate(zip(rooms, per_room, strict=True))
            ]
            yield Row(name, records)


def merged(room: int, seed: int, found: list[tuple[Driven, BumpMap]]) -> Record:
    """One merge, and how good the maps were of which it was made."""
    segments = polygon(room).segments
    alone = [errors_of(area, driven, segments)[0] for driven, area in found]
    began = time.perf_counter()
    whole = merge([Recording(driven.stages, CartParams(), area) for driven, area in found])
    seconds = time.perf_counter() - began
    places = [
        (nodes[1::2][area.is_bump][:, :2], driven.truth[driven.bumps + 1, :2])
        for nodes, (driven, area) in zip(whole.nodes, found, strict=True)
        if len(nodes)
    ]
    walls = laid(np.concatenate([one for one, _ in places]), np.concatenate([true for _, true in places]), whole.walls)
    error, covered = map_error(segments_of(walls), points_on(walls), segments)
    return {
        "seed": seed,
        "error": error,
        "covered": covered,
        "alone": float(np.median(alone)),
        "best": min(alone),
        "core": len(whole.core),
        "left_out": len(whole.left_out),
        "seconds": seconds,
    }


MERGING = Bench(
    name="bump-merging",
    about="recordings of several carts merged into one map: its error against their number, and the merge's time",
    rows=merge_rows,
    columns=(
        Column("rooms", runs),
        Column("merged map off: median / worst (m)", figures("error", 4, 0.5, 1.0)),
        Column("covered: median / least", figures("covered", 2, 0.5, 0.0)),
        Column("one cart's map off, median of the carts (m)", middle("alone", 3)),
        Column("best cart's", middle("best", 3)),
        Column("carts that agree at first: median / least", figures("core", 0, 0.5, 0.0)),
        Column("carts left out: median / most", figures("left_out", 0, 0.5, 1.0)),
        Column("merged in (s)", middle("seconds", 1)),
    ),
    seeds=3,
    minutes=50,
    heading=f"carts of {CART_BUMPS} bumps",
)


def laser_walls(laser: LaserLog, times: np.ndarray, trajectory: np.ndarray) -> np.ndarray:
    """Ends (n, 2) of all beams along a path of poses (k, 3) at times (k,)."""
    headings = np.unwrap(trajectory[:, 2])
    poses = np.column_stack(
        [np.interp(laser.scan_times, times, part) for part in (trajectory[:, 0], trajectory[:, 1], headings)]
    )
    ends = [np.zeros((0, 2))]
    for pose, ranges in zip(compose(poses, laser.mount), laser.scans, strict=True):
        is_echo = np.isfinite(ranges) & (ranges < 4.0)
        spots = ranges[is_echo, None] * np.column_stack(
            [np.cos(laser.bearings[is_echo]), np.sin(laser.bearings[is_echo])]
        )
        ends.append(transform(pose, spots))
    return np.concatenate(ends)


def felt_points(poses: np.ndarray, switches: np.ndarray, cart: CartParams) -> np.ndarray:
    """Where on the bumper (n, 2) each bump was, as far as its switches tell."""
    points = bumper_points(poses, cart)
    which = np.where(switches == LEFT, 0, np.where(switches == RIGHT, 2, 1))
    return 0.5 * (points[:, 1] + points[np.arange(len(points)), which])


def real_rows(crew: Crew) -> Iterator[Row]:
    """The Neato's bags against their laser; of the Roomba's logs, which have no truth, what there is."""
    data = data_folder()
    assert data is not None
    for name in ("avoid_obstacles", "testdrive"):
        if crew.wants(f"Neato, {name}"):
            jobs = [(str(data / "neato" / f"{name}.bag"), seed) for seed in range(crew.seeds)]
            yield Row(f"Neato, {name}", crew.map(neato, jobs, name))
    for name in ("DataTest1a", "Corner_finding_data"):
        if crew.wants(f"Roomba, {name}"):
            jobs = [(str(data / "roomba" / f"{name}.txt"), seed) for seed in range(crew.seeds)]
            yield Row(f"Roomba, {name}", crew.map(roomba, jobs, name))


def placed(log: CartLog, seed: int, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, BumpMap]:
    """Bumps (n, 2) by dead reckoning and by the filter, of a robot that began at a pose; and the map."""
    mapper = BumpMapper(log.params, BumpMapperParams(contact=0.02), seed)
    mapper.extend(log.stages)
    found = mapper.refine()
    rows = bumps_of(log.stages)
    switches = np.array([log.stages[row].bumper for row in rows])
    raw = compose(start, mapper.raw()[rows + 1])
    filtered = compose(start, found.path[found.is_bump])
    return felt_points(raw, switches, log.params), felt_points(filtered, switches, log.params), found


def neato(path: str, seed: int) -> Record:
    """One bag: Maze Runner's estimator makes the map of the laser, bumps are laid into it from the first pose on."""
    log, neato_log = read_log(path, robot="maze_runner"), read_neato(path)
    params = with_sensors(config.load({}, header=log.configuration).maze_runner, log)
    result = run_mapper(log, MazeMapper(params, seed, 1))
    walls = KDTree(laser_walls(neato_log.laser, result.drive.times, result.trajectory))
    raw, filtered, _ = placed(neato_log.cart, seed, result.trajectory[0])
    stages = neato_log.cart.stages
    rows = bumps_of(stages)
    when = np.searchsorted(result.drive.times, neato_log.cart.times[rows] + neato_log.start)
    judged = result.trajectory[np.minimum(when, len(result.trajectory) - 1)]
    by_laser = felt_points(judged, np.array([stages[row].bumper for row in rows]), neato_log.cart.params)
    return {
        "seed": seed,
        "bumps": len(raw),
        "laser_mm": 1e3 * float(np.median(walls.query(by_laser)[0])),
        "raw_mm": 1e3 * float(np.median(walls.query(raw)[0])),
        "mm": 1e3 * float(np.median(walls.query(filtered)[0])),
    }


def roomba(path: str, seed: int) -> Record:
    """One log."""
    log = read_roomba(path)
    _, _, found = placed(log, seed, np.zeros(3))
    home = raw_path(log.stages, log.params)[-1]
    return {
        "seed": seed,
        "bumps": len(found.contacts),
        "walls": len(found.lines),
        "home_mm": 1e3 * float(np.hypot(*home[:2])),
        "moved_mm": 1e3 * float(np.hypot(*(found.path[-1] - home)[:2])),
    }


REAL = Bench(
    name="bump-real",
    about="real robots that bumped, a few times: how far their bumps are from the walls of the Neato's laser",
    rows=real_rows,
    columns=(
        Column("bumps", plain("bumps")),
        Column("off the laser's walls, dead reckoning (mm)", middle("raw_mm", 0)),
        Column("with the filter (mm)", middle("mm", 0)),
        Column("on the laser's own path (mm)", middle("laser_mm", 0)),
        Column("lines felt", middle("walls", 0)),
        Column("dead reckoning's end from its start (mm)", middle("home_mm", 0)),
    ),
    seeds=3,
    minutes=2,
    needs_data=True,
    heading="recording",
)
BENCHES = (BENCH, MERGING, REAL)
