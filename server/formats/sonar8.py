"""Eight real sonars of a Pioneer-type robot: `measurement.txt` and `poses.txt` side by side (Udacity RoboND).

`measurement.txt` has rows of time in ms and eight ranges in mm, 5110 for no echo; `poses.txt` has time in ms, x and y
in mm and the heading in tenths of a degree. Ranges count from the robot's centre.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.errors import FormatError, read_lines
from server.messages import Message, Odometry, Ranges
from slam.rangefinder import RingParams

MEASUREMENTS, POSES = "measurement.txt", "poses.txt"
NO_ECHO = 5110  # mm
MEASUREMENT_REMEDY = "a row is the time in ms and eight ranges in mm"
POSE_REMEDY = "a row is the time in ms, x and y in mm, and the heading in 0.1 degree"
RING = RingParams(
    model="sonar",
    bearings_deg=(-90.0, -37.5, -22.5, -7.5, 7.5, 22.5, 37.5, 90.0),
    half_angle_deg=12.5,  # the main lobe of a 600-series electrostatic transducer at 50 kHz is 25 degrees wide
    min_range=0.15,
    max_range=5.0,
)


class Sonar8Log(NamedTuple):
    """Times (n,), poses (n, 3) and ranges (n, 8) in metres, inf for no echo."""

    times: np.ndarray
    poses: np.ndarray
    ranges: np.ndarray


def folder_of(path: Path | str) -> Path | None:
    """The folder of such a recording, if `path` is that folder or one of its two files."""
    path = Path(path)
    folder = path if path.is_dir() else path.parent if path.name in (MEASUREMENTS, POSES) else None
    return folder if folder is not None and (folder / MEASUREMENTS).is_file() else None


def read_sonar8(folder: Path | str) -> Sonar8Log:
    """The recording in a folder; FormatError names the file and the row."""
    folder = Path(folder)
    if not (folder / POSES).is_file():
        raise FormatError(folder / MEASUREMENTS, None, "is without odometry", f"put its {POSES} beside it")
    measured = read_table(folder / MEASUREMENTS, 9, MEASUREMENT_REMEDY)
    posed = read_table(folder / POSES, 4, POSE_REMEDY)
    for row in range(max(len(measured), len(posed))):
        if row >= len(measured) or row >= len(posed) or measured[row, 0] != posed[row, 0]:
            raise FormatError(folder / POSES, row + 1, f"does not match {MEASUREMENTS}", "both have one row per time")
    ranges = np.where(measured[:, 1:] >= NO_ECHO, np.inf, measured[:, 1:] / 1000.0)
    ranges[ranges > RING.max_range] = np.inf
    poses = np.column_stack([posed[:, 1:3] / 1000.0, np.radians(posed[:, 3] / 10.0)])
    return Sonar8Log(measured[:, 0] / 1000.0, poses, ranges)


def read_table(path: Path, columns: int, remedy: str) -> np.ndarray:
    """Rows of so many numbers."""
    rows = []
    for number, line in enumerate(read_lines(path, remedy), 1):
        fields = line.split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError:
            raise FormatError(path, number, "a field is not a number", remedy) from None
        if len(row) != columns or not np.all(np.isfinite(row)):
            raise FormatError(path, number, f"{len(row)} fields where {columns} numbers belong", remedy)
        rows.append(row)
    if not rows:
        raise FormatError(path, None, "is empty", remedy)
    return np.array(rows)


def messages(log: Sonar8Log) -> Iterator[Message]:
    """One pose and one sweep per row."""
    for t, pose, ranges in zip(log.times, log.poses, log.ranges, strict=True):
        yield Odometry(float(t), *(float(part) for part in pose))
        yield Ranges(float(t), "sonar", ranges)
