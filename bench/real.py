"""Real odometry and real buildings, one configuration for all, many seeds.

    python -m bench.real [--seeds 10] [--particles 5000]

`semi-real` drives have a log's own odometry and Crunch's simulated senses in the walls that the log's laser saw; a
seed is a new simulation and a new filter. `five directions` is `intel-dense.log`: its real beams, thinned to the
five of Crunch's eight directions that it sees; a seed is a new filter. Needs the recordings' folder (`CRUNCH_DATA`).
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from bench.recordings import data_folder, read, semireal
from bench.scores import HEADER, Score, keep, line, score, score_of
from server import config
from server.formats.logs import read_log
from server.formats.relations import read_relations
from server.formats.tum import read_tum
from server.replay import run_log
from slam.evaluate import relations_error
from slam.timeline import interpolate

Relations = tuple[float, float, float]


def semireal_run(job: tuple[str, int, str, int]) -> Score:
    """One seed of a semi-real drive."""
    name, seed, preset, particles = job
    params = config.load({"preset": preset, "crunch": {"filter": {"particles": particles}}}).crunch
    return score(*read(semireal(name, seed)), params, seed)[0]


def five_directions_run(job: tuple[str, int, str, int]) -> tuple[Score, Relations, Relations]:
    """One seed on the real beams; mean and deviation (m) and mean (deg) of the relations' errors, map and odometry."""
    _, seed, preset, particles = job
    data = data_folder()
    assert data is not None
    params = config.load({"preset": preset, "crunch": {"filter": {"particles": particles}}}).crunch
    result = run_log(read_log(data / "intel" / "intel-dense.log"), params, seed, threads=1)
    times, truth = read_tum(data / "intel" / "reference.tum")
    mapped = interpolate(result.drive.times, result.trajectory, times)[0]
    odometry = interpolate(result.drive.times, result.drive.odometry, times)[0]
    verified = data / "intel" / "intel.relations"
    return (
        score_of(result, mapped, odometry, truth, seed),
        relations_of(result.drive.times, result.trajectory, verified),
        relations_of(result.drive.times, result.drive.odometry, verified),
    )


def relations_of(times: np.ndarray, poses: np.ndarray, file: Path) -> Relations:
    """Mean and standard deviation (m) and mean (deg) of the errors on hand-verified relations."""
    errors = relations_error(times, poses, read_relations(file))
    return errors.translation.mean, errors.translation.std, float(np.degrees(errors.rotation.mean))


def main() -> None:
    """Run and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--particles", type=int, default=5000)
    parser.add_argument("--preset", nargs="+", default=["default", "thesis"])
    parser.add_argument("--drives", nargs="+", default=["intel", "aces", "five"])
    parser.add_argument("--processes", type=int, default=2)
    wanted = parser.parse_args()
    if data_folder() is None:
        sys.exit("bench.real: no recordings found; set CRUNCH_DATA to their folder")
    print(HEADER)
    rows, relations = {}, []
    with ProcessPoolExecutor(wanted.processes) as pool:
        for drive in wanted.drives:
            for preset in wanted.preset:
                jobs = [(drive, seed, preset, wanted.particles) for seed in range(wanted.seeds)]
                name = f"semi-real {drive}, {preset}" if drive != "five" else f"five directions, {preset}"
                task = semireal_run if drive != "five" else five_directions_run
                found = list(track(pool.map(task, jobs), name, len(jobs), console=Console(stderr=True), transient=True))
                scores = [item if isinstance(item, Score) else item[0] for item in found]
                rows[name] = [s._asdict() for s in scores]
                print(line(name, scores), flush=True)
                print(f"  ATE of each seed: {' '.join(f'{s.ate:.2f}' for s in scores)}", flush=True)
                if drive == "five":
                    relations += [(preset, item[1], item[2]) for item in found if not isinstance(item, Score)]
    if relations:
        show_relations(relations)
    print(keep("real", {"scores": rows, "relations": relations}))


def show_relations(relations: list[tuple[str, Relations, Relations]]) -> None:
    """Median over the seeds of the relations' errors, by preset, odometry's beside."""
    print("\n| relations of intel | mean (m) | std (m) | mean (deg) |\n|---|---|---|---|")
    for preset in dict.fromkeys(name for name, _, _ in relations):
        middle = np.median([mapped for name, mapped, _ in relations if name == preset], axis=0)
        print(f"| {preset} | {middle[0]:.3f} | {middle[1]:.3f} | {middle[2]:.2f} |")
    odometry = relations[0][2]
    print(f"| raw odometry | {odometry[0]:.3f} | {odometry[1]:.3f} | {odometry[2]:.2f} |")


if __name__ == "__main__":
    main()
