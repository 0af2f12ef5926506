"""Real odometry and real buildings, one configuration for all.

`semi-real` drives have a log's own odometry and Crunch's simulated senses in the walls that the log's laser saw; a
seed is a new simulation and a new filter. `five directions` is `intel-dense.log`: its real beams, thinned to the
five of Crunch's eight directions that it sees; a seed is a new filter.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.benchmark import Bench, Record, Row, each
from bench.recordings import data_folder, read, semireal
from bench.scores import (
    COLUMNS,
    PARTICLES_OFFLINE,
    against,
    beside_thesis,
    by_relations,
    of_each,
    oracle_of,
    record_of,
    relations_of,
)
from server.formats.logs import Log, read_log
from server.formats.tum import read_tum
from server.replay import Result
from slam.timeline import interpolate

FIVE = "Intel, five directions"


def run(name: str, seed: int) -> Record:
    """One seed of a drive."""
    if name == FIVE:
        return on_real_beams(seed)
    log, times, truth = read(semireal(name, seed))
    return beside_thesis(log, against(times, truth), seed, PARTICLES_OFFLINE, oracle_of(times, truth, seed))


def five_directions() -> tuple[Log, np.ndarray, np.ndarray]:
    """The real beams as a log, with the times (n,) and poses (n, 3) of its reference."""
    data = data_folder()
    assert data is not None
    return read_log(data / "intel" / "intel-dense.log"), *read_tum(data / "intel" / "reference.tum")


def on_real_beams(seed: int) -> Record:
    """One seed on the real beams; beside the path's errors those of the relations that were verified by hand."""
    data = data_folder()
    assert data is not None
    log, times, truth = five_directions()

    def scored(result: Result) -> Record:
        drive = result.drive
        mapped = interpolate(drive.times, result.trajectory, times)[0]
        odometry = interpolate(drive.times, drive.odometry, times)[0]
        return record_of(result, mapped, odometry, truth) | by_relations(result, data / "intel" / "intel.relations")

    return beside_thesis(log, scored, seed, PARTICLES_OFFLINE, oracle_of(times, truth, seed))


def notes(rows: list[Row]) -> Iterator[str]:
    """Every seed's ATE, and the relations' errors beside the thesis's and odometry's."""
    yield from of_each(rows, "ate")
    for row in rows:
        if "mean" in row.records[0]:
            ours, thesis, odometry = (relations_of(row, prefix) for prefix in ("", "thesis_", "odometry_"))
            yield f"{row.name}, relations, medians over the seeds: {ours}; thesis {thesis}; odometry {odometry}"


BENCH = Bench(
    name="real",
    about="semi-real Intel and ACES, and Intel's real beams in five directions",
    rows=each(run, {"semi-real Intel": "intel", "semi-real ACES": "aces", FIVE: FIVE}),
    columns=COLUMNS,
    seeds=20,
    minutes=30,
    needs_data=True,
    heading="drive",
    notes=notes,
)
