"""The motor board's pure C: which commands it takes, how the motors come to their powers, and when they stop."""

import random
import struct
import zlib
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.motor_board import MotorBoard
from firmware.virtual.native import native
from server import channels
from server.commands import ArmCommand, DriveCommand, PowersCommand, StopCommand
from server.link import Frame, encode
from server.messages import Motors, Status
from server.session import Session
from tests.firmware.motor_host import Host

FFI, LIB, _ = native()
RISE = 0.004  # of power in a ms
REST_MS = 100
HALF = PowersCommand(0.5, 0.5, 0.5)
OFF = (0.0, 0.0)
DISARMED, FAULT = 0, 4


def host():
    return Host(MotorBoard())


def driven(powers=HALF):
    """A host whose motors have what it asked for."""
    made = host()
    made.send(powers)
    made.wait(300)
    made.send(powers)
    assert made.board.powers == (powers.left, powers.right)
    return made


def raw(left, right, deadline_ms, echo_ms, source=channels.HOST, channel=channels.POWERS_COMMAND, spoil=0):
    payload = struct.pack("<hhHH", left, right, deadline_ms, echo_ms)
    return encode(Frame(source, channel, 99, 0, payload + struct.pack("<I", zlib.crc32(payload) ^ spoil)))


@pytest.mark.parametrize(("cause", "reason"), [(1, "boot"), (4, "boot"), (8, "watchdog")])
def test_after_a_start_it_stands_and_says_why(cause, reason):
    made = Host(MotorBoard(cause), 1000)
    assert made.board.powers == OFF
    now = made.motors
    assert (now.left, now.right, now.state, now.reason, now.acknowledged) == (0.0, 0.0, "disarmed", reason, 0)
    assert (made.status.state, made.status.reason, made.status.reset_cause) == ("disarmed", reason, cause)


def test_powers_move_it_and_are_told():
    made = driven(PowersCommand(0.5, -0.25, 0.5))
    made.wait(20)
    assert made.board.powers == (0.5, -0.25)
    now = made.motors
    assert (now.left, now.right, now.state, now.reason, now.acknowledged) == (0.5, -0.25, "armed", "none", 2)


@pytest.mark.parametrize("ms", [1, 2, 150, 1000])
def test_the_motors_coast_at_the_deadline(ms):
    made = driven()
    made.send(PowersCommand(0.5, 0.5, ms / 1000))
    assert set(made.traced(ms - 1)) <= {(0.5, 0.5)}
    made.wait(1)
    assert made.board.powers == OFF
    made.wait(20)
    assert (made.motors.state, made.motors.reason) == ("link lost", "link")
    made.send(HALF)
    made.wait(20)
    assert made.motors.state == "armed"


def test_a_driver_who_speaks_again_in_time_is_never_stopped():
    made = driven()
    for _ in range(50):
        made.send(PowersCommand(0.5, 0.5, 0.1))
        assert OFF not in made.traced(99)


def test_no_deadline_is_longer_than_a_second():
    made = driven()
    made.board.receive(raw(5000, 5000, 60_000, made.board.time_ms))
    assert OFF not in made.traced(999)
    made.wait(1)
    assert made.board.powers == OFF


@pytest.mark.parametrize("age_ms", [0, 5000])
def test_a_stop_is_obeyed_at_once_however_old(age_ms):
    made = driven()
    made.send(StopCommand(), age_ms)
    made.wait(1)
    assert made.board.powers == OFF
    made.wait(20)
    assert (made.motors.state, made.motors.reason, made.motors.acknowledged) == ("disarmed", "command", 3)


def test_noise_is_no_stop():
    made = driven()
    made.board.receive(encode(Frame(channels.HOST, channels.STOP_COMMAND, 99, 0, bytes(6))))
    made.wait(20)
    assert (made.motors.state, made.motors.acknowledged) == ("armed", 2)


def test_a_stop_leaves_the_reason_of_what_stands():
    made = host()
    made.send(StopCommand())
    made.wait(20)
    assert (made.motors.state, made.motors.reason, made.motors.acknowledged) == ("disarmed", "boot", 1)


@pytest.mark.parametrize(
    "spoilt",
    [
        {"spoil": 1},
        {"echo_ms": 2000 - 1001},
        {"echo_ms": 2001},
        {"left": 10_001},
        {"right": -10_001},
        {"left": -32768},
        {"deadline_ms": 0},
        {"source": channels.MOTOR},
        {"channel": channels.DRIVE_COMMAND},
        {"channel": channels.ADJUST_COMMAND},
    ],
    ids=str,
)
def test_what_is_corrupt_stale_or_out_of_bounds_is_refused_and_counted(spoilt):
    good = {"left": 10_000, "right": -10_000, "deadline_ms": 1, "echo_ms": 1000}
    made = Host(MotorBoard(), 2000)
    made.board.receive(raw(**(good | spoilt)))
    made.wait(1000)
    assert (made.motors.state, made.motors.acknowledged, made.status.rx_errors) == ("disarmed", 0, 1)
    made.board.receive(raw(**(good | {"echo_ms": 2000})))  # of an age of 1,000 ms
    made.wait(1000)
    assert (made.motors.state, made.motors.acknowledged, made.status.rx_errors) == ("link lost", 99, 1)


def test_crunch_s_commands_move_nothing_and_an_echo_from_before_the_start_neither():
    made = host()
    for command in (DriveCommand(0.3, 0.0), ArmCommand(True), ArmCommand(False)):
        made.send(command)
    made.send(HALF, age_ms=101)  # the board is 100 ms old
    made.wait(1000)
    assert (made.motors.state, made.motors.acknowledged, made.status.rx_errors) == ("disarmed", 0, 4)


def test_power_rises_slowly_and_falls_at_once():
    made = host()
    made.send(PowersCommand(1.0, -1.0, 1.0))
    trace = made.traced(300)
    assert trace[:250] == [(pytest.approx(RISE * n), pytest.approx(-RISE * n)) for n in range(1, 251)]
    assert set(trace[249:]) == {(1.0, -1.0)}
    made.send(PowersCommand(0.3, -0.3, 1.0))
    made.wait(1)
    assert made.board.powers == (0.3, -0.3)


@pytest.mark.parametrize("between", [None, StopCommand()], ids=["straight", "over a stop"])
def test_a_motor_that_turns_back_rests_first_and_the_other_does_not(between):
    made = driven()
    if between:
        made.send(between)
        made.wait(30)
    made.send(PowersCommand(-0.5, 0.5, 1.0))
    left, right = zip(*made.traced(400), strict=True)
    rests = REST_MS - (30 if between else 0)
    assert set(left[:rests]) == {0.0}
    assert left[rests] < 0.0
    assert left[-1] == -0.5
    assert right[0] > 0.0


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.integers(1, 150)), min_size=2, max_size=12))
def test_whatever_is_asked_no_power_jumps_up_and_none_is_reversed_without_rest(wishes):
    made = host()
    trace = [0.0] * REST_MS
    for left, right, ms in wishes:
        made.send(PowersCommand(left, right, 0.1))
        trace += [powers[0] for powers in made.traced(ms)]
    for before, now in pairwise(trace):
        assert abs(now) - abs(before) < RISE + 1e-9
    last, rested = 0.0, 0
    for now in trace:
        if now * last < 0.0:
            assert rested >= REST_MS
        last, rested = (now, 0) if now else (last, rested + 1)


def refreshed(made, ms):
    """Whether the motors had power all the time while they were asked to."""
    powers = []
    for _ in range(ms // 50):
        made.send(HALF)
        powers += made.traced(50)
    return OFF not in powers


def test_an_empty_battery_stops_the_motors_until_it_has_recovered():
    made = driven()
    made.board.battery = 9.8
    assert refreshed(made, 950), "a second of load is no reason"
    made.board.battery = 10.0
    assert refreshed(made, 50)
    made.board.battery = 9.8
    assert refreshed(made, 1000)
    assert not refreshed(made, 100)
    assert made.board.powers == OFF
    assert (made.motors.state, made.motors.reason) == ("fault", "battery")
    made.board.battery = 10.4
    assert not refreshed(made, 2000), "without a load it shows more and is empty still"
    assert made.motors.acknowledged == made.sequence, "refused powers are heard"
    made.board.battery = 11.0
    made.wait(900)
    assert made.motors.state == "fault"
    made.wait(200)
    assert (made.motors.state, made.motors.reason, made.board.powers) == ("disarmed", "battery", OFF)
    assert refreshed(made, 500)


def test_a_battery_that_jumps_up_without_its_load_takes_a_second_to_recover_as_well():
    supervisor = FFI.new("struct motor_supervisor *")
    for _ in range(1000):
        assert supervisor.state != FAULT
        LIB.motor_supervisor_step(supervisor, 9800)
    for _ in range(999):
        LIB.motor_supervisor_step(supervisor, 10_600)
        assert supervisor.state == FAULT
    LIB.motor_supervisor_step(supervisor, 10_600)
    assert supervisor.state == DISARMED


def test_every_sum_of_the_converter_has_its_nearest_millivolt():
    assert [LIB.battery_mv(total) for total in range(5116)] == [
        (2 * total * 20_000 + 5115) // 10_230 for total in range(5116)
    ]


@pytest.mark.parametrize("volts", [0.0, 9.9, 11.1, 12.6, 20.0])
def test_the_battery_is_told_to_the_converter_s_step(volts):
    made = host()
    made.board.battery = volts
    made.wait(40)
    assert made.motors.battery_volts == pytest.approx(volts, abs=0.011)


def test_motors_are_told_fifty_times_a_second_and_status_once():
    made = Host(MotorBoard(), 10_000)
    assert (len(made.told(Motors)), len(made.told(Status)), made.decoder.rejected) == (500, 10, 0)
    assert {round((b.t - a.t) * 1000) for a, b in pairwise(made.told(Motors))} == {20}
    sequence = [frame.sequence for frame in made.heard]
    assert sequence == [i % 256 for i in range(len(sequence))]


def test_a_session_of_this_board_alone_drives_and_stops_it():
    heard = []

    class Listener:
        def step(self, message):
            heard.append(message)
            return []

    board = MotorBoard()
    session = Session(Listener(), channels.Calibration(), boards=(channels.MOTOR,))
    session.receive("usb", board.run(1000), 1.0)
    assert session.drive_link == "usb"
    board.receive(session.encode(PowersCommand(0.5, -0.5, 1.0)))
    session.receive("usb", board.run(500), 1.5)
    assert board.powers == (0.5, -0.5)
    board.receive(session.encode(StopCommand()))
    session.receive("usb", board.run(40), 1.54)
    assert board.powers == OFF
    last = heard[-1]
    assert (last.left, last.state, last.reason, last.acknowledged) == (0.0, "disarmed", "command", 3)
    assert session.health(1.54)["lost"] == session.health(1.54)["rejected"] == 0


def test_no_corrupted_command_of_twenty_thousand_is_accepted():
    rng = random.Random(1)
    made = host()
    for _ in range(20_000):
        powers = PowersCommand(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(0.001, 1.0))
        sound = encode(made.frame(powers if rng.random() < 0.9 else StopCommand()))
        spoilt = bytearray(sound[:-1])
        for bit in rng.sample(range(8 * len(spoilt)), rng.randrange(1, 9)):
            spoilt[bit // 8] ^= 1 << bit % 8
        made.board.receive(bytes(spoilt) + sound[-1:])
        supervisor = made.board.loop.supervisor
        assert (supervisor.acknowledged, supervisor.state) == (0, 0), (sound, spoilt)
    made.wait(1000)
    assert made.status.rx_errors >= 20_000
    made.send(HALF)
    made.wait(20)
    assert made.motors.state == "armed"


def test_the_count_of_the_refused_stays_at_its_maximum():
    board = MotorBoard()
    board.loop.supervisor.refused = 0xFFFE
    board.run(100)
    for _ in range(3):
        board.receive(raw(0, 0, 0, 100))
    assert board.loop.supervisor.refused == 0xFFFF
