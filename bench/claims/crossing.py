"""Thesis 2.5: affinity by segments is zero where walls cross at right angles; affinity by test points is not."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from bench.claims.drives import by_odometry, jobs, outcome, summary
from bench.claims.findings import Effort, Findings, Row
from bench.claims.pairs import KINDS, Kind, affinity, paired, params_of, point_scores, points_of, turned_about
from bench.claims.plots import WAYS, panel, picture
from firmware.virtual import World
from slam.walls import Walls

REACH, N_RAYS, N_POINTS = 1.0, 120, 2000  # the thesis's 2 x 2 m
ANGLES = tuple(range(-180, 181, 5))  # degrees
OFFSETS = tuple(round(0.02 * step, 2) for step in range(-30, 31))  # m
SHOWN_ANGLES, SHOWN_OFFSETS = (0, 45, 90, 135, 180), (0.1, 0.2, 0.4)
FAR = 30.0  # m, the length of walls without an end

SCENES = {  # walls, where the vertex stands, and the place around which it is believed turned
    "a wall": ([[0.5, -0.6, 0.5, 0.6]], (0.0, 0.0, 0.0), (0.5, 0.0)),
    "a corner": ([[0.5, -FAR, 0.5, 0.5], [0.5, 0.5, -FAR, 0.5]], (0.0, 0.0, 0.0), (0.0, 0.0)),
    "a corridor": ([[-FAR, 0.6, FAR, 0.6], [-FAR, -0.6, FAR, -0.6]], (0.0, 0.0, 0.0), (0.0, 0.0)),
}
ACROSS = {"a wall": (1.0, 0.0), "a corner": (1.0, 0.0), "a corridor": (0.0, 1.0)}  # direction of the offsets
RUNS: dict[str, tuple[str, dict]] = {
    "default: points, 3 states": ("default", {}),
    "default: points, 2 states": (
        "default",
        {"states": 2, "both_free": 1.0, "both_wall": 1.0, "differ": -1.0, "gain": 0.3},
    ),
    "thesis: points, 2 states": ("thesis", {}),
    "thesis: segments": ("thesis", {"kind": "segments"}),
}


def sight(scene: str) -> Walls:
    """What a vertex sees without noise."""
    segments, (x, y, theta), _ = SCENES[scene]
    bearings = theta + 2.0 * math.pi * np.arange(N_RAYS) / N_RAYS
    distances = World(np.array(segments), name=scene).cast(x, y, bearings, REACH)
    return Walls(distances, np.minimum(distances, REACH))


def agreement(kind: Kind, walls: Walls, motions: np.ndarray) -> np.ndarray:
    """Affinity (k,) of what a vertex saw with itself, believed at `motions` (k, 3)."""
    params = params_of(kind)
    if kind == "segments":
        return np.array([affinity(params, walls, walls, motion, REACH) for motion in motions])
    pairs = paired([(walls, walls, np.zeros(3), motion) for motion in motions], params, REACH)
    return point_scores(pairs, points_of(params, REACH, N_POINTS), params).mean(axis=1)


def curves() -> list[Row]:
    """Affinity of a place with itself, believed turned or moved, as a share of what it is where it belongs."""
    rows: list[Row] = []
    for scene, (_, _, pivot) in SCENES.items():
        walls = sight(scene)
        ways = {
            "angle": [(at, turned_about(np.array(pivot), math.radians(at))) for at in ANGLES],
            "offset": [(at, np.array([*(at * np.array(ACROSS[scene])), 0.0])) for at in OFFSETS],
        }
        for kind in KINDS:
            [own] = agreement(kind, walls, np.zeros((1, 3)))
            for by, motions in ways.items():
                found = agreement(kind, walls, np.array([motion for _, motion in motions])) / own
                rows += [
                    {"scene": scene, "kind": kind, "by": by, "at": at, "affinity": float(value)}
                    for (at, _), value in zip(motions, found, strict=True)
                ]
    return rows


def table(rows: list[Row]) -> list[Row]:
    """A few of the angles and offsets."""
    found: list[Row] = []
    for scene in SCENES:
        for kind in KINDS:
            at = {
                (row["by"], row["at"]): row["affinity"] for row in rows if (row["scene"], row["kind"]) == (scene, kind)
            }
            row: Row = {"place": scene, "affinity": kind}
            row |= {f"{angle} deg": 0.0 + round(float(at["angle", angle]), 2) for angle in SHOWN_ANGLES}
            found.append(row | {f"{offset} m": 0.0 + round(float(at["offset", offset]), 2) for offset in SHOWN_OFFSETS})
    return found


def on_drives(effort: Effort) -> list[Row]:
    """Loops by either affinity."""
    rows: list[Row] = []
    runs = []
    for name, (preset, changes) in RUNS.items():
        over = {"filter": {"comparison": {"affinity": changes}}}
        runs = [outcome(job) for job in jobs(effort.seeds, effort.length, effort.particles, preset, changes=over)]
        rows.append({"filter": name, **summary(runs)})
    return [*rows, {"filter": "odometry", **by_odometry(runs)}]


def measure(effort: Effort) -> Findings:
    """All of it."""
    rows = curves()
    return Findings({"crossing-still": table(rows), "crossing-drives": on_drives(effort)}, {"crossing": rows})


def draw(findings: Findings) -> Figure:
    """Affinity against angle (above) and offset (below), a column for each place."""
    figure = picture(len(SCENES), 2)
    for column, scene in enumerate(SCENES):
        for row, (by, label) in enumerate((("angle", "believed turn (degrees)"), ("offset", "believed offset (m)"))):
            axes = panel(figure, row, column, scene if row == 0 else "")
            for place, kind in enumerate(KINDS):
                points = [
                    one for one in findings.curves["crossing"]
                    if (one["scene"], one["kind"], one["by"]) == (scene, kind, by)
                ]  # fmt: skip
                colour, way = WAYS[place]
                axes.plot(
                    [one["at"] for one in points], [one["affinity"] for one in points], way, color=colour, label=kind,
                    markevery=6,
                )  # fmt: skip
            axes.axhline(0.0, color="#888888", linewidth=0.8)
            axes.set_xlabel(label)
            if by == "angle":
                axes.set_xticks(range(-180, 181, 90))
            if column == 0:
                axes.set_ylabel("affinity, as a share of the true")
    figure.axes[0].legend()
    return figure
