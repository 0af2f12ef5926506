"""TUM trajectories: `time x y z qx qy qz qw` in seconds and metres, one pose per row, as evo reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server.formats.atomic import write_atomically
from server.formats.errors import FormatError, read_lines
from slam.pose import wrap

REMEDY = "each row of a TUM trajectory is `time x y z qx qy qz qw`"


def read_tum(path: Path | str) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and poses (n, 3) in file order; height, roll and pitch are dropped. FormatError names the row."""
    rows = []
    for number, line in enumerate(read_lines(path, REMEDY), 1):
        fields = line.split("#")[0].replace(",", " ").split()
        if fields:
            rows.append(parse_row(path, number, fields))
    if not rows:
        raise FormatError(path, None, "holds no poses", REMEDY)
    table = np.array(rows)
    return table[:, 0], planar(table[:, 1:])


def parse_row(path: Path | str, number: int, fields: list[str]) -> list[float]:
    """Eight finite numbers."""
    if len(fields) != 8:
        raise FormatError(path, number, f"{len(fields)} fields where 8 belong", REMEDY)
    try:
        row = [float(field) for field in fields]
    except ValueError:
        raise FormatError(path, number, "a field is not a number", REMEDY) from None
    if not np.all(np.isfinite(row)):
        raise FormatError(path, number, "a field is not finite", REMEDY)
    if sum(part * part for part in row[4:]) == 0.0:
        raise FormatError(path, number, "the quaternion is zero", "its four numbers have the length 1")
    return row


def planar(poses: np.ndarray) -> np.ndarray:
    """Rows (n, 7) of position and quaternion as (n, 3) x, y and heading."""
    qx, qy, qz, qw = poses[:, 3:].T
    heading = np.arctan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)
    return np.column_stack([poses[:, 0], poses[:, 1], wrap(heading)])


def format_tum(times: np.ndarray, poses: np.ndarray) -> str:
    """The rows of a trajectory; the same numbers give the same bytes."""
    half = 0.5 * wrap(poses[:, 2])
    table = zip(times, poses[:, 0], poses[:, 1], np.sin(half), np.cos(half), strict=True)
    return "".join(f"{t:.6f} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}\n" for t, x, y, qz, qw in table)


def write_tum(path: Path | str, times: np.ndarray, poses: np.ndarray) -> None:
    """Write times (n,) and poses (n, 3)."""
    write_atomically(path, format_tum(np.asarray(times, float), np.asarray(poses, float)))
