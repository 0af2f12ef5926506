"""Four time-of-flight beams of a nano-quadrotor: how far apart walls lie that it saw again, beside its odometry's.

There is no truth: the spread is that of `slam.evaluate.wall_spread`, which a path can also make small by never coming
back; so the points that were seen again are counted. In the thesis's 2 x 2 m the drone hardly ever sees a wall. The bag
is from H. Zhou et al., Efficient 2D Graph SLAM for Sparse Sensing, IROS 2022; `crunch replay` draws its map.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, middle, runs, tails
from bench.recordings import data_folder
from bench.scores import PARTICLES_OFFLINE, speed_of
from server import config
from server.formats.logs import read_log
from server.replay import Result, run_log
from slam.evaluate import wall_spread
from slam.walls import curves

BAG = "olsson-demo.bag"


def run(preset: str, seed: int) -> Record:
    """The spread of walls seen again along the best path of one seed; along the odometry for the preset `odometry`."""
    data = data_folder()
    assert data is not None
    log = read_log(data / "crazyflie-olsson" / BAG)
    is_odometry = preset == "odometry"
    flags = {"preset": "thesis", "crunch": {"filter": {"particles": PARTICLES_OFFLINE}}} if preset == "thesis" else {}
    result = run_log(log, config.load(flags, header=log.configuration).crunch, seed)
    path = np.array([keyframe.pose for keyframe in result.drive.keyframes]) if is_odometry else result.path
    record = {"seed": seed, **spread_of(path, result)}
    return record if is_odometry else {**record, "speed": speed_of(result)}


def spread_of(path: np.ndarray, result: Result) -> Record:
    """Median and 90th percentile (m) of the walls' spread along a path (v, 3), and how many points were seen again.

    `sighted` is the share (%) of the vertices that saw a wall at all.
    """
    seen = [curves(walls) for walls in result.drive.walls]
    spread = wall_spread(path, seen)
    sighted = 100.0 * float(np.mean([len(found) > 0 for found in seen]))
    return {"median": spread.median, "p90": spread.p90, "points": spread.n, "sighted": sighted}


def rows(crew: Crew) -> Iterator[Row]:
    """The map's rows, and odometry's, which has no seeds."""
    for preset in ("default", "thesis", "odometry"):
        if crew.wants(preset):
            seeds = range(1 if preset == "odometry" else crew.seeds)
            yield Row(preset, crew.map(run, [(preset, seed) for seed in seeds], preset))


BENCH = Bench(
    name="crazyflie",
    about="four time-of-flight beams of a nano-quadrotor: how far apart walls lie that it saw again",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("spread: median over the seeds / p90 / worst (m)", tails("median", 3)),
        Column("its 90th percentile (m)", tails("p90", 3)),
        Column("points seen again", middle("points", 0)),
        Column("vertices that saw a wall (%)", middle("sighted", 0)),
        Column("x real time", middle("speed", 0)),
    ),
    seeds=20,
    minutes=10,
    needs_data=True,
    heading="path",
)
