"""Few beams of a laser: Intel's relations by the number of beams, and ACES against its reference.

`intel-dense.log` is thinned to so many evenly spread beams, as far-seeing as the laser or cut at 5 m; the error is that
of the relative poses that R. Kuemmerle et al. verified by hand (Autonomous Robots 27, 2009). For ACES there are none in
`data/`: it is measured against GMapping's path of the full laser, which is a reference and not the truth. A seed is a
new filter; the preset is the one that `crunch replay --beams` takes, for both logs and any number of beams.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from bench.benchmark import Bench, Column, Record, Row, each, failed, middle, runs, tails
from bench.recordings import data_folder
from bench.scores import against, by_relations, params_of, record_of, relations_of, speed_of
from server import config
from server.formats.carmen import FLASER_MAX_RANGE
from server.formats.logs import Log, read_log
from server.formats.tum import read_tum
from server.replay import Result, run_log
from slam.timeline import interpolate

BEAMS = (4, 5, 8, 11, 30)
LOGS = {"Intel": "intel/intel-dense.log", "ACES": "aces/aces.log"}


class Published(NamedTuple):
    """Errors of Intel's relations that others reached: mean and standard deviation (m), mean turn (degrees)."""

    beams: int
    mean: float
    std: float
    degrees: float


class Case(NamedTuple):
    """A log below the folder of recordings, how many beams are left of its laser, and how far they see (m)."""

    log: str
    beams: int
    reach: float = FLASER_MAX_RANGE


PUBLISHED = {  # H. Zhou et al., Efficient 2D Graph SLAM for Sparse Sensing, IROS 2022; of all scans, five times as many
    "Sparse-GSLAM": Published(11, 0.0848, 0.1151, 2.319),
    "GMapping": Published(30, 0.1139, 0.2274, 2.283),
}


def run(case: Case, seed: int) -> Record:
    """One seed, beside the thesis's filter and odometry."""
    data = data_folder()
    assert data is not None
    log = read_log(data / case.log, case.beams, case.reach)
    ours = run_log(log, config.load({}, header=log.configuration).crunch, seed)
    thesis = run_log(log, params_of("thesis"), seed)
    record = {"seed": seed, "beams": case.beams, "reach": case.reach, **scored(ours, log), "speed": speed_of(ours)}
    theirs = {f"thesis_{name}": value for name, value in scored(thesis, log).items() if not name.startswith("odometry")}
    return record | theirs


def scored(result: Result, log: Log) -> Record:
    """A run's errors against the path beside its log, and by the relations where there are any."""
    times, reference = read_tum(log.path.parent / "reference.tum")
    if log.path.parent.name == "aces":
        record = against(times, reference)(result)
    else:
        drive = result.drive
        mapped, odometry = (interpolate(drive.times, poses, times)[0] for poses in (result.trajectory, drive.odometry))
        record = record_of(result, mapped, odometry, reference)
    return record | by_relations(result, log.path.parent / "intel.relations")


def relations_column(prefix: str = "") -> Column:
    """The relations' error, medians over the seeds."""
    return Column(prefix.replace("_", "'s ") + "relations", lambda row: relations_of(row, prefix))


def notes(rows: list[Row]) -> Iterator[str]:
    """Every seed's figure, and what others published."""
    for row in rows:
        key = "mean" if "mean" in row.records[0] else "ate"
        yield f"{row.name}, by seed (m): {' '.join(f'{record[key]:.4f}' for record in row.records)}"
    for name, other in PUBLISHED.items():
        reached = f"{other.mean} +- {other.std} m, {other.degrees} deg"
        yield f"published, Intel, {other.beams} beams of all scans: {name} {reached}"


BENCH = Bench(
    name="beams",
    about="few beams of Intel's and ACES's lasers, 40,000 particles; of relations medians over the seeds",
    rows=each(
        run,
        {f"Intel, {n} beams": Case(LOGS["Intel"], n) for n in BEAMS}
        | {"ACES, 11 beams": Case(LOGS["ACES"], 11)}
        | {f"{name}, 11 beams of 5 m": Case(log, 11, 5.0) for name, log in LOGS.items()},
    ),
    columns=(
        Column("runs", runs),
        relations_column(),
        Column("its mean: median / p90 / worst (m)", tails("mean", 4)),
        relations_column("thesis_"),
        relations_column("odometry_"),
        Column("ATE median / p90 / worst (m)", tails("ate")),
        Column("thesis's", tails("thesis_ate")),
        Column("odometry's", middle("odometry_ate")),
        Column("revisit error (m)", middle("revisit_error", 3)),
        Column("x real time", middle("speed", 0)),
        Column("not closed", failed("closed")),
    ),
    seeds=20,
    minutes=90,
    needs_data=True,
    heading="log",
    notes=notes,
)
