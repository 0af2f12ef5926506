"""Settings of both boards, on the host's build and on the real one: judged, answered, kept in the EEPROM."""

import math
import struct
import zlib
from collections import Counter
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.avr import AvrCrunch
from firmware.virtual.host import HostCrunch
from firmware.virtual.native import native
from server.channels import CHANNELS, SETTINGS, STREAMS
from tests.firmware.avr_tools import need_simavr
from tests.firmware.virtual_wire import (
    ANSWER,
    BALANCE,
    DRIVE,
    INFRARED,
    ODOMETRY,
    SENSOR,
    SETTING,
    SONAR,
    STATUS,
    adjust_command,
    arm_command,
    checked,
    frames,
    newest_time,
    room,
)

FFI, LIB, _ = native()
ASK, SET, STORE, BUILT_IN, ZERO_GYRO, LEARN_LEVEL = range(6)
DONE, UNKNOWN, BOUNDS, BUDGET, MOVING, MEMORY = range(6)
NONE, SOUND, SPOILED, WRITING = range(4)
ODOMETRY_MS, BALANCE_MS, SONAR_MS, INFRARED_MS, TILT = range(5)
LEVEL = SETTINGS.index("level")
HALF_LINE = 38400 // 10 // 2  # bytes per second
PERIODS = [ms for ms in range(1, 2001) if 2000 % ms == 0 and ms % 5 == 0]
RECORD = 1 + 4 * len(SETTINGS) + 4
EEPROM_START = 4


def made():
    settings = FFI.new("struct settings *")
    LIB.drive_settings_init(settings)
    return settings


def values(settings):
    return list(settings.values)


def write_record(settings, memory):
    """Stores as a board would; the bytes end up in `memory`."""
    work = FFI.new("struct settings_work *")
    LIB.settings_store(settings)
    while LIB.settings_work(settings, work):
        if work.is_write:
            memory[work.at] = work.byte
        LIB.settings_did(settings, memory[work.at])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -5.8, 0.0, 1e9, -1e-30])
def test_a_gain_that_is_no_number_negative_or_far_out_is_refused(value):
    settings = made()
    before = values(settings)
    assert LIB.settings_set(settings, TILT, value) == BOUNDS
    assert values(settings) == before


@pytest.mark.parametrize("period", [0.0, 7.0, 20.5, 30.0, 3000.0, -20.0, math.nan])
def test_a_period_that_no_stream_can_have_is_refused(period):
    assert LIB.settings_set(made(), ODOMETRY_MS, period) == BOUNDS


def test_infrared_keeps_to_its_sensors_and_sonar_to_its_slots():
    settings = made()
    outcomes = {ms: LIB.settings_set(settings, INFRARED_MS, ms) for ms in PERIODS}
    assert [ms for ms in PERIODS if outcomes[ms] == DONE] == [40, 80, 200, 400, 1000, 2000]
    assert LIB.settings_set(settings, SONAR_MS, 40) == BOUNDS


@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from(PERIODS)), max_size=30))
def test_no_sequence_of_settings_takes_half_of_the_line(orders):
    settings = made()
    for stream, period in orders:
        LIB.settings_set(settings, stream, period)
    assert load(values(settings)) < HALF_LINE


def load(values):
    """Bytes per second by the table of channels."""
    size = {row.name: row.payload.size + 8 for row in CHANNELS.values()}
    fixed = 2 * size["status"] + size["power"] + size["last_words"] + 10 * size["drive"]
    names = [name.removesuffix("_ms") for name in STREAMS]
    return fixed + sum(size[name] * 1000 / period for name, period in zip(names, values, strict=False))


def test_a_faster_stream_needs_a_slower_one_first():
    settings = made()
    assert LIB.settings_set(settings, ODOMETRY_MS, 10) == BUDGET
    assert LIB.settings_set(settings, INFRARED_MS, 2000) == DONE
    assert LIB.settings_set(settings, SONAR_MS, 400) == DONE
    assert LIB.settings_set(settings, ODOMETRY_MS, 10) == DONE
    assert LIB.settings_set(settings, INFRARED_MS, 40) == BUDGET
    assert values(settings)[:4] == [10, 500, 400, 2000]


def test_unknown_settings_are_refused():
    assert LIB.settings_set(made(), len(SETTINGS), 1.0) == UNKNOWN


@given(st.floats(1.25, 24.0, width=32), st.floats(-0.125, 0.125, width=32))
def test_a_record_brings_the_very_values_back(tilt, level):
    settings, memory = made(), bytearray(b"\xff" * RECORD)
    assert LIB.settings_set(settings, TILT, tilt) == LIB.settings_set(settings, LEVEL, level) == DONE
    write_record(settings, memory)
    assert settings.record == SOUND
    again = made()
    LIB.settings_load(again, bytes(memory))
    assert again.record == SOUND
    assert values(again) == values(settings)
    assert all(LIB.settings_is_stored(again, i) for i in range(len(SETTINGS)))


def test_one_spoiled_bit_anywhere_or_half_a_record_brings_the_built_in_ones():
    settings, memory = made(), bytearray(b"\xff" * RECORD)
    LIB.settings_set(settings, TILT, 7.0)
    write_record(settings, memory)
    for bit in range(8 * RECORD):
        spoiled = bytearray(memory)
        spoiled[bit // 8] ^= 1 << bit % 8
        assert_spoiled(spoiled)
    for size in range(1, RECORD):
        assert_spoiled(memory[:size] + b"\xff" * (RECORD - size))


def assert_spoiled(record):
    again = made()
    LIB.settings_load(again, bytes(record))
    assert again.record == SPOILED
    assert values(again) == values(made())


def test_an_erased_memory_is_none_and_a_record_out_of_bounds_is_spoiled():
    settings = made()
    LIB.settings_load(settings, b"\xff" * RECORD)
    assert settings.record == NONE
    for setting, value in ((TILT, 100.0), (BALANCE_MS, 0.0), (BALANCE_MS, math.nan), (ODOMETRY_MS, 5.0)):
        wild = list(values(settings))
        wild[setting] = value
        body = struct.pack(f"<{len(wild)}f", *wild)
        assert_spoiled(bytes((len(wild),)) + body + struct.pack("<I", zlib.crc32(body)))


def test_a_memory_that_does_not_keep_is_found_out():
    settings, work = made(), FFI.new("struct settings_work *")
    LIB.settings_store(settings)
    while LIB.settings_work(settings, work):
        LIB.settings_did(settings, work.byte if work.is_write or work.at < 20 else 0xFF)
    assert settings.record == SPOILED


def judged(data, board=DRIVE, now_ms=5000):
    """0 elsewhere, 1 refused, 2 good."""
    [frame] = frames(data)
    c = FFI.new("struct frame *", [frame.source, frame.channel, 0, len(frame.payload), 0, frame.payload])
    return LIB.adjust_of_frame(c, board, now_ms, FFI.new("struct adjustment *"))


def test_only_whole_fresh_adjustments_of_this_board_are_obeyed():
    good = adjust_command(DRIVE, SET, TILT, 5.0, 4900)
    assert judged(good) == 2
    assert judged(good, board=SENSOR) == 0
    assert judged(adjust_command(DRIVE, SET, TILT, 5.0, 3999)) == 1  # older than a second
    assert judged(adjust_command(DRIVE, SET, TILT, 5.0, 5001)) == 1  # from the future


class Answer(NamedTuple):
    outcome: int
    record: int
    is_stored: int
    value: float


class OnTheBench:
    """A robot of either build, and what a person does to its settings."""

    def __init__(self, robot):
        self.robot = robot
        self.said = robot.advance(1.5)
        self.sequence = 0
        self.asked_at = 0

    def wait(self, seconds):
        self.said += self.robot.advance(seconds)

    def adjust(self, board, verb, setting=0, value=0.0):
        """The answer."""
        return self.wait_for(self.ask(board, verb, setting, value), 3.0) or pytest.fail("no answer")

    def ask(self, board, verb, setting=0, value=0.0):
        """Sends an adjustment; what its answer says of it."""
        self.sequence += 1
        self.asked_at = len(self.said)
        self.robot.write(adjust_command(board, verb, setting, value, newest_time(self.said, board), self.sequence))
        return board, (verb, setting, self.sequence)

    def wait_for(self, asked, patience):
        """The answer; None if none comes."""
        for _ in range(round(patience / 0.1)):
            self.wait(0.1)
            for frame in frames(self.said[self.asked_at :]):
                if frame.channel == SETTING and frame.source == asked[0]:
                    told = struct.unpack(ANSWER, frame.payload)
                    assert frame.payload == checked(frame.payload[:-4])
                    assert told[:3] == asked[1]
                    return Answer(*told[3:7])
        return None

    def spoil(self, board, at):
        robot = self.robot
        if isinstance(robot, AvrCrunch):
            mcu = robot.robot.drive if board == DRIVE else robot.robot.sensor
            found = robot.lib.microcontroller_eeprom(mcu, EEPROM_START + at)
            robot.lib.microcontroller_spoil(mcu, EEPROM_START + at, found ^ 1)
        else:
            (robot.robot.drive if board == DRIVE else robot.robot.sensor).memory.bytes[at] ^= 1

    def knock(self):
        """Somebody stumbles over it, and holds it again."""
        body = self.robot.robot.body
        body.is_held, body.push = False, 10.0
        self.wait(0.06)
        body.is_held, body.push = True, 0.0

    def reset(self):
        self.robot.reset_boards()
        self.wait(1.5)

    def stand(self):
        self.robot.write(arm_command(1, newest_time(self.said)))
        self.wait(2.0)
        return self


@pytest.fixture(params=["host", "avr"])
def bench(request):
    if request.param == "avr":
        need_simavr()
        return OnTheBench(AvrCrunch(room(4.0, 4.0), (0.0, 0.0, 0.0), seed=1))
    return OnTheBench(HostCrunch(room(4.0, 4.0), np.zeros(3), seed=1))


def test_a_gain_is_set_answered_stored_and_there_after_a_reset(bench):
    assert bench.adjust(DRIVE, ASK, TILT) == (DONE, NONE, 0, pytest.approx(5.0))
    assert bench.adjust(DRIVE, SET, TILT, 6.25) == (DONE, NONE, 0, 6.25)
    assert bench.adjust(DRIVE, SET, TILT, math.nan) == (BOUNDS, NONE, 0, 6.25)
    assert bench.adjust(DRIVE, STORE)[:2] == (DONE, SOUND)
    assert bench.adjust(DRIVE, ASK, TILT) == (DONE, SOUND, 1, 6.25)
    assert bench.adjust(DRIVE, SET, TILT, 7.5) == (DONE, SOUND, 0, 7.5)
    bench.reset()
    assert bench.adjust(DRIVE, ASK, TILT) == (DONE, SOUND, 1, 6.25)
    assert bench.adjust(DRIVE, BUILT_IN)[:2] == (DONE, SOUND)
    assert bench.adjust(DRIVE, ASK, TILT) == (DONE, SOUND, 0, pytest.approx(5.0))


def test_a_spoiled_record_is_told_and_the_built_in_settings_are_in_force(bench):
    for board, setting, value in ((DRIVE, TILT, 6.25), (SENSOR, SONAR_MS, 200.0)):
        assert bench.adjust(board, SET, setting, value).outcome == DONE
        assert bench.adjust(board, STORE).record == SOUND
        bench.spoil(board, 1 + 4 * setting + 2)
    bench.reset()
    assert bench.adjust(DRIVE, ASK, TILT) == (DONE, SPOILED, 0, pytest.approx(5.0))
    assert bench.adjust(SENSOR, ASK, SONAR_MS) == (DONE, SPOILED, 0, 80.0)


def test_a_reset_amid_a_record_is_told_as_a_spoiled_one(bench):
    assert bench.adjust(DRIVE, SET, TILT, 6.25).outcome == DONE
    assert bench.wait_for(bench.ask(DRIVE, STORE), 0.2) is None  # under way
    bench.reset()
    assert bench.adjust(DRIVE, ASK, TILT) == (DONE, SPOILED, 0, pytest.approx(5.0))


def test_the_gyro_is_zeroed_at_rest_and_not_while_balancing(bench):
    zero = bench.adjust(DRIVE, ZERO_GYRO)
    assert zero.outcome == DONE
    assert abs(zero.value) < 0.2
    asked = bench.ask(DRIVE, ZERO_GYRO)
    bench.wait(0.3)
    bench.knock()
    moved = bench.wait_for(asked, 0.5)
    assert moved is not None
    assert moved.outcome == MOVING
    bench.wait(3.0)
    bench.stand()
    assert bench.adjust(DRIVE, ZERO_GYRO).outcome == MOVING


def test_what_the_accelerometer_shows_upright_becomes_a_setting(bench):
    bench.wait(2.0)
    learned = bench.adjust(DRIVE, LEARN_LEVEL)
    assert learned.outcome == DONE
    assert abs(learned.value) < 0.1
    assert bench.adjust(DRIVE, ASK, LEVEL).value == learned.value
    assert bench.adjust(DRIVE, STORE).record == SOUND
    bench.reset()
    assert bench.adjust(DRIVE, ASK, LEVEL) == (DONE, SOUND, 1, learned.value)
    bench.stand()
    assert bench.adjust(DRIVE, LEARN_LEVEL).outcome == MOVING


def test_streams_come_at_their_rates(bench):
    for setting, value in ((INFRARED_MS, 400.0), (SONAR_MS, 400.0), (ODOMETRY_MS, 10.0), (BALANCE_MS, 200.0)):
        for board in (DRIVE, SENSOR):
            assert bench.adjust(board, SET, setting, value) == (DONE, NONE, 0, value)
    before = len(bench.said)
    bench.wait(10.0)
    told = Counter((frame.source, frame.channel) for frame in frames(bench.said[before:]))
    expected = {(DRIVE, ODOMETRY): 1000, (DRIVE, BALANCE): 50, (SENSOR, SONAR): 25, (SENSOR, INFRARED): 25}
    for stream, count in expected.items():
        assert told[stream] == pytest.approx(count, abs=3)
    assert told[SENSOR, STATUS] == pytest.approx(10, abs=1)  # and no reset
    assert len(bench.said) - before < 10 * HALF_LINE


def test_the_other_board_s_settings_and_stale_ones_are_left_alone(bench):
    assert bench.adjust(SENSOR, SET, TILT, 6.0).outcome == UNKNOWN
    bench.robot.write(adjust_command(DRIVE, SET, TILT, 6.0, newest_time(bench.said) - 2000, 77))
    bench.wait(0.5)
    assert bench.adjust(DRIVE, ASK, TILT).value == pytest.approx(5.0)


def test_a_record_under_way_holds_up_no_step_of_a_real_board_that_balances():
    need_simavr()
    bench = OnTheBench(AvrCrunch(room(4.0, 4.0), (0.0, 0.0, 0.0), seed=1)).stand()
    robot, lib = bench.robot.robot, bench.robot.lib
    for tilt in (6.0, 5.5, 6.5):
        assert bench.adjust(DRIVE, SET, TILT, tilt).outcome == DONE
        assert bench.adjust(DRIVE, STORE).record == SOUND
    assert abs(bench.robot.tilt) < 0.05
    bench.wait(1.1)
    assert worst_step_us(bench) < 0.4 * 5000  # the answer's checksum takes 0.15 ms of it; waiting for a byte 8.5 ms
    for board in (robot.drive, robot.sensor):
        assert lib.microcontroller_resets(board) == 1
        assert lib.microcontroller_hasty(board) == 0
    assert bench.robot.collisions == 0


def worst_step_us(bench):
    told = [frame for frame in frames(bench.said) if (frame.source, frame.channel) == (DRIVE, STATUS)]
    return struct.unpack("<BBBBIHHHH", told[-1].payload)[6]
