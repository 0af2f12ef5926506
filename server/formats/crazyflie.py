"""Crazyflie nano-quadrotors with a multi-ranger and a flow deck: ROS 1 bags with two topics of plain numbers.

`.../state_xyzv` holds x, y and z in m of the odometry by optical flow, `.../state_ranger_qxyzw` the ranges (m) to the
right, ahead, to the left, behind and above, and the body's attitude as a quaternion (H. Zhou et al., Efficient 2D Graph
SLAM for Sparse Sensing, IROS 2022). Times are those of the robot's clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from server.formats.bags import opened
from server.formats.errors import FormatError
from server.messages import Message, Odometry, Ranges
from slam.rangefinder import RingParams

POSITIONS, RANGES = "/state_xyzv", "/state_ranger_qxyzw"  # the ends of the topics' names
ENDS = (POSITIONS, RANGES)
TYPE = "infrastructure/msg/RawData"
DEFINITION = "std_msgs/Header header\nfloat32[] raw\n"
REMEDY = f"a Crazyflie's bag has the topics .../{POSITIONS[1:]} and .../{RANGES[1:]} of type infrastructure/RawData"
FLOOR_SHARE = 0.9  # of the height that a beam may drop before its echo counts as the floor's
RING = RingParams(
    model="beam",
    bearings_deg=(-90.0, 0.0, 90.0, 180.0),
    height=0.5,
    min_range=0.05,
    max_range=2.0,  # the sensors' view is 27 degrees wide: half a metre up, the floor comes into it at 2.1 m
)


class CrazyflieLog(NamedTuple):
    """Times (n,) s, poses (n, 3) by optical flow, and ranges (n, 4) m over the floor, inf for no return.

    A beam that met the floor tells of no wall: nan.
    """

    times: np.ndarray
    poses: np.ndarray
    ranges: np.ndarray


def read_crazyflie(path: Path | str) -> CrazyflieLog:
    """What a bag holds; FormatError where it is damaged or another robot's."""
    path = Path(path)
    topics = read_topics(path)
    position_times, positions = topics[POSITIONS]
    times, measured = topics[RANGES]
    if positions.shape[1] < 3 or measured.shape[1] < 9:
        raise FormatError(path, None, "has messages with too few numbers", REMEDY)
    if not (np.all(np.isfinite(positions[:, :3])) and np.all(np.isfinite(measured[:, 5:9]))):
        raise FormatError(path, None, "has poses that are not finite", "record again")
    order = np.argsort(position_times, kind="stable")
    x, y, z = (np.interp(times, position_times[order], positions[order, axis]) for axis in range(3))
    forward, drop = on_the_floor(measured[:, 5:9], RING.bearings)
    ranges = measured[:, :4]
    is_echo = (ranges > 0.0) & (ranges * drop < FLOOR_SHARE * z[:, None])
    ranges = np.where(is_echo, ranges * forward, np.nan)
    ranges[ranges > RING.max_range] = np.inf
    return CrazyflieLog(times, np.column_stack([x, y, headings(measured[:, 5:9])]), ranges)


def read_topics(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Stamps (n,) and numbers (n, k) of both topics, in the order in which they were recorded."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # here, for only bags need it

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, TYPE))
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    with opened(path) as reader:
        for end in ENDS:
            connections = [each for each in reader.connections if each.topic.endswith(end)]
            if not connections or any(each.msgtype != TYPE for each in connections):
                raise FormatError(path, None, f"has no topic .../{end[1:]} as a Crazyflie's bag has it", REMEDY)
            rows: list[Any] = [store.deserialize_ros1(raw, TYPE) for _, _, raw in reader.messages(connections)]
            if not rows:
                raise FormatError(path, None, f"holds no message of .../{end[1:]}", "record again")
            stamps = [row.header.stamp.sec + 1e-9 * row.header.stamp.nanosec for row in rows]
            found[end] = np.array(stamps), np.array([row.raw for row in rows], float)
    return found


def headings(quaternions: np.ndarray) -> np.ndarray:
    """Headings (n,) of attitudes (n, 4) as x, y, z, w."""
    x, y, z, w = quaternions.T
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def on_the_floor(quaternions: np.ndarray, bearings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far a metre along each beam leads over the floor and down, both (n, bearings).

    The beams lie in the body's plane; how far the tilt turns them sideways is left out, a third of a degree at 6.
    """
    x, y, z, w = (part[:, None] for part in quaternions.T)
    rise = 2.0 * (x * z - w * y) * np.cos(bearings) + 2.0 * (y * z + w * x) * np.sin(bearings)
    return np.sqrt(np.clip(1.0 - rise * rise, 0.0, None)), -rise


def messages(log: CrazyflieLog) -> Iterator[Message]:
    """One pose and one sweep per message of the rangers."""
    for t, pose, ranges in zip(log.times, log.poses, log.ranges, strict=True):
        yield Odometry(float(t), *(float(part) for part in pose))
        yield Ranges(float(t), "laser", ranges)
