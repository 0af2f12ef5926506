"""How the filter grows with its particles: accuracy, time, memory and the tree, from 500 to a million, on two threads.

The drive is two laps of a 50 m cycle at 0.3 m/s with corridors 1.8 m wide and medium drift. Each run is a process of
its own, so that its peak memory is its own; decoding and fusion are not timed.

After a resampling a tree of T levels is expected to have at most T + C N ln N nodes, if every level is resampled
(Jacob, Murray and Rubenthaler 2015); where k levels go by between resamplings, k times the second part.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, failed, middle, runs, share, tails
from bench.recordings import cycle, read
from bench.scores import params_of
from server.replay import fold, warm_up
from server.report import peak_rss_mb
from server.robots.crunch import Crunch, make_filter
from slam.evaluate import absolute_error, revisits
from slam.islands import Islands
from slam.timeline import associate
from slam.trajectory import correct

PARTICLES = (500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000)
THREADS = 2


def run(particles: int, seed: int) -> Record:
    """One drive with so many particles."""
    log, times, truth = read(cycle(seed, "medium", 1.8))
    params = params_of(filter={"particles": particles})
    drive = fold(log, Crunch(params), lambda keyframe: None)
    warm_up(params, THREADS)
    before_mb = peak_rss_mb()
    path_filter = make_filter(params, seed, THREADS)
    assert isinstance(path_filter, Islands)
    seconds, most_nodes, kept_nodes = [], 0, 0
    for keyframe in drive.keyframes:
        resamplings = path_filter.resamplings
        began = time.perf_counter()
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        seconds.append(time.perf_counter() - began)
        most_nodes = max(most_nodes, path_filter.n_nodes)
        if path_filter.resamplings > resamplings:
            kept_nodes = max(kept_nodes, path_filter.n_nodes)
    estimate = path_filter.estimate()
    matches = associate(drive.times, times)
    mapped = correct(drive.odometry, drive.rows, estimate.path)[matches.rows]
    again, vertices, peak_mb = revisits(mapped, truth[matches.reference_rows]), len(seconds), peak_rss_mb()
    return {
        "seed": seed,
        "closed": again.is_closed,
        "ate": absolute_error(mapped, truth[matches.reference_rows]).translation.rmse,
        "revisit_error": again.errors.translation.median,
        "vertices": vertices,
        "microseconds": 1e6 * sum(seconds) / (particles * vertices),
        "vertex_ms": 1e3 * float(np.median(seconds)),
        "worst_ms": 1e3 * max(seconds),
        "between_s": float(np.min(np.diff(drive.times[drive.rows]))),  # that the robot takes from vertex to vertex
        "peak_mb": peak_mb,
        "bytes_per_particle": 1e6 * (peak_mb - before_mb) / particles,
        "nodes": most_nodes,
        "kept_nodes": kept_nodes,
        "constant": (kept_nodes - vertices) / (particles * math.log(particles)) * estimate.resamplings / vertices,
        "resamplings": estimate.resamplings,
    }


def rows(crew: Crew) -> Iterator[Row]:
    """One for each number of particles; every run in a process of its own."""
    for particles in PARTICLES:
        if crew.wants(str(particles)):
            yield Row(str(particles), [crew.alone(run, particles, seed) for seed in range(crew.seeds)])


BENCH = Bench(
    name="scale",
    about="500 to a million particles on the two-lap 50 m cycle: closed, ATE, time, memory, size of the tree",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("closed (95 %)", share("closed")),
        Column("ATE median / p90 / worst (m)", tails("ate")),
        Column("revisit error (m)", middle("revisit_error")),
        Column("µs per particle and vertex", middle("microseconds", 3)),
        Column("vertex, median (ms)", middle("vertex_ms", 1)),
        Column("worst (ms)", tails("worst_ms", 0)),
        Column("robot takes at least (s)", middle("between_s", 2)),
        Column("peak memory (MB)", middle("peak_mb", 0)),
        Column("bytes per particle", middle("bytes_per_particle", 0)),
        Column("most nodes", middle("nodes", 0)),
        Column("after resampling", middle("kept_nodes", 0)),
        Column("C in T + k C N ln N", middle("constant", 2)),
        Column("not closed", failed("closed")),
    ),
    seeds=10,
    minutes=60,
    is_timed=True,
    heading="particles",
)
