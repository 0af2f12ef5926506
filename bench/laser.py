"""Maze Runner on real logs of lasers, one configuration for all, and what each of its parts is worth.

Intel is told by the relations that R. Kuemmerle et al. verified by hand (Autonomous Robots 27, 2009); ACES by
GMapping's path, which is a reference and not the truth; the LEGO robot by an overhead camera, rigidly and with the
scale left free, for the camera sees a marker above the floor. A seed is a new filter. Runs are timed, one at a time, on
as many threads as there are cores.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, figures, middle, runs, tails
from bench.recordings import data_folder
from bench.scores import by_relations, relations_of
from bench.timed_mapper import TimedMapper
from server import config
from server.formats import lego
from server.formats.logs import read_log
from server.formats.tum import read_tum
from server.mapping import with_sensors
from server.presets import NAMED
from server.replay import Result, fold, run_mapper, warm_up
from server.report import peak_rss_mb
from server.robots.maze_runner import MazeRunner
from slam.evaluate import absolute_error, alignment
from slam.fastslam import FastSlam
from slam.grid_filter import GridFilter
from slam.pose import transform
from slam.refined_grid_filter import RefinedGridFilter
from slam.scan_graph import ScanGraph
from slam.timeline import associate

ALONE = {"odometry": {"is_alone": True}}
PAPER = "the authors' FastSLAM, literally"
PARTS: Mapping[str, Mapping[str, Any]] = {
    "": {},
    "the laser alone, no odometry": ALONE,
    "no scan graph": {"graph": {"rounds": 0}},
    "a single particle": {"filter": {"particles": 1}},
    "a single particle, no scan graph": {"filter": {"particles": 1}, "graph": {"rounds": 0}},
    "no odometry by the laser": {"odometry": {"is_on": False}, "filter": {"odometry": {"distance": 0.1, "turn": 0.1}}},
    PAPER: NAMED["paper"]["maze_runner"],
    "scans not compared by what they see through": {"graph": {"agreement": {"share": 0.01, "overlap": 0.0}}},
}
LOGS = {
    "Intel, dense": "intel/intel-dense.log",
    "Intel": "intel/intel.log",
    "ACES": "aces/aces.log",
    "LEGO": "lego-reference",
    "mine 1": "mines/exp1.dat",
    "mine 2": "mines/exp2.dat",
    "Wean Hall": "wean/robotdata1.log",
}
EVERYWHERE = ("", "the laser alone, no odometry", PAPER)
WHOLE = ("Intel, dense", "Intel", "ACES")  # logs on which every part is tried
PUBLISHED = (
    "others with the full laser, measured on another machine of this kind, on Intel, dense: GMapping 0.056 +- 0.062 m "
    "in 36 s, LaMa's particle filter 0.053 +- 0.063 m in 14 s, open_karto 0.061 m in 43 s; on Intel: GMapping 0.058 m "
    "in 47 s, LaMa's particle filter 0.062 m in 13 s"
)


class Case(NamedTuple):
    """A log below the folder of recordings, and the settings of the robot."""

    log: str
    settings: Mapping[str, Any]


CASES = {
    ", ".join(filter(None, (name, part))): Case(path, settings)
    for part, settings in PARTS.items()
    for name, path in LOGS.items()
    if (name in WHOLE and part != PAPER) or (name not in WHOLE and part in EVERYWHERE)
}


def run(case: Case, seed: int) -> Record:
    """One seed of a log."""
    data = data_folder()
    assert data is not None
    log = read_log(data / case.log, robot="maze_runner")
    params = config.load({"maze_runner": case.settings}, header=log.configuration).maze_runner
    params, threads = with_sensors(params, log), os.cpu_count() or 1
    warm_up(params, threads)
    mapper = TimedMapper(params, seed, threads)
    result = run_mapper(log, mapper)
    drive = result.drive
    return {
        "seed": seed,
        "vertices": len(result.path),
        "seconds": result.seconds["total"],
        "fold": result.seconds["fold"],
        "filter": result.seconds["filter"],
        "refinement": result.seconds["refinement"],
        "speed": float(np.ptp(drive.times)) / result.seconds["total"],
        **mapper.times_taken(),
        **revisits(mapper.path_filter, result.path),
        **errors_of(result, log.path.parent / "intel.relations", log.path),
    }


def revisits(path_filter: RefinedGridFilter | FastSlam, path: np.ndarray) -> Record:
    """How far scans of different visits agree, laid by a path (n, 3), and by the laser's own odometry: no truth."""
    if not isinstance(path_filter, RefinedGridFilter):
        return {}
    graph = ScanGraph(np.array(path_filter.odometry), path_filter.path_filter.scans, path_filter.params)
    after, before = (graph.agreement_along(way, gap=graph.params.gap) for way in (path, graph.odometry))
    return {"again": after, "again_before": before}


def errors_of(result: Result, relations: Path, path: Path) -> Record:
    """Against whatever there is beside the log."""
    if relations.is_file():
        return by_relations(result, relations)
    drive, reference = result.drive, path.parent / "reference.tum"
    if reference.is_file():
        times, poses = read_tum(reference)
        matches = associate(drive.times, times, 0.0, 0.02)
        error = absolute_error(result.trajectory[matches.rows], poses[matches.reference_rows])
        return {"ate": error.translation.rmse, "heading": float(np.degrees(error.rotation.mean))}
    stem = lego.stem_of(path)
    if stem is None:
        return {}
    times, places = lego.read_reference(stem)
    seen = np.stack([np.interp(times, drive.times, result.trajectory[:, axis]) for axis in (0, 1)], axis=1)
    scale = float(np.sqrt(np.sum(np.var(places, axis=0)) / np.sum(np.var(seen, axis=0))))
    return {"ate": off(seen, places), "scaled": off(scale * seen, places), "scale": scale}


def off(seen: np.ndarray, places: np.ndarray) -> float:
    """RMSE (m) of places (n, 2), laid onto others."""
    apart = transform(alignment(seen, places), seen) - places
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def rows(crew: Crew) -> Iterator[Row]:
    """Every log and part, one run after the other."""
    for name, case in CASES.items():
        if crew.wants(name, CASES):
            yield Row(name, crew.map(run, [(case, seed) for seed in range(crew.seeds)], name))


def longest(part: str) -> Callable[[Row], str]:
    """How long a part of the work takes: the 99th percentile, as the median of the runs, and the longest of all."""
    usual, worst = figures(f"{part}_p99_ms", 1, 0.5), figures(f"{part}_worst_ms", 1, 1.0)
    return lambda row: f"{usual(row)} / {worst(row)}"


def agreements(row: Row) -> str:
    """Medians in percent."""
    found = [[record.get(key, math.nan) for record in row.records] for key in ("again", "again_before")]
    return " / ".join(f"{100.0 * np.median(each):.1f}" if np.isfinite(each).all() else "-" for each in found)


def notes(rows: list[Row]) -> Iterator[str]:
    """Every seed's figure, and what others reached."""
    for row in rows:
        for key in ("mean", "ate"):
            if key in row.records[0]:
                yield f"{row.name}, by seed (m): {' '.join(f'{record[key]:.4f}' for record in row.records)}"
        if "scaled" in row.records[0]:
            scaled, scale = (np.median([record[key] for record in row.records]) for key in ("scaled", "scale"))
            yield f"{row.name}, laid with a scale of {scale:.3f}: {scaled:.3f} m"
    yield PUBLISHED


PARTICLES = (30, 100, 300, 1000)
COMPILING = 2  # vertices at which kernels are compiled


def grow(particles: int, seed: int) -> Record:
    """One seed with so many particles on Intel, for what it takes."""
    data = data_folder()
    assert data is not None
    log = read_log(data / LOGS["Intel, dense"], robot="maze_runner")
    params = config.load({"maze_runner": {"filter": {"particles": particles}}}).maze_runner
    params = with_sensors(params, log)
    keyframes = fold(log, MazeRunner(params), lambda keyframe: None).keyframes
    path_filter = GridFilter(params.filter, seed, os.cpu_count() or 1)
    spent, most = [], 0
    for keyframe in keyframes:
        began = time.perf_counter()
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        spent.append(time.perf_counter() - began)
        most = max(most, path_filter.maps.n_patches)
    cells = path_filter.maps.cells
    whole = int(np.prod(cells.table.shape[1:]))  # patches of a map of its own for everyone
    patch = cells.odds[0].nbytes + cells.surfels[0].nbytes
    return {
        "seed": seed,
        "particles": particles,
        "patches": most,
        "megabytes": most * patch * 1e-6,
        "apart": particles * min(whole, int(np.count_nonzero(cells.table[0] >= 0))) * patch * 1e-6,
        "peak_mb": peak_rss_mb(),
        "vertex_ms": 1e3 * float(np.median(spent)),
        "worst_ms": 1e3 * max(spent[COMPILING:]),
    }


def memory_rows(crew: Crew) -> Iterator[Row]:
    """Every number of particles, each in a process of its own."""
    names = {f"{n:,} particles": n for n in PARTICLES}
    for name, particles in names.items():
        if crew.wants(name, names):
            yield Row(name, [crew.alone(grow, particles, seed) for seed in range(crew.seeds)])


MEMORY = Bench(
    name="laser-memory",
    about="what Maze Runner's maps take as particles grow, on Intel: patches that they share along the path tree",
    rows=memory_rows,
    columns=(
        Column("runs", runs),
        Column("patches, at most", middle("patches", 0)),
        Column("their MB", middle("megabytes", 0)),
        Column("MB of maps of their own", middle("apart", 0)),
        Column("peak of the process (MB)", middle("peak_mb", 0)),
        Column("a vertex (ms)", middle("vertex_ms", 1)),
        Column("slowest vertex (ms)", figures("worst_ms", 0, 0.5, 1.0)),
    ),
    seeds=1,
    minutes=15,
    needs_data=True,
    is_timed=True,
    heading="on Intel, dense",
)
BENCH = Bench(
    name="laser",
    about="Maze Runner on real logs of lasers, 30 particles, and what each of its parts is worth",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("relations, medians over the seeds", relations_of),
        Column("its mean: median / worst (m)", figures("mean", 4, 0.5, 1.0)),
        Column("ATE median / p90 / worst (m)", tails("ate", 3)),
        Column("ends that agree on revisits: path / laser's own odometry (%)", agreements),
        Column("seconds", middle("seconds", 1)),
        Column("fold", middle("fold", 1)),
        Column("filter", middle("filter", 1)),
        Column("scan graph", middle("refinement", 1)),
        Column("x real time", middle("speed", 0)),
        Column("vertices", middle("vertices", 0)),
        Column("a scan's step: 99 % / worst (ms)", longest("step")),
        Column("a vertex in the filter: 99 % / worst (ms)", longest("extend")),
        Column("a scan comes every (ms)", middle("interval_ms", 0)),
    ),
    seeds=5,
    minutes=20,
    needs_data=True,
    is_timed=True,
    heading="log",
    notes=notes,
)
BENCHES = (BENCH, MEMORY)
