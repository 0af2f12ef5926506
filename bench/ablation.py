"""What each ingredient is worth: all of them, and every one switched off alone, on the same drives and seeds.

An ingredient is a change of settings; a new one gets a row in `INGREDIENTS`. Drives are folded once for all changes
of the filter alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

from bench.benchmark import Bench, Column, Crew, Record, Row, middle, share, tails
from bench.recordings import cycle, data_folder, read, semireal
from bench.scores import params_of
from server.formats.logs import Log
from server.presets import THESIS
from server.replay import Drive, fold, warm_up
from server.robots.crunch import Crunch, CrunchParams, make_estimator
from slam.evaluate import absolute_error, revisits
from slam.timeline import associate
from slam.trajectory import correct

INGREDIENTS: Mapping[str, Mapping[str, Any]] = {  # settings of the robot; those of its filter under `filter`
    "everything": {},
    "no refinement": {"refinement": {"rounds": 0}},
    "no refinement by wall directions": {"refinement": {"direction": 0.0}},
    "no bias of odometry": {"filter": {"motion": {"turn_bias": 0.0, "scale_bias": 0.0, "jitter": 0.0}}},
    "no jitter of the biases": {"filter": {"motion": {"jitter": 0.0}}},
    "no wall directions": {"filter": {"direction": {"gain": 0.0}}},
    "no noise of turns on the spot": {"filter": {"motion": {"rotation_noise": 0.0}}},
    "two states, agreement counted": {"filter": {"comparison": THESIS["crunch"]["filter"]["comparison"]}},
    "segments instead of points": {"filter": {"comparison": {"affinity": {"kind": "segments"}}}},
    "twice as hot": {"filter": {"comparison": {"affinity": {"gain": 10.0}}}},
    "one neighbour": {"filter": {"comparison": {"neighbours": 1}}},
    "resampled always": {"filter": {"threshold": 1.0}},
    "no hindsight": {"hindsight": 0},
    "a map of 2 x 2 m": {"local_map": {"reach": 1.0}},
    "map resampled": {"local_map": {"resample": True}},
    "walls where the ray meets them": {"walls": {"thickness": 1e-3}},
}  # fmt: skip
DRIVES = ("medium", "high", "intel", "aces")


def source(drive: str, seed: int) -> tuple[Log, Any, Any]:
    """A drive's log and truth."""
    return read(semireal(drive, seed) if drive in ("intel", "aces") else cycle(seed, drive))


def run(drive: str, seed: int, names: list[str]) -> dict[str, Record]:
    """Every named ingredient switched off alone on one drive."""
    log, times, truth = source(drive, seed)
    folded: dict[str, tuple[Drive, float]] = {}
    found = {}
    for name in names:
        params = params_of(**INGREDIENTS[name])
        warm_up(params, 1)
        own = repr({key: value for key, value in INGREDIENTS[name].items() if key != "filter"})
        if own not in folded:
            before = time.perf_counter()
            folded[own] = fold(log, Crunch(params), lambda keyframe: None), time.perf_counter() - before
        found[name] = measure(*folded[own], params, seed, times, truth)
    return found


def measure(drive: Drive, fold_seconds: float, params: CrunchParams, seed: int, times, truth) -> Record:
    """Errors of the filter on a folded drive, and its speed."""
    before = time.perf_counter()
    path_filter = make_estimator(params, seed, 1)
    for keyframe in drive.keyframes:
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
    path_filter.refine()
    path = path_filter.estimate().path
    seconds = time.perf_counter() - before
    matches = associate(drive.times, times)
    mapped, reference = correct(drive.odometry, drive.rows, path)[matches.rows], truth[matches.reference_rows]
    return {
        "ate": absolute_error(mapped, reference).translation.rmse,
        "closed": revisits(mapped, reference).is_closed,
        "vertex_ms": 1e3 * seconds / len(path),
        "fold_ms": 1e3 * fold_seconds / len(path),
    }


def rows(crew: Crew) -> Iterator[Row]:
    """One for each ingredient, when all drives are done."""
    names = [name for name in INGREDIENTS if crew.wants(name)]
    drives = DRIVES if data_folder() else DRIVES[:2]
    jobs = [(drive, seed, names) for drive in drives for seed in range(crew.seeds)]
    found = crew.map(run, jobs, "ablation")
    for name in names:
        records = [
            {"seed": seed, "drive": drive} | {f"{drive}_{key}": value for key, value in part[name].items()} | part[name]
            for (drive, seed, _), part in zip(jobs, found, strict=True)
        ]
        yield Row(name, records)


BENCH = Bench(
    name="ablation",
    about="every ingredient switched off alone, 2,000 particles: what it costs in accuracy and time",
    rows=rows,
    columns=(
        Column("cycle, medium: closed", share("medium_closed")),
        Column("ATE (m)", tails("medium_ate")),
        Column("high: closed", share("high_closed")),
        Column("ATE (m)", tails("high_ate")),
        Column("Intel: ATE (m)", tails("intel_ate")),
        Column("ACES: ATE (m)", tails("aces_ate")),
        Column("filter (ms per vertex)", middle("vertex_ms")),
        Column("fold", middle("fold_ms")),
    ),
    seeds=20,
    minutes=60,
    heading="switched off",
)
