"""CARMEN logs: `ODOM` rows of wheel odometry, `FLASER` or `ROBOTLASER1` scans, in file order, at the log's own times.

Odometry comes from `ODOM` rows only; poses inside scan rows are often corrected ones and are not looked at. Comments,
`PARAM` and every other kind of row are passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.atomic import write_atomically
from server.formats.errors import FormatError, read_bytes
from server.formats.laser import LaserLog
from slam.pose import between

KINDS = ("ODOM", "FLASER", "ROBOTLASER1")
FLASER_MAX_RANGE = 50.0  # m; farther readings of the old laser rows are their way to say "no return"
STEPS = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5, 720: 0.25, 721: 0.25}  # degrees between so many beams
ODOM_REMEDY = "an ODOM row is `ODOM x y theta tv rv accel time host time`"
SCAN_REMEDY = "a FLASER row is `FLASER n r1 ... rn x y theta odom_x odom_y odom_theta time host time`"


class Scan(NamedTuple):
    """One row of a laser: `ranges` (n,), inf for no return, nan for none measured; `bearings` (n,) in radians."""

    t: float
    ranges: np.ndarray
    bearings: np.ndarray
    mount: np.ndarray  # (3,) the laser's pose on the robot


def is_carmen(content: bytes) -> bool:
    """Whether the beginning of a file reads like a CARMEN log."""
    lines = content.decode("utf-8", errors="replace").splitlines()
    words = [line.split(maxsplit=1)[0] for line in lines if line.strip() and not line.startswith("#")]
    return any(word in KINDS for word in words)


def read_carmen(path: Path | str) -> LaserLog:
    """The odometry and the scans of a log; FormatError names the first row that cannot be read.

    A last row that was cut in the middle ends the log; any other broken row is an error.
    """
    path = Path(path)
    content = read_bytes(path)
    lines = content.decode("utf-8", errors="replace").split("\n")
    cut_line = len(lines) if lines[-1].strip() else None
    odometry: list[list[float]] = []
    scans: list[Scan] = []
    is_scan: list[bool] = []
    laser = ""
    for number, line in enumerate(lines, 1):
        kind = line.partition(" ")[0]
        if kind not in KINDS or (kind != "ODOM" and laser not in ("", kind)):
            continue
        try:
            if kind == "ODOM":
                odometry.append(parse_odom(path, number, line.split()))
            else:
                laser = kind
                scans.append(parse_scan(path, number, line.split(), scans))
            is_scan.append(kind != "ODOM")
        except FormatError:
            if number != cut_line:
                raise
            return assemble(path, odometry, scans, is_scan, number)
    return assemble(path, odometry, scans, is_scan, None)


def assemble(
    path: Path, odometry: list[list[float]], scans: list[Scan], is_scan: list[bool], truncated_at: int | None
) -> LaserLog:
    """Arrays of the rows; FormatError where there is no odometry or no scan."""
    if not odometry:
        raise FormatError(path, None, "holds no odometry", "a CARMEN log needs ODOM rows")
    if not scans:
        raise FormatError(path, None, "holds no ranges", "a CARMEN log needs FLASER or ROBOTLASER1 rows")
    table = np.array(odometry)
    return LaserLog(
        path=path,
        odometry_times=table[:, 0],
        odometry=table[:, 1:],
        scan_times=np.array([scan.t for scan in scans]),
        scans=np.array([scan.ranges for scan in scans]),
        bearings=scans[0].bearings,
        mount=scans[0].mount,
        is_scan=np.array(is_scan),
        truncated_at=truncated_at,
    )


def parse_odom(path: Path, number: int, fields: list[str]) -> list[float]:
    """Time, x, y and heading of an `ODOM` row."""
    if len(fields) < 9:
        raise FormatError(path, number, f"ODOM row with {len(fields)} fields", ODOM_REMEDY)
    try:
        row = [float(fields[index]) for index in (7, 1, 2, 3)]
    except ValueError:
        raise FormatError(path, number, "ODOM row with a field that is not a number", ODOM_REMEDY) from None
    if not np.all(np.isfinite(row)):
        raise FormatError(path, number, "ODOM row with a field that is not finite", ODOM_REMEDY)
    return row


def parse_scan(path: Path, number: int, fields: list[str], earlier: list[Scan]) -> Scan:
    """A laser's row; all rows of a log have the same number of beams."""
    parse: Callable[[list[str]], Scan] = parse_flaser if fields[0] == "FLASER" else parse_robotlaser
    try:
        scan = parse(fields)
    except (ValueError, IndexError):
        raise FormatError(path, number, f"broken {fields[0]} row", SCAN_REMEDY) from None
    if scan.ranges.size < 2 or not np.isfinite(scan.t):
        raise FormatError(path, number, f"broken {fields[0]} row", SCAN_REMEDY)
    if earlier and earlier[0].ranges.size != scan.ranges.size:
        beams = earlier[0].ranges.size
        raise FormatError(path, number, f"{scan.ranges.size} beams after rows of {beams}", "split the log by laser")
    return scan


def parse_flaser(fields: list[str]) -> Scan:
    """A row of the older kind: beam 0 looks to -90 degrees, the others follow counter-clockwise."""
    n_beams = int(fields[1])
    bearings = np.radians(-90.0 + STEPS.get(n_beams, 180.0 / max(n_beams - 1, 1)) * np.arange(n_beams))
    ranges = parse_ranges(fields[2 : 2 + n_beams], n_beams, FLASER_MAX_RANGE)
    rest = fields[2 + n_beams :]
    if len(rest) < 8:
        raise ValueError("cut")
    return Scan(float(rest[6]), ranges, bearings, np.zeros(3))


def parse_robotlaser(fields: list[str]) -> Scan:
    """`ROBOTLASER1 type start view step max accuracy mode n ranges m remissions laser robot ... time host time`."""
    start, step, max_range = float(fields[2]), float(fields[4]), float(fields[5])
    n_beams = int(fields[8])
    ranges = parse_ranges(fields[9 : 9 + n_beams], n_beams, max_range)
    at = 9 + n_beams
    rest = fields[at + 1 + int(fields[at]) :]
    if len(rest) < 13:
        raise ValueError("cut")
    poses = np.array(rest[:6], float)
    return Scan(float(rest[11]), ranges, start + step * np.arange(n_beams), between(poses[3:], poses[:3]))


def parse_ranges(fields: list[str], n_beams: int, max_range: float) -> np.ndarray:
    """Ranges in metres: at or above the maximum is no return, zero and below was not measured."""
    if len(fields) != n_beams:
        raise ValueError("cut")
    ranges = np.array(fields, float)
    ranges[ranges >= max_range] = np.inf
    ranges[ranges <= 0.0] = np.nan
    return ranges


def format_odom(t: float, pose: np.ndarray) -> str:
    """An `ODOM` row."""
    x, y, theta = pose
    return f"ODOM {x:.6f} {y:.6f} {theta:.6f} 0 0 0 {t:.6f} crunch {t:.6f}\n"


def format_flaser(t: float, ranges: np.ndarray, pose: np.ndarray) -> str:
    """A `FLASER` row; no return becomes the maximum, not measured becomes zero."""
    readings = np.nan_to_num(np.asarray(ranges, float), nan=0.0, posinf=FLASER_MAX_RANGE)
    x, y, theta = (f"{part:.6f}" for part in pose)
    beams = " ".join(f"{reading:.3f}" for reading in readings)
    return f"FLASER {readings.size} {beams} {x} {y} {theta} {x} {y} {theta} {t:.6f} crunch {t:.6f}\n"


def write_carmen(path: Path | str, rows: Iterable[str]) -> None:
    """Write rows made by `format_odom` and `format_flaser`."""
    write_atomically(path, "".join(["# CARMEN Logfile\n", *rows]))
