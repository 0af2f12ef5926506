"""What either board needs to speak: the queue of whole frames, turns on the line; the drive board's supplies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.native import native
from server.link import Decoder

FFI, LIB, _ = native()
BYTE_MS = 10 / 38.4
LONGEST = 24  # bytes of the sensor board's longest frame


class Outbox:
    """The C queue with room for `capacity` bytes."""

    def __init__(self, capacity):
        self.room = FFI.new("uint8_t[]", capacity)
        self.box = FFI.new("struct outbox *")
        LIB.outbox_init(self.box, self.room, capacity)

    def put(self, sequence, payload):
        frame = FFI.new(
            "struct frame *", [1, 2, sequence, len(payload), 1000, list(payload) + [0] * (24 - len(payload))]
        )
        return LIB.outbox_put(self.box, frame)

    def take(self):
        out = FFI.new("uint8_t[32]")
        return bytes(FFI.buffer(out, LIB.outbox_take(self.box, out)))


@given(st.lists(st.one_of(st.none(), st.binary(max_size=24)), max_size=60))
def test_frames_leave_whole_and_in_order_or_are_dropped_and_counted(orders):
    outbox, waiting, dropped = Outbox(100), [], 0
    for number, payload in enumerate(orders):
        if payload is not None:
            is_kept = outbox.put(number % 256, payload)
            waiting += [(number % 256, payload)] if is_kept else []
            dropped += not is_kept
            assert outbox.box.dropped == dropped
            continue
        taken = [(frame.sequence, frame.payload) for frame in Decoder().feed(outbox.take())]
        assert taken == waiting[:1]
        del waiting[:1]
    assert outbox.box.size <= 100


def test_an_outbox_takes_no_frame_that_might_not_fit():
    outbox = Outbox(64)
    assert [outbox.put(i, b"") for i in range(6)] == [True] * 5 + [False]  # 8 bytes each, 32 must be free


@given(st.lists(st.booleans(), min_size=400, max_size=400), st.floats(0.0, 0.99), st.integers(0, 60))
def test_the_two_boards_never_speak_at_once(wishes, phase, boot):
    """Both boards as their main loops are, with clocks out of step and frames of the longest kind whenever they may."""
    turns, permit = FFI.new("struct turns *"), FFI.new("struct permit *")
    LIB.turns_init(turns)
    LIB.permit_init(permit)
    is_high, drive_until, sensor_until, spoken = False, 0.0, 0.0, [0, 0]
    for ms, wish in enumerate(wishes):
        if ms == boot + 150:  # the drive board was reset: its line is cut short, GRANT falls
            LIB.turns_init(turns)
            drive_until = min(drive_until, float(ms))
        is_high = LIB.turns_step(turns, ms < drive_until)
        if wish and LIB.turns_may_send(turns) and ms >= drive_until:
            assert ms >= sensor_until
            drive_until = ms + 32 * BYTE_MS
            spoken[0] += 1
        now = ms + phase  # the sensor board's tick
        if ms >= boot and now >= sensor_until and LIB.permit_may_send(permit, is_high):
            LIB.permit_use(permit)
            assert now >= drive_until
            sensor_until = now + LONGEST * BYTE_MS
            spoken[1] += 1
    assert spoken[1] >= (400 - boot) // 30 - 1  # a driver who talks all the time starves nobody
    assert spoken[1] <= 400 // 20 + 1  # one frame a round


def supplies(reverse=(False, False), **sums):
    values = {"battery": 0, "current": 2558, "charger": 0, "motors": [0, 0]} | sums
    return LIB.power_supplies(FFI.new("struct supply_sums *", values), FFI.new("bool[2]", list(reverse)))


def test_supplies_are_told_in_thousandths():
    told = supplies(battery=3700, motors=[512, 1024], reverse=(True, False))
    assert told.battery_mv == pytest.approx(3700 / 5115 * 40000, abs=1)
    assert list(told.motor_ma) == pytest.approx([-512 / 5115 * 6028, 1024 / 5115 * 6028], abs=1)
    assert (told.battery_ma, told.charger_mv, told.charger_ma) == (pytest.approx(0, abs=15), 0, 0)
    assert supplies(current=2558 + 102).battery_ma == pytest.approx(1000, abs=20)


def test_current_into_the_battery_is_the_charger_s_while_one_is_connected():
    assert supplies(current=2456).charger_ma == 0
    charged = supplies(current=2456, charger=4500)
    assert charged.charger_ma == -charged.battery_ma == pytest.approx(1000, abs=20)
