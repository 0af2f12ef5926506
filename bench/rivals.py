"""What a user would install today, on Intel: the programs of MRPT as Debian ships them, beside Maze Runner, in one run.

MRPT (J. L. Blanco-Claraco et al., https://www.mrpt.org): rbpf-slam with both configurations that it brings for Intel,
G. Grisetti's proposals (IEEE Transactions on Robotics 23, 2007) on maps of points and J. L. Blanco's optimal sampling
(International Journal of Robotics Research 29, 2010) on grids, icp-slam with its demonstration's, and graphslam-engine
with those for odometry and a laser, once with the loop closer. Configurations are the shipped ones but for files,
logging, display and the seed, and for particles where a row tells them.

All read the same scans, and odometry as it was told before each. rbpf-slam is judged by the most likely particle's path
at its end, `most_likely_path.txt`, with a pose wherever its filter ran, as its log tells; icp-slam never mends a pose,
so that `log_estimated_path.txt`, with a pose per scan, is its path; graphslam-engine by its last graph, whose nodes
stand where odometry went what its log tells. Odometry fills in what lies between, as for ours.
Theirs is the time of the whole program, with reading its log, about 0.2 s; ours begins when the log is read and all is
compiled. The processor's time is that of all threads, and does not depend on who else works on the machine.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Crew, Record, Row, figures, middle, runs
from bench.laser import LOGS
from bench.rawlog import scans_and_rows, write_rawlog
from bench.recordings import data_folder
from bench.scores import by_relations, of_relations, relations_of
from server import config
from server.errors import UserError
from server.formats.carmen import read_carmen
from server.formats.logs import read_log
from server.formats.relations import read_relations
from server.mapping import mapper_of, with_sensors
from server.replay import run_mapper, warm_up
from slam.pose import between
from slam.trajectory import correct

CONFIGS = Path("/usr/share/mrpt/config_files")
REMEDY = "bench rivals runs MRPT's programs; apt-get install mrpt-apps mrpt-common"
GRAPH = "graphslam-engine"
SECTION = "[MappingApplication]"
QUIET = {
    "LOG_FREQUENCY": 1_000_000,
    "SAVE_MAP_IMAGES": 0,
    "SAVE_3D_SCENE": 0,
    "SAVE_POSE_LOG": 0,
    "SHOW_PROGRESS_IN_WINDOW": 0,
    "SHOW_PROGRESS_3D_REAL_TIME": 0,
    "verbosity_level": "INFO",
}
DIGITS = 2e-6  # m and rad, of a motion in graphslam-engine's log
LIMIT = 3600.0  # s that a rival may take
LOST = 1.0  # m: whose relations err by more on average has lost its way
OURS = "crunch, 30 particles"


class Rival(NamedTuple):
    """A program with one of its shipped configurations; `particles` instead of the shipped number, and more options."""

    program: str
    shipped: str
    particles: int | None = None
    options: tuple[str, ...] = ()

    @property
    def is_random(self) -> bool:
        """Whether another seed gives another path."""
        return self.program == "rbpf-slam"


RIVALS = {
    "icp-slam": Rival("icp-slam", "icp-slam_demo_classic.ini"),
    GRAPH: Rival(GRAPH, "odometry_2DRangeScans.ini"),
    f"{GRAPH}, loop closer": Rival(GRAPH, "odometry_2DRangeScans_LC.ini", options=("-e", "CLoopCloserERD")),
    "rbpf-slam on points, 10 particles": Rival("rbpf-slam", "gridmapping_RBPF_ICPbased_intel.ini"),
    "rbpf-slam on grids, 20 particles": Rival("rbpf-slam", "gridmapping_intel.ini"),
    "rbpf-slam on points, 30 particles": Rival("rbpf-slam", "gridmapping_RBPF_ICPbased_intel.ini", 30),
}
ON = ("Intel, dense", "Intel")


def run(log: str, rival: Rival, seed: int) -> Record:
    """One seed of a rival on a log below the folder of recordings."""
    data = data_folder()
    assert data is not None
    recording = read_carmen(data / log)
    with tempfile.TemporaryDirectory(prefix="rivals-") as name:
        folder = Path(name)
        write_rawlog(folder / "log.rawlog", recording)
        record: Record = {"seed": seed, **executed(rival, folder, seed)}
        if record["outcome"] != "ended":
            return record
        _, rows = scans_and_rows(recording)
        steps, path = path_of(folder, recording.odometry[rows])
    trajectory = correct(recording.odometry, rows[steps], path)
    found = of_relations(
        recording.odometry_times, trajectory, read_relations(data / Path(log).parent / "intel.relations")
    )
    return {**record, **found, "outcome": outcome_of(found), "vertices": len(steps)}


def executed(rival: Rival, folder: Path, seed: int) -> Record:
    """Run the program on `log.rawlog` in a folder, into its `out` and `said`: how it ended, and the seconds it took."""
    command = command_of(rival, folder, seed)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with (folder / "said").open("w") as said:
        try:
            status = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, cwd=folder, timeout=LIMIT, check=False
            ).returncode
        except subprocess.TimeoutExpired:
            return {"outcome": f"stopped after {LIMIT:.0f} s"}
    ended, after = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    version = re.search(r"MRPT C\+\+ Library: MRPT (\S+)", (folder / "said").read_text(errors="replace"))
    return {
        "outcome": "ended" if status == 0 else how_it_died(status),
        "seconds": ended - began,
        "processor": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        **({"version": version[1]} if version else {}),
    }


def command_of(rival: Rival, folder: Path, seed: int) -> list[str]:
    """The program's command, for which its settings are written to the folder."""
    shipped = CONFIGS / rival.program / rival.shipped
    if rival.program == GRAPH:
        return [GRAPH, "--2d", "--disable-visuals", *rival.options, "-r", "log.rawlog", "-i", str(shipped)]
    changes = {**QUIET, "rawlog_file": folder / "log.rawlog", "logOutput_dir": folder / "out", "RANDOM_SEED": seed}
    if rival.particles is not None:
        changes["sampleSize"] = rival.particles
    (folder / "settings.ini").write_text(with_settings(shipped.read_text(), changes))
    return [rival.program, "settings.ini"]


def with_settings(text: str, changes: Mapping[str, object]) -> str:
    """A configuration of MRPT with some keys of its main section set, in place of what it says of them."""
    kept = re.sub(rf"(?m)^[ \t]*(?:{'|'.join(map(re.escape, changes))})[ \t]*=.*\n", "", text)
    if SECTION not in kept:
        raise ValueError(f"a configuration without {SECTION}")
    head, _, tail = kept.partition(f"\n{SECTION}")
    rest = tail.partition("\n")[2]
    return f"{head}\n{SECTION}\n" + "".join(f"{key} = {value}\n" for key, value in changes.items()) + rest


def how_it_died(status: int) -> str:
    """What a program's status, which is not 0, means."""
    return f"died of {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"


def path_of(folder: Path, odometry: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The steps (v,) at which a program has poses at its end, and the poses (v, 3); `odometry` (k, 3) is by step."""
    said, online = (folder / "said").read_text(errors="replace"), folder / "out" / "log_estimated_path.txt"
    graph, final = folder / "graphslam_results" / "output_graph.graph", folder / "out" / "most_likely_path.txt"
    if graph.is_file():
        steps, path = node_steps(said, odometry), nodes_of(graph.read_text())
    elif final.is_file():
        steps, path = filtered_steps(said), np.loadtxt(final, ndmin=2)[1:]  # the first is before the first step
    else:
        table = np.loadtxt(online, ndmin=2)
        steps, path = table[:, 0].astype(int), table[:, 1:4]
    if len(steps) != len(path):
        raise ValueError(f"{len(path)} poses of {len(steps)} steps")
    return steps, path


def nodes_of(graph: str) -> np.ndarray:
    """The nodes (v, 3) of a graph's text, by their numbers."""
    nodes = [[float(field) for field in line.split()[1:5]] for line in graph.splitlines() if line.startswith("VERTEX")]
    return np.array(sorted(nodes))[:, 1:]


def node_steps(said: str, odometry: np.ndarray) -> np.ndarray:
    """The steps (v,) of graphslam-engine's nodes, whose motions by odometry (k, 3) it tells; the first is the start."""
    steps = [0]
    for match in re.finditer(r"\d+ => \d+\s+Edge: \[(\S+) (\S+) (\S+)deg\]", said):
        motion = np.array([float(match[1]), float(match[2]), np.radians(float(match[3]))])
        apart = between(motion, between(odometry[steps[-1]], odometry[steps[-1] :]))
        is_there = np.all(np.abs(apart) < DIGITS, axis=1)
        if not is_there.any():
            raise ValueError(f"no step after {steps[-1]} goes {motion}")
        steps.append(steps[-1] + int(np.argmax(is_there)))
    return np.array(steps)


def filtered_steps(said: str) -> np.ndarray:
    """At which steps rbpf-slam's filter ran, by what it said: a new pose before the step's end."""
    steps, step = [], 0
    for match in re.finditer(r"New pose=|-- STEP (\d+) --", said):
        if match[1] is None:
            steps.append(step)
        else:
            step = int(match[1])
    return np.array(steps, int)


def ours(log: str, seed: int) -> Record:
    """One seed of Maze Runner on a log, on all cores."""
    data = data_folder()
    assert data is not None
    recording = read_log(data / log, robot="maze_runner")
    params, threads = with_sensors(config.load({}).maze_runner, recording), os.cpu_count() or 1
    warm_up(params, threads)
    before = time.process_time()
    result = run_mapper(recording, mapper_of(params, seed, threads))
    processor = time.process_time() - before
    found = by_relations(result, recording.path.parent / "intel.relations")
    return {
        "seed": seed,
        "outcome": outcome_of(found),
        "seconds": result.seconds["total"],
        "processor": processor,
        **found,
        "vertices": len(result.path),
    }


def outcome_of(found: Record) -> str:
    """Whether a map came out."""
    return "mapped" if found["mean"] < LOST else "lost"


def rows(crew: Crew) -> Iterator[Row]:
    """Ours on each log, then the rivals with how many times as long they took; UserError without MRPT."""
    if any(shutil.which(rival.program) is None for rival in RIVALS.values()) or not CONFIGS.is_dir():
        raise UserError(REMEDY)
    names = [f"{log}, {name}" for log in ON for name in (OURS, *RIVALS)]
    for log in ON:
        wanted = {name: rival for name, rival in RIVALS.items() if crew.wants(f"{log}, {name}", names)}
        if not wanted and not crew.wants(f"{log}, {OURS}", names):
            continue
        own = crew.map(ours, [(LOGS[log], seed) for seed in range(crew.seeds)], OURS)
        yield Row(f"{log}, {OURS}", beside(own, own))
        for name, rival in wanted.items():
            seeds = range(crew.seeds if rival.is_random else 1)
            yield Row(f"{log}, {name}", beside(crew.map(run, [(LOGS[log], rival, seed) for seed in seeds], name), own))


def beside(records: list[Record], own: list[Record]) -> list[Record]:
    """Runs with their times as multiples of the median of our own."""
    ratios = {"times": "seconds", "processor_times": "processor"}
    medians = {key: float(np.median([record[key] for record in own])) for key in ratios.values()}
    return [
        record | {name: record[key] / medians[key] for name, key in ratios.items() if key in record}
        for record in records
    ]


def outcomes(row: Row) -> str:
    """How many runs ended in each way."""
    counts = Counter(record["outcome"] for record in row.records)
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items())


def notes(rows: list[Row]) -> Iterator[str]:
    """Every seed's figure, and whose programs they are."""
    for row in rows:
        means = [f"{record['mean']:.4f}" if "mean" in record else "-" for record in row.records]
        yield f"{row.name}, by seed (m): {' '.join(means)}"
    versions = {record["version"] for row in rows for record in row.records if "version" in record}
    if versions:
        yield f"the rivals are of MRPT {', '.join(sorted(versions))}"
    yield f"lost is who errs by more than {LOST:g} m on average"


BENCH = Bench(
    name="rivals",
    about="Intel by what a user would install today, MRPT's programs for lasers, beside Maze Runner in one run",
    rows=rows,
    columns=(
        Column("runs", runs),
        Column("outcome", outcomes),
        Column("relations, medians over the seeds", relations_of),
        Column("its mean: median / worst (m)", figures("mean", 4, 0.5, 1.0)),
        Column("seconds", middle("seconds", 1)),
        Column("times ours", middle("times", 1)),
        Column("processor (s)", middle("processor", 1)),
        Column("that, times ours", middle("processor_times", 1)),
        Column("vertices", middle("vertices", 0)),
    ),
    seeds=3,
    minutes=70,
    needs_data=True,
    is_timed=True,
    heading="log and program",
    notes=notes,
)
