"""A Crazyflie's bag: four ranges and a pose per message, projected on the floor; other bags and damage are told."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from server.formats import FormatError, read_log
from server.formats.crazyflie import DEFINITION, TYPE, read_crazyflie
from server.messages import Odometry, Ranges
from server.presets import NAMED

POSITIONS, RANGES = "/crazyflie2/state_xyzv", "/crazyflie2/state_ranger_qxyzw"


def attitude(heading: float, pitch: float = 0.0, roll: float = 0.0) -> list[float]:
    """The quaternion x, y, z, w of a body that was turned, then pitched nose down, then rolled to the right."""

    def about(axis: int, angle: float) -> np.ndarray:
        q = np.array([0.0, 0.0, 0.0, math.cos(0.5 * angle)])
        q[axis] = math.sin(0.5 * angle)
        return q

    def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        w = a[3] * b[3] - a[:3] @ b[:3]
        return np.array([*(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])), w])

    return times(times(about(2, heading), about(1, pitch)), about(0, roll)).tolist()


def write_bag(path: Path, topics: dict[str, list[tuple[float, list[float]]]], msgtype: str = TYPE) -> Path:
    """A bag of messages with these stamps and numbers, in the order of their stamps."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, msgtype))
    time, header, raw_data = (store.types[n] for n in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", msgtype))
    with Writer(path) as writer:
        connections = {topic: writer.add_connection(topic, msgtype, typestore=store) for topic in topics}
        rows = sorted((t, topic, numbers) for topic, messages in topics.items() for t, numbers in messages)
        for t, topic, numbers in rows:
            stamp = time(sec=int(t), nanosec=round((t % 1.0) * 1e9))
            message = raw_data(header(seq=0, stamp=stamp, frame_id=""), np.array(numbers, np.float32))
            writer.write(connections[topic], round(t * 1e9), store.serialize_ros1(message, msgtype))
    return path


def flight(ranges: list[float], pose=(1.0, 2.0, 0.5), pitch: float = 0.0, roll: float = 0.0) -> dict:
    """Two moments of a robot that hovers 0.5 m up."""
    x, y, heading = pose
    return {
        POSITIONS: [(t, [x, y, 0.5, 0.0, 0.0, 0.0]) for t in (10.0, 11.0)],
        RANGES: [(t, [*ranges, 2.0, *attitude(heading, pitch, roll)]) for t in (10.25, 10.75)],
    }


def test_a_message_becomes_a_pose_and_four_ranges(tmp_path):
    log = read_log(write_bag(tmp_path / "a.bag", flight([0.5, 1.0, 1.5, 3.0])))
    pose, sweep, *rest = log.messages()
    assert len(rest) == 2
    assert isinstance(pose, Odometry)
    assert isinstance(sweep, Ranges)
    assert (pose.t, sweep.t, log.kind) == (10.25, 10.25, "crazyflie")
    np.testing.assert_allclose([pose.x, pose.y, pose.theta], [1.0, 2.0, 0.5], atol=1e-6)
    np.testing.assert_allclose(sweep.ranges, [0.5, 1.0, 1.5, math.inf], atol=1e-6)
    assert log.sensors is not None
    assert log.sensors[sweep.sensor].bearings_deg == (-90.0, 0.0, 90.0, 180.0)
    assert log.configuration["preset"] in NAMED


def test_positions_are_those_of_the_moment_of_the_ranges(tmp_path):
    topics = flight([1.0] * 4)
    topics[POSITIONS] = [(10.0, [0.0, 4.0, 0.5]), (11.0, [2.0, 0.0, 0.5])]
    log = read_crazyflie(write_bag(tmp_path / "a.bag", topics))
    np.testing.assert_allclose(log.poses[:, :2], [[0.5, 3.0], [1.5, 1.0]], atol=1e-6)


def test_a_leaning_beam_is_projected_on_the_floor(tmp_path):
    lean = math.radians(10.0)
    nose_down = read_crazyflie(write_bag(tmp_path / "a.bag", flight([1.0] * 4, pitch=lean))).ranges[0]
    np.testing.assert_allclose(nose_down, [1.0, math.cos(lean), 1.0, math.cos(lean)], atol=1e-6)
    rolled = read_crazyflie(write_bag(tmp_path / "b.bag", flight([1.0] * 4, roll=lean))).ranges[0]
    np.testing.assert_allclose(rolled, [math.cos(lean), 1.0, math.cos(lean), 1.0], atol=1e-6)


def test_a_beam_that_meets_the_floor_tells_of_no_wall(tmp_path):
    lean = math.asin(0.5 / 1.5)  # ahead the floor lies at 1.5 m, behind the beam looks up
    ranges = read_crazyflie(write_bag(tmp_path / "a.bag", flight([1.5] * 4, pitch=lean))).ranges[0]
    assert math.isnan(ranges[1])
    assert np.isfinite(ranges[[0, 2, 3]]).all()
    nearer = read_crazyflie(write_bag(tmp_path / "b.bag", flight([1.3] * 4, pitch=lean))).ranges[0]
    assert np.isfinite(nearer).all()


def test_zero_was_not_measured(tmp_path):
    log = read_crazyflie(write_bag(tmp_path / "a.bag", flight([0.0, 1.0, math.nan, 1.0])))
    assert np.isnan(log.ranges[0, [0, 2]]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda topics: topics.pop(RANGES), "has no topic .../state_ranger_qxyzw"),
        (lambda topics: topics.pop(POSITIONS), "has no topic .../state_xyzv"),
        (lambda topics: topics[RANGES].clear(), "holds no message"),
        (lambda topics: topics.update({RANGES: [(10.0, [1.0, 2.0])]}), "too few numbers"),
        (lambda topics: topics[RANGES].append((12.0, [1.0])), "damaged"),
        (lambda topics: topics.update({POSITIONS: [(10.0, [math.nan] * 6)]}), "not finite"),
    ],
)
def test_bags_that_are_not_a_crazyflies_are_told(tmp_path, change, words):
    topics = flight([1.0] * 4)
    change(topics)
    path = write_bag(tmp_path / "a.bag", topics)
    with pytest.raises(FormatError, match=words):
        read_log(path)


def test_messages_of_another_type_are_told(tmp_path):
    with pytest.raises(FormatError, match="infrastructure/RawData"):
        read_log(write_bag(tmp_path / "a.bag", flight([1.0] * 4), "other/msg/RawData"))


@pytest.mark.parametrize("seed", range(20))
def test_a_damaged_bag_is_told_or_read_but_never_crashes(tmp_path, seed):
    path = write_bag(tmp_path / "a.bag", flight([1.0] * 4))
    rng = np.random.default_rng(seed)
    content = bytearray(path.read_bytes())
    for place in rng.integers(13, len(content), 20):
        content[place] = rng.integers(256)
    path.write_bytes(content[: rng.integers(13, len(content)) if seed % 2 else None])
    with contextlib.suppress(FormatError):
        read_log(path)


def test_a_cut_bag_is_told(tmp_path):
    path = write_bag(tmp_path / "a.bag", flight([1.0] * 4))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(FormatError, match="bag"):
        read_log(path)


def test_a_bag_has_no_laser_to_thin(tmp_path):
    with pytest.raises(FormatError, match="no laser"):
        read_log(write_bag(tmp_path / "a.bag", flight([1.0] * 4)), beams=11)
