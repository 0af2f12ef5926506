"""The drive board's pure C: tilt, odometry, balance, commands, supervision, telemetry."""

import math
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.native import native

FFI, LIB, _ = native()
DISARMED, ARMED, FALLEN, LINK_LOST, FAULT = range(5)
COMMAND, FELL, LINK, STALL, CURRENT, BATTERY, SENSOR, CHARGER, BOOT, BLOCKED, LIFTED, DISAGREEMENT, WATCHDOG = range(
    1, 14
)
ACCORD, WHEELS_ALONE, BODY_ALONE = range(3)
REFUSED, DRIVE, STOP, ARM, DISARM = range(5)


def sums(rate=0.0, lean=0.0, zero=512.0):
    """Five ADC readings' sums for a rate (rad/s) and a lean (rad)."""
    gyro = 5 * (zero + rate / 0.00681769)
    return FFI.new("struct inertial_sums *", [round(gyro), round(5 * (512 + math.sin(lean) * 204.8))])


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


def test_tilt_follows_fast_motion_by_gyro_and_settles_by_gravity():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    for _ in range(20):  # 0.1 s at 1 rad/s: the accelerometer, kept level, can hardly object
        LIB.tilt_step(tilt, sums(rate=1.0))
    assert tilt.angle == pytest.approx(0.1, abs=0.01)
    for _ in range(200 * 60):
        LIB.tilt_step(tilt, sums(lean=0.05))
    assert tilt.angle == pytest.approx(0.05, abs=0.002)


def test_tilt_trims_a_wrong_gyro_zero():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    for _ in range(200 * 180):
        LIB.tilt_step(tilt, sums(zero=515.0))
    assert tilt.gyro_zero == pytest.approx(3 * 0.00681769, rel=0.1)
    assert abs(tilt.angle) < 0.003


def test_rest_learns_the_gyros_zero_in_a_second_and_motion_starts_it_again():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    still = sums(lean=0.1, zero=520.0)
    assert not any(LIB.tilt_rest(tilt, still) for _ in range(199))
    assert LIB.tilt_rest(tilt, still)
    assert tilt.gyro_zero == pytest.approx(8 * 0.00681769, rel=0.01)
    assert tilt.angle == pytest.approx(0.1, abs=0.003)
    assert LIB.tilt_rest(tilt, still)
    for _ in range(200):  # set up so slowly that no gyro shows it
        assert LIB.tilt_rest(tilt, sums(lean=0.0, zero=520.0))
    assert tilt.angle == pytest.approx(0.0, abs=0.005)
    assert not LIB.tilt_rest(tilt, sums(rate=0.5))


@pytest.mark.parametrize("zero", [0.0, 205.0, 819.0, 1023.0])
def test_a_gyro_that_is_dead_or_stuck_is_never_at_rest(zero):
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    for _ in range(1000):
        LIB.tilt_step(tilt, sums(zero=zero))
        assert not LIB.tilt_rest(tilt, sums(zero=zero))
    for _ in range(400):  # mended
        LIB.tilt_step(tilt, sums())
        LIB.tilt_rest(tilt, sums())
    assert tilt.is_rested
    assert abs(tilt.gyro_zero) < 0.01


def test_a_builder_levels_a_crooked_accelerometer_at_rest():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    crooked = sums(lean=math.asin(0.1), zero=520.0)
    assert not LIB.tilt_level(tilt)  # not at rest yet
    for _ in range(200):
        LIB.tilt_step(tilt, crooked)
        LIB.tilt_rest(tilt, crooked)
    assert tilt.angle == pytest.approx(0.1, abs=0.003)
    assert LIB.tilt_level(tilt)
    assert tilt.angle == 0.0
    assert LIB.tilt_of_gravity(tilt, crooked) == pytest.approx(0.0, abs=1e-3)
    assert tilt.accelerometer_zero == pytest.approx(512 + 20.48, abs=0.2)
    lying = sums(lean=1.3)
    for _ in range(600):
        LIB.tilt_rest(tilt, lying)
    assert not LIB.tilt_level(tilt)
    assert tilt.accelerometer_zero == pytest.approx(512 + 20.48, abs=0.2)


def agreement_after(seconds, acceleration=0.0, body=0.0):
    """Judged after wheels and body have accelerated (m/s2) for so long from standing."""
    agreement = FFI.new("struct agreement *")
    LIB.agreement_rest(agreement, 0.0)
    for i in range(round(seconds / 0.005)):
        LIB.agreement_step(agreement, acceleration * 0.005 * (i + 1), 0.0, -body / 9.81)
    return LIB.agreement_judge(agreement)


def test_wheels_and_body_agree_or_one_tells_alone():
    assert agreement_after(0.3, acceleration=3.0, body=3.0) == ACCORD
    assert agreement_after(5.0, acceleration=0.5) == ACCORD  # what a wrong lean of 3 degrees looks like
    assert agreement_after(0.2, acceleration=3.0) == ACCORD
    assert agreement_after(0.3, acceleration=3.0) == WHEELS_ALONE
    assert agreement_after(0.3, acceleration=-3.0) == WHEELS_ALONE
    assert agreement_after(0.3, body=3.0) == BODY_ALONE
    assert agreement_after(0.3, acceleration=-1.0, body=3.0) == BODY_ALONE


def test_a_sensor_at_its_rail_is_counted():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    for _ in range(4):
        LIB.tilt_step(tilt, FFI.new("struct inertial_sums *", [5115, 2560]))
    assert tilt.rail_steps == 4
    LIB.tilt_step(tilt, sums())
    assert tilt.rail_steps == 0


@given(
    st.lists(st.tuples(st.integers(-200, 200), st.integers(-200, 200)), min_size=1, max_size=50), st.integers(0, 65535)
)
def test_odometry_adds_up_across_the_counters_wrap(moves, start):
    odometry = FFI.new("struct odometry *")
    LIB.odometry_init(odometry, start, start)
    left = right = start
    distance = angle = 0.0
    for a, b in moves:
        left, right = left + a, right + b
        rolled = LIB.odometry_step(odometry, left % 65536, right % 65536, 0.0)
        distance, angle = distance + rolled.distance, angle + rolled.angle
    metres = 2 * math.pi * 0.0508 / 1000
    assert distance == pytest.approx((left + right - 2 * start) / 2 * metres, abs=1e-4)
    assert angle == pytest.approx((right - left) * metres / 0.19, abs=1e-3)


def test_tracked_speed_settles_without_the_ticks_grain():
    odometry = FFI.new("struct odometry *")
    LIB.odometry_init(odometry, 0, 0)
    speeds = []
    for i in range(400):
        ticks = int(0.3 * 0.005 * (i + 1) / (2 * math.pi * 0.0508 / 1000))
        speeds.append(LIB.odometry_step(odometry, ticks, ticks, 0.0).speed)
    assert np.mean(speeds[200:]) == pytest.approx(0.3, abs=0.002)
    assert np.ptp(speeds[200:]) < 0.03  # one tick in 5 ms alone would be 0.064


def balance_duties(tilt=0.0, rate=0.0, speed=0.0, turn_rate=0.0, wish=(0.0, 0.0), battery=28.8, warm=True):
    balance = FFI.new("struct balance *")
    LIB.balance_init(balance)
    balance.soft_start = 1.0 if warm else 0.0
    rolled = FFI.new("struct rolled *", [0.0, speed, 0.0, turn_rate])
    return LIB.balance_step(
        balance, FFI.new("struct lean *", [tilt, rate]), rolled, FFI.new("struct drive_wish *", list(wish)), battery
    )


@given(st.floats(-0.15, 0.15), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1))
def test_balance_is_a_linear_sum(tilt, rate, speed):
    whole = balance_duties(tilt, rate, speed).left
    parts = balance_duties(tilt=tilt).left + balance_duties(rate=rate).left + balance_duties(speed=speed).left
    if abs(whole) < 1.0 and all(abs(p) < 1.0 for p in (balance_duties(tilt=tilt).left, balance_duties(rate=rate).left)):
        assert whole == pytest.approx(parts, abs=1e-5)


def test_leaning_forward_drives_forward_and_a_turn_leaves_the_sum_alone():
    straight = balance_duties(tilt=0.05)
    assert straight.left == straight.right > 0.0
    turning = balance_duties(tilt=0.05, wish=(0.0, 1.0))
    assert turning.right > turning.left
    assert turning.left + turning.right == pytest.approx(straight.left + straight.right, abs=1e-6)


def test_a_weak_battery_gets_more_duty_and_a_soft_start_less():
    assert balance_duties(tilt=0.05, battery=24.0).left == pytest.approx(1.2 * balance_duties(tilt=0.05).left)
    assert balance_duties(tilt=0.5, warm=False).left == pytest.approx(0.4, abs=0.01)


def test_against_a_wall_the_commanded_position_waits():
    balance = FFI.new("struct balance *")
    LIB.balance_init(balance)
    still, wish = FFI.new("struct rolled *"), FFI.new("struct drive_wish *", [0.3, 0.0])
    for _ in range(2000):
        LIB.balance_step(balance, FFI.new("struct lean *"), still, wish, 28.8)
    assert balance.ahead == pytest.approx(-0.25)


def test_the_trim_is_learned_by_standing_away_from_the_place_and_by_nothing_else():
    balance = FFI.new("struct balance *")
    LIB.balance_init(balance)
    still, level, rolled = FFI.new("struct drive_wish *"), FFI.new("struct lean *"), FFI.new("struct rolled *")

    def stand(seconds, ahead, wish=still):
        for _ in range(round(seconds / 0.005)):
            balance.ahead = ahead
            LIB.balance_step(balance, level, rolled, wish, 28.8)
        return balance.trim

    assert stand(60.0, 0.039) == 0.0  # noise does as much
    assert stand(3.9, 0.1, FFI.new("struct drive_wish *", [0.0, 1.0])) == 0.0
    assert stand(3.9, 0.1) == 0.0  # it has just been turning
    assert stand(1.0, 0.1) == pytest.approx(0.9 * 0.06 * 0.048, rel=0.02)
    LIB.balance_rest(balance)
    assert balance.trim > 0.0
    assert stand(300.0, 0.2) == pytest.approx(0.12)
    assert stand(300.0, -0.2) == pytest.approx(-0.12)


def judge(frame, now=5000):
    return LIB.command_of_frame(frame, now).kind


def test_only_whole_fresh_commands_of_the_host_are_obeyed():
    good = LIB.command_of_frame(command_frame(16, (300, -500, 4900), "<hhH"), 5000)
    assert (good.kind, good.sequence) == (DRIVE, 7)
    assert (good.wish.speed, good.wish.turn) == (pytest.approx(0.3), pytest.approx(-0.5))
    assert judge(command_frame(16, (300, 0, 4000), "<hhH")) == DRIVE
    assert judge(command_frame(16, (300, 0, 3999), "<hhH")) == REFUSED  # older than a second
    assert judge(command_frame(16, (300, 0, 5001), "<hhH")) == REFUSED  # from the future
    assert judge(command_frame(16, (300, 0, 65500), "<hhH"), now=100) == DRIVE  # across the clock's wrap
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
    wish = LIB.supervisor_wish(made, health())
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
        ({"accord": WHEELS_ALONE}, 5, LIFTED),
        ({"accord": BODY_ALONE}, 5, DISAGREEMENT),
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
    obey(made, DRIVE, 0.3)
    assert steps(made, 1, **values)
    assert made.reason == reason
    assert LIB.supervisor_wish(made, health(**values)).speed == 0.0
    assert LIB.supervisor_wish(made, health()).speed == pytest.approx(0.3)


@pytest.mark.parametrize(("cause", "reason"), [(1, BOOT), (4, BOOT), (8, WATCHDOG)])
def test_a_start_after_the_watchdog_says_so(cause, reason):
    loop, outbox = FFI.new("struct drive_loop *"), FFI.new("struct outbox *")
    LIB.drive_loop_init(loop, FFI.new("struct boot *", {"reset_cause": cause}), outbox)
    assert loop.supervisor.reason == reason


def test_telemetry_keeps_its_rates_and_tells_a_change_at_once():
    telemetry = FFI.new("struct telemetry *")
    LIB.telemetry_init(telemetry)
    due = [LIB.telemetry_step(telemetry, ARMED) for _ in range(2000)]  # 10 s
    assert due[0] & 2
    counts = [sum(bool(d & bit) for d in due[1:]) for bit in (1, 2, 4, 8)]
    assert counts == [499, 20, 10, 10]
    assert all(bin(d & ~1).count("1") <= 1 for d in due[1:])  # the slow ones never meet
    assert LIB.telemetry_step(telemetry, LINK_LOST) & 2
