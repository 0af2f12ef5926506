"""What each ingredient is worth: all of them, and every one switched off alone, on the same drives and seeds.

An ingredient is a change of settings; a new one gets a row in `INGREDIENTS`. There are a quarter of the default's
particles and islands, for there are many rows, and what is missed shows the sooner. Below stand the literal thesis,
with its 2,000 particles, and the odometry. Restarts are off, for they would mend with more islands what is missing; a
row has them on. Drives are folded once for all changes of the filter alone. Drives are of three kinds: cycles,
buildings that mislead, and, for the first few seeds, logs. What an ingredient is worth is told seed by seed: the ATE
without it over that with everything on the same drive, the geometric mean of each kind's drives.
Times are those on the cycles.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, figures, middle, share, tails
from bench.real import five_directions
from bench.recordings import cycle, data_folder, read, semireal
from bench.scores import params_of
from bench.worlds import recording
from server.formats.logs import Log
from server.presets import THESIS
from server.replay import Drive, fold, warm_up, with_sensors
from server.restarts import decided
from server.robots.crunch import Crunch, CrunchParams, make_estimator
from slam.evaluate import absolute_error, revisits
from slam.timeline import associate
from slam.trajectory import correct

FIVE = "five"  # of Crunch's eight directions, Intel's real beams
WHOLE, RESTARTED = "nothing", "nothing; restarts on"
THESIS_ITSELF, ODOMETRY = "all: the literal thesis", "all: odometry"
NO_DIRECTIONS: Mapping[str, Any] = {"filter": {"direction": {"gain": 0.0}}, "refinement": {"direction": 0.0}}
INGREDIENTS: Mapping[str, Mapping[str, Any]] = {  # settings of the robot; those of its filter under `filter`
    WHOLE: {},
    RESTARTED: {"restarts": CrunchParams().restarts},
    "islands": {"filter": {"islands": 1}},
    "beliefs that differ": {"filter": {"beliefs": "one"}},
    "refinement": {"refinement": {"rounds": 0}},
    "wall directions": NO_DIRECTIONS,
    "wall directions in the filter": {"filter": NO_DIRECTIONS["filter"]},
    "wall directions in the refinement": {"refinement": NO_DIRECTIONS["refinement"]},
    "biases of odometry": {"filter": {"motion": {"turn_bias": 0.0, "scale_bias": 0.0, "jitter": 0.0}}},
    "bias of turns": {"filter": {"motion": {"turn_bias": 0.0}}},
    "bias of distances": {"filter": {"motion": {"scale_bias": 0.0}}},
    "jitter of the biases": {"filter": {"motion": {"jitter": 0.0}}},
    "noise of turns on the spot": {"filter": {"motion": {"rotation_noise": 0.0}}},
    "the unknown and chance: two states": {"filter": {"comparison": THESIS["crunch"]["filter"]["comparison"]}},
    "test points: segments": {"filter": {"comparison": {"affinity": {"kind": "segments"}}}},
    "tempering: points add up": {"filter": {"comparison": {"affinity": {"gain": 64.0}}}},
    "second and third neighbour": {"filter": {"comparison": {"neighbours": 1}}},
    "threshold: resampled always": {"filter": {"threshold": 1.0}},
    "hindsight": {"hindsight": 0},
    "what lies beyond 2 x 2 m": {"local_map": {"reach": 1.0}},
    "scrolling: map resampled": {"local_map": {"resample": True}},
    "walls filled in between sweeps": {"local_map": {"bridge": 0.0}},
    "silence of sonars": {"local_map": {"sonar_silent_miss": 0.0}},
    "middle of the wall: where the ray meets it": {"walls": {"thickness": 1e-3}},
}
CYCLES, BUILDINGS, LOGS = ("medium", "high"), ("round", "parallel"), ("intel", "aces", FIVE)
KINDS = {"cycles": CYCLES, "buildings": BUILDINGS, "logs": LOGS}
PARTICLES = 10_000  # on eight islands
LOG_SEEDS = 2  # of the logs, which take ten times as long as a cycle and whose odometry every seed shares


def source(drive: str, seed: int) -> tuple[Log, Any, Any]:
    """A drive's log and truth; buildings are driven through at the drift that misleads most."""
    if drive == FIVE:
        return five_directions()
    if drive in LOGS:
        return read(semireal(drive, seed))
    return read(recording(drive, seed, "high") if drive in BUILDINGS else cycle(seed, drive))


def settings_of(name: str) -> CrunchParams:
    """The robot without an ingredient, or the thesis's."""
    if name == THESIS_ITSELF:
        return params_of("thesis")
    changes = INGREDIENTS.get(name, {})
    return params_of(**{"restarts": 0, **changes, "filter": {"particles": PARTICLES, **changes.get("filter", {})}})


def run(drive: str, seed: int, names: list[str]) -> dict[str, Record]:
    """Every named ingredient switched off alone on one drive."""
    log, times, truth = source(drive, seed)
    folded: dict[str, tuple[Drive, float]] = {}
    found = {}
    for name in names:
        params = with_sensors(settings_of(name), log)
        warm_up(params, 1)
        own = params.model_dump_json(exclude={"filter", "refinement"})
        if own not in folded:
            before = time.perf_counter()
            folded[own] = fold(log, Crunch(params), lambda keyframe: None), time.perf_counter() - before
        if name == ODOMETRY:
            found[name] = errors_of(folded[own][0], None, times, truth)
        else:
            found[name] = measure(*folded[own], params, seed, times, truth)
    return found


def measure(drive: Drive, fold_seconds: float, params: CrunchParams, seed: int, times, truth) -> Record:
    """Errors of the filter on a folded drive, and its speed."""
    began = time.perf_counter()
    path_filter = make_estimator(params, seed, 1)
    for keyframe in drive.keyframes:
        path_filter.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
    filtered = time.perf_counter()
    path_filter.refine()
    path_filter = decided(path_filter, drive.keyframes, params, seed, 1)[0]
    refined = time.perf_counter()
    n = len(drive.keyframes)
    return {
        **errors_of(drive, path_filter.estimate().path, times, truth),
        "vertex_ms": 1e3 * (filtered - began) / n,
        "refinement_ms": 1e3 * (refined - filtered) / n,
        "fold_ms": 1e3 * fold_seconds / n,
    }


def errors_of(drive: Drive, path: np.ndarray | None, times: np.ndarray, truth: np.ndarray) -> Record:
    """Errors of a path (v, 3) of a drive's vertices, or of its odometry, against true poses (n, 3) at `times` (n,)."""
    matches = associate(drive.times, times)
    poses = drive.odometry if path is None else correct(drive.odometry, drive.rows, path)
    mapped, reference = poses[matches.rows], truth[matches.reference_rows]
    return {
        "ate": absolute_error(mapped, reference).translation.rmse,
        "closed": revisits(mapped, reference).is_closed,
    }


def rows(crew: Crew) -> Iterator[Row]:
    """One for each ingredient, when all drives are done."""
    wanted = [name for name in (*INGREDIENTS, THESIS_ITSELF, ODOMETRY) if crew.wants(name)]
    names = list(dict.fromkeys([WHOLE, *wanted]))  # which the others are told beside
    jobs = [(drive, seed, names) for seed in range(crew.seeds) for drive in drives_of(seed)]
    done = iter(crew.map(run, jobs, "ablation") if wanted else [])
    found = [{drive: next(done) for drive in drives_of(seed)} for seed in range(crew.seeds)] if wanted else []
    for name in wanted:
        yield Row(name, [together(name, seed, parts) for seed, parts in enumerate(found)])


def drives_of(seed: int) -> tuple[str, ...]:
    """The drives of a seed: of the logs there are few."""
    return (*CYCLES, *BUILDINGS, *(LOGS if seed < LOG_SEEDS and data_folder() else ()))


def together(name: str, seed: int, parts: Mapping[str, Mapping[str, Record]]) -> Record:
    """The record of all drives of a seed: each drive's errors, the cycles' times, and what it costs."""
    found = {drive: records[name] for drive, records in parts.items()}
    record: Record = {"seed": seed}
    for drive, part in found.items():
        record |= {f"{drive}_{key}": part[key] for key in ("ate", "closed")}
    for key in ("vertex_ms", "refinement_ms", "fold_ms"):
        record[key] = float(np.mean([found[drive][key] for drive in CYCLES])) if name != ODOMETRY else None
    for kind, drives in KINDS.items():
        costs = [found[drive]["ate"] / parts[drive][WHOLE]["ate"] for drive in drives if drive in found]
        if costs:
            record[f"{kind}_cost"] = float(np.exp(np.mean(np.log(costs))))
    return record


BENCH = Bench(
    name="ablation",
    about="every ingredient switched off alone: what it costs in accuracy and time",
    rows=rows,
    columns=(
        Column("cycles, by seed, times the ATE of everything: median / p90", figures("cycles_cost", 2, 0.5, 0.9)),
        Column("misleading buildings, likewise: median / p90", figures("buildings_cost", 2, 0.5, 0.9)),
        Column("logs, likewise: median / worst", figures("logs_cost", 2, 0.5, 1.0)),
        Column("cycle, medium: closed", share("medium_closed")),
        Column("ATE (m)", tails("medium_ate")),
        Column("high: closed", share("high_closed")),
        Column("ATE (m)", tails("high_ate")),
        Column("round: closed", share("round_closed")),
        Column("parallel: closed", share("parallel_closed")),
        Column("Intel: ATE (m)", tails("intel_ate")),
        Column("ACES: ATE (m)", tails("aces_ate")),
        Column("five real directions: ATE (m)", tails("five_ate")),
        Column("filter (ms per vertex)", middle("vertex_ms")),
        Column("refinement", middle("refinement_ms")),
        Column("fold", middle("fold_ms")),
    ),
    seeds=20,
    minutes=60,
    heading="switched off",
)
