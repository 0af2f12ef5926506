"""MRPT's rawlog of a laser's log: what MRPT's own programs read, written without MRPT.

A rawlog is a gzip stream of objects, in little endian: 0x80 + the length of the class's name, the name, the version of
its format, its fields, 0x88 (MRPT 2.5, libs/serialization/src/CArchive.cpp). It holds actions and what was seen after
them in turn: `CActionCollection` of one `CActionRobotMovement2D`, and `CSensoryFrame` of one `CObservation2DRangeScan`.
`carmen2rawlog` of MRPT 2.5.8 is no way there: it takes beams to be half a degree apart, gives all records the time of
the conversion, and writes the other order of records, on which rbpf-slam dies.
"""

from __future__ import annotations

import gzip
import math
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from server.formats.laser import LaserLog
from slam.pose import between, compose

END = b"\x88"
TICKS = 10_000_000  # of MRPT's clock in a second
UNIX_EPOCH = 11_644_473_600  # s from its zero, the year 1601, to 1970
LEAST_STEP = 1e-5  # s between two scans
MAX_RANGE = 81.0  # m, of a laser in a CARMEN log, as MRPT has it
RANGE_NOISE = 0.01  # m, CObservation2DRangeScan's default
GAUSSIAN = (
    0.01,
    math.degrees(0.001),
    math.radians(1.0),
    0.05,
    0.01,
    math.radians(0.2),
)  # its defaults: a1 to a4, least
THRUN = (
    0.05,
    math.radians(4.0),
    0.01,
    math.degrees(0.0001),
    0.001,
    math.radians(0.05),
)  # not in use, but in the format
THRUN_PARTICLES = 300


def write_rawlog(path: Path, log: LaserLog) -> None:
    """Write a log as actions and scans in turn."""
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.writelines(entries(log))


def entries(log: LaserLog) -> Iterator[bytes]:
    """An action and a sensory frame for every scan that has odometry before it, both at one time.

    That is the scan's time, or just after the one before where the log's clock stood still or stepped back: MRPT leaves
    odometry out that is not newer than what it has (CRobot2DPoseEstimator.cpp).
    """
    scans, rows = scans_and_rows(log)
    poses = log.odometry[rows]
    motions = between(poses[np.maximum(np.arange(len(poses)) - 1, 0)], poses)
    t = -math.inf
    for scan, motion in zip(scans, motions, strict=True):
        t = max(float(log.scan_times[scan]), t + LEAST_STEP)
        yield thing("CActionCollection", 0, struct.pack("<I", 1) + action(t, motion))
        yield thing("CSensoryFrame", 2, struct.pack("<I", 1) + observation(t, log.scans[scan], log.bearings, log.mount))


def scans_and_rows(log: LaserLog) -> tuple[np.ndarray, np.ndarray]:
    """The scans (k,) that have odometry before them in the file, and the row (k,) of the newest of it at each."""
    rows = np.cumsum(~log.is_scan)[log.is_scan] - 1
    scans = np.flatnonzero(rows >= 0)
    return scans, rows[scans]


def thing(name: str, version: int, fields: bytes, space: str = "obs") -> bytes:
    """A serialized object."""
    full = f"mrpt::{space}::{name}".encode()
    return bytes([0x80 | len(full)]) + full + bytes([version]) + fields + END


def ticks(t: float) -> bytes:
    """A time (s since 1970) on MRPT's clock."""
    return struct.pack("<q", round((t + UNIX_EPOCH) * TICKS))


def action(t: float, motion: np.ndarray) -> bytes:
    """A motion (3,) that odometry told, with MRPT's default Gaussian errors (CActionRobotMovement2D.cpp)."""
    odometry, gaussian = 0, 0  # the way it was estimated, and the model of its errors
    model = struct.pack("<I6f", gaussian, *GAUSSIAN) + struct.pack("<I6f", THRUN_PARTICLES, *THRUN)
    has_velocities = has_encoders = b"\0"
    fields = struct.pack("<I", odometry) + pose_2d(motion) + model + has_velocities + has_encoders + ticks(t)
    return thing("CActionRobotMovement2D", 7, fields)


def observation(t: float, ranges: np.ndarray, bearings: np.ndarray, mount: np.ndarray) -> bytes:
    """A scan (n,) with even `bearings` (n,), of a laser at `mount` (3,); what did not return is invalid.

    MRPT spreads the beams evenly to both sides of the sensor's x axis (CObservation2DRangeScan.cpp), so that the sensor
    is turned by the middle of the bearings.
    """
    is_valid = np.isfinite(ranges) & (ranges > 0.0)
    told = np.nan_to_num(np.where(np.isinf(ranges), MAX_RANGE, ranges), nan=0.0)
    aperture, is_counter_clockwise = float(bearings[-1] - bearings[0]), bearings[-1] > bearings[0]
    middle = np.array([0.0, 0.0, 0.5 * float(bearings[0] + bearings[-1])])
    label = b"FLASER"
    fields = (
        struct.pack("<f?f", abs(aperture), is_counter_clockwise, MAX_RANGE)
        + pose_3d(compose(mount, middle))
        + struct.pack("<I", len(told))
        + told.astype("<f4").tobytes()
        + is_valid.astype("u1").tobytes()
        + struct.pack("<f", RANGE_NOISE)
        + ticks(t)
        + struct.pack("<fI", 0.0, len(label))  # how wide a beam is
        + label
        + struct.pack("<d?", 0.0, False)  # pitch in a scan; whether there are intensities
    )
    return thing("CObservation2DRangeScan", 7, fields)


def pose_2d(pose: np.ndarray) -> bytes:
    """A pose (3,) in the plane (CPose2D.cpp)."""
    return thing("CPose2D", 1, struct.pack("<3d", *pose), "poses")


def pose_3d(pose: np.ndarray) -> bytes:
    """The pose (3,) in space: place and rotation matrix, row by row (CPose3D.cpp)."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    return thing("CPose3D", 3, struct.pack("<12d", x, y, 0.0, cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0), "poses")
