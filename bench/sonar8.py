"""Eight real sonars with their ghosts and cross-talk: do the extracted walls stand where the whole drive saw walls?

Wall points of every vertex, at the recorded poses, are compared with an occupancy grid made from all echoes of the
drive. The control has the sonars' bearings shuffled, against the true grid and against a grid of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, figures, plain, runs
from bench.recordings import data_folder
from server import config
from server.formats.logs import Log, read_log
from server.formats.sonar8 import read_sonar8
from server.replay import run_log
from server.robots.crunch import CrunchParams
from slam.evaluate import MapAgreement, map_agreement
from slam.grid import Grid
from slam.local_map import LocalMap
from slam.pose import transform
from slam.rangefinder import RingParams
from slam.walls import curves

MARGIN = 6.0  # m around the path that the grid covers


def whole_drive(ring: RingParams, folder: Path, params: CrunchParams) -> Grid:
    """Occupancy grid of all sweeps at the recorded poses."""
    recording = read_sonar8(folder)
    extent = float(np.abs(recording.poses[:, :2]).max()) + MARGIN
    sensors = {"sonar": ring}
    wide = params.local_map.model_copy(update={"reach": extent, "cells_per_reach": round(extent / 0.05)})
    whole = LocalMap(wide, sensors)
    for pose, ranges in zip(recording.poses, recording.ranges, strict=True):
        whole.fuse("sonar", ranges, pose)
    return whole.grid()


def agreement(log: Log, ring: RingParams, grid: Grid, params: CrunchParams) -> MapAgreement:
    """Share of wall points, seen with `ring` and placed by the recorded poses, near the grid's walls."""
    result = run_log(log.__class__(**{**vars(log), "sensors": {"sonar": ring}}), params)
    points = [
        transform(keyframe.pose, curve) for keyframe in result.drive.keyframes for curve in curves(keyframe.walls)
    ]
    return map_agreement(np.vstack(points), grid, 0.15)


def measure(seed: int) -> dict[str, Record]:
    """Shares of one shuffle of the bearings, by the row that they belong to; seed -1 leaves them as they are."""
    data = data_folder()
    assert data is not None
    folder, params = data / "sonar8", config.load({}).crunch
    log = read_log(folder)
    assert log.sensors is not None
    ring = log.sensors["sonar"]
    grid = whole_drive(ring, folder, params)
    if seed < 0:
        true = agreement(log, ring, grid, params)
        return {"true": {"points": true.n, "share": 100.0 * true.share}}
    bearings = np.random.default_rng(seed).permutation(ring.bearings_deg)
    mixed = ring.model_copy(update={"bearings_deg": tuple(bearings.tolist())})
    grids = {"shuffled": grid, "shuffled, against a grid of its own": whole_drive(mixed, folder, params)}
    return {
        name: {"seed": seed, "share": 100.0 * agreement(log, mixed, walls, params).share}
        for name, walls in grids.items()
    }


def rows(crew: Crew) -> Iterator[Row]:
    """The true bearings, then shuffled ones."""
    found = crew.map(measure, [(seed,) for seed in range(-1, crew.seeds)], "eight sonars")
    for name in ("true", "shuffled", "shuffled, against a grid of its own"):
        if crew.wants(name):
            yield Row(name, [shares[name] for shares in found if name in shares])


BENCH = Bench(
    name="sonar8",
    about="eight real sonars: share of wall points near the whole drive's walls; a seed shuffles the bearings",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("wall points", plain("points")),
        Column("within 15 cm of a wall, least / median / most (%)", figures("share", 0, 0.0, 0.5, 1.0)),
    ),
    seeds=20,
    minutes=2,
    quick=3,
    needs_data=True,
    heading="bearings",
)
