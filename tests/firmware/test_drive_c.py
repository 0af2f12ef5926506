"""The drive board's pure C: tilt, agreement, odometry, balance, telemetry."""

import itertools
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.virtual.native import native
from tests.firmware.virtual_wire import LAYOUTS, STATUS, Decoder

FFI, LIB, _ = native()
ARMED, LINK_LOST = 1, 3
ACCORD, WHEELS_ALONE, BODY_ALONE = range(3)
SHIVER = itertools.cycle((-1, 1))


def sums(rate=0.0, lean=0.0, zero=512.0, is_stuck=False):
    """Five ADC readings' sums for a rate (rad/s) and a lean (rad), of a gyro that shivers as all that work do."""
    gyro = round(5 * (zero + rate / 0.00681769)) + (0 if is_stuck else next(SHIVER))
    return FFI.new("struct inertial_sums *", [max(0, min(5115, gyro)), round(5 * (512 + math.sin(lean) * 204.8))])


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
    assert not any(LIB.tilt_rest(tilt, sums(lean=0.1, zero=520.0)) for _ in range(199))
    assert LIB.tilt_rest(tilt, sums(lean=0.1, zero=520.0))
    assert tilt.gyro_zero == pytest.approx(8 * 0.00681769, rel=0.01)
    assert tilt.angle == pytest.approx(0.1, abs=0.003)
    assert LIB.tilt_rest(tilt, sums(lean=0.1, zero=520.0))
    for _ in range(200):  # set up so slowly that no gyro shows it
        assert LIB.tilt_rest(tilt, sums(lean=0.0, zero=520.0))
    assert tilt.angle == pytest.approx(0.0, abs=0.005)
    assert not all(LIB.tilt_rest(tilt, sums(rate=0.5)) for _ in range(4))  # 20 ms


def test_rest_is_found_in_a_hand_that_trembles_and_behind_a_gyro_that_hisses():
    """0.05 deg/s per root hertz over the 100 Hz of a step's mean; a hand's 0.03 rad/s at 9 Hz."""
    rng = np.random.default_rng(5)
    for _ in range(100):
        tilt = FFI.new("struct tilt *")
        LIB.tilt_init(tilt)
        phase = rng.uniform(0.0, 6.0)
        steps = 0
        while not tilt.is_rested and steps < 1000:
            hiss = math.radians(0.05) * math.sqrt(100.0) * rng.standard_normal()
            LIB.tilt_rest(
                tilt, sums(rate=0.03 * math.sin(phase + 2.0 * math.pi * 9.0 * 0.005 * steps) + hiss, zero=515.0)
            )
            steps += 1
        assert steps == 200
        assert tilt.gyro_zero == pytest.approx(3 * 0.00681769, abs=0.004)


@pytest.mark.parametrize(
    ("zero", "is_stuck"), [(0.0, True), (1023.0, True), (205.0, False), (819.0, False), (512.0, True), (530.0, True)]
)
def test_a_gyro_that_is_dead_or_stuck_is_never_at_rest(zero, is_stuck):
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    for _ in range(1000):
        shown = sums(zero=zero, is_stuck=is_stuck)
        LIB.tilt_step(tilt, shown)
        assert not LIB.tilt_rest(tilt, shown)
    for _ in range(400):  # mended
        shown = sums()
        LIB.tilt_step(tilt, shown)
        LIB.tilt_rest(tilt, shown)
    assert tilt.is_rested
    assert abs(tilt.gyro_zero) < 0.01


def test_a_gyro_that_dies_at_rest_is_found_within_two_seconds():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    for _ in range(500):
        LIB.tilt_rest(tilt, sums(zero=515.0))
    assert tilt.is_rested
    for _ in range(400):
        LIB.tilt_rest(tilt, sums(zero=516.0, is_stuck=True))
    assert not any(LIB.tilt_rest(tilt, sums(zero=516.0, is_stuck=True)) for _ in range(400))


def test_a_builder_levels_a_crooked_accelerometer_at_rest():
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    crooked = [sums(lean=math.asin(0.1), zero=520.0) for _ in range(200)]
    assert not LIB.tilt_level(tilt)  # not at rest yet
    for shown in crooked:
        LIB.tilt_step(tilt, shown)
        LIB.tilt_rest(tilt, shown)
    assert tilt.angle == pytest.approx(0.1, abs=0.003)
    assert LIB.tilt_level(tilt)
    assert tilt.angle == 0.0
    assert LIB.tilt_of_gravity(tilt, crooked[0]) == pytest.approx(0.0, abs=1e-3)
    assert tilt.accelerometer_zero == pytest.approx(512 + 20.48, abs=0.2)
    for _ in range(600):
        LIB.tilt_rest(tilt, sums(lean=1.3))
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


def test_telemetry_keeps_its_rates_and_tells_a_change_at_once():
    telemetry = FFI.new("struct telemetry *")
    LIB.telemetry_init(telemetry)
    due = [LIB.telemetry_step(telemetry, ARMED) for _ in range(2000)]  # 10 s
    assert due[0] & 2
    counts = [sum(bool(d & bit) for d in due[1:]) for bit in (1, 2, 4, 8, 16)]
    assert counts == [499, 20, 10, 10, 10]
    assert all(bin(d & ~1).count("1") <= 1 for d in due[1:])  # the slow ones never meet
    assert LIB.telemetry_step(telemetry, LINK_LOST) & 2


@pytest.mark.parametrize(
    ("rejected", "refused", "told"), [(3, 4, 7), (65_000, 1_000, 65_535), (65_535, 0, 65_535), (65_535, 65_535, 65_535)]
)
def test_what_was_not_understood_is_told_as_one_number_that_stays_at_its_maximum(rejected, refused, told):
    store, outbox, teller = FFI.new("uint8_t[256]"), FFI.new("struct outbox *"), FFI.new("struct teller *")
    LIB.outbox_init(outbox, store, 256)
    LIB.teller_init(teller, 1, FFI.new("struct boot *"), outbox)
    LIB.teller_tell_status(teller, 0, 0, rejected, refused)
    sent = FFI.new("uint8_t[64]")
    [frame] = Decoder().feed(bytes(FFI.buffer(sent, LIB.outbox_take(outbox, sent))))
    assert struct.unpack(LAYOUTS[STATUS], frame.payload)[7] == told
