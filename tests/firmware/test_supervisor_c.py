"""The drive board's pure C: which commands it takes, and what the supervisor lets it do."""

import struct
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.native import native

FFI, LIB, _ = native()
DISARMED, ARMED, FALLEN, LINK_LOST, FAULT = range(5)
NONE, COMMAND, FELL, LINK, STALL, CURRENT, BATTERY, SENSOR, CHARGER, BOOT, BLOCKED, LIFTED, DISAGREEMENT, WATCHDOG = (
    range(14)
)
ACCORD, WHEELS_ALONE, BODY_ALONE = range(3)
REFUSED, DRIVE, STOP, ARM, DISARM = range(5)


def command_frame(channel, fields, layout, source=0, spoil=b""):
    payload = struct.pack(layout, *fields)
    payload += struct.pack("<I", zlib.crc32(payload + spoil))
    return FFI.new("struct frame *", [source, channel, 7, len(payload), 0, payload])


def health(**given_values):
    values = {"tilt": 0.0, "is_rested": True, "battery_mv": 29000, "wheel_speed": [0.1, 0.1]} | given_values
    return FFI.new("struct drive_health *", values)


def supervisor(state=DISARMED):
    made = FFI.new("struct supervisor *")
    LIB.supervisor_init(made)
    made.state = state
    made.silent_ms = 0
    return made


def obey(made, kind, speed=0.0, turn=0.0):
    LIB.supervisor_obey(made, FFI.new("struct command *", [kind, [speed, turn], 9]))


def steps(made, count, **values):
    return [LIB.supervisor_step(made, health(**values)) for _ in range(count)][-1]


def judge(frame, now=5000):
    return LIB.command_of_frame(frame, now).kind


def test_only_whole_fresh_commands_of_the_host_are_obeyed():
    good = LIB.command_of_frame(command_frame(16, (300, -500, 4900), "<hhH"), 5000)
    assert (good.kind, good.sequence) == (DRIVE, 7)
    assert (good.wish.speed, good.wish.turn) == (pytest.approx(0.3), pytest.approx(-0.5))
    assert judge(command_frame(16, (300, 0, 4000), "<hhH")) == DRIVE
    assert judge(command_frame(16, (300, 0, 3999), "<hhH")) == REFUSED  # older than a second
    assert judge(command_frame(16, (300, 0, 5001), "<hhH")) == REFUSED  # from the future
    assert judge(command_frame(16, (300, 0, 65500), "<hhH"), now=65536 + 100) == DRIVE  # across the clock's wrap
    assert judge(command_frame(16, (300, 0, 65500), "<hhH"), now=100) == REFUSED  # from before the board's start
    assert judge(command_frame(16, (300, 0, 4900), "<hhH", spoil=b"x")) == REFUSED
    assert judge(command_frame(16, (300, 0, 4900), "<hhH", source=1)) == REFUSED
    assert judge(command_frame(16, (300, 4900), "<hH")) == REFUSED  # too short
    assert judge(command_frame(17, (0,), "<H")) == STOP  # a stop is never too old
    assert judge(command_frame(18, (1, 4900), "<HH")) == ARM
    assert judge(command_frame(18, (1, 1000), "<HH")) == REFUSED
    assert judge(command_frame(18, (0, 1000), "<HH")) == DISARM
    assert judge(command_frame(2, (300, 0, 4900), "<hhH")) == REFUSED


@given(st.binary(min_size=10, max_size=10))
def test_noise_is_no_command(payload):
    if struct.unpack("<I", payload[6:])[0] != zlib.crc32(payload[:6]):
        assert judge(FFI.new("struct frame *", [0, 16, 0, 10, 0, payload])) == REFUSED


def test_arming_needs_the_wish_the_rest_and_the_upright_stand():
    asked = supervisor()
    assert not steps(asked, 400)  # nobody asked
    obey(asked, ARM)
    assert not steps(asked, 400, is_rested=False)
    assert not steps(asked, 400, tilt=0.3)
    assert not steps(asked, 79)
    assert steps(asked, 1)
    assert asked.state == ARMED


def test_who_asks_again_and_again_is_not_kept_waiting():
    asked = supervisor()
    for _ in range(3):
        obey(asked, ARM)
        assert not steps(asked, 20)
    obey(asked, ARM)
    assert steps(asked, 20)


def test_a_stop_or_time_ends_the_wish_to_be_armed():
    asked = supervisor()
    obey(asked, ARM)
    obey(asked, STOP)
    assert not steps(asked, 4000)
    obey(asked, ARM)
    assert not steps(asked, 4000, is_rested=False)
    assert not steps(asked, 400)
    obey(asked, ARM)
    assert steps(asked, 80)


def test_every_wish_has_its_own_patience():
    made = supervisor()
    for _ in range(20):  # 0.4 s of upright, and a second of rest before: 28 s of wishes in all
        obey(made, ARM)
        assert not steps(made, 200, is_rested=False)
        assert steps(made, 80)
        assert not steps(made, 1, tilt=0.8)


@pytest.mark.parametrize(
    "values", [{"charger_mv": 6000}, {"battery_mv": 23000}, {"motor_ma": 4000}], ids=["charger", "battery", "motor"]
)
def test_none_is_armed_that_could_not_drive(values):
    made = supervisor()
    steps(made, 60, **values)
    obey(made, ARM)
    assert not steps(made, 200, **values)
    if "motor_ma" not in values:
        assert made.reason in (CHARGER, BATTERY)
    assert not steps(made, 100, battery_mv=29000)
    assert steps(made, 300)


def test_a_lost_link_keeps_its_reason_on_an_empty_battery():
    made = supervisor(ARMED)
    steps(made, 100, battery_mv=23000)
    assert (made.state, made.reason) == (LINK_LOST, LINK)
    steps(made, 100)
    assert (made.state, made.reason) == (LINK_LOST, LINK)
    obey(made, DRIVE, 0.1)
    steps(made, 60, battery_mv=23000)
    assert (made.state, made.reason) == (ARMED, BATTERY)


def test_a_stop_leaves_the_reason_of_what_lies():
    made = supervisor(ARMED)
    steps(made, 1, tilt=0.8)
    obey(made, STOP)
    assert (made.state, made.reason) == (FALLEN, FELL)


def test_a_fall_is_latched_until_armed_again():
    made = supervisor(ARMED)
    assert steps(made, 1, tilt=0.69)
    assert not steps(made, 1, tilt=-0.71)
    assert (made.state, made.reason) == (FALLEN, FELL)
    obey(made, DRIVE, 0.3)
    assert not steps(made, 1000)
    assert made.state == FALLEN
    obey(made, ARM)
    assert steps(made, 80)


def test_what_is_helpless_and_leans_is_falling():
    made = supervisor(ARMED)
    assert not steps(made, 80, tilt=0.3, duty=[1.0, 0.0])
    assert (made.state, made.reason) == (FALLEN, FELL)
    made = supervisor(ARMED)
    assert steps(made, 9, tilt=-0.3, tilt_rate=-2.6)
    assert not steps(made, 1, tilt=-0.3, tilt_rate=-2.6)
    assert (made.state, made.reason) == (FALLEN, FELL)


def test_silence_stops_the_drive_but_not_the_balance():
    made = supervisor(ARMED)
    obey(made, DRIVE, 0.3, 0.5)
    assert steps(made, 79)
    assert made.state == ARMED
    assert steps(made, 1)
    assert (made.state, made.reason) == (LINK_LOST, LINK)
    wish = LIB.supervisor_wish(made)
    assert (wish.speed, wish.turn) == (0.0, 0.0)
    obey(made, DRIVE, 0.2)
    assert made.state == ARMED


def test_a_fast_robot_turns_less_so_that_its_motors_can_balance():
    made = supervisor(ARMED)
    for speed, wanted, turn in (
        (0.0, 5.0, 3.0),
        (0.3, 2.0, 2.0),
        (-0.6, 3.0, 0.15 / 0.095),
        (9.0, -3.0, -0.15 / 0.095),
    ):
        obey(made, DRIVE, speed, wanted)
        assert made.wish.turn == pytest.approx(turn, rel=1e-5)


def test_refused_commands_are_counted_and_change_nothing():
    made = supervisor(ARMED)
    steps(made, 40)
    obey(made, REFUSED)
    assert (made.refused, made.acknowledged, made.silent_ms) == (1, 0, 200)


@pytest.mark.parametrize(
    ("values", "milliseconds", "reason"),
    [
        ({"duty": [0.96, 0.0]}, 400, STALL),
        ({"duty": [0.0, 0.96]}, 400, STALL),
        ({"duty": [0.5, 0.5], "wheel_speed": [0.0, 0.4]}, 400, BLOCKED),
        ({"duty": [0.1, 0.5], "wheel_speed": [0.4, 0.0]}, 400, BLOCKED),
        ({"accord": WHEELS_ALONE}, 50, LIFTED),
        ({"accord": BODY_ALONE}, 50, DISAGREEMENT),
        ({"motor_ma": 6000}, 20, CURRENT),
        ({"rail_steps": 4}, 5, SENSOR),
    ],
)
def test_hazards_switch_off_in_time(values, milliseconds, reason):
    made = supervisor(ARMED)
    count = milliseconds // 5
    if count > 1:
        assert steps(made, count - 1, **values)
    assert not steps(made, 1, **values)
    assert (made.state, made.reason) == (FAULT, reason)


def test_a_warm_motor_gets_less_and_a_cool_one_all_again():
    made = supervisor(ARMED)
    steps(made, 19, motor_ma=3500)
    assert made.ceiling == 1.0
    for now in range(50):  # a bridge that gives what it is let: 4.6 A at full duty
        assert steps(made, 1, motor_ma=round(4600 * made.ceiling))
        assert now < 20 or 4600 * made.ceiling < 3200
    steps(made, 200, motor_ma=1000)
    assert made.ceiling == 1.0
    assert not steps(made, 60, motor_ma=3500, tilt=0.8)
    assert made.ceiling == pytest.approx(0.18, abs=0.001), "held down while it lies, too"


def test_a_blocked_wheel_is_found_between_the_throws_of_a_robot_that_balances():
    made = supervisor(ARMED)
    blocked = {"wheel_speed": [0.0, 0.3]}
    for _ in range(39):
        assert steps(made, 2, duty=[0.5, 0.5], **blocked)
        assert steps(made, 7, duty=[0.1, 0.1], **blocked)
    assert not steps(made, 2, duty=[0.5, 0.5], **blocked)
    assert made.reason == BLOCKED
    made = supervisor(ARMED)
    for _ in range(100):  # what moves in between is not blocked
        assert steps(made, 20, duty=[0.5, 0.5], **blocked)
        assert steps(made, 1, duty=[0.5, 0.5], wheel_speed=[0.05, 0.3])


@pytest.mark.parametrize(("values", "reason"), [({"battery_mv": 23900}, BATTERY), ({"charger_mv": 30000}, CHARGER)])
def test_an_empty_battery_or_a_charger_forbids_moves_but_not_balance(values, reason):
    made = supervisor(ARMED)
    made.reason = NONE
    obey(made, DRIVE, 0.3)
    assert steps(made, 39, **values)
    assert (made.reason, LIB.supervisor_wish(made).speed) == (NONE, pytest.approx(0.3)), "a spike is no reason"
    assert steps(made, 1, **values)
    assert (made.reason, LIB.supervisor_wish(made).speed) == (reason, 0.0)
    obey(made, DRIVE, 0.3)
    assert steps(made, 40)
    assert (made.reason, LIB.supervisor_wish(made).speed) == (NONE, pytest.approx(0.3))


def test_an_empty_battery_that_rests_is_still_empty():
    made = supervisor(ARMED)
    steps(made, 40, battery_mv=23900)
    steps(made, 39, battery_mv=24900)
    obey(made, DRIVE, 0.3)
    steps(made, 79, battery_mv=24900)
    assert (made.state, made.reason, LIB.supervisor_wish(made).speed) == (ARMED, BATTERY, 0.0)


@pytest.mark.parametrize(("cause", "reason"), [(1, BOOT), (4, BOOT), (8, WATCHDOG)])
def test_a_start_after_the_watchdog_says_so(cause, reason):
    loop, outbox = FFI.new("struct drive_loop *"), FFI.new("struct outbox *")
    LIB.drive_loop_init(loop, FFI.new("struct boot *", {"reset_cause": cause}), outbox)
    assert loop.supervisor.reason == reason
