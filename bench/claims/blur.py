"""Thesis 2.1: a map that is transformed and resampled at every move, against one that scrolls by whole cells.

On a still wall, with all else held: how wide it becomes and how much of it is still found. On drives: where the
extracted walls lie, and what the blur does to loops.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from bench.claims.drives import fold_of, jobs, outcome, setting, summary, world_of
from bench.claims.findings import Effort, Findings, Row
from bench.claims.plots import WAYS, panel, picture
from firmware.virtual import World
from slam.local_map import LocalMap, LocalMapParams
from slam.pose import transform
from slam.rangefinder import RingParams
from slam.walls import WallParams, extract

AWAY = 0.6  # m from the robot to the wall that is carried along
SWAY = 0.25  # m driven to and fro, so that the wall stays in the map
SPEED, TURN_RATE = 0.3, 1.0  # m/s, rad/s
RATES = (50.0, 10.0)  # moves of the map per second
METRES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
TURNS = (0.0, 0.125, 0.25, 0.5, 1.0, 2.0)
PATCH = 0.3  # m around the wall's middle where its width is measured
PRESETS = ("default", "thesis")
MODES = {"scrolled": False, "resampled": True}
WIDEST = 24.0  # cm, in the picture
FOUND = 0.10  # m from a true wall that an extracted one may lie


def driven(rate: float) -> Iterator[tuple[float, np.ndarray]]:
    """Metres driven and pose (3,) at each move of a robot that sways along x."""
    steps = math.ceil(METRES[-1] / SPEED * rate)
    for step in range(1, steps + 1):
        way = step * SPEED / rate
        phase = way % (4.0 * SWAY)
        yield way, np.array([SWAY - abs(phase - SWAY) if phase < 2.0 * SWAY else abs(phase - 3.0 * SWAY) - SWAY, 0, 0])


def turned(rate: float) -> Iterator[tuple[float, np.ndarray]]:
    """Turns made and pose (3,) at each move of a robot that turns on the spot."""
    steps = math.ceil(TURNS[-1] * 2.0 * math.pi / TURN_RATE * rate)
    for step in range(1, steps + 1):
        angle = step * TURN_RATE / rate
        yield angle / (2.0 * math.pi), np.array([0.0, 0.0, math.remainder(angle, 2.0 * math.pi)])


def walled(direction: float, resample: bool, **evidence: float) -> LocalMap:
    """A local map that has just seen one straight wall `AWAY` in the direction (rad) given."""
    bearings = np.arange(0.0, 360.0, 1.0)
    ring = RingParams(model="beam", bearings_deg=tuple(bearings.tolist()), max_range=4.0)
    params = LocalMapParams.model_validate({"reach": 1.0, "resample": resample, "footprint": 0.0, **evidence})
    local_map = LocalMap(params, {"laser": ring})
    aim = np.cos(np.radians(bearings) - direction)
    ranges = np.where(aim > 0.3, AWAY / np.maximum(aim, 0.3), math.nan)
    local_map.move(np.zeros(3))
    for _ in range(3):
        local_map.fuse("laser", ranges, np.zeros(3))
    return local_map


def width(local_map: LocalMap, direction: float) -> float:
    """Standard deviation (m) across the wall of the evidence for it."""
    grid = local_map.grid()
    rows, columns = np.nonzero(grid.cells > 0.0)
    points = np.column_stack([grid.x + (columns + 0.5) * grid.resolution, grid.y + (rows + 0.5) * grid.resolution])
    if local_map.frame is not None:
        points = transform(local_map.frame, points)
    across = points @ [math.cos(direction), math.sin(direction)] - AWAY
    along = points @ [-math.sin(direction), math.cos(direction)]
    near = np.abs(along) < PATCH
    weights = grid.cells[rows, columns][near]
    mean = np.average(across[near], weights=weights)
    return math.sqrt(np.average((across[near] - mean) ** 2, weights=weights))


def still_found(local_map: LocalMap, pose: np.ndarray, direction: float) -> float:
    """Share of the rays towards the wall's middle that still meet it within `FOUND`."""
    walls = extract(local_map, pose, WallParams())
    bearings = pose[2] + 2.0 * math.pi * np.arange(walls.distances.size) / walls.distances.size
    away = AWAY - pose[0] * math.cos(direction) - pose[1] * math.sin(direction)
    aim = np.cos(bearings - direction)
    facing = aim > math.cos(math.atan2(PATCH, away))
    return float(np.mean(np.abs(walls.distances[facing] * aim[facing] - away) < FOUND))


def carried(motion: str, direction: float, resample: bool, rate: float) -> list[Row]:
    """Width of a lone wall, and what is found of one with free floor before it, at the marks of a motion."""
    moves, marks = (driven(rate), METRES) if motion == "driven" else (turned(rate), TURNS)
    lone = walled(direction, resample, beam_miss=0.0)
    full = walled(direction, resample)
    rows: list[Row] = []
    ways = [(0.0, np.zeros(3)), *moves]
    for way, pose in ways:
        lone.move(pose)
        full.move(pose)
        if len(rows) < len(marks) and way >= marks[len(rows)] - 1e-9:
            found = still_found(full, pose, direction)
            rows.append({"way": marks[len(rows)], "width": 100.0 * width(lone, direction), "found": 100.0 * found})
    return rows


CASES = {  # motion, where the wall is
    "driven, wall ahead": ("driven", 0.0),
    "driven, wall beside": ("driven", 0.5 * math.pi),
    "turned on the spot": ("turned", 0.0),
}


def still() -> list[Row]:
    """Every case, mode and rate."""
    rows: list[Row] = []
    for case, (motion, direction) in CASES.items():
        for mode, resample in MODES.items():
            for rate in RATES if resample else RATES[:1]:
                name = f"{mode}, {rate:.0f} Hz" if resample else mode
                rows += [{"case": case, "map": name, **row} for row in carried(motion, direction, resample, rate)]
    return rows


def still_table(curves: list[Row]) -> list[Row]:
    """The curves' ends."""
    rows: list[Row] = []
    for case, (motion, _) in CASES.items():
        for name in dict.fromkeys(row["map"] for row in curves):
            at = {row["way"]: row for row in curves if row["case"] == case and row["map"] == name}
            marks = (1.0, 4.0) if motion == "driven" else (0.25, 1.0)
            words = ("1 m", "4 m") if motion == "driven" else ("a quarter turn", "a whole turn")
            for mark, word in zip(marks, words, strict=True):
                row = {"motion": f"{case}: {word}", "map": name, "width (cm)": at[mark]["width"]}
                rows.append(row | {"wall still found (%)": at[mark]["found"]})
    return rows


def wall_errors(world: World, seed: int, length: float, preset: str, resample: bool) -> tuple[np.ndarray, np.ndarray]:
    """Distances (k,) of extracted wall points from true walls, and whether each true wall ray (m,) was found."""
    params = setting(preset, {"local_map": {"resample": resample}})
    seen = fold_of("cycle", seed, length, params)
    reach = LocalMap(params.local_map, params.sensors).reach
    distances, hits = [], []
    for keyframe, pose in zip(seen.drive.keyframes, seen.vertex_truth, strict=True):
        found = keyframe.walls.distances
        bearings = 2.0 * math.pi * np.arange(found.size) / found.size
        true = world.cast(pose[0], pose[1], pose[2] + bearings, reach)
        wall = np.isfinite(found)
        ends = found[wall, None] * np.stack([np.cos(bearings[wall]), np.sin(bearings[wall])], axis=1)
        if len(ends):
            distances.append(world.clearances(transform(pose, ends), reach))
        near = np.isfinite(true) & (true < 0.9 * reach)
        hits.append(np.abs(np.where(wall, found, 1e9)[near] - true[near]) < FOUND)
    return np.concatenate(distances), np.concatenate(hits)


def on_drives(effort: Effort) -> list[Row]:
    """Walls and loops of both modes, in the default and in the thesis's own set-up."""
    rows: list[Row] = []
    for preset in PRESETS:
        for mode, resample in MODES.items():
            changes = {"local_map": {"resample": resample}}
            medians, tails, found = [], [], []
            for seed in range(effort.seeds):
                world = world_of(seed, effort.length)
                errors, hits = wall_errors(world, seed, effort.length, preset, resample)
                medians.append(100.0 * float(np.median(errors)))
                tails.append(100.0 * float(np.quantile(errors, 0.9)))
                if hits.size:  # some corridors are too wide for a small map
                    found.append(100.0 * float(np.mean(hits)))
            runs = [outcome(job) for job in jobs(*effort[:1], effort.length, effort.particles, preset, changes=changes)]
            row: Row = {"set-up": preset, "map": mode, "wall error median (cm)": float(np.median(medians))}
            row |= {"p90 (cm)": float(np.median(tails)), "walls found (%)": float(np.median(found))}
            rows.append(row | summary(runs))
    return rows


def measure(effort: Effort) -> Findings:
    """All of it."""
    curves = still()
    return Findings({"blur-still": still_table(curves), "blur-drives": on_drives(effort)}, {"blur": curves})


def draw(findings: Findings) -> Figure:
    """Width and what is found against the way, a column for each motion."""
    figure = picture(3, 2)
    for column, (case, (motion, _)) in enumerate(CASES.items()):
        for row, (key, label) in enumerate((("width", "width of the wall (cm)"), ("found", "wall still found (%)"))):
            axes = panel(figure, row, column, case if row == 0 else "")
            for place, name in enumerate(dict.fromkeys(point["map"] for point in findings.curves["blur"])):
                points = [one for one in findings.curves["blur"] if (one["case"], one["map"]) == (case, name)]
                colour, marker = WAYS[place]
                axes.plot(
                    [one["way"] for one in points], [one[key] for one in points], marker, color=colour, label=name
                )
            axes.set_ylim(0.0, 105.0 if key == "found" else WIDEST)
            if column == 0:
                axes.set_ylabel(label)
            if row == 1:
                axes.set_xlabel("metres driven" if motion == "driven" else "turns")
    figure.axes[0].legend()
    return figure
