"""A tracked LEGO robot with a laser, and where an overhead camera saw it (C. Brenner, lectures on SLAM).

Three files stand side by side, `NAME_motors.txt`, `NAME_scan.txt` and `NAME_reference.txt`, with rows `M time left ...
right ...` of motor ticks (columns 2 and 6), `S time n r1 ... rn` of ranges in mm, and `P time x y` of places in mm;
times are in ms.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from server.formats.errors import FormatError, read_lines
from server.formats.laser import LaserLog, by_time, integrate

MOTORS, SCANS, REFERENCE = "_motors.txt", "_scan.txt", "_reference.txt"
STEP = 0.006135923151543  # rad between beams, of which the middle one looks ahead
METRES_PER_TICK = 0.000349
TRACK = 0.173  # m, by which the tracks turn the robot
MOUNT = np.array([0.030, 0.0, -0.06981317])
MIN_RANGE, MAX_RANGE = 0.02, 5.6  # m
REMEDIES = {
    "M": "a row of the motors is M, the time in ms, the left ticks, three numbers, the right ticks, and more",
    "S": "a row of scans is S, the time in ms, the number of beams, and as many ranges in mm",
    "P": "a row of the reference is P, the time in ms, x and y in mm",
}


def stem_of(path: Path | str) -> Path | None:
    """What the three files' names begin with, if `path` is one of them or their folder."""
    path = Path(path)
    if path.is_dir():
        found = sorted(path.glob(f"*{SCANS}"))
        return stem_of(found[0]) if found else None
    for end in (MOTORS, SCANS, REFERENCE):
        stem = path.with_name(path.name.removesuffix(end))
        if path.name.endswith(end) and all(stem.with_name(stem.name + other).is_file() for other in (MOTORS, SCANS)):
            return stem
    return None


def read_lego(stem: Path) -> LaserLog:
    """The drive of motors and scans; FormatError names the file and the row that cannot be read."""
    motors, scans = (stem.with_name(stem.name + end) for end in (MOTORS, SCANS))
    ticks = np.array(read_rows(motors, "M", 7)).reshape(-1, 7)
    rows = read_rows(scans, "S", None)
    n_beams = len(rows[0]) - 2 if rows else 0
    ranges = np.array([row[2:] for row in rows]).reshape(-1, n_beams) / 1000.0
    measured = np.where(ranges < MIN_RANGE, np.nan, np.where(ranges >= MAX_RANGE, np.inf, ranges))
    bearings = (np.arange(n_beams) - n_beams // 2) * STEP
    ways = METRES_PER_TICK * ticks[:, [1, 5]]
    odometry = integrate(ways[:, 0], ways[:, 1], TRACK)
    times = np.array([row[0] for row in rows])
    return by_time(scans, ticks[:, 0] / 1000.0, odometry, times / 1000.0, measured, bearings, MOUNT)


def read_reference(stem: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s and places (n, 2) m that the camera saw."""
    rows = np.array(read_rows(stem.with_name(stem.name + REFERENCE), "P", 3)).reshape(-1, 3)
    return rows[:, 0] / 1000.0, rows[:, 1:] / 1000.0


def read_rows(path: Path, kind: str, columns: int | None) -> list[list[float]]:
    """The first so many numbers of each row; all of a scan's, whose number its third column tells."""
    found: list[list[float]] = []
    for number, line in enumerate(read_lines(path, REMEDIES[kind]), 1):
        fields = line.split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields[1:]]
        except ValueError:
            raise FormatError(path, number, "a field is not a number", REMEDIES[kind]) from None
        wanted = columns or 2 + int(row[1] if len(row) > 1 and math.isfinite(row[1]) else 0)
        is_like = columns is not None or (wanted > 3 and len(row) == wanted and (not found or len(found[0]) == wanted))
        if fields[0] != kind or len(row) < wanted or not is_like or not np.all(np.isfinite(row)):
            raise FormatError(path, number, "cannot be read", REMEDIES[kind])
        found.append(row[:wanted])
    if not found:
        raise FormatError(path, None, "is empty", REMEDIES[kind])
    return found
