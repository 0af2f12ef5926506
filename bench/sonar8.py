"""Eight real sonars with their ghosts and cross-talk: do the extracted walls stand where the whole drive saw walls?

    python -m bench.sonar8 [--picture FILE]

Wall points of every vertex, at the recorded poses, are compared with an occupancy grid made from all echoes of the
drive. The control has the sonars' bearings shuffled, against the true grid and against a grid of its own. Needs the
recordings' folder (`CRUNCH_DATA`).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from bench.recordings import data_folder
from bench.scores import draw, keep
from server import config
from server.formats.logs import Log, read_log
from server.formats.sonar8 import read_sonar8
from server.replay import Result, run_log
from server.robots.crunch import CrunchParams
from slam.evaluate import MapAgreement, map_agreement
from slam.grid import Grid
from slam.local_map import LocalMap
from slam.pose import transform
from slam.rangefinder import RingParams
from slam.walls import curves

SHUFFLES = 20
MARGIN = 6.0  # m around the path that the grid covers


def whole_drive(ring: RingParams, folder: Path, params: CrunchParams) -> Grid:
    """Occupancy grid of all sweeps at the recorded poses."""
    recording = read_sonar8(folder)
    extent = float(np.abs(recording.poses[:, :2]).max()) + MARGIN
    sensors = {"sonar": ring}
    wide = params.local_map.model_copy(update={"reach": extent, "cells_per_reach": round(extent / 0.05)})
    whole = LocalMap(wide, sensors)
    for pose, ranges in zip(recording.poses, recording.ranges, strict=True):
        whole.fuse("sonar", ranges, pose)
    return whole.grid()


def agreement(log: Log, ring: RingParams, grid: Grid, params: CrunchParams) -> tuple[MapAgreement, Result]:
    """Share of wall points, seen with `ring` and placed by the recorded poses, near the grid's walls."""
    result = run_log(log.__class__(**{**vars(log), "sensors": {"sonar": ring}}), params)
    points = [
        transform(keyframe.pose, curve) for keyframe in result.drive.keyframes for curve in curves(keyframe.walls)
    ]
    return map_agreement(np.vstack(points), grid, 0.15), result


def main() -> None:
    """Run and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path)
    wanted = parser.parse_args()
    data = data_folder()
    if data is None:
        sys.exit("bench.sonar8: no recordings found; set CRUNCH_DATA to their folder")
    folder, params = data / "sonar8", config.load({}).crunch
    log = read_log(folder)
    assert log.sensors is not None
    ring = log.sensors["sonar"]
    grid = whole_drive(ring, folder, params)
    true, result = agreement(log, ring, grid, params)
    rng = np.random.default_rng(0)
    shuffled, own = [], []
    for _ in range(SHUFFLES):
        mixed = ring.model_copy(update={"bearings_deg": tuple(rng.permutation(ring.bearings_deg).tolist())})
        shuffled.append(agreement(log, mixed, grid, params)[0].share)
        own.append(agreement(log, mixed, whole_drive(mixed, folder, params), params)[0].share)
    print("| bearings | wall points | within 15 cm |\n|---|---|---|")
    print(f"| true | {true.n} | {100 * true.share:.0f} % |")
    print(f"| shuffled ({SHUFFLES} times, median, range) | | {spread(shuffled)} |")
    print(f"| shuffled, against its own grid | | {spread(own)} |")
    print(keep("sonar8", {"true": true.share, "shuffled": shuffled, "shuffled_own_grid": own}))
    if wanted.picture:
        draw(result, wanted.picture, "Eight real sonars", f"{len(result.path)} vertices, {true.n} wall points")


def spread(shares: list[float]) -> str:
    """Median and range in percent."""
    low, middle, high = 100.0 * np.quantile(shares, [0.0, 0.5, 1.0])
    return f"{middle:.0f} % ({low:.0f} to {high:.0f})"


if __name__ == "__main__":
    main()
