"""ROS 1 bags of any robot with a laser: `sensor_msgs/LaserScan`, `nav_msgs/Odometry`, and how the laser sits by `tf`.

Of several topics of a kind the one with the most messages counts. Times are the messages' own stamps. Without odometry
the laser is alone: its own path is the robot's.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from server.formats.errors import FormatError, read_bytes
from server.formats.laser import LaserLog, by_time
from slam.pose import compose, inverse

SCAN, ODOMETRY, TRANSFORMS = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
REMEDY = "a bag of a robot with a laser has a topic of sensor_msgs/LaserScan"
DAMAGED = "try `rosbag reindex`, or record again"
MAGIC = b"#ROSBAG V2.0"


def is_bag(content: bytes) -> bool:
    """Whether the beginning of a file is that of a ROS 1 bag."""
    return content.startswith(MAGIC)


def topics_in(path: Path) -> set[str]:
    """The topics in a bag; FormatError where it is damaged."""
    with opened(path) as reader:
        return {connection.topic for connection in reader.connections}


def read_laser_bag(path: Path | str) -> LaserLog:
    """Odometry and scans by their stamps; FormatError where the bag is damaged or has no scan."""
    path = Path(path)
    with opened(path) as reader:
        scans = list(messages(reader, SCAN))
        poses = list(messages(reader, ODOMETRY))
        transforms = dict(transforms_in(reader))
    if not scans:
        raise FormatError(path, None, "holds no sensor_msgs/LaserScan", REMEDY)
    first = scans[0]
    n_beams = len(first.ranges)
    bearings = first.angle_min + first.angle_increment * np.arange(n_beams)
    if n_beams > 2 and abs(bearings[-1] - bearings[0] - 2.0 * np.pi) < 0.5 * abs(first.angle_increment):
        n_beams -= 1  # the last beam looks where the first does
    ranges = np.array([measured(scan, n_beams, path) for scan in scans])
    order = np.argsort(bearings[:n_beams])
    if not poses:
        still, nowhere, times = np.zeros((len(scans), 3)), np.zeros(3), stamps(scans)
        log = by_time(path, times, still, times, ranges[:, order], bearings[:n_beams][order], nowhere)
        return log._replace(has_odometry=False)
    odometry = np.array([pose_of(message.pose.pose.position, message.pose.pose.orientation) for message in poses])
    mount = mount_of(transforms, poses[0].child_frame_id, first.header.frame_id)
    return by_time(
        path, stamps(poses), odometry, stamps(scans), ranges[:, order], bearings[:n_beams][order], mount
    )  # fmt: skip


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A bag's reader; FormatError where it cannot be opened, or fails while it is read."""
    from rosbags.rosbag1 import Reader, ReaderError  # here, for only bags need it

    read_bytes(path)
    try:
        with Reader(path) as reader:
            yield reader
    except FormatError:
        raise
    except ReaderError as error:
        raise FormatError(path, None, f"cannot be read as a bag ({str(error).rstrip('.')})", DAMAGED) from None
    except Exception as error:  # a damaged bag fails anywhere within its reader
        raise FormatError(path, None, f"is a damaged bag ({type(error).__name__})", DAMAGED) from None


def store_of() -> Any:
    """The types of messages that are known."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, TRANSFORMS))
    return store


def messages(reader: Any, kind: str) -> Iterator[Any]:
    """The messages of the fullest topic of a type."""
    topics: dict[str, int] = {}
    for connection in reader.connections:
        if connection.msgtype == kind:
            topics[connection.topic] = topics.get(connection.topic, 0) + connection.msgcount
    if not topics:
        return
    fullest = max(topics, key=lambda topic: (topics[topic], topic))
    store = store_of()
    for _, _, raw in reader.messages([each for each in reader.connections if each.topic == fullest]):
        yield store.deserialize_ros1(raw, kind)


def transforms_in(reader: Any) -> Iterator[tuple[str, tuple[str, np.ndarray]]]:
    """Each frame's parent, and its pose (3,) there as it was said first."""
    store, known = store_of(), set()
    connections = [each for each in reader.connections if each.msgtype == TRANSFORMS]
    for _, _, raw in reader.messages(connections) if connections else ():  # no connections would be all of them
        for transform in store.deserialize_ros1(raw, TRANSFORMS).transforms:
            frame = transform.child_frame_id.lstrip("/")
            if frame not in known:
                known.add(frame)
                pose = pose_of(transform.transform.translation, transform.transform.rotation)
                yield frame, (transform.header.frame_id.lstrip("/"), pose)


def mount_of(transforms: dict[str, tuple[str, np.ndarray]], base: str, laser: str) -> np.ndarray:
    """Pose (3,) of the laser's frame in the robot's; as if they were one where the bag does not tell."""
    above_base, above_laser = (chain_of(transforms, frame.lstrip("/")) for frame in (base, laser))
    for frame, pose in above_laser.items():
        if frame in above_base:
            return compose(inverse(above_base[frame]), pose)
    return np.zeros(3)


def chain_of(transforms: dict[str, tuple[str, np.ndarray]], frame: str) -> dict[str, np.ndarray]:
    """A frame's pose (3,) in itself, its parent, its parent's parent, and so on."""
    chain = {frame: np.zeros(3)}
    while frame in transforms and transforms[frame][0] not in chain:
        parent, pose = transforms[frame]
        chain[parent] = compose(pose, chain[frame])
        frame = parent
    return chain


def pose_of(place: Any, attitude: Any) -> np.ndarray:
    """(3,) of a place and an attitude in space."""
    x, y, z, w = attitude.x, attitude.y, attitude.z, attitude.w
    return np.array([place.x, place.y, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))])


def measured(scan: Any, n_beams: int, path: Path) -> np.ndarray:
    """Ranges (beams,): from the maximum on there is no return, below the minimum nothing was measured."""
    ranges = np.asarray(scan.ranges, float)[:n_beams]
    if len(ranges) != n_beams:
        raise FormatError(path, None, f"has scans of {n_beams} beams and of {len(ranges)}", "split the bag by laser")
    return np.where(ranges >= scan.range_max, np.inf, np.where(ranges < max(scan.range_min, 1e-3), np.nan, ranges))


def stamps(rows: list[Any]) -> np.ndarray:
    """Times (n,) in s."""
    return np.array([row.header.stamp.sec + 1e-9 * row.header.stamp.nanosec for row in rows])
