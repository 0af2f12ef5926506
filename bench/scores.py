"""The record of one run beside the thesis's and odometry's on the same drive, and the columns that tell them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.benchmark import Column, Record, Row, failed, figures, middle, runs, share, tails
from bench.oracle import oracle_path
from server import config
from server.formats.logs import Log
from server.formats.relations import read_relations
from server.replay import Result, run_log
from server.robots.crunch import CrunchParams
from slam.evaluate import Relations, absolute_error, relations_error, revisits
from slam.timeline import associate
from slam.trajectory import correct

PARTICLES = 2000  # of the thesis, live; the default has its own number
PARTICLES_OFFLINE = 5000  # of the thesis, on its longest drive

COLUMNS = (
    Column("runs", runs),
    Column("closed (95 %)", share("closed")),
    Column("thesis closes", share("thesis_closed")),
    Column("odometry", share("odometry_closed")),
    Column("ATE median / p90 / worst (m)", tails("ate")),
    Column("thesis's", tails("thesis_ate")),
    Column("oracle's", tails("oracle_ate")),
    Column("by seed, times the oracle's: median / p90", figures("of_oracle", 2, 0.5, 0.9)),
    Column("odometry's", tails("odometry_ate")),
    Column("revisit error (m)", middle("revisit_error")),
    Column("not decided", share("open")),
    Column("restarts, median / most", figures("restarts", 0, 0.5, 1.0)),
    Column("x real time", middle("speed", 0)),
    Column("not closed", failed("closed")),
)

RELATIONS = (("mean", 4), ("std", 4), ("degrees", 2))  # of their errors, with digits

Scored = Callable[[Result], Record]


def params_of(preset: str = "default", filter: Mapping[str, Any] | None = None, **changes: Any) -> CrunchParams:
    """A preset's parameters with changes to the filter's and the robot's settings; the thesis has 2,000 particles."""
    size = {"particles": PARTICLES} if preset == "thesis" else {}
    crunch = {**changes, "filter": {**size, **(filter or {})}}
    return config.load({"preset": preset, "crunch": crunch}).crunch


def beside_thesis(
    log: Log, scored: Scored, seed: int, particles: int = PARTICLES, oracle: Scored = lambda result: {}
) -> Record:
    """The default's record on a log, with the literal thesis's under `thesis_...`; both on one thread.

    `particles` are the thesis's. `oracle` adds what a perfect loop closer makes of the default's drive.
    """
    ours, thesis = run_log(log, params_of(), seed), run_log(log, params_of("thesis", {"particles": particles}), seed)
    record = {"seed": seed, **scored(ours), **oracle(ours)}
    theirs = {f"thesis_{name}": value for name, value in scored(thesis).items() if not name.startswith("odometry")}
    if "oracle_ate" in record:
        record["of_oracle"] = record["ate"] / record["oracle_ate"]
    return record | theirs


def oracle_of(times: np.ndarray, truth: np.ndarray, seed: int) -> Scored:
    """The ATE (m) of odometry that was told all true loops, by the true poses (n, 3) at `times` (n,)."""

    def scored(result: Result) -> Record:
        drive = result.drive
        matches = associate(drive.times, times)
        filled = correct(drive.odometry, matches.rows, truth[matches.reference_rows])  # true poses may stand far apart
        is_known = (drive.times >= times.min()) & (drive.times <= times.max())
        at_vertices = np.where(is_known[:, None], filled, np.nan)[drive.rows]
        path = oracle_path(drive.odometry[drive.rows], at_vertices, params_of().filter.motion, seed)
        told = correct(drive.odometry, drive.rows, path)[matches.rows]
        return {"oracle_ate": absolute_error(told, truth[matches.reference_rows]).translation.rmse}

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
        "lead": result.verdict.lead,
        "restarts": result.verdict.restarts,
        "open": result.verdict.is_open if result.verdict.of > 1 else None,
        "speed": speed_of(result),
    }


def by_relations(result: Result, path: Path) -> Record:
    """Mean and standard deviation (m) and mean turn (degrees) of the relations' errors, odometry's beside them."""
    if not path.is_file():
        return {}
    relations, drive = read_relations(path), result.drive
    odometry = of_relations(drive.times, drive.odometry, relations)
    return {
        **of_relations(drive.times, result.trajectory, relations),
        **{f"odometry_{name}": value for name, value in odometry.items()},
    }


def of_relations(times: np.ndarray, poses: np.ndarray, relations: Relations) -> Record:
    """The same of any trajectory: poses (n, 3) at times (n,)."""
    errors = relations_error(times, poses, relations)
    return {
        "mean": errors.translation.mean,
        "std": errors.translation.std,
        "degrees": float(np.degrees(errors.rotation.mean)),
    }


def relations_of(row: Row, prefix: str = "") -> str:
    """Mean, standard deviation and turn of a path's relations, medians over the seeds; a dash where there are none."""
    if f"{prefix}mean" not in row.records[0]:
        return "-"
    mean, std, turn = (middle(f"{prefix}{name}", digits)(row) for name, digits in RELATIONS)
    return f"{mean} +- {std} m, {turn} deg"


def speed_of(result: Result) -> float:
    """How many times real time a run was."""
    return float(np.ptp(result.drive.times)) / result.seconds["total"]


def against(times: np.ndarray, truth: np.ndarray, record: Callable[..., Record] = record_of) -> Scored:
    """Scores a run by the true poses (n, 3) at `times` (n,)."""

    def scored(result: Result) -> Record:
        matches = associate(result.drive.times, times)
        mapped, odometry = result.trajectory[matches.rows], result.drive.odometry[matches.rows]
        return record(result, mapped, odometry, truth[matches.reference_rows])

    return scored


def of_each(rows: Sequence[Any], key: str, digits: int = 2) -> list[str]:
    """A line per row with the value of every run."""
    return [f"{row.name}: {' '.join(f'{record[key]:.{digits}f}' for record in row.records)}" for row in rows]
