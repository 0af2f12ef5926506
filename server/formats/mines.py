"""Drives of a rover with a Hokuyo URG-04LX around an indoor loop (B. Steux and O. El Hamzaoui, tinySLAM, 2010).

A row is one scan: time in microseconds, something, the ticks of the left and of the right wheel, 21 columns of other
things, and 682 ranges in mm. The first and last 70 beams look at the rover itself; ranges below 20 mm are codes of
errors.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from server.formats.errors import FormatError, read_lines
from server.formats.laser import LaserLog, by_time, integrate

BEAMS, HEADER = 682, 25
COLUMNS = HEADER + BEAMS
STEP = 2.0 * math.pi / 1024.0  # rad between beams; the middle one looks ahead
BLIND = 70  # beams at either end
MIN_RANGE, MAX_RANGE = 0.02, 5.6  # m
METRES_PER_TICK = 2.0 * math.pi * 0.077 / 2000.0
HALF_AXLE = 0.165  # m
MOUNT = np.array([0.145, 0.0, 0.0])
REMEDY = f"a row is the time in us, a number, left and right ticks, 21 more numbers and {BEAMS} ranges in mm"


def is_mines(content: bytes) -> bool:
    """Whether the beginning of a file reads like such a log: a first row of so many numbers."""
    fields = content.partition(b"\n")[0].split()
    try:
        return len([float(field) for field in fields]) == COLUMNS
    except ValueError:
        return False


def read_mines(path: Path | str) -> LaserLog:
    """All scans; FormatError names the first row that cannot be read. A last row that was cut ends the log."""
    path = Path(path)
    rows, truncated_at = [], None
    lines = read_lines(path, REMEDY)
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            row = [float(field) for field in line.split()]
        except ValueError:
            row = []
        if len(row) != COLUMNS or not np.all(np.isfinite(row)):
            if number == len(lines):
                truncated_at = number
                break
            raise FormatError(path, number, f"is no row of {COLUMNS} numbers", REMEDY)
        rows.append(row)
    table = np.array(rows).reshape(-1, COLUMNS)
    times = table[:, 0] * 1e-6
    ranges = table[:, HEADER:] / 1000.0
    scans = np.where(ranges < MIN_RANGE, np.nan, np.where(ranges >= MAX_RANGE, np.inf, ranges))
    scans[:, :BLIND] = scans[:, -BLIND:] = np.nan
    bearings = (np.arange(BEAMS) - (BEAMS - 1) // 2) * STEP
    ways = METRES_PER_TICK * table[:, 2:4]
    odometry = integrate(ways[:, 0], ways[:, 1], 2.0 * HALF_AXLE)
    log = by_time(path, times, odometry, times, scans, bearings, MOUNT)
    return log._replace(truncated_at=truncated_at)
