"""Two laps of a 50 m corridor cycle (the shape of the thesis's Figure 5) at three levels of drift, many seeds each.

    python -m bench.cycle [--seeds 50] [--drift low medium high] [--particles 2000]

Worlds are `corridor_cycle(seed)` with corridors 1.5, 1.8, 2.1 and 2.4 m wide in turn. The default stands beside the
literal thesis. Two runs go at a time, each on one thread; the speed of a run includes decoding, fusion and the filter.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor

from rich.console import Console
from rich.progress import track

from bench.recordings import cycle, read
from bench.scores import HEADER, Score, keep, line, score
from server import config


def run(job: tuple[int, str, str, int]) -> Score:
    """One seed at one drift with one preset."""
    seed, drift, preset, particles = job
    params = config.load({"preset": preset, "crunch": {"filter": {"particles": particles}}}).crunch
    return score(*read(cycle(seed, drift)), params, seed)[0]


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--drift", nargs="+", default=["low", "medium", "high"])
    parser.add_argument("--preset", nargs="+", default=["default", "thesis"])
    parser.add_argument("--particles", type=int, default=2000)
    parser.add_argument("--processes", type=int, default=2)
    wanted = parser.parse_args()
    print(HEADER)
    rows = {}
    with ProcessPoolExecutor(wanted.processes) as pool:
        for drift in wanted.drift:
            for preset in wanted.preset:
                jobs = [(seed, drift, preset, wanted.particles) for seed in range(wanted.seeds)]
                name = f"{drift}, {preset}"
                scores = list(track(pool.map(run, jobs), name, len(jobs), console=Console(stderr=True), transient=True))
                rows[name] = [s._asdict() for s in scores]
                print(line(name, scores), flush=True)
    print(keep("cycle", rows))


if __name__ == "__main__":
    main()
