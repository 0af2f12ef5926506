"""Drives of a Roomba Create 2 (Clemson University): counts of both wheels, and which bumpers are closed, every 16 ms.

Rows of 13 columns under a header: time, distances, angles, the counts of the left and right wheel, speeds, place,
bumpers and light bumpers as eight binary digits. Or of 7 without one: time, the counts, distance, place, angle, and the
bumpers. Bit 0 of the bumpers is the right one, bit 1 the left one (iRobot Create 2 Open Interface, packet 7). Counts
are of 16 bits and wrap. The bumper is half a circle about the axle's middle; here it is a straight one of nearly that
width.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from server.formats.cart_log import CartLog, stages_of
from server.formats.errors import FormatError, read_lines
from slam.cart_odometry import LEFT, RIGHT, CartParams

COLUMNS = {13: (0, 5, 6, 11), 7: (0, 1, 2, 6)}  # by their number: time, left, right, bumpers
HEADER = "Time Stamp"
RIGHT_BIT, LEFT_BIT = 1, 2
TURN_OF_COUNTS = 1 << 16
PARAMS = CartParams(
    wheelbase=0.235, tick=math.pi * 0.072 / 508.8, bumper_width=0.25, bumper_ahead=0.17, slip_distance=0.01
)  # as the maker tells: wheels of 72 mm, 508.8 counts a turn
REMEDY = "a row is 13 columns under a header, or 7 without one; the bumpers are eight binary digits"


def is_roomba(content: bytes) -> bool:
    """Whether the beginning of a file reads like such a log."""
    first = content.partition(b"\n")[0].decode("utf-8", errors="replace")
    fields = [field.strip() for field in first.split(",")]
    return len(fields) in COLUMNS and (fields[0] == HEADER or is_byte(fields[COLUMNS[len(fields)][3]]))


def is_byte(text: str) -> bool:
    """Whether a field is eight binary digits."""
    return len(text) == 8 and not text.strip("01")


def read_roomba(path: Path | str) -> CartLog:
    """The whole drive; FormatError names the first row that cannot be read. A last row that was cut ends the log."""
    path = Path(path)
    rows, truncated_at = [], None
    lines = read_lines(path, REMEDY)
    for number, line in enumerate(lines, 1):
        if not line.strip() or (number == 1 and line.startswith(HEADER)):
            continue
        try:
            rows.append(row_of(path, number, line, len(rows[0]) if rows else None))
        except FormatError:
            if number < len(lines) or not rows:
                raise
            truncated_at = number
    if not rows:
        raise FormatError(path, None, "holds no row", REMEDY)
    time, left, right, bits = COLUMNS[len(rows[0])]
    table = np.array(rows)
    bumpers = table[:, bits].astype(np.int64)
    switches = LEFT * ((bumpers & LEFT_BIT) > 0) + RIGHT * ((bumpers & RIGHT_BIT) > 0)
    stages, ends = stages_of(unwrapped(table[:, left]), unwrapped(table[:, right]), switches, PARAMS)
    return CartLog(path, stages, PARAMS, table[ends, time], truncated_at)


def row_of(path: Path, number: int, line: str, n_columns: int | None) -> list[float]:
    """The numbers of a row, its bumpers' digits as one number; FormatError where it is none."""
    fields = [field.strip() for field in line.split(",")]
    if len(fields) not in COLUMNS or len(fields) != (n_columns or len(fields)):
        raise FormatError(path, number, f"{len(fields)} columns where {n_columns or '13 or 7'} belong", REMEDY)
    _, left, right, bits = COLUMNS[len(fields)]
    if not is_byte(fields[bits]):
        raise FormatError(path, number, f"bumpers {fields[bits]!r} are not eight binary digits", REMEDY)
    try:
        row = [float(int(field, 2)) if is_byte(field) else float(field) for field in fields]
    except ValueError:
        raise FormatError(path, number, "a column is not a number", REMEDY) from None
    if not np.all(np.isfinite(row)):
        raise FormatError(path, number, "a column is not finite", REMEDY)
    for wheel in (row[left], row[right]):
        if wheel != int(wheel) or not -TURN_OF_COUNTS // 2 <= wheel < TURN_OF_COUNTS:
            raise FormatError(path, number, f"{wheel:g} is no count of 16 bits", REMEDY)
    return row


def unwrapped(counts: np.ndarray) -> np.ndarray:
    """Counts (n,) that go on where those of 16 bits wrapped."""
    steps = np.diff(counts.astype(np.int64), prepend=int(counts[0]))
    return np.cumsum((steps + TURN_OF_COUNTS // 2) % TURN_OF_COUNTS - TURN_OF_COUNTS // 2)
