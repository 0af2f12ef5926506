"""ROS 1 bags of a Neato vacuum robot: its wheels' ways, which of its four bumpers are closed, and its laser's scans.

`/odom` is what `neato_node` adds up from counts of whole millimetres and a wheelbase of 248 mm; they are found again
from it, exactly. `/bump` (neato_node/Bump) tells the front and side switches of both sides. Times are seconds since the
first odometry of the bag.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from server.formats.bags import ODOMETRY, SCAN, messages, opened, pose_of, read_laser_bag, stamps
from server.formats.cart_log import CartLog, stages_of
from server.formats.errors import FormatError
from server.formats.laser import LaserLog
from slam.cart_odometry import LEFT, RIGHT, CartParams
from slam.pose import between, wrap

BUMP = "neato_node/msg/Bump"
DEFINITION = "uint8 leftFront\nuint8 leftSide\nuint8 rightFront\nuint8 rightSide\n"
PARAMS = CartParams(wheelbase=0.248, tick=0.001, bumper_width=0.33, bumper_ahead=0.14, slip_distance=0.01)
REMEDY = "a Neato's bag has neato_node/Bump, nav_msgs/Odometry and sensor_msgs/LaserScan"
UNEVEN = 0.25  # of a tick that ways found again may be off whole ones


class NeatoLog(NamedTuple):
    """The run, and the laser's log of the same bag, whose times are the messages' own; `start` (s) is the run's 0."""

    cart: CartLog
    laser: LaserLog
    start: float


def has_bumps(path: Path) -> bool:
    """Whether a bag is of a Neato that told its bumpers."""
    with opened(path) as reader:
        return any(connection.msgtype == BUMP for connection in reader.connections)


def read_neato(path: Path | str) -> NeatoLog:
    """Run and scans; FormatError where the bag is damaged or another robot's."""
    path = Path(path)
    with opened(path) as reader:
        kinds = {connection.msgtype for connection in reader.connections}
        missing = [kind for kind in (BUMP, ODOMETRY, SCAN) if kind not in kinds]
        if missing:
            raise FormatError(path, None, f"holds no {missing[0].replace('/msg/', '/')}", REMEDY)
        rows: list[Any] = list(messages(reader, ODOMETRY))
        bump_times, switches = bumps_in(reader)
    if len(rows) < 2 or not len(bump_times):
        raise FormatError(path, None, "holds too little odometry, or no bumper", "record again")
    times = stamps(rows)
    poses = np.array([pose_of(row.pose.pose.position, row.pose.pose.orientation) for row in rows])
    left, right = counts_of(path, poses)
    # the node sends its bumpers, which have no stamp, after the odometry of the same turn of its loop
    same = np.clip(np.searchsorted(bump_times, times), 0, len(bump_times) - 1)
    stages, ends = stages_of(left, right, switches[same], PARAMS)
    return NeatoLog(CartLog(path, stages, PARAMS, times[ends] - times[0]), read_laser_bag(path), float(times[0]))


def bumps_in(reader: Any) -> tuple[np.ndarray, np.ndarray]:
    """When the bumper's messages were recorded (n,) in s, and the switches (n,) then closed."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # here, for only bags need it

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, BUMP))
    times, switches = [], []
    for _, nanoseconds, raw in reader.messages([each for each in reader.connections if each.msgtype == BUMP]):
        message: Any = store.deserialize_ros1(raw, BUMP)
        is_left, is_right = message.leftFront or message.leftSide, message.rightFront or message.rightSide
        times.append(1e-9 * nanoseconds)
        switches.append(LEFT * bool(is_left) + RIGHT * bool(is_right))
    return np.array(times), np.array(switches, np.int64)


def counts_of(path: Path, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts (n,) of the left and right wheel since the first of the poses (n, 3) that the node added up from them.

    FormatError where another node, or another robot, made the poses.
    """
    motions = between(poses[:-1], poses[1:])
    ways = np.hypot(motions[:, 0], motions[:, 1]) * np.where(motions[:, 0] < 0.0, -1.0, 1.0) / PARAMS.tick
    halves = 0.5 * wrap(np.diff(poses[:, 2])) * PARAMS.wheelbase / PARAMS.tick
    steps = np.stack([ways - halves, ways + halves])
    whole = np.round(steps)
    if np.max(np.abs(steps - whole)) > UNEVEN:
        raise FormatError(path, None, "has odometry that a Neato's node did not add up from millimetres", REMEDY)
    left, right = np.cumsum(np.concatenate([np.zeros((2, 1)), whole], axis=1), axis=1).astype(np.int64)
    return left, right
