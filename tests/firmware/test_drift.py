"""Slip between wheels and floor has the statistics that its level names, and the balance does not mind."""

import numpy as np
import pytest

from firmware.virtual import DRIFTS, World
from firmware.virtual.native import native

FFI, LIB, _ = native()
RADIUS, TRACK, DT = 0.0508, 0.19, 0.001
OPEN = World(np.empty((0, 4)))


IDLE = FFI.new("double[2]")


def held_at(body, speed):
    """One step of a body held upright and to a straight course; returns the lean that it had begun (rad)."""
    body.speed, body.turn_rate, body.tilt, body.tilt_rate = speed, 0.0, 0.0, 0.0
    LIB.body_step(body, IDLE)
    return body.tilt


def rolled_away(drift, seed, metres, biases=True):
    """Wheels' distance and turn beyond the true ones after a straight drive of so many metres at 0.5 m/s."""
    body = FFI.new("struct body *")
    LIB.body_init(body, OPEN.caster, seed)
    random_part, bias_part = DRIFTS[drift][:2], DRIFTS[drift][2:]
    LIB.body_set_slip(body, *random_part, *(bias_part if biases else (0.0, 0.0, 0.0)))
    leaned = 0.0
    for _ in range(round(metres / (0.5 * DT))):
        leaned += held_at(body, 0.5)
    left, right = (body.wheels[0] + leaned) * RADIUS, (body.wheels[1] + leaned) * RADIUS
    return (left + right) / 2 - body.x, (right - left) / TRACK - body.heading


@pytest.mark.parametrize("drift", ["low", "medium", "high"])
def test_random_slip_grows_with_the_root_of_the_distance(drift):
    runs = np.array([rolled_away(drift, seed, 4.0, biases=False) for seed in range(150)])
    spread = np.std(runs, axis=0)
    assert spread == pytest.approx(np.array(DRIFTS[drift][:2]) * 2.0, rel=0.2)  # 150 runs: 6 percent
    assert np.abs(np.mean(runs, axis=0)) == pytest.approx([0.0, 0.0], abs=4 * np.max(spread) / 12)


def test_biases_are_drawn_per_run_and_stay():
    bodies = []
    for seed in range(400):
        body = FFI.new("struct body *")
        LIB.body_init(body, OPEN.caster, seed)
        LIB.body_set_slip(body, *DRIFTS["high"])
        bodies.append([body.slip.distance_bias, body.slip.turn_bias, body.slip.rotation_bias])
    assert np.std(bodies, axis=0) == pytest.approx(DRIFTS["high"][2:], rel=0.15)


def test_without_drift_ticks_times_radius_is_the_distance():
    assert rolled_away("none", 1, 3.0) == pytest.approx((0.0, 0.0), abs=2e-3)


def test_rocking_on_the_spot_does_not_drift():
    """Slip belongs to the place on the way: what rolls back un-slips."""
    body = FFI.new("struct body *")
    LIB.body_init(body, OPEN.caster, 5)
    LIB.body_set_slip(body, *DRIFTS["high"])
    for i in range(8000):
        held_at(body, 0.04 if i // 500 % 2 else -0.04)
    turn = (body.wheels[1] - body.wheels[0]) * RADIUS / TRACK
    assert abs(turn) < 0.02
    assert abs(body.x) < 0.03


def test_levels_are_the_named_ones():
    degrees = {name: (d, np.degrees(t), bd, np.degrees(bt), br) for name, (d, t, bd, bt, br) in DRIFTS.items()}
    assert degrees["low"] == pytest.approx((0.02, 1.0, 0.01, 0.10, 0.01))
    assert degrees["medium"] == pytest.approx((0.04, 2.0, 0.02, 0.25, 0.02))
    assert degrees["high"] == pytest.approx((0.06, 3.0, 0.03, 0.50, 0.03))
