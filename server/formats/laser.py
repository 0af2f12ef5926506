"""What any log of a laser and an odometry holds, whatever its file looks like: arrays, and the rows' order."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from server.formats.errors import FormatError
from server.messages import Message, Odometry, Ranges
from slam.pose import compose

SENSOR = "laser"  # what its ranges are called


class LaserLog(NamedTuple):
    """What a log holds; `is_scan` (n_odometry + n_scans,) tells the rows' order in the file."""

    path: Path
    odometry_times: np.ndarray  # (n,)
    odometry: np.ndarray  # (n, 3)
    scan_times: np.ndarray  # (m,)
    scans: np.ndarray  # (m, beams), inf for no return, nan for none measured
    bearings: np.ndarray  # (beams,)
    mount: np.ndarray  # (3,) the laser's pose on the robot
    is_scan: np.ndarray
    truncated_at: int | None = None  # line of a last row that was cut
    has_odometry: bool = True  # else the robot is told to stand still, and only its scans speak


def by_time(
    path: Path,
    odometry_times: np.ndarray,
    odometry: np.ndarray,
    scan_times: np.ndarray,
    scans: np.ndarray,
    bearings: np.ndarray,
    mount: np.ndarray,
) -> LaserLog:
    """A log whose odometry and scans come from different files or topics: the order is that of their times.

    Of what is of one time the odometry comes first. FormatError where there is no odometry or no scan.
    """
    if not len(odometry):
        raise FormatError(path, None, "holds no odometry", "replay a log whose robot reported its motion")
    if not len(scans):
        raise FormatError(path, None, "holds no ranges", "replay a log of a robot with a laser")
    is_scan = np.repeat([False, True], [len(odometry_times), len(scan_times)])
    order = np.argsort(np.concatenate([odometry_times, scan_times]), kind="stable")
    first, second = np.argsort(odometry_times, kind="stable"), np.argsort(scan_times, kind="stable")
    return LaserLog(
        path, odometry_times[first], odometry[first], scan_times[second], scans[second], bearings, mount, is_scan[order]
    )


def messages(log: LaserLog) -> Iterator[Message]:
    """Odometry and whole scans in the rows' order; odometry tells how the laser moved, wherever it sits."""
    odometry = compose(log.odometry, log.mount)
    row = scan = 0
    for is_scan in log.is_scan:
        if is_scan:
            yield Ranges(float(log.scan_times[scan]), SENSOR, log.scans[scan])
            scan += 1
        else:
            yield Odometry(float(log.odometry_times[row]), *(float(part) for part in odometry[row]))
            row += 1


def integrate(left: np.ndarray, right: np.ndarray, track: float) -> np.ndarray:
    """Poses (n, 3) of a robot whose wheels, `track` m apart, have gone `left` (n,) and `right` (n,) m, in arcs."""
    ways = 0.5 * (np.diff(left, prepend=left[:1]) + np.diff(right, prepend=right[:1]))
    turns = (np.diff(right, prepend=right[:1]) - np.diff(left, prepend=left[:1])) / track
    headings = np.cumsum(turns)
    chords = ways * np.sinc(0.5 * turns / np.pi)  # of an arc
    x = np.cumsum(chords * np.cos(headings - 0.5 * turns))
    y = np.cumsum(chords * np.sin(headings - 0.5 * turns))
    return np.column_stack([x, y, headings])
