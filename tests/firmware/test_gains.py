"""The balance law's gains on a linear model: every body of +-20 % is damped, with the time that the board takes.

The model is firmware/virtual/body.c near upright without friction, walked through one step of the loop in five
milliseconds: the gyro's mean, the tracking filter of the wheels, the complementary filter, and duties that come late.
Its poles are the logarithms of the monodromy's eigenvalues. What is not linear is measured by `crunch bench ride`.
"""

import itertools

import numpy as np
import pytest

from firmware.virtual.native import native

FFI, LIB, _ = native()
MS, STEP_MS = 0.001, 5
GRAVITY, WHEEL, WHEELS_MASS, STALL_TORQUE, FREE_SPEED = 9.81, 0.0508, 0.30, 1.2, 22.0
MASS, CENTRE, INERTIA = 2.6, 0.135, 0.025
FOLLOW_LAG, FOLLOW_SPEED, TIME_CONSTANT = 0.5, 0.09, 3.0
STATES = 12
BALANCE = FFI.new("struct balance *")
LIB.balance_init(BALANCE)
BODIES = list(itertools.product((0.8, 1.0, 1.2), repeat=2))


def one_step(state, mass, centre, delay_ms, tilt_rate):
    """A state (12,) 5 ms later; linear in it."""
    gains = BALANCE.gains
    speed, tilt, rate, ahead, followed, lag, rates, rolled, estimate, gravity, duty, wanted = state
    m, arm, inertia = MASS * mass, CENTRE * centre, INERTIA * mass * centre**2
    masses = np.array([[m + 1.5 * WHEELS_MASS, m * arm], [m * arm, inertia + m * arm**2]])
    for ms in range(STEP_MS):
        rates += rate
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
    return np.array([speed, tilt, rate, ahead, followed, lag, rates, rolled, estimate, gravity, duty, wanted])


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
def test_twice_the_delay_is_still_stable(mass, centre):
    assert poles(mass, centre, delay_ms=2).real.max() < 0.0


def test_a_third_more_gain_of_the_tilt_rate_shakes_a_light_and_low_body():
    assert poles(0.8, 0.8, delay_ms=2, tilt_rate=0.88).real.max() > 10.0
