import math
import struct
import subprocess
import zlib
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from server import channels, link
from server.channels import CHANNELS, DRIVE, MOTOR, SENSOR, Calibration, Refused, decode, encode_command, read
from server.commands import ArmCommand, DriveCommand, PowersCommand, RunCommand, StopCommand, UploadCommand
from server.link import Frame
from server.messages import Balance, Cart, CartStage, LastWords, Motors, Power, Ranges, Setting, Status, Wheels
from slam.cart_odometry import BACK, TURN, Stage
from slam.cart_odometry import DRIVE as DRIVE_STAGE

HEADER = Path(__file__).parents[2] / "firmware" / "link" / "channels.h"
CALIBRATION = Calibration()
FIELDS = {
    "status": "version state reason reset_cause uptime_ms boot_count worst_loop_us rx_errors build",
    "odometry": "left_ticks right_ticks tilt",
    "balance": "tilt_rate position_error left_duty right_duty state reason acknowledged",
    "power": "battery_mv battery_ma charger_mv charger_ma left_motor_ma right_motor_ma",
    "sonar": "echo_us",
    "infrared": "counts",
    "setting": "verb setting sequence outcome record is_stored value check",
    "last_words": "state reason since_ms uptime_ms",
    "drive": "speed turn echo_ms check",
    "stop": "echo_ms check",
    "arm": "arm echo_ms check",
    "adjust": "board verb setting value echo_ms check",
    "motors": "left_power right_power battery_mv state reason acknowledged",
    "powers": "left right deadline_ms echo_ms check",
    "cart": "left_ticks right_ticks battery_mv logged bumps doing bumper run state reason acknowledged",
    "stage": "number run kind bumper is_kept left right",
    "run": "bumps seed manner leash_s echo_ms check",
    "upload": "first count echo_ms check",
}

ENUMS = {
    "SETTING": channels.SETTINGS, "VERB": channels.VERBS, "OUTCOME": channels.OUTCOMES, "RECORD": channels.RECORDS,
}  # fmt: skip


def frame(channel, source, *values, time_ms=0):
    return Frame(source, channel, 0, time_ms, CHANNELS[channel].payload.pack(*values))


def status(state=1, reason=0, version=channels.PROTOCOL_VERSION):
    return frame(channels.STATUS, DRIVE, version, state, reason, 8, 123_456, 7, 850, 2, 0xBEEF)


def answer(verb=1, setting=4, outcome=0, record=1, is_stored=1, value=4.25, spoil=0):
    body = struct.pack("<BBBBBBf", verb, setting, 9, outcome, record, is_stored, value)
    return Frame(DRIVE, channels.SETTING, 0, 0, body + struct.pack("<I", zlib.crc32(body) ^ spoil))


def assert_about(message, expected):
    """Equal but for round-off."""
    assert type(message) is type(expected)
    for got, wanted in zip(astuple(message), astuple(expected), strict=True):
        assert got == (pytest.approx(wanted) if isinstance(wanted, float) else wanted)


def offsets(layout):
    """(offset, size, is signed) of each item of a struct format."""
    items, at = [], 0
    repeat = ""
    for letter in layout.lstrip("<"):
        if letter.isdigit():
            repeat += letter
            continue
        n, size = int(repeat or 1), struct.calcsize(f"<{letter}")
        items += [(at + i * size, size, letter.islower()) for i in range(n)]
        at, repeat = at + n * size, ""
    return items


def claims():
    """C expressions that hold if the Python table tells the same as channels.h."""
    for row in CHANNELS.values():
        kind = f"struct {row.name}_payload"
        yield f"CHANNEL_{row.name.upper()} == {row.number}"
        yield f"sizeof({kind}) == {row.payload.size}"
        items = offsets(row.payload.format)
        names = FIELDS[row.name].split()
        if len(names) == 1:
            names = [f"{names[0]}[{i}]" for i in range(len(items))]
        assert len(names) == len(items)
        for name, (offset, size, is_signed) in zip(names, items, strict=True):
            yield f"offsetof({kind}, {name}) == {offset}"
            yield f"sizeof((({kind} *)0)->{name}) == {size}"
            yield f"IS_SIGNED((({kind} *)0)->{name}) == {int(is_signed)}"
    for value, name in channels.SOURCES.items():
        yield f"SOURCE_{name.upper()} == {value}"
    for value, name in enumerate(channels.STATES):
        yield f"DRIVE_{name.upper().replace(' ', '_')} == {value}"
    for value, name in enumerate(channels.REASONS):
        yield f"STOP_{name.upper()} == {value}"
    for prefix, names in ENUMS.items():
        for value, name in enumerate(names):
            yield f"{prefix}_{name.upper().replace(' ', '_')} == {value}"
    yield f"LINK_PROTOCOL_VERSION == {channels.PROTOCOL_VERSION}"
    yield f"SONAR_SLOT_MS == {channels.SONAR_SLOT_MS}"
    yield f"SONAR_NO_RETURN == {channels.NO_RETURN}"
    yield f"MOTOR_FULL_POWER == {channels.FULL_POWER}"
    yield f"MOTOR_LONGEST_MS == {channels.MAX_DEADLINE_MS}"
    yield f"SOURCE_CART == {channels.CART}"
    yield f"RUN_MATCHED == {channels.MATCHED}"
    yield f"RUN_COARSE == {channels.COARSE}"
    for value, name in enumerate(channels.DOINGS):
        yield f"CART_{name.upper()} == {value}"
    yield f"(CART_LEFT | CART_MIDDLE | CART_RIGHT) == {channels.ALL_SWITCHES}"
    for name, kind in (("DRIVE", DRIVE_STAGE), ("BACK", BACK), ("TURN", TURN)):
        yield f"STAGE_{name} == {kind}"
    yield f"LINK_MAX_PAYLOAD == {link.MAX_PAYLOAD}"
    yield f"LINK_MAX_ENCODED == {link.MAX_ENCODED}"
    yield f"LINK_MAX_PAYLOAD >= {max(row.payload.size for row in CHANNELS.values())}"


def test_the_compiler_reads_the_header_as_the_table_does(tmp_path):
    is_signed = "#define IS_SIGNED(x) _Generic((x), int8_t: 1, int16_t: 1, int32_t: 1, float: 1, default: 0)"
    lines = [
        f'#include "{HEADER}"',
        f'#include "{HEADER.parents[1] / "cart" / "program.h"}"',
        "#include <stddef.h>",
        is_signed,
    ]
    lines += [f'_Static_assert({claim}, "{claim.replace(chr(34), chr(39))}");' for claim in claims()]
    source = tmp_path / "claims.c"
    source.write_text("\n".join(lines) + "\n")
    subprocess.run(["cc", "-std=c11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", source], check=True)


def test_the_table_has_a_row_for_every_channel_and_name_of_the_header():
    text = HEADER.read_text()
    enums = [(prefix, len(names)) for prefix, names in ENUMS.items()]
    for prefix, n in [
        ("CHANNEL", len(CHANNELS)),
        ("SOURCE", len(channels.SOURCES) + 1),  # number 3 has two names
        ("STOP", len(channels.REASONS)),
        *enums,
    ]:
        assert len({word.strip(",;") for word in text.split() if word.startswith(f"{prefix}_")}) == n
    assert text.count("DRIVE_") == len(channels.STATES)


def test_status():
    [message] = decode(status(), 1.5, CALIBRATION)
    assert_about(message, Status(1.5, "drive", 1, "armed", "none", 8, 123.456, 7, 850e-6, 2, 0xBEEF))


def test_ticks_become_metres_rolled():
    [wheels] = decode(frame(channels.ODOMETRY, DRIVE, 1000, -500, 1234), 2.0, CALIBRATION)
    turn = 2 * math.pi * 0.0508
    assert_about(wheels, Wheels(2.0, turn, -turn / 2, 0.1234, turn * 65.536))


def test_balance():
    [balance] = decode(frame(channels.BALANCE, DRIVE, -500, 20, 127, -127, 2, 2, 9), 2.0, CALIBRATION)
    assert balance == Balance(2.0, -0.5, 0.02, 1.0, -1.0, "fallen", "fell", 9)


def test_power():
    [power] = decode(frame(channels.POWER, DRIVE, 29_500, -1500, 0, 0, 700, 800), 2.0, CALIBRATION)
    assert_about(power, Power(2.0, 29.5, -1.5, 0.0, 0.0, 0.7, 0.8))


def test_motors():
    [motors] = decode(frame(channels.MOTORS, MOTOR, -10_000, 2500, 11_800, 3, 3, 9), 2.0, CALIBRATION)
    assert_about(motors, Motors(2.0, -1.0, 0.25, 11.8, "link lost", "link", 9))


def test_the_cart_and_its_stages():
    told = frame(channels.CART_STATE, MOTOR, -32_768, 20, 7250, 13, 5, 2, 5, 255, 1, 0, 9)
    [cart] = decode(told, 2.0, CALIBRATION)
    assert_about(cart, Cart(2.0, -32_768, 20, 7.25, 13, 5, "back", 5, 255, "armed", "none", 9))
    [stage] = decode(frame(channels.STAGE, MOTOR, 13, 255, 1, 4, 1, -50, -49), 2.0, CALIBRATION)
    assert stage == CartStage(2.0, 255, 13, Stage(1, -50, -49, 4), True)


@pytest.mark.parametrize(
    "command",
    [
        RunCommand(bumps=65_536),
        RunCommand(seed=-1),
        RunCommand(leash=256),
        UploadCommand(0, 70_000),
        UploadCommand(-1, 1),
    ],
    ids=str,
)
def test_a_run_or_question_that_the_cart_cannot_hold_is_no_command(command):
    with pytest.raises(ValueError, match="does not fit a command"):
        encode_command(command, 0, 0)


def test_an_answer_names_what_was_asked_and_what_came_of_it():
    [setting] = decode(answer(), 2.0, CALIBRATION)
    assert setting == Setting(2.0, "drive", "set", "tilt", 9, "done", "sound", True, 4.25)


def test_last_words():
    [words] = decode(frame(channels.LAST_WORDS, DRIVE, 1, 3, 4000, 70_500), 2.0, CALIBRATION)
    assert_about(words, LastWords(2.0, "armed", "link", 4.0, 70.5))


def test_a_sonar_frame_is_two_sweeps_a_slot_apart():
    echoes = [1000, 2000, 3000, 4000, 17492, 17493, 40000, 0xFFFF]
    even, odd = decode(frame(channels.SONAR, SENSOR, *echoes), 5.0, CALIBRATION)
    assert isinstance(even, Ranges)
    assert isinstance(odd, Ranges)
    assert (even.sensor, even.t, odd.sensor, odd.t) == ("sonar", 5.0, "sonar", pytest.approx(5.04))
    nan, inf = math.nan, math.inf
    np.testing.assert_allclose(even.ranges, [0.1715, nan, 0.5145, nan, 17492 * 343 / 2e6, nan, inf, nan])
    np.testing.assert_allclose(odd.ranges, [nan, 0.343, nan, 0.686, nan, inf, nan, inf])


def test_no_return_is_infinite_whatever_the_reach_and_the_speed_of_sound():
    calibration = Calibration(sonar_max=100.0, speed_of_sound=300.0)
    even, _ = decode(frame(channels.SONAR, SENSOR, *[40_000] * 2, *[0xFFFF] * 6), 0.0, calibration)
    assert isinstance(even, Ranges)
    np.testing.assert_allclose(even.ranges[::2], [6.0, math.inf, math.inf, math.inf])


@given(st.floats(0.10, 0.79))
def test_the_infrared_curve_is_inverted_to_within_one_count(distance):
    counts = round(6787 / (100 * distance + 4) + 3)
    [message] = decode(frame(channels.INFRARED, SENSOR, *[counts] * 8), 0.0, CALIBRATION)
    assert isinstance(message, Ranges)
    one_count = (100 * distance + 4) ** 2 / 6787 / 100
    np.testing.assert_allclose(message.ranges, distance, atol=one_count)


def test_infrared_beyond_its_reach_is_no_return_and_no_count_is_negative():
    ranges = np.array(CALIBRATION.infrared_ranges)
    assert ranges.size == 1024
    assert np.all(np.isinf(ranges[:84]))  # 0.80 m reads 83.8
    assert np.all(np.isfinite(ranges[84:]))
    assert np.all(np.diff(ranges[84:]) < 0)
    assert np.all(ranges >= 0)


@pytest.mark.parametrize(
    "refused",
    [
        frame(channels.INFRARED, SENSOR, *[100] * 7, 1024),
        frame(channels.SONAR, SENSOR, *[1000] * 7, 40_001),
        frame(channels.SONAR, SENSOR, *[1000] * 7, 0xFFFE),
        frame(channels.ODOMETRY, DRIVE, 0, 0, 31_417),
        frame(channels.ODOMETRY, DRIVE, 0, 0, -31_417),
        frame(channels.BALANCE, DRIVE, 0, 0, -128, 0, 0, 0, 0),
        frame(channels.BALANCE, DRIVE, 0, 0, 0, 0, 5, 0, 0),
        frame(channels.BALANCE, DRIVE, 0, 0, 0, 0, 0, len(channels.REASONS), 0),
        frame(channels.POWER, DRIVE, 60_001, 0, 0, 0, 0, 0),
        frame(channels.POWER, DRIVE, 0, 0, 0, 0, 0, -30_001),
        frame(channels.MOTORS, MOTOR, 10_001, 0, 0, 0, 0, 0),
        frame(channels.MOTORS, MOTOR, 0, -10_001, 0, 0, 0, 0),
        frame(channels.MOTORS, MOTOR, 0, 0, 60_001, 0, 0, 0),
        frame(channels.MOTORS, MOTOR, 0, 0, 0, 5, 0, 0),
        frame(channels.MOTORS, MOTOR, 0, 0, 0, 0, len(channels.REASONS), 0),
        frame(channels.CART_STATE, MOTOR, 0, 0, 60_001, 0, 0, 0, 0, 0, 0, 0, 0),
        frame(channels.CART_STATE, MOTOR, 0, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0),
        frame(channels.CART_STATE, MOTOR, 0, 0, 0, 0, 0, 0, 8, 0, 0, 0, 0),
        frame(channels.CART_STATE, MOTOR, 0, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0),
        frame(channels.STAGE, MOTOR, 0, 0, 3, 0, 0, 0, 0),
        frame(channels.STAGE, MOTOR, 0, 0, 0, 8, 0, 0, 0),
        frame(channels.STAGE, MOTOR, 0, 0, 0, 0, 2, 0, 0),
        answer(verb=len(channels.VERBS)),
        answer(setting=len(channels.SETTINGS)),
        answer(outcome=len(channels.OUTCOMES)),
        answer(record=len(channels.RECORDS)),
        answer(is_stored=2),
        answer(value=math.nan),
        answer(spoil=1),
        status(state=5),
        status(reason=len(channels.REASONS)),
    ],
)
def test_what_no_healthy_board_says_is_implausible(refused):
    with pytest.raises(Refused, match="implausible"):
        read(refused)


@pytest.mark.parametrize("row", [row for row in CHANNELS.values() if row.convert], ids=lambda row: row.name)
def test_every_other_length_and_source_is_refused(row):
    for size in range(link.MAX_PAYLOAD + 1):
        payload = bytes((channels.PROTOCOL_VERSION,)).ljust(size, b"\0")[:size]
        if row.number == channels.SETTING and size == row.payload.size:
            payload = payload[:-4] + struct.pack("<I", zlib.crc32(payload[:-4]))
        for source in range(4):
            if source in row.sources and size == row.payload.size:
                read(Frame(source, row.number, 0, 0, payload))
                continue
            with pytest.raises(Refused) as refused:
                read(Frame(source, row.number, 0, 0, payload))
            if source not in row.sources:
                assert refused.value.reason == "source"
            else:
                assert refused.value.reason in ("length", "version")


def test_unknown_channels_and_other_versions_are_told_apart():
    for number in set(range(64)) - set(CHANNELS):
        with pytest.raises(Refused, match="unknown"):
            read(Frame(DRIVE, number, 0, 0, b""))
    with pytest.raises(Refused, match="version"):
        read(status(version=2))
    with pytest.raises(Refused, match="version"):
        read(Frame(DRIVE, channels.STATUS, 0, 0, b"\x02 of another length"))


def test_our_own_commands_coming_back_are_refused():
    for command in (
        DriveCommand(0.1, 0.2),
        StopCommand(),
        ArmCommand(True),
        PowersCommand(0.1, 0.2, 0.3),
        RunCommand(),
    ):
        with pytest.raises(Refused, match="source"):
            read(encode_command(command, 0, 0))


def test_a_frame_of_a_board_that_the_robot_has_not_is_refused():
    told = frame(channels.MOTORS, MOTOR, 0, 0, 11_800, 0, 9, 0)
    assert read(told, (MOTOR,)) == read(told) == (0, 0, 11_800, 0, 9, 0)
    with pytest.raises(Refused, match="source"):
        read(told, (DRIVE, SENSOR))


def test_a_misspelt_calibration_is_refused():
    with pytest.raises(ValidationError, match="wheel_radios"):
        Calibration.model_validate({"wheel_radios": 0.05})
    with pytest.raises(ValidationError, match="wheel_radius"):
        Calibration(wheel_radius=0.0)


def test_calibrations_compare_by_their_settings_after_use():
    used = Calibration()
    assert used.infrared_ranges
    assert used == Calibration()
    assert used != Calibration(sonar_max=2.0)


def test_the_document_tells_the_table_s_sizes_and_the_budget():
    text = (HEADER.parents[2] / "docs" / "wire.md").read_text()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]
    told = {int(row[0]): row for row in rows if len(row) == 7 and row[0].isdecimal()}
    assert set(told) == set(CHANNELS)
    crunch, maze_runner, cart = 0.0, 24.0, 24.0  # of which a status each
    assert CHANNELS[channels.STATUS].payload.size + 8 == 24
    for number, channel in CHANNELS.items():
        _, name, sources, size, on_line, rate, load = told[number]
        assert name == channel.name
        assert sources == ", ".join(channels.SOURCES[source] for source in channel.sources)
        assert (int(size), int(on_line)) == (channel.payload.size, channel.payload.size + 8)
        if load:
            times, _, each = rate.split(",")[0].removesuffix(" while driven").rpartition(" x ")
            assert float(load) == int(on_line) * float(times or 1) * float(each)
            if number in (channels.MOTORS, channels.POWERS_COMMAND):
                maze_runner += float(load)
            elif number == channels.CART_STATE:
                cart += float(load)
            else:
                crunch += float(load)
    assert f"Together Crunch's take {crunch:,.0f} bytes per second" in text
    assert f"Maze Runner's {maze_runner:,.0f}" in text
    assert f"Bumper Cart's {cart:,.0f}" in text
    assert max(crunch, maze_runner) < 1920
