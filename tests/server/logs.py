"""Small logs for tests: a robot that drives a rectangle in a room, as a CARMEN log and as numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server.formats.carmen import format_flaser, format_odom, write_carmen

HALF_WIDTH, HALF_HEIGHT = 3.0, 2.0  # m, of the room around the origin
BEARINGS = np.radians(np.arange(-90, 90))


def cast(pose: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    """Ranges (n,) from a pose within the room to its walls."""
    angles = pose[2] + bearings
    with np.errstate(divide="ignore"):
        x = (np.copysign(HALF_WIDTH, np.cos(angles)) - pose[0]) / np.cos(angles)
        y = (np.copysign(HALF_HEIGHT, np.sin(angles)) - pose[1]) / np.sin(angles)
    return np.minimum(x, y)


def drive(laps: int = 2, step: float = 0.1) -> np.ndarray:
    """Poses (n, 3) along a rectangle in the room, 1 m from its walls, turning on the spot at the corners."""
    corners = np.array([[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]])
    poses = []
    for side in range(4 * laps):
        start, end = corners[side % 4], corners[(side + 1) % 4]
        heading = 0.5 * np.pi * side
        n = round(float(np.hypot(*(end - start))) / step)
        poses += [[*(start + (end - start) * k / n), heading] for k in range(n)]
        poses += [[*end, heading + 0.5 * np.pi * k / 8] for k in range(8)]
    return np.array(poses)


def write_room_log(
    path: Path, laps: int = 2, scan_every: int = 2, turn_bias: float = 0.01
) -> tuple[np.ndarray, np.ndarray]:
    """Write a CARMEN log whose odometry drifts; returns times (n,) and true poses (n, 3) of its odometry."""
    truth = drive(laps)
    odometry = truth.copy()
    odometry[:, 2] += turn_bias * np.arange(len(truth)) * 0.1
    steps = np.diff(truth[:, :2], axis=0)
    drift = odometry[:-1, 2] - truth[:-1, 2]
    turned = np.column_stack(
        [
            np.cos(drift) * steps[:, 0] - np.sin(drift) * steps[:, 1],
            np.sin(drift) * steps[:, 0] + np.cos(drift) * steps[:, 1],
        ]
    )
    odometry[1:, :2] = odometry[0, :2] + np.cumsum(turned, axis=0)
    times = 100.0 + 0.25 * np.arange(len(truth))
    rows = []
    for row, (t, pose) in enumerate(zip(times, odometry, strict=True)):
        rows.append(format_odom(t, pose))
        if row % scan_every == 0:
            rows.append(format_flaser(t, cast(truth[row], BEARINGS), pose))
    write_carmen(path, rows)
    return times, truth
