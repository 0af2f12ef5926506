"""Mice tell the robot's motion, and who of them was fooled by the floor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.mouse_odometry import MouseOdometry, MouseOdometryParams, MouseParams, moment_arm

FOUR = (
    MouseParams(x=0.1, y=0.08, angle=0.3),
    MouseParams(x=0.1, y=-0.08, angle=-1.2),
    MouseParams(x=-0.1, y=0.08, angle=2.0),
    MouseParams(x=-0.12, y=-0.07, angle=0.0, counts_per_metre=20_000.0),
)


def counted(mice, motion):
    """What mice count when the robot moves by (x, y, turn), a small one: by geometry, mouse by mouse."""
    x, y, turn = motion
    counts = []
    for mouse in mice:
        way = np.array([x - turn * mouse.y, y + turn * mouse.x])
        axes = np.array([[np.cos(mouse.angle), np.sin(mouse.angle)], [-np.sin(mouse.angle), np.cos(mouse.angle)]])
        counts.append(mouse.counts_per_metre * (axes @ way))
    return np.array(counts)


@given(st.floats(-0.02, 0.02), st.floats(-0.05, 0.05), st.integers(1, 4))
def test_any_number_of_mice_tells_the_motion(x, turn, n):
    found = MouseOdometry(MouseOdometryParams(mice=FOUR[:n])).step(counted(FOUR[:n], (x, 0.0, turn)))
    assert found.motion == pytest.approx([x, 0.0, turn], abs=1e-9)
    assert found.is_sound
    assert np.all(found.believed)


def test_one_mouse_on_an_arm_turns_by_its_sideways_way_over_the_arm():
    mice = moment_arm(0.2, counts_per_metre=1000.0)
    found = MouseOdometry(MouseOdometryParams(mice=tuple(mice))).step(np.array([[30.0, 8.0]]))
    assert found.motion == pytest.approx([0.03, 0.0, 0.008 / 0.2], abs=1e-4)  # omega = v / r


def test_a_robot_that_slips_sideways_is_seen_by_several_mice():
    found = MouseOdometry(MouseOdometryParams(mice=FOUR, sideways=1.0)).step(counted(FOUR, (0.01, 0.004, 0.02)))
    assert found.motion == pytest.approx([0.01, 0.004, 0.02], abs=1e-6)


@pytest.mark.parametrize("fooled", range(4))
@pytest.mark.parametrize("harm", ["it stands still", "it follows a line", "it jumps"])
def test_one_of_four_that_is_fooled_is_left_out(fooled, harm):
    motion = (0.015, 0.0, 0.04)
    counts = counted(FOUR, motion)
    if harm == "it stands still":
        counts[fooled] = 0.0
    elif harm == "it follows a line":  # a black marking holds it: only along the mark the floor seems to go by
        across = int(np.argmin(np.abs(counts[fooled])))
        counts[fooled] = np.hypot(*counts[fooled]) * np.eye(2)[across]
    else:
        counts[fooled] += [900.0, -700.0]
    found = MouseOdometry(MouseOdometryParams(mice=FOUR)).step(counts)
    assert found.is_sound
    assert not found.believed[fooled]
    assert found.believed.sum() == 3
    assert found.motion == pytest.approx(motion, abs=1e-6)


def test_two_mice_that_disagree_are_told_but_nobody_knows_whose_fault_it_is():
    counts = counted(FOUR[:2], (0.015, 0.0, 0.0))
    counts[1] = 0.0
    found = MouseOdometry(MouseOdometryParams(mice=FOUR[:2])).step(counts)
    assert not found.is_sound
    assert found.misfit > 3.0


def test_noise_is_no_slip_and_the_mean_is_right():
    rng = np.random.default_rng(3)
    odometry = MouseOdometry(MouseOdometryParams(mice=FOUR))
    motion = np.array([0.01, 0.0, 0.03])
    found = []
    for _ in range(500):
        noise = 0.0005 * rng.standard_normal((4, 2)) * [[mouse.counts_per_metre] for mouse in FOUR]
        found.append(odometry.step(counted(FOUR, motion) + noise))
    assert all(np.all(one.believed) and one.is_sound for one in found)
    errors = np.array([one.motion - motion for one in found])
    assert np.all(np.abs(errors.mean(axis=0)) < 4.0 * errors.std(axis=0) / np.sqrt(500))


def test_mice_that_say_nothing_are_done_without():
    odometry = MouseOdometry(MouseOdometryParams(mice=FOUR))
    counts = counted(FOUR, (0.01, 0.0, 0.02))
    counts[2] = 12345.0
    found = odometry.step(counts, np.array([True, True, False, True]))
    assert found.motion == pytest.approx([0.01, 0.0, 0.02], abs=1e-6)
    nothing = odometry.step(counts, np.zeros(4, bool))
    assert not nothing.is_sound
    assert nothing.motion == pytest.approx(np.zeros(3))


def test_a_floor_that_fools_all_alike_is_not_noticed():
    found = MouseOdometry(MouseOdometryParams(mice=FOUR)).step(0.5 * counted(FOUR, (0.015, 0.0, 0.04)))
    assert found.is_sound
    assert found.motion == pytest.approx([0.0075, 0.0, 0.02], abs=1e-6)


@pytest.mark.parametrize("counts", [np.zeros((3, 2)), np.zeros((4, 3)), np.full((4, 2), np.nan)])
def test_counts_that_are_none_are_refused(counts):
    with pytest.raises(ValueError, match="two numbers each"):
        MouseOdometry(MouseOdometryParams(mice=FOUR)).step(counts)
