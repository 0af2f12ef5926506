"""Buildings in which an estimator might lose itself: slanted, round and mixed walls, corridors side by side.

    python -m bench.worlds [--seeds 50] [--worlds slanted round ...] [--drift medium high] [--particles 2000]

*Lost*: the loop was not closed and the ATE is worse than half of odometry's. *Captured*: a heading errs by more than 45
degrees somewhere. *Merged*: where the map has the robot come back to a place, it was truly somewhere else (by more than
0.8 m) in over 2 % of the cases. Every seed is another building, drive, noise and filter.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from bench.recordings import made, read
from bench.scores import keep
from firmware.virtual import VirtualCrunch
from firmware.virtual.buildings import Site, round_corridor, slanted_wings
from firmware.virtual.lanes import parallel_corridors
from firmware.virtual.museum import museum
from server import config
from server.replay import run_log
from slam.evaluate import absolute_error, alignment, revisit_pairs, revisits
from slam.pose import between, compose
from slam.timeline import associate

WORLDS: dict[str, Callable[[int], Site]] = {
    "slanted": slanted_wings,
    "round": round_corridor,
    "museum": museum,
    "parallel": parallel_corridors,
}
MEETING = 0.4  # m between two poses that the map holds for one place
ELSEWHERE = 0.8  # m by which such a place is truly another one
LEFT = 5.0  # m of path after which a place was left
HEADER = (
    "| world | seeds | closed | by odometry | lost | captured | merged | ATE median / p90 / worst (m) "
    "| odometry's | lost seeds |\n|---|---|---|---|---|---|---|---|---|---|"
)


class WorldScore(NamedTuple):
    """One run: errors (m) of map and odometry, loops closed by either, worst heading error (rad), wrong meetings."""

    seed: int
    ate: float
    odometry_ate: float
    closed: bool
    odometry_closed: bool
    heading: float
    merged: float  # share of the map's meetings

    @property
    def is_lost(self) -> bool:
        """No loop closed, and hardly better than odometry."""
        return not self.closed and self.ate > 0.5 * self.odometry_ate

    @property
    def is_captured(self) -> bool:
        """Somewhere the heading belongs to another wall."""
        return self.heading > np.pi / 4.0

    @property
    def is_merged(self) -> bool:
        """Two places have become one."""
        return self.merged > 0.02


def recording(name: str, seed: int, drift: str) -> Path:
    """The drive through a building, simulated once."""
    site = WORLDS[name](seed)

    def robot() -> VirtualCrunch:
        return VirtualCrunch(site.world, seed=seed, drift=drift, plan=site.plan)  # pyright: ignore

    return made(f"{name}-{drift}-{seed}", robot, 3.0 * site.plan.length / 0.3)


def wrong_meetings(poses: np.ndarray, truth: np.ndarray) -> float:
    """Share of the meetings of a mapped path (n, 3) with itself where the truth (n, 3) was elsewhere."""
    later, earlier = revisit_pairs(poses, MEETING, LEFT)
    apart = np.hypot(*(truth[later, :2] - truth[earlier, :2]).T)
    return float(np.mean(apart > ELSEWHERE)) if len(apart) else 0.0


def world_score(mapped: np.ndarray, odometry: np.ndarray, truth: np.ndarray, seed: int) -> WorldScore:
    """The score of poses (n, 3) that belong row by row to the true ones."""
    aligned = compose(alignment(mapped[:, :2], truth[:, :2]), mapped)
    return WorldScore(
        seed,
        absolute_error(mapped, truth).translation.rmse,
        absolute_error(odometry, truth).translation.rmse,
        revisits(mapped, truth).is_closed,
        revisits(odometry, truth).is_closed,
        float(np.max(np.abs(between(truth, aligned)[:, 2]))),
        wrong_meetings(mapped, truth),
    )


def run(job: tuple[str, int, str, str, int]) -> WorldScore:
    """One seed of a world at one drift with one preset and so many particles."""
    name, seed, drift, preset, particles = job
    params = config.load({"preset": preset, "crunch": {"filter": {"particles": particles}}}).crunch
    log, times, truth = read(recording(name, seed, drift))
    result = run_log(log, params, seed)
    matches = associate(result.drive.times, times)
    mapped, odometry = result.trajectory[matches.rows], result.drive.odometry[matches.rows]
    return world_score(mapped, odometry, truth[matches.reference_rows], seed)


def line(name: str, scores: Sequence[WorldScore]) -> str:
    """A row of the table."""
    column = {field: np.array([getattr(s, field) for s in scores], float) for field in WorldScore._fields}
    lost = [s.seed for s in scores if s.is_lost]
    n_captured, n_merged = sum(s.is_captured for s in scores), sum(s.is_merged for s in scores)
    ate, odometry = column["ate"], column["odometry_ate"]
    return (
        f"| {name} | {len(scores)} | {100.0 * column['closed'].mean():.0f} % "
        f"| {100.0 * column['odometry_closed'].mean():.0f} % | {len(lost)} | {n_captured} | {n_merged} "
        f"| {np.median(ate):.2f} / {np.quantile(ate, 0.9):.2f} / {ate.max():.2f} "
        f"| {np.median(odometry):.2f} / {np.quantile(odometry, 0.9):.2f} / {odometry.max():.2f} "
        f"| {lost or 'none'} |"
    )


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS))
    parser.add_argument("--drift", nargs="+", default=["medium", "high"])
    parser.add_argument("--preset", nargs="+", default=["default", "thesis"])
    parser.add_argument("--particles", type=int, default=2000)
    parser.add_argument("--processes", type=int, default=2)
    wanted = parser.parse_args()
    print(HEADER)
    rows = {}
    with ProcessPoolExecutor(wanted.processes) as pool:
        for world in wanted.worlds:
            for drift in wanted.drift:
                for preset in wanted.preset:
                    jobs = [(world, seed, drift, preset, wanted.particles) for seed in range(wanted.seeds)]
                    name = f"{world}, {drift}, {preset}"
                    made_of = pool.map(run, jobs)
                    scores = list(track(made_of, name, len(jobs), console=Console(stderr=True), transient=True))
                    rows[name] = [s._asdict() for s in scores]
                    print(line(name, scores), flush=True)
    print(keep("worlds", rows))


if __name__ == "__main__":
    main()
