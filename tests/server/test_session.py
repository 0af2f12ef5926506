import random
import struct
import zlib
from collections import Counter

import numpy as np
import pytest
from cobs import cobs

from server import channels, link
from server.channels import Calibration
from server.commands import ArmCommand, DriveCommand, PowersCommand, StopCommand
from server.link import Frame
from server.messages import Arm, Drive, Effect, Goal, Message, Motors, Ranges, Status, Stop, Wheels
from server.recording import Header, Kind, LinkName, Reader, Recorder
from server.session import Session, command_of


class Echo:
    """A robot that keeps what it is told, and answers each reading of its wheels and each wish with a command."""

    def __init__(self):
        self.heard = []

    def step(self, message: Message) -> list[Effect]:
        self.heard.append(message)
        match message:
            case Wheels(t=t):
                return [DriveCommand(t, 0.0)]
            case Drive(speed=speed, turn=turn):
                return [DriveCommand(speed, turn)]
            case Stop():
                return [StopCommand()]
        return []


class Shelf:
    """A recording in memory."""

    def __init__(self):
        self.records = []

    def append(self, kind, link_id, data, t):
        self.records.append((kind, link_id, data, t))


class Boards:
    """Both boards' frames in the order and at the rates of the wire; drops what `loses` says."""

    def __init__(self, boot_ms=0):
        self.sequences = Counter()
        self.boot_ms = boot_ms
        self.boots = 1

    def frame(self, source, channel, ms, *values):
        sequence = self.sequences[source] % 256
        self.sequences[source] += 1
        payload = channels.CHANNELS[channel].payload.pack(*values)
        return Frame(source, channel, sequence, (ms - self.boot_ms) % 65536, payload)

    def status(self, source, ms, version=channels.PROTOCOL_VERSION):
        return self.frame(source, channels.STATUS, ms, version, 0, 0, 0, ms - self.boot_ms, self.boots, 0, 0, 0)

    def motors(self, ms):
        return self.frame(channels.MOTOR, channels.MOTORS, ms, 2500, -2500, 11_800, 1, 0, 7)

    def frames(self, start_ms, end_ms):
        for ms in range(start_ms, end_ms, 20):
            if ms % 1000 == 0:
                yield ms, self.status(channels.DRIVE, ms)
                yield ms, self.status(channels.SENSOR, ms)
            yield ms, self.frame(channels.DRIVE, channels.ODOMETRY, ms, ms % 30_000, -ms % 30_000, 0)
            if ms % 40 == 0:
                yield ms, self.frame(channels.SENSOR, channels.INFRARED, ms, *[100] * 8)
            if ms % 80 == 0:
                yield ms, self.frame(channels.SENSOR, channels.SONAR, ms, *[5000] * 8)


def feed(session, frames, loses=lambda i: False, delay=0.03):
    effects = []
    for i, (ms, frame) in enumerate(frames):
        if not loses(i):
            effects += session.receive("radio", link.encode(frame), ms * 1e-3 + delay)
    return effects


def new_session(sink=None):
    robot = Echo()
    return Session(robot, Calibration(), sink), robot


def test_bytes_become_messages_in_order_and_effects_come_back():
    session, robot = new_session()
    effects = feed(session, Boards().frames(0, 2000))
    kinds = Counter(type(message).__name__ for message in robot.heard)
    assert kinds == {"Wheels": 100, "Ranges": 50 + 2 * 25, "Status": 4}
    assert len(effects) == 100
    wheels = [message.t for message in robot.heard if isinstance(message, Wheels)]
    np.testing.assert_allclose(np.diff(wheels), 0.02, atol=1e-6)
    assert session.frames == {"odometry": 100, "infrared": 50, "sonar": 25, "status": 4}


def test_the_odd_half_of_the_sonars_is_a_slot_later():
    session, robot = new_session()
    feed(session, Boards().frames(0, 1000))
    sweeps = [m for m in robot.heard if isinstance(m, Ranges) and m.sensor == "sonar"]
    for even, odd in zip(sweeps[::2], sweeps[1::2], strict=True):
        assert odd.t - even.t == pytest.approx(0.04)
        assert np.array_equal(np.isnan(even.ranges), ~np.isnan(odd.ranges))


def test_slicing_changes_neither_messages_nor_counts():
    stream = b"".join(link.encode(frame) for _, frame in Boards().frames(0, 1000))
    rng = random.Random(1)
    whole, sliced = new_session(), new_session()
    whole[0].receive("radio", stream, 1.0)
    while stream:
        n = rng.randrange(1, 50)
        sliced[0].receive("radio", stream[:n], 1.0)
        stream = stream[n:]
    assert len(whole[1].heard) == len(sliced[1].heard)
    assert whole[0].health(1.0) == sliced[0].health(1.0)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2])
def test_every_lost_frame_is_seen(share):
    rng = random.Random(2)
    lost = Counter()

    def loses(i):
        is_lost = 50 < i < 4000 and rng.random() < share
        lost["frames"] += is_lost
        return is_lost

    session, _ = new_session()
    feed(session, Boards().frames(0, 60_000), loses)
    assert session.health(60.0)["lost"] == lost["frames"]


@pytest.mark.parametrize("silence", [0.5, 3.0, 10.0, 60.0])
def test_losses_of_more_than_a_wrap_are_counted_by_the_usual_rate(silence):
    boards = Boards()
    session, _ = new_session()
    feed(session, boards.frames(0, 20_000))
    end = 20_000 + int(1000 * silence)
    lost = len(list(boards.frames(20_000, end)))
    feed(session, boards.frames(end, end + 2000))
    assert session.health(end / 1000 + 2)["lost"] == lost


@pytest.mark.parametrize("stall", [0.5, 2.0, 5.0])
def test_frames_that_stood_in_a_queue_are_late_and_not_lost(stall):
    session, _ = new_session()
    boards = Boards()
    feed(session, boards.frames(0, 10_000))
    end = 10.0 + stall
    session.receive("radio", b"".join(link.encode(f) for _, f in boards.frames(10_000, int(1000 * end))), end)
    feed(session, boards.frames(int(1000 * end), int(1000 * end) + 2000))
    assert session.health(end + 2.0)["lost"] == 0


def test_a_frame_heard_twice_is_no_loss():
    session, _ = new_session()
    frames = list(Boards().frames(0, 5000))
    feed(session, [pair for pair in frames for _ in range(2)])
    assert session.health(5.0)["lost"] == 0


def test_health_tells_age_and_recent_loss():
    session, _ = new_session()
    assert session.health(0.0)["boards"]["drive"]["age"] is None
    feed(session, Boards().frames(0, 20_000), loses=lambda i: i % 4 == 3 and i > 1000)
    boards = session.health(20.0)["boards"]
    assert boards["drive"]["age"] == pytest.approx(20.0 - 19.98 - 0.03, abs=0.03)
    received = sum(boards[name]["received"] for name in boards)
    assert received == session.frames.total()
    assert 0.0 < boards["drive"]["loss"] < 0.5
    assert session.health(40.0)["boards"]["drive"]["loss"] == 1.0


def test_noise_is_counted_and_survived():
    session, robot = new_session()
    feed(session, Boards().frames(0, 1000))
    before = len(robot.heard)
    clock = session.clocks[channels.DRIVE].ticks
    rng = random.Random(3)
    for i in range(200):
        assert session.receive("radio", rng.randbytes(500), 1.0 + i * 0.01) == []
    assert len(robot.heard) == before
    assert session.clocks[channels.DRIVE].ticks == clock
    assert session.health(3.0)["rejected"] > 300


def test_frames_that_are_none_of_ours_touch_nothing_but_a_count():
    session, robot = new_session()
    feed(session, Boards().frames(0, 1000))
    before = len(robot.heard), session.health(1.0)["boards"], session.clocks[channels.DRIVE].ticks
    for wrong in (
        Frame(channels.DRIVE, 33, 9, 9, b""),
        Frame(channels.DRIVE, channels.SONAR, 9, 9, bytes(16)),
        Frame(3, channels.STATUS, 9, 9, bytes(16)),
        Frame(channels.DRIVE, channels.ODOMETRY, 9, 9, bytes(7)),
        Frame(channels.SENSOR, channels.INFRARED, 9, 9, b"\xff" * 16),
    ):
        assert session.receive("radio", link.encode(wrong), 1.0) == []
    assert session.refused == {"unknown": 1, "source": 2, "length": 1, "implausible": 1}
    assert (len(robot.heard), session.health(1.0)["boards"], session.clocks[channels.DRIVE].ticks) == before


def test_a_board_of_another_version_is_refused_until_it_speaks_ours():
    session, robot = new_session()
    boards = Boards()
    session.receive("radio", link.encode(boards.status(channels.DRIVE, 0, version=2)), 0.0)
    feed(session, boards.frames(20, 100))
    assert {type(message) for message in robot.heard} == {Ranges}
    assert session.refused == {"version": 5}
    assert session.health(0.1)["boards"]["drive"]["wrong_version"] == 2
    feed(session, boards.frames(1000, 1020))
    assert {type(message) for message in robot.heard} == {Ranges, Status, Wheels}
    assert session.health(1.0)["boards"]["drive"]["wrong_version"] is None


def test_a_rebooted_board_is_no_loss():
    session, robot = new_session()
    feed(session, Boards().frames(0, 5000))
    again = Boards(boot_ms=6000)
    again.boots = 2
    feed(session, again.frames(6000, 9000))
    health = session.health(9.0)
    assert health["lost"] == 0
    assert health["boards"]["drive"]["reboots"] == health["boards"]["sensor"]["reboots"] == 1
    times = [message.t for message in robot.heard if isinstance(message, Wheels)]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(8.98 + 0.03)


def sent_frames(data):
    return link.Decoder().feed(data)


def test_commands_echo_the_drive_board_s_newest_time_and_count_up():
    session, _ = new_session()
    feed(session, Boards().frames(0, 1000))
    frames = sent_frames(session.encode(DriveCommand(0.25, -0.5)) + session.encode(ArmCommand(True)))
    assert [frame.sequence for frame in frames] == [0, 1]
    speed, turn, echo, check = struct.unpack("<hhHI", frames[0].payload)
    assert (speed, turn, echo) == (250, -500, 980)
    assert check == zlib.crc32(frames[0].payload[:6])
    for _ in range(300):
        session.encode(DriveCommand(0.0, 0.0))
    assert sent_frames(session.encode(DriveCommand(0.0, 0.0)))[0].sequence == 302 % 256


def test_a_stop_is_said_three_times():
    session, _ = new_session()
    frames = sent_frames(session.encode(StopCommand()))
    assert [frame.channel for frame in frames] == [channels.STOP_COMMAND] * 3
    assert [frame.sequence for frame in frames] == [0, 1, 2]


def test_commands_go_where_the_drive_board_was_heard():
    session, _ = new_session()
    boards = Boards()
    session.receive("b", link.encode(boards.frame(channels.SENSOR, channels.INFRARED, 0, *[100] * 8)), 0.0)
    assert session.drive_link == ""
    session.receive("a", link.encode(boards.frame(channels.DRIVE, channels.ODOMETRY, 0, 0, 0, 0)), 0.0)
    assert session.drive_link == "a"


def motor_session():
    robot = Echo()
    session = Session(robot, Calibration(), boards=(channels.MOTOR,))
    boards = Boards()
    feed(session, [(0, boards.status(channels.MOTOR, 0)), *((ms, boards.motors(ms)) for ms in range(20, 5000, 20))])
    return session, robot


def test_a_robot_may_have_the_motor_board_alone():
    session, robot = motor_session()
    status, *motors = robot.heard
    assert (status.board, len(motors)) == ("motor", 249)
    assert {type(message) for message in motors} == {Motors}
    np.testing.assert_allclose(np.diff([message.t for message in motors]), 0.02, atol=1e-6)
    health = session.health(5.0)
    assert (health["lost"], set(health["boards"])) == (0, {"motor"})
    assert session.drive_link == "radio"


def test_the_motor_board_s_commands_echo_its_own_time_a_stop_as_well():
    session, _ = motor_session()
    frames = sent_frames(session.encode(PowersCommand(0.5, -0.5, 0.3)) + session.encode(StopCommand()))
    assert [frame.channel for frame in frames] == [channels.POWERS_COMMAND] + 3 * [channels.STOP_COMMAND]
    assert struct.unpack("<hhHHI", frames[0].payload)[:4] == (5000, -5000, 300, 4980)
    assert {struct.unpack("<HI", frame.payload)[0] for frame in frames[1:]} == {4980}


def test_boards_of_another_robot_are_refused():
    session, robot = motor_session()
    before = len(robot.heard)
    feed(session, Boards().frames(6000, 6001))
    assert (len(robot.heard), session.refused) == (before, {"source": 5})
    session, robot = new_session()
    session.receive("radio", link.encode(Boards().motors(0)), 0.0)
    assert (robot.heard, session.refused, session.drive_link) == ([], {"source": 1}, "")


def test_frames_of_two_links_do_not_mix():
    session, robot = new_session()
    first, second = (link.encode(Boards().frame(channels.DRIVE, channels.ODOMETRY, 0, 0, 0, 0)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        session.receive("a", bytes((a,)), 0.0)
        session.receive("b", bytes((b,)), 0.0)
    assert len(robot.heard) == 2


def test_everything_is_recorded_before_it_is_parsed():
    shelf = Shelf()
    session, _ = new_session(shelf)
    session.receive("radio", b"noise", 0.5)
    [effect] = session.command(Drive(0.75, 0.1, 0.2), 0.75)
    assert isinstance(effect, DriveCommand)
    data = session.encode(effect)
    assert [record[0] for record in shelf.records] == [Kind.RX, Kind.MARK, Kind.TX]
    assert shelf.records[0] == (Kind.RX, "radio", b"noise", 0.5)
    assert shelf.records[2] == (Kind.TX, "", data, 0.75)
    assert cobs.decode(data[:-1])[0] == channels.DRIVE_COMMAND


@pytest.mark.parametrize(
    "message",
    [
        Drive(1.5, 0.3, -0.7),
        Drive(1.5, 0.3, -0.7, shared=True),
        Goal(1.5, (1.25, -3.0), 0.2),
        Goal(1.5, None),
        Goal(1.5, (1.25, -3.0), 0.2, ((0.5, 0.0), (1.0, -1.0))),
        Stop(1.5),
        Arm(1.5),
        Arm(1.5, False),
    ],
)
def test_a_person_s_command_comes_back_from_its_mark(tmp_path, message):
    path = tmp_path / "run.rlog"
    recorder = Recorder(path, Header(robot="crunch", links=(), unix_ns=0, monotonic_ns=5))
    session, robot = new_session(recorder)
    session.command(message, 1.5)
    recorder.close()
    [record] = Reader(path)
    assert record.kind == Kind.MARK
    assert command_of(record.data) == message == robot.heard[0]


def test_other_marks_are_no_commands():
    assert command_of(b'{"shed": 200}') is None
    assert command_of(b'{"command": "odometry", "t": 0, "x": 0, "y": 0, "theta": 0}') is None


def test_a_replay_hears_the_very_same_messages(tmp_path):
    path = tmp_path / "run.rlog"
    recorder = Recorder(
        path, Header(robot="crunch", links=(LinkName(id="radio"),), unix_ns=0, monotonic_ns=987_654_321)
    )
    session, live = new_session(recorder)
    rng = random.Random(4)
    for ms, frame in Boards().frames(0, 10_000):
        session.receive("radio", link.encode(frame), ms * 1e-3 + 0.03 + rng.expovariate(100.0))
    recorder.close()
    again, replayed = new_session()
    for record in Reader(path):
        again.receive(record.link_id, record.data, record.t)
    assert [repr(message) for message in replayed.heard] == [repr(message) for message in live.heard]
    assert again.health(10.0) == session.health(10.0)
