"""The balance law's gains on a linear model: every body of +-20 % is damped, with the time that the board takes.

The model is firmware/virtual/body.c near upright without friction, walked through one step of the loop in five
milliseconds: the gyro's filter and its mean, the tracking filter of the wheels, the complementary filter, and duties
that come late: the board's by 1 ms, of which the simulation sees whole ones, and silicon's by less than 2.
Its poles are the logarithms of the monodromy's eigenvalues. What is not linear is measured by `crunch bench ride`.
"""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from firmware.virtual.native import native

FFI, LIB, _ = native()
FIRMWARE = Path(__file__).parents[2] / "firmware"


def constant(path, name):
    """A number that a source gives a name, or an initial value."""
    found = re.search(rf"(?:#define {name} |\.{name} = )([\d.]+)", (FIRMWARE / path).read_text())
    assert found is not None, f"{path} has no {name}"
    return float(found[1])


MS, STEP_MS = 0.001, 5
GRAVITY, WHEEL = 9.81, 0.0508
WHEELS_MASS, STALL_TORQUE, FREE_SPEED, MASS, CENTRE, INERTIA = (
    constant("virtual/body.c", name)
    for name in ("WHEELS_MASS", "STALL_TORQUE", "FREE_SPEED", "mass", "centre", "inertia")
)
GYRO_PASSED = constant("virtual/sensors.c", "GYRO_PASSED")
FOLLOW_LAG, FOLLOW_SPEED = (constant("drive/odometry.c", name) for name in ("FOLLOW_LAG", "FOLLOW_SPEED"))
TIME_CONSTANT = constant("drive/tilt.h", "TILT_TIME_CONSTANT")
STATES = 13
BALANCE = FFI.new("struct balance *")
LIB.balance_init(BALANCE)
BODIES = list(itertools.product((0.8, 1.0, 1.2), repeat=2))


def one_step(state, mass, centre, delay_ms, tilt_rate):
    """A state (13,) 5 ms later; linear in it."""
    gains = BALANCE.gains
    speed, tilt, rate, ahead, followed, lag, rates, rolled, estimate, gravity, duty, wanted, gyro = state
    m, arm, inertia = MASS * mass, CENTRE * centre, INERTIA * mass * centre**2
    masses = np.array([[m + 1.5 * WHEELS_MASS, m * arm], [m * arm, inertia + m * arm**2]])
    for ms in range(STEP_MS):
        gyro += GYRO_PASSED * (rate - gyro)
        rates += gyro
        if ms == STEP_MS - 1:
            mean, rates = rates / STEP_MS, 0.0
            lag += rolled - followed * STEP_MS * MS
            followed += lag * FOLLOW_SPEED / (STEP_MS * MS)
            lag *= 1.0 - FOLLOW_LAG
            estimate += (mean + (gravity - estimate) / TIME_CONSTANT) * STEP_MS * MS
            ahead += rolled + WHEEL * mean * STEP_MS * MS
            rolled = 0.0
            wanted = (gains.tilt * estimate + tilt_rate * mean + gains.speed * (followed + WHEEL * mean)
                      + gains.position * ahead)  # fmt: skip
        if ms == (STEP_MS - 1 + delay_ms) % STEP_MS:
            duty = wanted
        torque = 2.0 * STALL_TORQUE * (duty - (speed / WHEEL - rate) / FREE_SPEED)
        forces = np.array([torque / WHEEL, m * GRAVITY * arm * tilt - torque])
        acceleration, tilting = np.linalg.solve(masses, forces)
        rate += tilting * MS
        speed += acceleration * MS
        tilt += rate * MS
        rolled += (speed - WHEEL * rate) * MS
        gravity = tilt - acceleration / GRAVITY
    return np.array([speed, tilt, rate, ahead, followed, lag, rates, rolled, estimate, gravity, duty, wanted, gyro])


def poles(mass, centre, delay_ms, tilt_rate=None):
    """Of the closed loop, per second; those that die within a step left out."""
    gain = BALANCE.gains.tilt_rate if tilt_rate is None else tilt_rate
    monodromy = np.stack([one_step(state, mass, centre, delay_ms, gain) for state in np.eye(STATES)], axis=1)
    values = np.linalg.eigvals(monodromy)
    found = np.log(values[np.abs(values) > 1e-6]) / (STEP_MS * MS)
    return found[np.abs(found) < 560.0]


@pytest.mark.parametrize(("mass", "centre"), BODIES)
def test_every_body_is_damped_with_the_board_s_delay(mass, centre):
    found = poles(mass, centre, delay_ms=1)
    swings = found[(found.imag > 0.5) & (found.imag < 100.0)]  # of the body
    shaking = found[found.imag > 100.0]  # between gyro and motors, towards half the loop's rate
    assert shaking.real.max() < -20.0
    assert (-swings.real / np.abs(swings)).min() > 0.45
    assert np.abs(found).min() > 0.2  # the gyro's zero settles within 5 s,
    assert np.sort(-found.real)[1] > 0.9  # the rest within about one


@pytest.mark.parametrize(("mass", "centre"), BODIES)
@pytest.mark.parametrize(("delay_ms", "margin"), [(2, 10.0), (3, 2.0)])
def test_later_duties_are_stable_still(mass, centre, delay_ms, margin):
    found = poles(mass, centre, delay_ms)
    assert found[found.imag > 100.0].real.max() < -margin
    assert found.real.max() < 0.0


def test_more_gain_of_the_tilt_rate_shakes_a_light_and_low_body():
    assert poles(0.8, 0.8, delay_ms=2, tilt_rate=0.88).real.max() > 10.0
