"""A 250 m drive through real floor plans (the length of the thesis's Figure 6) with 5,000 particles.

    python -m bench.floor [--seeds 5] [--threads 2] [--pictures DIR]

Needs the recordings' folder (`CRUNCH_DATA`). Prints a row per drive: ATE beside odometry's, whether the loops closed,
speed; `--pictures` draws each map.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.recordings import data_folder, floor, read
from bench.scores import HEADER, draw, keep, line, score
from server import config


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--maps", nargs="+", default=["freiburg", "longwood"])
    parser.add_argument("--preset", nargs="+", default=["default", "thesis"])
    parser.add_argument("--particles", type=int, default=5000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--pictures", type=Path)
    wanted = parser.parse_args()
    if data_folder() is None:
        sys.exit("bench.floor: no recordings found; set CRUNCH_DATA to their folder")
    print(HEADER)
    rows = {}
    for name in wanted.maps:
        for preset in wanted.preset:
            params = config.load({"preset": preset, "crunch": {"filter": {"particles": wanted.particles}}}).crunch
            scores = []
            for seed in range(wanted.seeds):
                errors, result = score(*read(floor(name, seed, "medium")), params, seed, wanted.threads)
                scores.append(errors)
                print(line(f"{name} {seed}, {preset}", [errors]), flush=True)
                if wanted.pictures and preset == "default":
                    draw(result, wanted.pictures / f"floor-{name}-{seed}.png", f"Crunch on {name}", f"tour {seed}")
            print(line(f"**{name}, {preset}**", scores), flush=True)
            rows[f"{name}, {preset}"] = [s._asdict() for s in scores]
    print(keep("floor", rows))


if __name__ == "__main__":
    main()
