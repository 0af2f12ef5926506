"""Buildings in which an estimator might lose itself: slanted, round and mixed walls, corridors side by side.

Who does not close the loop is lost. *Captured*: a heading errs by more than 45 degrees somewhere. *Merged*: where the
map has the robot come back to a place, it was truly somewhere else (by more than 0.8 m) in over 2 % of the cases. Every
seed is another building, drive, noise and filter.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from bench.benchmark import Bench, Column, Record, each, failed, figures, middle, runs, share, tails
from bench.recordings import made, read
from bench.scores import against, beside_thesis, record_of
from firmware.virtual import VirtualCrunch
from firmware.virtual.buildings import Site, round_corridor, slanted_wings
from firmware.virtual.lanes import parallel_corridors
from firmware.virtual.museum import museum
from server.replay import Result
from slam.evaluate import alignment, wrong_meetings
from slam.pose import between, compose

WORLDS: dict[str, Callable[[int], Site]] = {
    "slanted": slanted_wings,
    "round": round_corridor,
    "museum": museum,
    "parallel": parallel_corridors,
}
MERGED = 0.02  # of the meetings on the map that are of two places


def recording(name: str, seed: int, drift: str) -> Path:
    """The drive through a building, simulated once."""
    site = WORLDS[name](seed)

    def robot() -> VirtualCrunch:
        return VirtualCrunch(site.world, seed=seed, drift=drift, plan=site.plan)  # pyright: ignore

    return made(f"{name}-{drift}-{seed}", robot, 3.0 * site.plan.length / 0.3)


def world_record(result: Result, mapped: np.ndarray, odometry: np.ndarray, truth: np.ndarray) -> Record:
    """The record of poses (n, 3) that belong row by row to the true ones, and how they went wrong if they did."""
    record = record_of(result, mapped, odometry, truth)
    aligned = compose(alignment(mapped[:, :2], truth[:, :2]), mapped)
    heading, merged = float(np.max(np.abs(between(truth, aligned)[:, 2]))), wrong_meetings(mapped, truth)
    return {
        **record,
        "heading": heading,
        "wrong_meetings": merged,
        "captured": bool(heading > np.pi / 4.0),
        "merged": merged > MERGED,
    }


def run(case: tuple[str, str], seed: int) -> Record:
    """One seed of a world at one drift."""
    log, times, truth = read(recording(case[0], seed, case[1]))
    return beside_thesis(log, against(times, truth, world_record), seed)


BENCH = Bench(
    name="worlds",
    about="slanted, round and mixed walls, corridors side by side: who gets lost",
    rows=each(run, {f"{world}, {drift}": (world, drift) for world in WORLDS for drift in ("medium", "high")}),
    columns=(
        Column("runs", runs),
        Column("closed (95 %)", share("closed")),
        Column("thesis closes", share("thesis_closed")),
        Column("odometry", share("odometry_closed")),
        Column("captured", share("captured")),
        Column("merged", share("merged")),
        Column("not decided", share("open")),
        Column("restarts, median / most", figures("restarts", 0, 0.5, 1.0)),
        Column("ATE median / p90 / worst (m)", tails("ate")),
        Column("thesis's", tails("thesis_ate")),
        Column("odometry's", tails("odometry_ate")),
        Column("x real time", middle("speed", 0)),
        Column("lost seeds", failed("closed")),
    ),
    seeds=50,
    minutes=60,
    heading="world, drift",
)
