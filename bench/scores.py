"""The record of one run beside the thesis's and odometry's on the same drive, and the columns that tell them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.benchmark import Column, Record, failed, middle, runs, share, tails
from server import config
from server.formats.logs import Log
from server.map_picture import draw_png
from server.maps import floor_map
from server.replay import Result, run_log
from server.robots.crunch import CrunchParams
from slam.evaluate import absolute_error, revisits
from slam.timeline import associate

PARTICLES = 2000  # the thesis's number

COLUMNS = (
    Column("runs", runs),
    Column("closed (95 %)", share("closed")),
    Column("thesis closes", share("thesis_closed")),
    Column("odometry", share("odometry_closed")),
    Column("ATE median / p90 / worst (m)", tails("ate")),
    Column("thesis's", tails("thesis_ate")),
    Column("odometry's", tails("odometry_ate")),
    Column("revisit error (m)", middle("revisit_error")),
    Column("x real time", middle("speed", 0)),
    Column("not closed", failed("closed")),
)

Scored = Callable[[Result], Record]


def params_of(preset: str = "default", filter: Mapping[str, Any] | None = None, **changes: Any) -> CrunchParams:
    """The robot's parameters: a preset with 2,000 particles, and changes to the filter's and the robot's settings."""
    crunch = {**changes, "filter": {"particles": PARTICLES, **(filter or {})}}
    return config.load({"preset": preset, "crunch": crunch}).crunch


def beside_thesis(log: Log, scored: Scored, seed: int, particles: int = PARTICLES) -> Record:
    """The default's record on a log, with the literal thesis's under `thesis_...`; both on one thread."""
    ours, thesis = (
        scored(run_log(log, params_of(preset, {"particles": particles}), seed)) for preset in ("default", "thesis")
    )
    return {"seed": seed, **ours, **{f"thesis_{name}": thesis[name] for name in ("ate", "closed", "speed")}}


def against(times: np.ndarray, truth: np.ndarray) -> Scored:
    """Scores a run by the true poses (n, 3) at `times` (n,)."""

    def scored(result: Result) -> Record:
        matches = associate(result.drive.times, times)
        mapped, odometry = result.trajectory[matches.rows], result.drive.odometry[matches.rows]
        return record_of(result, mapped, odometry, truth[matches.reference_rows])

    return scored


def record_of(result: Result, mapped: np.ndarray, odometry: np.ndarray, truth: np.ndarray) -> Record:
    """Errors of a run whose poses (n, 3), mapped and by odometry, belong row by row to the true ones.

    ATE and the median error over revisits are in m; speed is a multiple of real time.
    """
    again = revisits(mapped, truth)
    return {
        "ate": absolute_error(mapped, truth).translation.rmse,
        "closed": again.is_closed,
        "revisit_error": again.errors.translation.median,
        "odometry_ate": absolute_error(odometry, truth).translation.rmse,
        "odometry_closed": revisits(odometry, truth).is_closed,
        "speed": float(np.ptp(result.drive.times)) / result.seconds["total"],
    }


def draw(result: Result, path: Path, *headline: str) -> None:
    """The map as a picture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    floor = floor_map(result.path, result.drive.walls, int(result.estimate.fixed_depth))
    path.write_bytes(draw_png(floor, *headline))


def of_each(rows: Sequence[Any], key: str, digits: int = 2) -> list[str]:
    """A line per row with the value of every run."""
    return [f"{row.name}: {' '.join(f'{record[key]:.{digits}f}' for record in row.records)}" for row in rows]
