"""How the filter grows with its particles: accuracy, time, memory and the tree, from 500 to a million, on two threads.

The drive is two laps of a 50 m cycle at 0.3 m/s with corridors 1.8 m wide and medium drift. Each run is a process of
its own, so that its peak memory is its own; decoding and fusion are not timed. A vertex is timed twice: the filter
alone, and with what the live worker does for its answer, the estimate and, where it is due, a quick refinement. Errors
are those of the path that is told, which is refined; beside them those of the filter's own best path.

After a resampling a tree of T levels is expected to have at most T + C N ln N nodes, if every level is resampled
(Jacob, Murray and Rubenthaler 2015); where k levels go by between resamplings, k times the second part. Each island has
a tree of its own: C is that of the worst.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, failed, middle, plain, runs, share, tails
from bench.recordings import cycle, read
from bench.scores import params_of
from server.estimator import EstimatorParams
from server.filter_worker import estimate_of
from server.replay import fold, warm_up
from server.report import peak_rss_mb
from server.robots.crunch import Crunch, make_estimator
from slam.evaluate import absolute_error, revisits
from slam.islands import Islands
from slam.path_filter import PathFilter
from slam.timeline import associate
from slam.trajectory import correct

PARTICLES = (500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000)
THREADS = 2


class Size(NamedTuple):
    """How many particles there are, by which preset."""

    particles: int
    preset: str = "default"


CASES = {str(particles): Size(particles) for particles in PARTICLES}
CASES |= {f"thesis, {particles}": Size(particles, "thesis") for particles in (2000, 40_000)}


class Trees:
    """How large the islands' trees were at most, and right after a resampling."""

    def __init__(self, islands: list[PathFilter]):
        self.islands = islands
        self.resamplings = [0] * len(islands)
        self.kept = [0] * len(islands)
        self.most = 0

    def look(self) -> None:
        """To be called after every vertex."""
        nodes = [island.tree.n_nodes if island.tree else 0 for island in self.islands]
        self.most = max(self.most, sum(nodes))
        for k, island in enumerate(self.islands):
            if island.resamplings > self.resamplings[k]:
                self.resamplings[k] = island.resamplings
                self.kept[k] = max(self.kept[k], nodes[k])

    def constant(self) -> float:
        """C of T + k C N ln N, where k levels went by between resamplings; of the worst island."""
        return max(
            (kept - island.vertices) / (island.n_particles * math.log(island.n_particles)) * often / island.vertices
            for island, kept, often in zip(self.islands, self.kept, self.resamplings, strict=True)
        )


def run(size: Size, seed: int) -> Record:
    """One drive with so many particles."""
    log, times, truth = read(cycle(seed, "medium", 1.8))
    params = params_of(size.preset, {"particles": size.particles})
    drive = fold(log, Crunch(params), lambda keyframe: None)
    warm_up(params, THREADS)
    before_mb = peak_rss_mb()
    estimator = make_estimator(params, seed, THREADS)
    assert isinstance(estimator.path_filter, Islands)
    trees, seconds, answers = Trees(estimator.path_filter.filters), [], []
    for keyframe in drive.keyframes:
        began = time.perf_counter()
        estimator.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        extended = time.perf_counter()
        if estimator.is_due:
            estimator.refine(is_quick=True)
        estimate_of(estimator, keyframe.t, EstimatorParams().shown)
        seconds.append(extended - began)
        answers.append(time.perf_counter() - began)
        trees.look()
    filtered, filter_mb, began = estimator.path_filter.estimate(), peak_rss_mb() - before_mb, time.perf_counter()
    estimator.refine()
    refinement = time.perf_counter() - began
    matches = associate(drive.times, times)
    reference = truth[matches.reference_rows]
    mapped, alone = (
        correct(drive.odometry, drive.rows, path)[matches.rows] for path in (estimator.estimate().path, filtered.path)
    )
    again, vertices, odometry = revisits(mapped, reference), len(seconds), drive.odometry[matches.rows]
    return {
        "seed": seed,
        "particles": size.particles,
        "islands": len(trees.islands),
        "closed": again.is_closed,
        "odometry_closed": revisits(odometry, reference).is_closed,
        "ate": absolute_error(mapped, reference).translation.rmse,
        "filter_ate": absolute_error(alone, reference).translation.rmse,
        "odometry_ate": absolute_error(odometry, reference).translation.rmse,
        "revisit_error": again.errors.translation.median,
        "vertices": vertices,
        "microseconds": 1e6 * sum(seconds) / (size.particles * vertices),
        "vertex_ms": 1e3 * float(np.median(seconds)),
        "worst_ms": 1e3 * max(seconds),
        "answer_ms": 1e3 * max(answers),
        "between_s": float(np.min(np.diff(drive.times[drive.rows]))),  # that the robot takes from vertex to vertex
        "refinement_s": refinement,  # at the end, of all islands
        "peak_mb": peak_rss_mb(),  # of the whole process, refinement and all
        "bytes_per_particle": 1e6 * filter_mb / size.particles,
        "nodes": trees.most,
        "kept_nodes": sum(trees.kept),
        "constant": trees.constant(),
        "resamplings": sum(trees.resamplings),
    }


def rows(crew: Crew) -> Iterator[Row]:
    """One for each number of particles; every run in a process of its own."""
    for name, size in CASES.items():
        if crew.wants(name):
            yield Row(name, [crew.alone(run, size, seed) for seed in range(crew.seeds)])


def notes(rows: list[Row]) -> Iterator[str]:
    """What the columns cannot say."""
    yield "Bytes per particle are what the process grew by, buffers of its libraries and all: read them from 50,000 on."
    yield "The thesis's 2 x 2 m map makes its vertices cheaper; it has 2,000 particles, and as many as the default has."


BENCH = Bench(
    name="scale",
    about="500 to a million particles on the two-lap 50 m cycle: closed, ATE, time, memory, size of the tree",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("islands", plain("islands")),
        Column("closed (95 %)", share("closed")),
        Column("odometry", share("odometry_closed")),
        Column("ATE median / p90 / worst (m)", tails("ate")),
        Column("the filter's alone", tails("filter_ate")),
        Column("odometry's", tails("odometry_ate")),
        Column("revisit error (m)", middle("revisit_error")),
        Column("µs per particle and vertex", middle("microseconds", 3)),
        Column("vertex, median (ms)", middle("vertex_ms", 1)),
        Column("worst (ms)", tails("worst_ms", 0)),
        Column("with all that the page is told, worst (ms)", tails("answer_ms", 0)),
        Column("robot takes at least (s)", middle("between_s", 2)),
        Column("refinement at the end (s)", tails("refinement_s", 1)),
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
    notes=notes,
)
