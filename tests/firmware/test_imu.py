"""An MPU-6050 on the bus in place of the analogue parts: the same units, and a dead bus is a dead sensor."""

import re
import struct
import subprocess

import numpy as np
import pytest

from firmware.virtual.avr import AvrCrunch
from firmware.virtual.native import FIRMWARE, native
from tests.firmware.avr_robot import ARMED, FAULT, LINK_LOST, Driven
from tests.firmware.avr_tools import need_simavr
from tests.firmware.virtual_wire import DRIVE, arm_command, newest_time

FFI, LIB, _ = native()
SENSOR_DEAD = 7
N_SETTINGS = 5
MIDDLE = 5 * 512


def answer(along=0, rate=0):
    """Twelve bytes from 0x3B on: accelerometer X first, gyro Y last."""
    return struct.pack(">hhhhhh", along, 1, 2, 3, 4, rate)


def ready():
    """A part that is set up and has been read once."""
    imu = FFI.new("struct mpu6050 *")
    LIB.mpu6050_init(imu)
    for _ in range(N_SETTINGS):
        LIB.mpu6050_answered(imu, b"")
    LIB.mpu6050_answered(imu, answer(100, 100))
    return imu


def test_it_is_woken_and_set_up_register_by_register_and_then_read():
    imu = FFI.new("struct mpu6050 *")
    LIB.mpu6050_init(imu)
    asked = []
    for _ in range(N_SETTINGS):
        request = LIB.mpu6050_request(imu)
        assert (request.to_write, request.to_read) == (2, 0)
        asked.append((request.bytes[0], request.bytes[1]))
        assert imu.sums.accelerometer == 0  # at its rail: nobody arms on this
        LIB.mpu6050_answered(imu, b"")
    assert asked == [(0x6B, 1), (0x1A, 2), (0x19, 0), (0x1B, 0), (0x1C, 0)]
    request = LIB.mpu6050_request(imu)
    assert (request.bytes[0], request.to_write, request.to_read) == (0x3B, 1, 12)


@pytest.mark.parametrize("rate", [-140.0, -3.0, 0.0, 0.5, 90.0])
def test_a_rate_is_told_in_the_analogue_gyro_s_units(rate):
    imu = ready()
    LIB.mpu6050_answered(imu, answer(rate=round(131.0 * rate)))
    analogue = 5 * (512 + 1024 * 0.0125 / 5 * rate)  # ADXRS150 on a converter of 1024 counts for 5 V
    assert imu.sums.gyro == pytest.approx(analogue, abs=1.1)


@pytest.mark.parametrize("lean", [-0.7, -0.05, 0.0, 0.05, 0.7])
def test_a_lean_is_told_in_the_analogue_accelerometer_s_units(lean):
    imu = ready()
    tilt = FFI.new("struct tilt *")
    LIB.tilt_init(tilt)
    LIB.mpu6050_answered(imu, answer(along=round(-16384 * np.sin(lean))))  # X points down when it leans forward
    told = LIB.tilt_of_gravity(tilt, FFI.addressof(imu, "sums"))
    assert told == pytest.approx(lean, abs=0.05 if abs(lean) > 0.5 else 2e-3)


def test_the_fastest_rates_end_at_the_rails():
    imu = ready()
    for raw, rail in ((32767, 5 * 1023), (-32768, 0)):
        LIB.mpu6050_answered(imu, answer(rate=raw))
        assert imu.sums.gyro == rail


@pytest.mark.parametrize("miss", ["silent", "asleep"])
def test_a_part_is_set_up_anew_before_its_last_reading_is_too_old(miss):
    imu = ready()
    sums = imu.sums.gyro, imu.sums.accelerometer
    for _ in range(2):
        assert LIB.mpu6050_request(imu).bytes[0] == 0x3B
        LIB.mpu6050_failed(imu) if miss == "silent" else LIB.mpu6050_answered(imu, answer(100, 100))
    for _ in range(N_SETTINGS):
        assert LIB.mpu6050_request(imu).to_write == 2
        LIB.mpu6050_answered(imu, b"")
    assert (imu.sums.gyro, imu.sums.accelerometer) == sums
    LIB.mpu6050_answered(imu, answer(-160, 131))
    assert (imu.sums.gyro, imu.sums.accelerometer, imu.stale) == (MIDDLE + 12, MIDDLE + 10, 0)


def test_a_part_that_stays_away_is_a_rail_after_35_ms_and_asked_for_ever():
    imu = ready()
    gyro = imu.sums.gyro
    for step in range(600):
        assert imu.sums.gyro == gyro
        assert (imu.sums.accelerometer == 0) == (step > 7)
        LIB.mpu6050_failed(imu)
        assert LIB.mpu6050_request(imu).bytes[0] == (0x3B if step == 0 else 0x6B)


def test_its_program_builds_without_a_warning_and_fits(tmp_path):
    need_simavr()
    command = ["make", "-C", str(FIRMWARE), "avr", "IMU=mpu6050", f"BUILD={tmp_path}"]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    assert "warning" not in made.stderr
    assert max(float(share) for share in re.findall(r"Program:.*\(([\d.]+)% Full\)", made.stdout)) < 50.0


def test_it_stands_is_pushed_and_drives():
    driven = Driven(width=8.0, imu="mpu6050").stand()
    driven.wait(5.0)
    assert max(np.hypot(*pose[:2]) for pose in driven.poses) < 0.10
    assert max(driven.leans) < 0.05
    driven.robot.push(8.0)
    driven.wait(0.2)
    driven.robot.push(0.0)
    driven.wait(3.0)
    assert 0.03 < max(driven.leans) < 0.5
    before = driven.robot.pose[0]
    driven.drive(4.0, 0.3)
    assert driven.robot.pose[0] - before == pytest.approx(1.2, abs=0.3)
    assert driven.balance()[4] == ARMED
    assert driven.robot.collisions == 0
    assert driven.status(DRIVE)[6] < 0.4 * 5000  # us, the worst step


@pytest.mark.parametrize("hazard", ["the bus dies", "the part breaks"])
def test_a_dead_bus_or_part_ends_it_as_a_dead_sensor(hazard):
    driven = Driven(imu="mpu6050").stand()
    part = driven.robot.ffi.addressof(driven.robot.robot, "imu")
    if hazard == "the bus dies":
        part.is_dead = True
    else:
        driven.robot.lib.imu_part_reset(part)
        part.is_stuck = True
    milliseconds = 0
    while not driven.robot.is_off and milliseconds < 300:
        driven.said += driven.robot.advance(0.001)
        milliseconds += 1
    assert milliseconds <= 145
    assert driven.robot.tilt < 0.2
    driven.wait(0.6)
    assert tuple(driven.balance()[4:6]) == (FAULT, SENSOR_DEAD)


def test_a_bus_that_comes_back_is_used_again():
    driven = Driven(imu="mpu6050")
    part = driven.robot.robot.imu
    part.is_dead = True
    driven.wait(0.3)
    driven.robot.write(arm_command(1, newest_time(driven.said)))
    driven.wait(2.0)
    assert driven.robot.is_off
    part.is_dead = False
    driven.wait(2.5)
    assert not driven.robot.is_off  # what was asked for comes true, after a second of stillness
    assert driven.balance()[4] in (ARMED, LINK_LOST)


def test_a_part_that_was_reset_for_a_moment_is_woken_before_anybody_notices():
    driven = Driven(imu="mpu6050").stand()
    driven.robot.lib.imu_part_reset(driven.robot.ffi.addressof(driven.robot.robot, "imu"))
    driven.wait(2.0)
    assert not driven.robot.is_off
    assert max(driven.leans) < 0.1


def test_the_same_seed_gives_the_same_bytes():
    need_simavr()
    said = [AvrCrunch(Driven(imu="mpu6050").robot.world, seed=3, imu="mpu6050").advance(0.5) for _ in range(2)]
    assert said[0] == said[1]
