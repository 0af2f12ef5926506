"""A scripted robot: its ticks integrate to the given odometry, its senses stand at the true poses."""

from collections import Counter

import numpy as np
import pytest

from firmware.virtual import ScriptedCrunch
from firmware.virtual.scripted import at_times, filled_in, ordered, wrap
from tests.firmware.virtual_wire import BALANCE, INFRARED, METRES_PER_TICK, ODOMETRY, SONAR, frames, payloads, room


def wavy(times):
    """A smooth drive: poses (n, 3) that roll along their own heading, with a stretch backwards."""
    fine = np.arange(0.0, times[-1] + 0.01, 0.01)
    speed, turn = 0.4 * np.cos(0.15 * fine), 0.8 * np.sin(0.4 * fine)
    heading = np.cumsum(turn) * 0.01
    x, y = np.cumsum(speed * np.cos(heading)) * 0.01, np.cumsum(speed * np.sin(heading)) * 0.01
    return np.column_stack([np.interp(times, fine, values) for values in (x, y, heading)])


def drifted(poses):
    """The same drive as bad odometry would tell it: 5 percent long, turning 0.05 rad per m too much."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    extra = np.concatenate([[0.0], np.cumsum(0.05 * steps)])
    step = np.diff(poses[:, :2], axis=0) * 1.05
    turn = extra[:-1]
    x = np.cumsum(np.cos(turn) * step[:, 0] - np.sin(turn) * step[:, 1])
    y = np.cumsum(np.sin(turn) * step[:, 0] + np.cos(turn) * step[:, 1])
    return np.column_stack([np.append(0.0, x), np.append(0.0, y), poses[:, 2] + extra])


def scripted(seed=1):
    odometry_times = np.arange(0.0, 40.0, 0.19)
    odometry = drifted(wavy(odometry_times))
    reference_times = np.arange(0.5, 39.0, 3.0)
    robot = ScriptedCrunch(room(16, 16), reference_times, wavy(reference_times), odometry_times, odometry, seed=seed)
    return robot, odometry_times, odometry


def integrated(data):
    """Poses (n, 3) from the ticks of a stream, started at the origin."""
    left, right, tilt = payloads(data, ODOMETRY).T
    assert np.all(tilt == 0)
    left, right = (np.unwrap(side, period=65536) * METRES_PER_TICK for side in (left, right))
    distance, turn = np.diff((left + right) / 2), np.diff((right - left) / 0.19)
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    middle = heading[:-1] + turn / 2
    return np.column_stack(
        [
            np.append(0.0, np.cumsum(distance * np.cos(middle))),
            np.append(0.0, np.cumsum(distance * np.sin(middle))),
            heading,
        ]
    )


def test_ticks_integrate_to_the_given_odometry():
    robot, times, odometry = scripted()
    poses = integrated(robot.advance(robot.duration + 0.01))
    wanted = robot.start_time + 0.02 * np.arange(len(poses))
    given = at_times(times, odometry, wanted)
    cos, sin = np.cos(given[0, 2]), np.sin(given[0, 2])
    moved = given[:, :2] - given[0, :2]
    expected = np.column_stack([cos * moved[:, 0] + sin * moved[:, 1], -sin * moved[:, 0] + cos * moved[:, 1]])
    assert np.hypot(*(poses[:, :2] - expected).T).max() < 0.01
    assert np.abs(poses[:, 2] - given[:, 2] + given[0, 2]).max() < 0.01


def test_truth_passes_the_references_and_keeps_the_odometrys_shape():
    robot, *_ = scripted()
    robot.advance(robot.duration + 0.01)
    times, poses = robot.truth()
    truth = wavy(times + robot.start_time)
    assert np.hypot(*(poses[:, :2] - truth[:, :2]).T).max() < 0.03
    assert np.abs(wrap(poses[:, 2] - truth[:, 2])).max() < 0.05


def test_rates_are_those_of_the_real_boards_and_it_ends():
    robot, *_ = scripted()
    data = robot.advance(20.0)
    assert not robot.finished
    counts = Counter(f.channel for f in frames(data))
    assert (counts[ODOMETRY], counts[INFRARED]) == (1000, 500)
    assert counts[SONAR] == pytest.approx(250, abs=2)
    assert counts[BALANCE] == 41
    data += robot.advance(30.0)
    assert robot.finished
    times, _ = robot.truth()
    assert len(times) == len(payloads(data, ODOMETRY))
    assert times[-1] == pytest.approx(robot.duration, abs=0.02)


def test_senses_stand_at_the_true_pose():
    stand = np.tile([1.0, 0.5, np.pi / 2], (2, 1))
    robot = ScriptedCrunch(room(4, 3), np.array([0.0, 9.0]), stand, np.array([0.0, 9.0]), np.zeros((2, 3)), seed=2)
    echoes = payloads(robot.advance(9.0), SONAR)[:, [0, 2, 4, 6]].astype(float)
    echoes[echoes == 0xFFFF] = np.nan
    assert np.nanmedian(echoes, axis=0) * 343e-6 / 2 == pytest.approx([0.93, 2.93, 1.93, 0.93], abs=0.04)


def test_the_same_seed_says_the_same_bytes():
    first, second, third = (scripted(seed)[0].advance(10.0) for seed in (3, 3, 4))
    assert first == second != third


def test_stammering_clocks_are_put_in_order_without_leaps():
    times = np.arange(0.0, 20.0, 0.2)
    poses = np.column_stack([0.5 * times, 0 * times, 0 * times])
    stammering = times.copy()
    stammering[30:36] = times[36]  # held back and told at once
    stammering[60] -= 1.0  # a step back
    even, kept = ordered(stammering, poses)
    assert np.all(np.diff(even) > 0.0)
    assert np.all(np.diff(kept[:, 0]) / np.diff(even) < 1.51)
    assert np.abs(np.interp(times, even, kept[:, 0]) - poses[:, 0]).max() < 0.6


def test_corrections_are_spread_along_the_way():
    """Odometry stands, drives a metre and stands again; the reference went 1.2 m: nobody moves while it stands."""
    wanted = np.arange(0.0, 12.0, 0.02)
    x = np.clip(wanted - 5.0, 0.0, 1.0)
    odometry = np.column_stack([x, 0 * x, 0 * x])
    filled = filled_in(np.array([0.0, 11.0]), np.array([[0.0, 0, 0], [1.2, 0, 0]]), wanted, odometry)
    assert filled[-60, 0] == pytest.approx(1.2, abs=0.005)
    assert filled[249, 0] < 0.06
    assert np.diff(filled[:, 0]).max() < 0.03


def test_spans_that_do_not_overlap_are_refused():
    with pytest.raises(ValueError, match="do not overlap"):
        ScriptedCrunch(room(4, 4), np.array([0, 1]), np.zeros((2, 3)), np.array([5, 6]), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="at least two"):
        ScriptedCrunch(room(4, 4), np.array([0]), np.zeros((1, 3)), np.array([5, 6]), np.zeros((2, 3)))
