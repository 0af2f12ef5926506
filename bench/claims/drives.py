"""Drives that the claims are measured on: folded once for each way of fusing, and mapped with any filter.

`Watched` is the one place that knows the path filter's inside: the two methods by which it resamples.
"""

from __future__ import annotations

import functools
import hashlib
import json
import pickle
import time
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from bench.claims.findings import Row
from bench.recordings import CACHE, ROOT, WIDTHS, cycle, firmware_hash, made, read
from firmware.virtual import Plan, VirtualCrunch, World, corridor_cycle
from firmware.virtual.corridor import centre_line
from server import config
from server.replay import Drive, fold
from server.robots.crunch import Crunch, CrunchParams, make_filter
from slam.evaluate import absolute_error, revisits
from slam.local_search import LocalSearch
from slam.path_filter import PathFilter, PathFilterParams
from slam.resampling import effective_particles, effective_sample_size
from slam.timeline import associate, interpolate
from slam.trajectory import correct

DRIFT = "medium"
FOLDED_BY = ("slam", "server/robots", "server/channels.py", "server/replay.py")
FUSION = {"sensors", "calibration", "track", "vertex_spacing", "hindsight", "local_map", "walls"}
OUT = 0.45  # share of a lap that is driven out before turning back, which closes no cycle

Route = Literal["cycle", "out and back"]
Criterion = Literal["entropy", "ess", "always"]


class Job(NamedTuple):
    """One run: where, how the robot is set up (`changes` to the preset, as JSON), and how it resamples."""

    route: Route
    seed: int
    length: float
    preset: str
    changes: str
    criterion: Criterion = "entropy"
    multinomial: bool = False


class Folded(NamedTuple):
    """A drive after fusion, with the true poses (v, 3) of its vertices and (n, 3) of its odometry's `rows` (n,)."""

    drive: Drive
    rows: np.ndarray
    truth: np.ndarray
    vertex_truth: np.ndarray


class Outcome(NamedTuple):
    """How a run ended; `profile` (v,) is the path tree's, `degeneracy` (v, 2) is 2^H and ESS as shares of all.

    `accepted` (v,) is how many perturbations a local search has kept up to each vertex.
    """

    closed: bool
    ate: float
    revisit: float
    seconds: float
    resamplings: int
    fixed_depth: int
    profile: np.ndarray
    degeneracy: np.ndarray
    accepted: np.ndarray
    odometry_closed: bool
    odometry_ate: float
    odometry_revisit: float


class Watched(PathFilter):
    """The path filter with another criterion or scheme of resampling, and a memory of how unequal its weights were.

    A filter whose threshold is 1 asks to resample whenever weights differ; whether it does is decided here.
    """

    def __init__(
        self, params: PathFilterParams, seed: int, criterion: Criterion = "entropy", multinomial: bool = False
    ):
        super().__init__(params.model_copy(update={"threshold": 1.0}), seed)
        self.wanted = params.threshold
        self.criterion: Criterion = criterion
        self.rng = np.random.default_rng([seed, 0xC1A1]) if multinomial else None
        self.degeneracy: list[tuple[float, float]] = []

    def resample_if_needed(self) -> None:
        """Ask; weights of which none is asked for are equal."""
        known, n = len(self.degeneracy), self.n_particles
        super().resample_if_needed()
        if len(self.degeneracy) == known:
            self.resample(np.full(n, 1.0 / n), n)

    def resample(self, weights: np.ndarray, n_particles: int) -> None:
        """As the criterion says. Multinomial counts are weights that leave a systematic draw nothing to decide."""
        entropy, ess = effective_particles(weights) / weights.size, effective_sample_size(weights) / weights.size
        self.degeneracy.append((entropy, ess))
        measure = {"entropy": entropy, "ess": ess, "always": -1.0}[self.criterion]
        if measure < self.wanted * (1.0 - 1e-9):
            counts = weights if self.rng is None else self.rng.multinomial(n_particles, weights) / n_particles
            super().resample(counts, n_particles)


def setting(preset: str, changes: dict[str, Any]) -> CrunchParams:
    """The robot by a preset with changes."""
    return config.load({"preset": preset, "crunch": changes}).crunch


def out_and_back(seed: int, length: float) -> Plan:
    """As far as two laps and a bit along the cycle's corridors, out and back again without ever going round."""
    step = 0.1
    line = centre_line(length, step)
    rng = np.random.default_rng([seed, 0xB1])
    tangents = np.gradient(line, axis=0)
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]]) / np.hypot(*tangents.T)[:, None]
    way = int(OUT * len(line))
    passes = round(2.2 / OUT)
    points = []
    for turn in range(passes):
        rows = np.arange(way)[:: -1 if turn % 2 else 1]
        points.append(line[rows] + normals[rows] * np.clip(rng.normal(0.0, 0.12), -0.3, 0.3))
    return Plan.through(np.vstack(points), 0.3, name=f"out-and-back-{seed}")


def world_of(seed: int, length: float) -> World:
    """The corridors of a seed."""
    return corridor_cycle(seed, length, WIDTHS[seed % len(WIDTHS)])


def recorded(route: Route, seed: int, length: float):
    """The recording of a drive, made if it is not there."""
    if route == "cycle":
        return cycle(seed, DRIFT, length=length)
    plan = out_and_back(seed, length)

    def robot() -> VirtualCrunch:
        return VirtualCrunch(world_of(seed, length), seed=seed, drift=DRIFT, plan=plan)

    return made(f"out-and-back-{length:g}-{DRIFT}-{seed}", robot, 3.0 * plan.length / 0.3)


@functools.cache
def fold_hash() -> bytes:
    """Of the sources that a folded drive was made by."""
    digest = hashlib.sha256(firmware_hash())
    for name in FOLDED_BY:
        place = ROOT / name
        for path in sorted(place.glob("*.py")) if place.is_dir() else [place]:
            digest.update(path.read_bytes())
    return digest.digest()


@functools.lru_cache(maxsize=100)
def folded(route: Route, seed: int, length: float, params: str) -> Folded:
    """A drive fused with `params` (JSON of what fusion depends on), kept in the cache."""
    key = hashlib.sha256(fold_hash() + f"{route} {seed} {length} {params}".encode()).hexdigest()[:12]
    path = CACHE / f"folded-{route.replace(' ', '-')}-{seed}-{key}.pickle"
    if path.exists():
        return pickle.loads(path.read_bytes())
    log, times, poses = read(recorded(route, seed, length))
    drive = fold(log, Crunch(CrunchParams(**json.loads(params))), lambda keyframe: None)
    matches = associate(drive.times, times)
    vertex_truth, _ = interpolate(times, poses, drive.times[drive.rows])
    result = Folded(drive, matches.rows, poses[matches.reference_rows], vertex_truth)
    path.write_bytes(pickle.dumps(result))
    return result


def fold_of(route: Route, seed: int, length: float, params: CrunchParams) -> Folded:
    """A drive fused as the parameters say."""
    return folded(route, seed, length, json.dumps(params.model_dump(include=FUSION), sort_keys=True))


@functools.cache
def outcome(job: Job) -> Outcome:
    """Map a drive, once for each job; nothing is refined."""
    params = setting(job.preset, json.loads(job.changes))
    seen = fold_of(job.route, job.seed, job.length, params)
    estimator = (
        Watched(params.filter_params(), job.seed, job.criterion, job.multinomial)
        if params.estimator == "filter"
        else make_filter(params, job.seed)
    )
    accepted = []
    started = time.process_time()
    for keyframe in seen.drive.keyframes:
        estimator.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        accepted.append(estimator.accepted if isinstance(estimator, LocalSearch) else 0)
    estimate = estimator.estimate()
    seconds = time.process_time() - started
    mapped = correct(seen.drive.odometry, seen.drive.rows, estimate.path)[seen.rows]
    odometry = seen.drive.odometry[seen.rows]
    found, by_odometry = revisits(mapped, seen.truth), revisits(odometry, seen.truth)
    return Outcome(
        closed=found.is_closed,
        ate=absolute_error(mapped, seen.truth).translation.rmse,
        revisit=found.errors.translation.median,
        seconds=seconds,
        resamplings=estimate.resamplings,
        fixed_depth=estimate.fixed_depth,
        profile=np.asarray(estimate.profile, float),
        degeneracy=np.array(estimator.degeneracy) if isinstance(estimator, Watched) else np.ones((0, 2)),
        accepted=np.array(accepted),
        odometry_closed=by_odometry.is_closed,
        odometry_ate=absolute_error(odometry, seen.truth).translation.rmse,
        odometry_revisit=by_odometry.errors.translation.median,
    )


def jobs(
    seeds: int, length: float, particles: int, preset: str = "default", route: Route = "cycle", **ways: Any
) -> list[Job]:
    """A job for each seed; `ways` are a job's criterion and scheme, and `changes` to the preset."""
    size = {"filter": {"particles": particles}}
    changes = json.dumps(config.merge(size, ways.pop("changes", {})), sort_keys=True)
    return [Job(route, seed, length, preset, changes, **ways) for seed in range(seeds)]


def summary(outcomes: Sequence[Outcome]) -> Row:
    """Loops closed, ATE and revisit error, seconds."""
    ate = np.array([one.ate for one in outcomes])
    return {
        "closed": f"{sum(one.closed for one in outcomes)} of {len(outcomes)}",
        "ATE median (m)": float(np.median(ate)),
        "p90": float(np.quantile(ate, 0.9)),
        "revisit error (m)": float(np.median([one.revisit for one in outcomes])),
        "s per drive": float(np.median([one.seconds for one in outcomes])),
    }


def by_odometry(outcomes: Sequence[Outcome]) -> Row:
    """The same of the odometry."""
    ate = np.array([one.odometry_ate for one in outcomes])
    return {
        "closed": f"{sum(one.odometry_closed for one in outcomes)} of {len(outcomes)}",
        "ATE median (m)": float(np.median(ate)),
        "p90": float(np.quantile(ate, 0.9)),
        "revisit error (m)": float(np.median([one.odometry_revisit for one in outcomes])),
        "s per drive": "",
    }
