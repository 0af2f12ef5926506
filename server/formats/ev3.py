"""One ultrasonic sensor that turns on a LEGO EV3 robot: at every stop 13 bearings, each measured 25 times.

A row is x and y in cm, the heading in radians by dead reckoning, and 13 times 25 ranges in cm, 255 for no echo
(S. Gavriilidis). What such repeats tell is how much the sensor's readings vary.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.errors import FormatError, read_lines

BEARINGS_DEG = tuple(90.0 - 15.0 * turn for turn in range(13))  # the sensor turns from the left to the right
REPEATS = 25
COLUMNS = 3 + len(BEARINGS_DEG) * REPEATS
NO_ECHO = 255.0  # cm
REMEDY = f"a row is x and y in cm, the heading in rad, and {len(BEARINGS_DEG)} x {REPEATS} ranges in cm"


class Ev3Log(NamedTuple):
    """Poses (n, 3) of the stops and ranges (n, 13, 25) in m, inf for no echo."""

    poses: np.ndarray
    ranges: np.ndarray


def is_ev3(content: bytes) -> bool:
    """Whether the beginning of a file reads like such a log: a first row of so many numbers."""
    fields = content.partition(b"\n")[0].split()
    try:
        return len([float(field) for field in fields]) == COLUMNS
    except ValueError:
        return False


def read_ev3(path: Path | str) -> Ev3Log:
    """All stops; FormatError names the first row that cannot be read."""
    rows = []
    for number, line in enumerate(read_lines(path, REMEDY), 1):
        fields = line.split()
        if not fields:
            continue
        if len(fields) != COLUMNS:
            raise FormatError(path, number, f"{len(fields)} fields where {COLUMNS} belong", REMEDY)
        try:
            row = np.array(fields, float)
        except ValueError:
            raise FormatError(path, number, "a field is not a number", REMEDY) from None
        if not np.all(np.isfinite(row)) or np.any(row[3:] < 0.0):
            raise FormatError(path, number, "a field is not finite, or a range is negative", REMEDY)
        rows.append(row)
    if not rows:
        raise FormatError(path, None, "is empty", REMEDY)
    table = np.array(rows)
    poses = np.column_stack([table[:, :2] / 100.0, np.remainder(table[:, 2] + np.pi, 2.0 * np.pi) - np.pi])
    ranges = np.where(table[:, 3:] >= NO_ECHO, np.inf, table[:, 3:] / 100.0)
    return Ev3Log(poses, ranges.reshape(len(rows), -1, REPEATS))
