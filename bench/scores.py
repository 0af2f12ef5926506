"""One benchmark run and its score, and how many runs become a line of a table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.recordings import CACHE
from server.formats.logs import Log
from server.map_picture import draw_png
from server.maps import floor_map
from server.replay import Result, run_log
from server.robots.crunch import CrunchParams
from slam.evaluate import absolute_error, revisits
from slam.timeline import associate


class Score(NamedTuple):
    """Errors of one run: ATE (m) of map and odometry, loops closed by either, speed as a multiple of real time."""

    seed: int
    ate: float
    odometry_ate: float
    closed: bool
    odometry_closed: bool
    revisit_median: float
    real_time_factor: float


def score(
    log: Log, times: np.ndarray, truth: np.ndarray, params: CrunchParams, seed: int, threads: int = 1
) -> tuple[Score, Result]:
    """Map `log` and compare with the true poses (n, 3) at `times`."""
    result = run_log(log, params, seed, threads)
    matches = associate(result.drive.times, times)
    mapped, odometry = result.trajectory[matches.rows], result.drive.odometry[matches.rows]
    return score_of(result, mapped, odometry, truth[matches.reference_rows], seed), result


def score_of(result: Result, mapped: np.ndarray, odometry: np.ndarray, truth: np.ndarray, seed: int) -> Score:
    """The score of a run whose poses (n, 3), mapped and by odometry, belong row by row to the true ones."""
    again = revisits(mapped, truth)
    return Score(
        seed,
        absolute_error(mapped, truth).translation.rmse,
        absolute_error(odometry, truth).translation.rmse,
        again.is_closed,
        revisits(odometry, truth).is_closed,
        again.errors.translation.median,
        float(np.ptp(result.drive.times)) / result.seconds["total"],
    )


def line(name: str, scores: Sequence[Score]) -> str:
    """A table row: how often the loop closed, ATE median and 90th percentile beside odometry's, speed."""
    column = {field: np.array([getattr(s, field) for s in scores], float) for field in Score._fields}
    failed = [s.seed for s in scores if not s.closed]
    closed, by_odometry = 100.0 * column["closed"].mean(), 100.0 * column["odometry_closed"].mean()
    return (
        f"| {name} | {len(scores)} | {closed:.0f} % | {by_odometry:.0f} % "
        f"| {np.median(column['ate']):.2f} / {np.quantile(column['ate'], 0.9):.2f} "
        f"| {np.median(column['odometry_ate']):.2f} / {np.quantile(column['odometry_ate'], 0.9):.2f} "
        f"| {np.median(column['revisit_median']):.2f} | {np.median(column['real_time_factor']):.0f} "
        f"| {failed or 'none'} |"
    )


HEADER = (
    "| run | seeds | closed | by odometry | ATE median / p90 (m) | odometry's "
    "| revisit error (m) | x real time | not closed |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def draw(result: Result, path: Path, *headline: str) -> None:
    """The map as a picture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    floor = floor_map(result.path, result.drive.walls, int(result.estimate.fixed_depth))
    path.write_bytes(draw_png(floor, *headline))


def keep(name: str, rows: object) -> Path:
    """Write the figures behind a table to `build/bench/NAME.json`."""
    CACHE.mkdir(parents=True, exist_ok=True)
    path = CACHE / f"{name}.json"
    path.write_text(json.dumps(rows, indent=1) + "\n")
    return path
