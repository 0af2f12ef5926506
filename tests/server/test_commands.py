"""Commands as they go out: each to its board, with its check and the board's time echoed; mistakes are never sent."""

import math
import struct
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server import channels
from server.channels import CHANNELS, DRIVE, HOST, MOTOR, SENSOR, encode_command
from server.commands import AdjustCommand, ArmCommand, DriveCommand, PowersCommand, StopCommand


@given(st.floats(-2.0, 2.0), st.floats(-6.0, 6.0), st.integers(0, 255), st.integers(0, 65535))
def test_a_drive_command_carries_its_check_and_the_echo(speed, turn, sequence, echo_ms):
    sent = encode_command(DriveCommand(speed, turn), sequence, echo_ms)
    assert (sent.source, sent.channel, sent.sequence) == (HOST, channels.DRIVE_COMMAND, sequence)
    millimetres, milliradians, echo, check = CHANNELS[sent.channel].payload.unpack(sent.payload)
    assert millimetres == pytest.approx(1000 * speed, abs=0.5)
    assert milliradians == pytest.approx(1000 * turn, abs=0.5)
    assert echo == echo_ms
    assert check == zlib.crc32(sent.payload[:-4])


def test_stop_and_arm_commands():
    stop, arm, disarm = (
        encode_command(command, 5, 777) for command in (StopCommand(), ArmCommand(True), ArmCommand(False))
    )
    assert stop.payload == struct.pack("<H", 777) + struct.pack("<I", zlib.crc32(struct.pack("<H", 777)))
    assert CHANNELS[arm.channel].payload.unpack(arm.payload)[:2] == (1, 777)
    assert CHANNELS[disarm.channel].payload.unpack(disarm.payload)[:2] == (0, 777)


@pytest.mark.parametrize("speed", [math.nan, math.inf, 40.0])
def test_a_command_no_robot_can_mean_is_a_mistake(speed):
    with pytest.raises(ValueError, match="does not fit a command"):
        encode_command(DriveCommand(speed, 0.0), 0, 0)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.001, 1.0), st.integers(0, 65535))
def test_powers_carry_their_deadline_their_check_and_the_echo(left, right, deadline, echo_ms):
    sent = encode_command(PowersCommand(left, right, deadline), 5, echo_ms)
    assert (sent.source, sent.channel) == (HOST, channels.POWERS_COMMAND)
    *fields, check = CHANNELS[sent.channel].payload.unpack(sent.payload)
    assert fields[:2] == [pytest.approx(10_000 * power, abs=0.5) for power in (left, right)]
    assert fields[2:] == [pytest.approx(1000 * deadline, abs=0.5), echo_ms]
    assert check == zlib.crc32(sent.payload[:-4])


@pytest.mark.parametrize(
    "powers",
    [
        PowersCommand(1.001, 0.0, 0.3),
        PowersCommand(0.0, -1.001, 0.3),
        PowersCommand(0.0, math.nan, 0.3),
        PowersCommand(0.0, 0.0, 0.0),
        PowersCommand(0.0, 0.0, 1.001),
        PowersCommand(0.0, 0.0, math.nan),
    ],
)
def test_powers_beyond_full_and_deadlines_that_are_none_are_mistakes(powers):
    with pytest.raises(ValueError, match="does not fit a command"):
        encode_command(powers, 0, 0)


def test_each_command_has_its_board():
    commands = {
        DriveCommand(0.1, 0.2): DRIVE, ArmCommand(True): DRIVE, AdjustCommand("drive", "ask", "tilt"): DRIVE,
        AdjustCommand("sensor", "ask", "sonar_ms"): SENSOR, PowersCommand(0.1, 0.2, 0.3): MOTOR,
    }  # fmt: skip
    assert {command: channels.addressee(command) for command in commands} == commands


def test_an_adjustment_names_its_board_and_carries_its_check_and_the_echo():
    sent = encode_command(AdjustCommand("sensor", "set", "sonar_ms", 400.0), 5, 777)
    *fields, check = CHANNELS[sent.channel].payload.unpack(sent.payload)
    assert fields == [SENSOR, 1, 2, 400.0, 777]
    assert check == zlib.crc32(sent.payload[:-4])
    with pytest.raises(ValueError, match="does not fit an adjustment"):
        encode_command(AdjustCommand("drive", "set", "tilt", 1e60), 0, 0)


def test_what_is_no_command_is_a_mistake():
    with pytest.raises(TypeError, match="not a command"):
        encode_command("a keyframe", 0, 0)  # pyright: ignore[reportArgumentType]
