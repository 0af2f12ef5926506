"""Logs of Carnegie Mellon's course on robotics, driven in Wean Hall: rows `O x y theta time` of odometry, and
`L x y theta laser_x laser_y laser_theta r1 ... r180 time` of scans.

Lengths are in cm, angles in radians, the beams stand one degree apart from the right to the left.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server.formats.errors import FormatError, read_lines
from server.formats.laser import LaserLog
from slam.pose import between

BEAMS = 180
COLUMNS = {"O": 4, "L": 7 + BEAMS}  # numbers behind the letter
MAX_RANGE = 81.0  # m; farther readings are this laser's way to say "no return"
REMEDIES = {
    "O": "an odometry row is `O x y theta time`",
    "L": f"a scan row is `L x y theta laser_x laser_y laser_theta r1 ... r{BEAMS} time`",
}


def is_wean(content: bytes) -> bool:
    """Whether the beginning of a file reads like such a log."""
    fields = content.partition(b"\n")[0].decode("utf-8", errors="replace").split()
    return bool(fields) and fields[0] in COLUMNS and len(fields) == 1 + COLUMNS[fields[0]]


def read_wean(path: Path | str) -> LaserLog:
    """Odometry and scans in file order; FormatError names the first row that cannot be read.

    A scan row's pose is odometry as well: it is taken up as a row of its own before the scan. A last row that was cut
    ends the log.
    """
    path = Path(path)
    odometry: list[list[float]] = []
    scans: list[list[float]] = []
    is_scan: list[bool] = []
    truncated_at = None
    lines = read_lines(path, REMEDIES["O"])
    for number, line in enumerate(lines, 1):
        fields = line.split()
        if not fields:
            continue
        row = numbers(fields)
        if row is None:
            if number == len(lines):
                truncated_at = number
                break
            raise FormatError(path, number, "cannot be read", REMEDIES.get(fields[0], REMEDIES["O"]))
        odometry.append([row[-1], *row[:3]])
        is_scan.append(False)
        if fields[0] == "L":
            scans.append(row)
            is_scan.append(True)
    if not scans:
        raise FormatError(path, None, "holds no ranges", REMEDIES["L"])
    table, seen = np.array(odometry), np.array(scans)
    ranges = seen[:, 6 : 6 + BEAMS] / 100.0
    ranges = np.where(ranges <= 0.0, np.nan, np.where(ranges >= MAX_RANGE, np.inf, ranges))
    return LaserLog(
        path=path,
        odometry_times=table[:, 0],
        odometry=metres(table[:, 1:]),
        scan_times=seen[:, -1],
        scans=ranges,
        bearings=np.radians(np.arange(BEAMS) - 90.0),
        mount=between(metres(seen[0, :3]), metres(seen[0, 3:6])),
        is_scan=np.array(is_scan),
        truncated_at=truncated_at,
    )


def numbers(fields: list[str]) -> list[float] | None:
    """The numbers of a row; None for one that is no row."""
    if len(fields) != 1 + COLUMNS.get(fields[0], -1):
        return None
    try:
        row = [float(field) for field in fields[1:]]
    except ValueError:
        return None
    return row if np.all(np.isfinite(row)) else None


def metres(poses: np.ndarray) -> np.ndarray:
    """Poses (..., 3) with lengths in cm, in m."""
    return poses * np.array([0.01, 0.01, 1.0])
