"""Logs of whole lasers: the mines', Wean Hall's, the LEGO robot's and ROS bags; broken ones are told where."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from server import config
from server.formats import FormatError, read_log
from server.formats.bags import DEFINITION, ODOMETRY, SCAN, TRANSFORMS, mount_of, read_laser_bag
from server.formats.lego import read_lego, read_reference, stem_of
from server.formats.mines import COLUMNS, HEADER, METRES_PER_TICK, integrate, read_mines
from server.formats.wean import read_wean
from server.messages import Odometry, Ranges
from slam.pose import compose
from tests.server.logs import write_room_log
from tests.server.test_formats_logs import DATA


def mines_row(t_us: float, left: int, right: int, millimetres: float = 1500.0) -> str:
    row = np.zeros(COLUMNS)
    row[0], row[2], row[3] = t_us, left, right
    row[HEADER:] = millimetres
    return " ".join(f"{value:g}" for value in row) + "\n"


def write_mines(path: Path, rows: list[str]) -> Path:
    path.write_text("".join(rows))
    return path


def test_a_row_of_the_mines_is_a_pose_and_a_scan(tmp_path):
    ticks = round(1.0 / METRES_PER_TICK)
    path = write_mines(tmp_path / "exp.dat", [mines_row(2e6, 0, 0), mines_row(3e6, ticks, ticks, 5700.0)])
    log = read_log(path)
    messages = list(log.messages())
    assert [type(message) for message in messages] == [Odometry, Ranges] * 2
    assert [message.t for message in messages] == [2.0, 2.0, 3.0, 3.0]
    assert (log.kind, log.robot, log.n_odometry) == ("mines", "maze_runner", 2)
    first, scan, second, beyond = messages
    assert isinstance(first, Odometry)
    assert isinstance(scan, Ranges)
    assert isinstance(second, Odometry)
    assert isinstance(beyond, Ranges)
    assert (first.x, second.x - first.x) == pytest.approx((0.145, 1.0), abs=1e-3)  # of the laser, ahead of the axle
    assert np.all(np.isnan(scan.ranges[:70]))
    assert np.all(np.isnan(scan.ranges[-70:]))
    assert scan.ranges[70:-70] == pytest.approx(1.5)
    assert np.all(np.isinf(beyond.ranges[70:-70]))
    assert log.laser is not None
    assert log.laser.bearings[341 - 1] == pytest.approx(0.0, abs=1e-9)


def test_ranges_of_a_few_millimetres_are_codes(tmp_path):
    log = read_mines(write_mines(tmp_path / "exp.dat", [mines_row(0, 0, 0, 6.0)]))
    assert np.all(np.isnan(log.scans))


def test_a_cut_last_row_ends_a_log_and_another_is_told(tmp_path):
    good, cut = mines_row(1e6, 0, 0), mines_row(2e6, 1, 1)[:500]
    log = read_log(write_mines(tmp_path / "exp.dat", [good, good, cut]))
    assert log.truncated_at == 3
    assert "replayed up to it" in log.warnings[0]
    with pytest.raises(FormatError, match=r"exp.dat:2: is no row of 707 numbers"):
        read_mines(write_mines(tmp_path / "exp.dat", [good, cut + "\n", good]))


def test_wheels_go_in_arcs():
    """A quarter of a circle to the left of 1 m: the right wheel goes farther by the track times the angle."""
    steps = np.linspace(0.0, 1.0, 50)
    way, turn, track = 0.5 * math.pi * steps, 0.5 * math.pi * steps, 0.33
    poses = integrate(way - 0.5 * track * turn, way + 0.5 * track * turn, track)
    assert poses[-1] == pytest.approx([1.0, 1.0, 0.5 * math.pi], abs=1e-9)


def wean_row(kind: str, pose: tuple[float, float, float], t: float) -> str:
    x, y, theta = pose
    if kind == "O":
        return f"O {x} {y} {theta} {t}\n"
    laser = compose(np.array(pose), np.array([25.0, 0.0, 0.0]))
    ranges = " ".join(["120"] * 178 + ["8183", "0"])
    return f"L {x} {y} {theta} {laser[0]} {laser[1]} {laser[2]} {ranges} {t}\n"


def test_rows_of_wean_hall_are_centimetres(tmp_path):
    path = tmp_path / "robotdata1.log"
    path.write_text(wean_row("O", (100.0, 0.0, 0.0), 0.1) + wean_row("L", (200.0, 0.0, 0.5), 0.2))
    log = read_wean(path)
    assert log.odometry == pytest.approx(np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.5]]))
    assert log.mount == pytest.approx([0.25, 0.0, 0.0], abs=1e-9)
    assert log.is_scan.tolist() == [False, False, True]
    assert log.scans[0, 0] == pytest.approx(1.2)
    assert math.isinf(log.scans[0, 178])
    assert math.isnan(log.scans[0, 179])
    assert read_log(path).kind == "wean"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (wean_row("O", (0, 0, 0), 0), "holds no ranges"),
        (wean_row("L", (0, 0, 0), 0) + "L 1 2 3\n" + wean_row("O", (0, 0, 0), 0), ":2: cannot be read; a scan row"),
        (wean_row("O", (0, 0, 0), 0) + "O 1 2 x 4\n" + wean_row("L", (0, 0, 0), 0), ":2: cannot be read; an odometry"),
    ],
)
def test_broken_logs_of_wean_hall_are_told(tmp_path, content, told):
    path = tmp_path / "broken.log"
    path.write_text(content)
    with pytest.raises(FormatError) as error:
        read_wean(path)
    assert told in str(error.value)


def test_a_cut_log_of_wean_hall_is_read_up_to_the_cut(tmp_path):
    path = tmp_path / "cut.log"
    path.write_text(wean_row("L", (0, 0, 0), 0) + wean_row("L", (1, 0, 0), 0)[:200])
    assert (read_wean(path).truncated_at, len(read_wean(path).scans)) == (2, 1)


def write_lego(folder: Path, scan_rows: list[str] | None = None) -> Path:
    (folder / "r_motors.txt").write_text("M 0 0 0 0 0 0 0 0\nM 400 1000 1000 0 0 1000 0 0\n")
    (folder / "r_scan.txt").write_text(
        "".join(scan_rows or ["S 100 5 0 500 2000 500 9000\n", "S 500 5 1 2 30 40 50\n"])
    )
    (folder / "r_reference.txt").write_text("P 0 1850 1897\nP 400 1500 1897\n")
    return folder


def test_the_lego_robots_three_files_are_one_log(tmp_path):
    stem = tmp_path / "r"
    assert stem_of(write_lego(tmp_path)) == stem
    assert stem_of(tmp_path / "r_scan.txt") == stem_of(tmp_path / "r_reference.txt") == stem
    log = read_lego(stem)
    assert log.is_scan.tolist() == [False, True, False, True]
    assert log.odometry[1] == pytest.approx([0.349, 0.0, 0.0])
    assert math.isnan(log.scans[0, 0])
    assert math.isinf(log.scans[0, 4])
    assert log.scans[0, 1:4] == pytest.approx([0.5, 2.0, 0.5])
    assert read_log(tmp_path).kind == "lego"
    times, places = read_reference(stem)
    assert (times.tolist(), places[0].tolist()) == ([0.0, 0.4], [1.85, 1.897])


@pytest.mark.parametrize("row", ["S 100 5 1 2 3\n", "S 100 5 1 2 3 4 x\n", "M 100 5 1 2 3 4 5\n", "S 100 nan 1 2\n"])
def test_broken_rows_of_the_lego_robot_are_told(tmp_path, row):
    write_lego(tmp_path, ["S 50 5 1 2 3 4 5\n", row])
    with pytest.raises(FormatError, match=r"r_scan.txt:2"):
        read_log(tmp_path)


def write_bag(path: Path, topics: tuple[str, ...] = (SCAN, ODOMETRY, TRANSFORMS), n_beams: int = 361) -> Path:
    """A robot that goes 0.1 m between two scans; its laser sits 0.1 m behind its middle and looks back."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, TRANSFORMS))

    def header(t: float, frame: str):
        stamp = store.types["builtin_interfaces/msg/Time"](sec=int(t), nanosec=round((t % 1.0) * 1e9))
        return store.types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id=frame)

    def of(kind: str, *values):
        return store.types[f"geometry_msgs/msg/{kind}"](*values)

    def rotation(angle: float):
        return of("Quaternion", 0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle))

    def message(kind: str, t: float):
        if kind == SCAN:
            ranges = np.full(n_beams, 2.0, np.float32)
            ranges[:2] = [0.0, 9.0]
            step = 2.0 * math.pi / (n_beams - 1)
            numbers = -math.pi, math.pi, step, 0.0, 0.2, 0.02, 5.0
            return store.types[SCAN](header(t, "laser"), *numbers, ranges, np.zeros(0, np.float32))
        if kind == ODOMETRY:
            pose = of("Pose", of("Point", t - 10.0, 0.0, 0.0), rotation(0.0))
            posed = of("PoseWithCovariance", pose, np.zeros(36))
            still = of("Twist", of("Vector3", 0.0, 0.0, 0.0), of("Vector3", 0.0, 0.0, 0.0))
            return store.types[ODOMETRY](
                header(t, "odom"), "base", posed, of("TwistWithCovariance", still, np.zeros(36))
            )
        sits = of("Transform", of("Vector3", -0.1, 0.0, 0.2), rotation(math.pi))
        return store.types[TRANSFORMS]([of("TransformStamped", header(t, "base"), "laser", sits)])

    with Writer(path) as writer:
        connections = {kind: writer.add_connection(f"/{kind}", kind, typestore=store) for kind in topics}
        for t in (10.0, 10.1):
            for kind in topics:
                writer.write(connections[kind], round(t * 1e9), store.serialize_ros1(message(kind, t), kind))
    return path


def test_a_bag_of_any_robot_with_a_laser_is_a_log(tmp_path):
    path = write_bag(tmp_path / "a.bag")
    log = read_laser_bag(path)
    assert log.mount == pytest.approx([-0.1, 0.0, math.pi])
    assert log.odometry[:, 0] == pytest.approx([0.0, 0.1])
    assert log.scans.shape == (2, 360)  # the last beam looked where the first did
    assert math.isnan(log.scans[0, 0])
    assert math.isinf(log.scans[0, 1])
    assert (read_log(path).kind, read_log(path).robot) == ("bag", "maze_runner")


def test_a_bag_without_scans_is_told(tmp_path):
    with pytest.raises(FormatError, match="holds no sensor_msgs/LaserScan"):
        read_log(write_bag(tmp_path / "a.bag", (ODOMETRY,)))


def test_a_laser_without_odometry_is_alone_and_not_for_crunch(tmp_path):
    path = write_bag(tmp_path / "a.bag", (SCAN, TRANSFORMS))
    log = read_log(path)
    assert config.load(header=log.configuration).maze_runner.odometry.is_alone
    assert not config.load(header=read_log(write_bag(tmp_path / "b.bag")).configuration).maze_runner.odometry.is_alone
    assert [type(message) for message in log.messages()] == [Odometry, Ranges] * 2
    with pytest.raises(FormatError, match="holds no odometry"):
        read_log(path, robot="crunch")


def test_a_damaged_bag_is_told(tmp_path):
    content = write_bag(tmp_path / "a.bag").read_bytes()
    for size in range(20, len(content), len(content) // 25):
        (tmp_path / "b.bag").write_bytes(content[:size])
        with pytest.raises(FormatError, match="bag"):
            read_log(tmp_path / "b.bag")


def test_where_a_laser_sits_is_found_through_frames_between():
    half, back = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.2, math.pi])
    frames = {"plate": ("base", half), "laser": ("plate", back), "odd": ("odd", half)}
    assert mount_of(frames, "base", "/laser") == pytest.approx([0.1, 0.2, math.pi])
    assert mount_of(frames, "base", "elsewhere") == pytest.approx(np.zeros(3))
    assert mount_of(frames, "base", "odd") == pytest.approx(np.zeros(3))


def test_a_laser_is_whole_for_maze_runner_and_sparse_for_crunch(tmp_path):
    write_room_log(tmp_path / "room.log")
    whole, sparse = (read_log(tmp_path / "room.log", robot=robot) for robot in ("maze_runner", None))
    assert whole.laser is not None
    assert (whole.laser.beams, whole.robot, whole.sensors) == (180, "maze_runner", None)
    assert (sparse.laser, sparse.robot) == (None, None)
    assert {message.sensor for message in whole.messages() if isinstance(message, Ranges)} == {"laser"}
    path = write_bag(tmp_path / "a.bag")
    assert read_log(path, robot="crunch").sensors is not None
    assert read_log(path, beams=11).configuration == {"preset": "beams"}
    with pytest.raises(FormatError, match="maze_runner takes whole scans"):
        read_log(tmp_path / "room.log", beams=11, robot="maze_runner")


@pytest.mark.skipif(not DATA.is_dir(), reason="other people's recordings are not here")
@pytest.mark.parametrize(
    ("name", "kind", "n_beams", "length"),
    [
        ("mines/exp1.dat", "mines", 682, 45.0),
        ("lego-reference", "lego", 660, 8.5),
        ("wean/robotdata1.log", "wean", 180, 89.0),
        ("neato/avoid_obstacles.bag", "bag", 360, 8.0),
    ],
)
def test_real_logs_are_what_their_makers_say(name, kind, n_beams, length):
    log = read_log(DATA / name)
    assert log.laser is not None
    assert (log.kind, log.laser.beams) == (kind, n_beams)
    places = np.array([(message.x, message.y) for message in log.messages() if isinstance(message, Odometry)])
    assert float(np.hypot(*np.diff(places, axis=0).T).sum()) == pytest.approx(length, rel=0.1)
