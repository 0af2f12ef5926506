"""Four time-of-flight beams of a nano-quadrotor: how far apart walls lie that it saw again, beside its odometry's.

    python -m bench.crazyflie [--seeds 20] [--particles 5000] [--picture FILE]

There is no truth: the spread is that of `slam.evaluate.wall_spread`. Needs the recordings' folder (`CRUNCH_DATA`); the
bag is from H. Zhou et al., Efficient 2D Graph SLAM for Sparse Sensing, IROS 2022.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.recordings import data_folder
from bench.scores import draw, keep
from server import config
from server.formats.logs import read_log
from server.replay import Result, run_log
from slam.evaluate import wall_spread
from slam.walls import curves


class Row(NamedTuple):
    """One seed: median and 90th percentile (m) of the walls' spread, how many points were seen again, real time."""

    seed: int
    median: float
    p90: float
    n: int
    real_time_factor: float


def rows(seeds: Sequence[int], particles: int = 5000, bag: str = "olsson-demo.bag") -> tuple[Row, list[Row], Result]:
    """Odometry's row, a row per seed, and the last run; FileNotFoundError without the recordings."""
    data = data_folder()
    if data is None:
        raise FileNotFoundError("no recordings found; set CRUNCH_DATA to their folder")
    log = read_log(data / "crazyflie-olsson" / bag)
    params = config.load({"crunch": {"filter": {"particles": particles}}}, header=log.configuration).crunch
    found: list[Row] = []
    result = None
    for seed in seeds:
        result = run_log(log, params, seed)
        found.append(row_of(seed, result.path, result))
    assert result is not None, "at least one seed"
    odometry = np.array([keyframe.pose for keyframe in result.drive.keyframes])
    return row_of(-1, odometry, result), found, result


def row_of(seed: int, path: np.ndarray, result: Result) -> Row:
    """The spread of the walls along a path (v, 3)."""
    spread = wall_spread(path, [curves(walls) for walls in result.drive.walls])
    speed = float(np.ptp(result.drive.times)) / result.seconds["total"]
    return Row(seed, spread.median, spread.p90, spread.n, speed)


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--particles", type=int, default=5000)
    parser.add_argument("--picture", type=Path)
    wanted = parser.parse_args()
    try:
        odometry, mapped, result = rows(range(wanted.seeds), wanted.particles)
    except FileNotFoundError as error:
        sys.exit(f"bench.crazyflie: {error}")
    print("| path | seeds | spread of walls seen again: median (m) | p90 (m) | points | x real time |")
    print("|---|---|---|---|---|---|")
    print(f"| odometry | | {odometry.median:.3f} | {odometry.p90:.3f} | {odometry.n} | |")
    for name, pick in (("map, median of the seeds", np.median), ("map, worst seed", np.max)):
        column = [float(pick([getattr(row, field) for row in mapped])) for field in ("median", "p90")]
        points, speed = (np.median([getattr(row, field) for row in mapped]) for field in ("n", "real_time_factor"))
        print(f"| {name} | {len(mapped)} | {column[0]:.3f} | {column[1]:.3f} | {points:.0f} | {speed:.0f} |")
    print(keep("crazyflie", {"odometry": odometry._asdict(), "map": [row._asdict() for row in mapped]}))
    if wanted.picture:
        draw(result, wanted.picture, "Four beams of a nano-quadrotor", f"{len(result.path)} vertices")


if __name__ == "__main__":
    main()
