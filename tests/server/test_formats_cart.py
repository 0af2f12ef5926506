"""Runs of robots with a bumper: a Roomba's counts, a Neato's bag, an RCX's pairs; broken ones are told where."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from server.errors import UserError
from server.formats import FormatError
from server.formats.bags import ODOMETRY, SCAN
from server.formats.cart_log import stages_of
from server.formats.neato import BUMP, DEFINITION, has_bumps, read_neato
from server.formats.rcx import is_rcx, read_rcx
from server.formats.roomba import is_roomba, read_roomba, unwrapped
from slam.cart_odometry import BACK, DRIVE, LEFT, MIDDLE, RIGHT, TURN, CartParams, Stage, arc, bumps_of, raw_path
from slam.pose import between, compose
from tests.server.test_formats_logs import DATA

PARAMS = CartParams()


def counts(stages: list[Stage], samples: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the wheels' counters and the bumper say while a robot goes through stages; closed until it backs up."""
    left, right, bumpers = [0.0], [0.0], [0]
    for stage in stages:
        for sample in range(1, samples + 1):
            left.append(left[-1] + stage.left / samples)
            right.append(right[-1] + stage.right / samples)
            is_pressed = sample == samples if stage.kind == DRIVE else stage.kind == BACK and sample < samples // 4
            bumpers.append(stage.bumper if stage.kind == DRIVE and is_pressed else bumpers[-1] if is_pressed else 0)
    return np.round(left).astype(int), np.round(right).astype(int), np.array(bumpers)


CYCLES = [
    Stage(DRIVE, 500, 520, LEFT), Stage(BACK, -80, -78), Stage(TURN, 60, -64),
    Stage(DRIVE, 400, 440, MIDDLE), Stage(BACK, -80, -80), Stage(TURN, -90, 88), Stage(DRIVE, 300, 300, RIGHT),
]  # fmt: skip


def test_counts_are_cut_into_the_stages_that_made_them():
    left, right, bumpers = counts(CYCLES)
    stages, ends = stages_of(left, right, bumpers, PARAMS)
    assert [stage.bumper for stage in stages if stage.bumper] == [LEFT, MIDDLE, RIGHT]
    kinds = [stage.kind for stage in stages]
    assert [kind for row, kind in enumerate(kinds) if row == 0 or kinds[row - 1] != kind] == [
        DRIVE, BACK, TURN, DRIVE, BACK, TURN, DRIVE,
    ]  # fmt: skip
    assert [bumpers[end] for end in ends[bumps_of(stages)]] == [LEFT, MIDDLE, RIGHT]
    off = between(raw_path(CYCLES, PARAMS)[-1], raw_path(stages, PARAMS)[-1])
    assert np.hypot(*off[:2]) < 0.02


@given(
    steps=st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.booleans()), min_size=2, max_size=150),
)
def test_stages_lead_where_the_wheels_led(steps):
    """No tick is lost but those at the end, no bump told twice, and each stage strays by less than is allowed."""
    left, right = np.cumsum([step[0] for step in steps]), np.cumsum([step[1] for step in steps])
    bumpers = np.array([MIDDLE * step[2] for step in steps])
    stages, ends = stages_of(left, right, bumpers, PARAMS)
    assert np.all(np.diff(ends) > 0)
    closings = np.flatnonzero(np.diff(bumpers) > 0) + 1
    assert sum(stage.bumper > 0 for stage in stages) <= len(closings)
    last = ends[-1] if len(ends) else 0
    assert sum(stage.left for stage in stages) == left[last] - left[0]
    assert sum(stage.right for stage in stages) == right[last] - right[0]
    truth = np.zeros(3)
    for change in arc(np.diff(left[: last + 1]), np.diff(right[: last + 1]), PARAMS):
        truth = compose(truth, change)
    assert np.hypot(*between(truth, raw_path(stages, PARAMS)[-1])[:2]) < 0.01 + 0.05 * len(stages)


def test_a_robot_that_stands_has_no_stages():
    stages, ends = stages_of(np.zeros(50), np.zeros(50), np.zeros(50), PARAMS)
    assert stages == []
    assert len(ends) == 0


def roomba_row(t: float, left: int, right: int, bumpers: str = "00000000") -> str:
    return f"{t:.5f}, 0.0, 0.0, 0.0, 0.0, {left}, {right}, 0, 0, 0.0, 0.0, {bumpers}, 00000000\n"


HEADER = "Time Stamp, Total Distance Traveled, a, b, c, d, e, f, g, h, i, Bumper Byte, Light Bumper Byte\n"


def write_roomba(path: Path, short: bool = False, offset: int = 0) -> Path:
    rows = []
    for row, (left, right, bumper) in enumerate(zip(*counts(CYCLES), strict=True)):
        bits = f"{2 * bool(bumper & LEFT) + bool(bumper & RIGHT):08b}"
        left, right = ((int(count) + offset + 32768) % 65536 - 32768 for count in (left, right))
        rows.append(f"{row},{left},{right},0.0,0.0,0.0,{bits}\n" if short else roomba_row(row, left, right, bits))
    path.write_text(("" if short else HEADER) + "".join(rows))
    return path


@pytest.mark.parametrize("short", [False, True])
def test_a_roombas_rows_are_stages(tmp_path, short):
    path = write_roomba(tmp_path / "drive.txt", short)
    assert is_roomba(path.read_bytes())
    log = read_roomba(path)
    assert [log.stages[row].bumper for row in bumps_of(log.stages)] == [LEFT, RIGHT]
    assert log.times[-1] == 280.0
    wrapped = read_roomba(write_roomba(tmp_path / "wrapped.txt", short, offset=32000))
    assert wrapped.stages == log.stages, "counts of 16 bits go on where they wrap"


def test_counts_wrap_both_ways():
    assert unwrapped(np.array([32760.0, -32768.0, -32760.0, 32767.0])).tolist() == [0, 8, 16, 7]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no row"),
        (HEADER, "holds no row"),
        (HEADER + "1, 2\n" + roomba_row(0, 0, 0), r":2: 2 columns where 13 or 7 belong"),
        (
            HEADER + roomba_row(0, 0, 0, "2") + roomba_row(0, 0, 0),
            r":2: bumpers '2' are not eight binary digits; a row",
        ),
        (roomba_row(0, 0, 0).replace("0.0", "x") * 2, r":1: a column is not a number"),
        (roomba_row(math.nan, 0, 0) * 2, r":1: a column is not finite"),
        (roomba_row(0, 70000, 0) * 2, r":1: 70000 is no count of 16 bits"),
        (roomba_row(0, 0, 0) + "0,1,2,0,0,0,00000000\n" + roomba_row(0, 0, 0), r":2: 7 columns where 13 belong"),
    ],
)
def test_broken_roomba_logs_are_told_with_their_line(tmp_path, text, words):
    path = tmp_path / "drive.txt"
    path.write_text(text)
    with pytest.raises(UserError, match=words) as told:
        read_roomba(path)
    assert isinstance(told.value, FormatError)
    assert told.value.remedy


def test_a_cut_last_row_ends_a_roombas_log(tmp_path):
    path = tmp_path / "drive.txt"
    path.write_text(HEADER + roomba_row(0, 0, 0) + roomba_row(1, 50, 50) + roomba_row(2, 80, 80)[:20])
    log = read_roomba(path)
    assert log.truncated_at == 4
    assert log.stages == [Stage(DRIVE, 50, 50)]


@given(content=st.binary(max_size=300))
def test_noise_is_refused_and_never_crashes(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("noise") / "log"
    path.write_bytes(content)
    is_rcx(content)
    is_roomba(content)
    for read in (read_roomba, read_rcx):
        with contextlib.suppress(FormatError):
            read(path)


PAIRS = "".join(f"{stage.left} {stage.right}\n" for stage in CYCLES)


@pytest.mark.parametrize(
    "content",
    [
        PAIRS.encode(),
        PAIRS.replace(" ", "\n").encode(),
        b"# left, right\n" + PAIRS.replace(" ", ", ").encode(),
        "".join(f"{stage.left % 65536} {stage.right % 65536}\n" for stage in CYCLES).encode(),
        np.array([(stage.left, stage.right) for stage in CYCLES], "<i2").tobytes(),
    ],
    ids=["pairs", "one a line", "comments and commas", "unsigned", "bytes"],
)
def test_an_rcx_logs_a_pair_a_stage(tmp_path, content):
    path = tmp_path / "cart.log"
    path.write_bytes(content)
    log = read_rcx(path)
    assert log.stages == [stage._replace(bumper=MIDDLE * (stage.kind == DRIVE)) for stage in CYCLES]
    assert log.truncated_at is None
    assert len(bumps_of(log.stages)) == 3


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty; the log is pairs"),
        (b"# nothing\n", "holds no integer"),
        (b"5\n", "holds not one pair"),
        (b"1 2\nfive\n", ":2: 'five' is no integer of 16 bits"),
        (b"1 2 3\n", ":1: 3 integers where one or two belong"),
        (b"70000 1\n", ":1: '70000' is no integer"),
        (b"100 100\n100 100\n", ":2: 100 100 is the wrong way to back up; a value was lost"),
        (b"100 100\n-9 -9\n5 -5\n-100 -100\n", ":4: -100 -100 is the wrong way to drive"),
        (np.array([100, 100, 100, 100], "<i2").tobytes(), ":4: 100 100 is the wrong way to back up"),
    ],
)
def test_broken_rcx_logs_are_told_with_their_place(tmp_path, content, words):
    path = tmp_path / "cart.log"
    path.write_bytes(content)
    with pytest.raises(UserError, match=words):
        read_rcx(path)


def test_a_lost_half_of_the_last_pair_is_left_out(tmp_path):
    path = tmp_path / "cart.log"
    path.write_text("100 90\n-20 -20\n5\n")
    log = read_rcx(path)
    assert (len(log.stages), log.truncated_at) == (2, 3)


def test_rcx_logs_are_told_from_others():
    assert is_rcx(b"# a run\n100 90\n")
    assert is_rcx(b"100\n90\n")
    assert not is_rcx(b"")
    assert not is_rcx(b"ODOM 1 2 3\n")
    assert not is_rcx(b"1.5 2.5\n")


def write_neato(path: Path, kinds: tuple[str, ...] = (BUMP, ODOMETRY, SCAN), scale: float = 1.0) -> Path:
    """A bag as `neato_node` writes it: every 0.1 s a pose added up from whole millimetres, the bumpers and a scan."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, BUMP))
    types = store.types
    time, header, vector = (types[f"{each}"] for each in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header",
                                                         "geometry_msgs/msg/Vector3"))  # fmt: skip
    point, attitude = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
    pose_kind, twist = types["geometry_msgs/msg/Pose"], types["geometry_msgs/msg/Twist"]
    with_pose, with_twist = (types[f"geometry_msgs/msg/{each}WithCovariance"] for each in ("Pose", "Twist"))
    left, right, bumpers = counts(CYCLES)
    pose = np.array([1.0, 2.0, 0.5])
    with Writer(path) as writer:
        connections = {kind: writer.add_connection(f"/{kind.lower().rpartition('/')[2]}", kind, typestore=store)
                       for kind in kinds}  # fmt: skip
        for row in range(len(left)):
            if row:
                steps = [1e-3 * (each[row] - each[row - 1]) for each in (left, right)]
                pose = compose(pose, np.array([scale * 0.5 * sum(steps), 0.0, (steps[1] - steps[0]) / 0.248]))
            nanoseconds = 10**18 + 10**8 * row
            stamped = header(row, time(nanoseconds // 10**9, nanoseconds % 10**9), "odom")
            place = point(pose[0], pose[1], 0.0)
            turn = attitude(0.0, 0.0, math.sin(0.5 * pose[2]), math.cos(0.5 * pose[2]))
            still = twist(vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
            made = {
                ODOMETRY: types[ODOMETRY](
                    stamped,
                    "base_link",
                    with_pose(pose_kind(place, turn), np.zeros(36)),
                    with_twist(still, np.zeros(36)),
                ),
                BUMP: types[BUMP](bool(bumpers[row] & LEFT), 0, 0, bool(bumpers[row] & RIGHT)),
                SCAN: types[SCAN](
                    stamped, 0.0, 6.28, 0.01745, 0.0, 0.1, 0.1, 5.0, np.ones(360, np.float32), np.zeros(0, np.float32)
                ),
            }
            for late, kind in enumerate((ODOMETRY, BUMP, SCAN)):
                if kind in kinds:
                    raw = store.serialize_ros1(made[kind], kind)
                    writer.write(connections[kind], nanoseconds + 10**6 * late, raw)
    return path


def test_a_neatos_bag_is_stages_and_scans(tmp_path):
    path = write_neato(tmp_path / "drive.bag")
    assert has_bumps(path)
    log = read_neato(path)
    assert len(log.laser.scans) == len(log.laser.odometry)
    assert [log.cart.stages[row].bumper for row in bumps_of(log.cart.stages)] == [LEFT, RIGHT]
    assert sum(stage.left for stage in log.cart.stages) == sum(stage.left for stage in CYCLES)
    assert sum(stage.right for stage in log.cart.stages) == sum(stage.right for stage in CYCLES)
    assert log.cart.times[-1] == pytest.approx(28.0)
    assert log.start == pytest.approx(1e9)


@pytest.mark.parametrize("missing", [BUMP, ODOMETRY, SCAN])
def test_bags_of_other_robots_are_refused(tmp_path, missing):
    path = write_neato(tmp_path / "drive.bag", tuple(kind for kind in (BUMP, ODOMETRY, SCAN) if kind != missing))
    with pytest.raises(UserError, match=f"holds no {missing.replace('/msg/', '/')}; a Neato's bag has"):
        read_neato(path)


def test_odometry_that_is_no_neatos_is_refused(tmp_path):
    with pytest.raises(FormatError, match="did not add up from millimetres"):
        read_neato(write_neato(tmp_path / "drive.bag", scale=1.03))


def test_a_cut_bag_is_refused(tmp_path):
    path = write_neato(tmp_path / "drive.bag")
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(FormatError, match="bag"):
        read_neato(path)


needs_data = pytest.mark.skipif(not (DATA / "roomba").is_dir(), reason="needs CRUNCH_DATA/roomba and neato")


@needs_data
def test_real_roombas_bump_and_come_home():
    """The first drive was to a goal and back, and its odometry says that it came back to within centimetres."""
    log = read_roomba(DATA / "roomba" / "DataTest1a.txt")
    assert len(bumps_of(log.stages)) == 13
    assert np.hypot(*raw_path(log.stages, log.params)[-1][:2]) < 0.05
    assert len(bumps_of(read_roomba(DATA / "roomba" / "DataTest2.txt").stages)) == 0
    assert len(bumps_of(read_roomba(DATA / "roomba" / "Corner_finding_data.txt").stages)) == 8


@needs_data
@pytest.mark.parametrize("name", ["avoid_obstacles", "testdrive"])
def test_real_neatos_stages_lead_where_its_odometry_led(name):
    log = read_neato(DATA / "neato" / f"{name}.bag")
    end = raw_path(log.cart.stages, log.cart.params)[-1]
    off = between(between(log.laser.odometry[0], log.laser.odometry[-1]), end)
    assert np.hypot(*off[:2]) < 0.1
    assert abs(off[2]) < 0.02
