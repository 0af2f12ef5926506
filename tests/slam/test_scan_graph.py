"""The scan graph closes loops that are off by metres, lets wrong ones go, and tells how certain the path is."""

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.pose import between, compose
from slam.scan_graph import ScanGraph, ScanGraphParams
from tests.slam.laser_world import around, odometry_of, ring, scan_at

SMALL = {"turn_noise": 0.01, "distance_noise": 0.02}


def drive(seed=0, bias=0.01, laps=1.6):
    poses = around(laps, step=0.4)
    odometry = odometry_of(poses, np.random.default_rng(seed), bias=bias, **SMALL)
    return poses, odometry, [scan_at(pose, ring(), 100 * seed + k) for k, pose in enumerate(poses)]


@pytest.mark.parametrize("seed", range(3))
def test_a_path_that_comes_back_metres_off_is_closed(seed):
    poses, odometry, scans = drive(seed)
    assert np.hypot(*between(compose(odometry[0], between(poses[0], poses[-1])), odometry[-1])[:2]) > 1.0
    graph = ScanGraph(odometry, scans, ScanGraphParams(turn=0.01))  # as it errs here, bias and all
    path = graph.refine(odometry)
    assert len(graph.loops.pairs) > 20
    assert absolute_error(path, poses).translation.rmse < 0.06
    assert absolute_error(path, poses).translation.rmse < 0.1 * absolute_error(odometry, poses).translation.rmse


def test_a_good_path_stays_good_and_the_second_visit_falls_on_the_first():
    poses, odometry, scans = drive(5, bias=0.0)
    path = ScanGraph(odometry, scans, ScanGraphParams()).refine(poses)
    assert absolute_error(path, poses).translation.max < 0.08


def corridor_with_a_room():
    """Walls (m, 4) of a corridor of 2 m, with a room open to it on the right at its beginning."""
    room = [[3.0, 0.0, 3.0, -2.5], [3.0, -2.5, 5.5, -2.5], [5.5, -2.5, 5.5, 0.0]]
    sides = [[0.0, 0.0, 3.0, 0.0], [5.5, 0.0, 14.0, 0.0], [0.0, 2.0, 14.0, 2.0]]
    return np.array([*room, *sides, [0.0, 0.0, 0.0, 2.0], [14.0, 0.0, 14.0, 2.0]])


def test_loops_where_scans_see_through_walls_are_not_believed():
    """A robot that thinks it is back beside the room and is elsewhere in the corridor: its walls fit all the same."""
    walls = corridor_with_a_room()
    poses = np.array([[x, 1.0, 0.0] for x in np.arange(1.5, 9.5, 0.3)])
    scans = [scan_at(pose, walls, k) for k, pose in enumerate(poses)]
    lies = poses.copy()
    lies[-3:, 0] = [2.4, 2.7, 3.0]
    loops = []
    for params in (ScanGraphParams(), credulous()):
        graph = ScanGraph(lies, scans, params)
        graph.associate(lies, 1.0)
        loops.append(len(graph.loops.pairs))
    assert loops[0] == 0
    assert loops[1] > 0


def test_a_loop_that_the_odometry_rules_out_is_none():
    """Cells of 0.6 m are all alike; who has driven three metres with a good odometry is in none but his own."""
    cell, n = 0.6, 40
    posts = [[cell * k, y, cell * k, y + 0.15 * sign] for k in range(14) for y, sign in ((0.0, 1.0), (cell, -1.0))]
    walls = np.array([[0.0, 0.0, 13 * cell, 0.0], [0.0, cell, 13 * cell, cell], *posts])
    steps = np.concatenate([np.linspace(1.5, 4.5, n // 2), np.linspace(4.5, 1.5, n // 2)])
    poses = np.column_stack([steps, np.full(n, 0.5 * cell), np.zeros(n)])
    scans = [scan_at(pose, walls, k) for k, pose in enumerate(poses)]
    start = poses.copy()
    start[n // 2 :, 0] += 0.6 * cell  # nearer to the wrong one
    graph = ScanGraph(poses, scans, ScanGraphParams())
    path = graph.refine(start)
    assert np.abs(path[:, :2] - poses[:, :2]).max() < 0.1
    for first, second in graph.loops.pairs:
        assert abs(path[first, 0] - path[second, 0] - poses[first, 0] + poses[second, 0]) < 0.1


def credulous():
    params = ScanGraphParams()
    return params.model_copy(update={"agreement": params.agreement.model_copy(update={"share": 1e-6, "overlap": 0.0})})


def test_without_rounds_or_loops_the_path_is_the_guess():
    poses, odometry, scans = drive(laps=0.3)
    assert np.array_equal(ScanGraph(odometry, scans, ScanGraphParams(rounds=0)).refine(poses), poses)
    assert ScanGraph(odometry, scans, ScanGraphParams()).refine(odometry) == pytest.approx(odometry, abs=1e-6)
    assert np.array_equal(ScanGraph(odometry[:1], scans[:1], ScanGraphParams()).refine(odometry[:1]), odometry[:1])


def test_what_was_seen_twice_is_more_certain():
    poses, odometry, scans = drive()
    open_graph, closed = (ScanGraph(odometry, scans, ScanGraphParams()) for _ in range(2))
    path = closed.refine(odometry)
    spread = [
        np.trace(graph.covariances(path).marginals()[:, :2, :2], axis1=1, axis2=2) for graph in (open_graph, closed)
    ]
    assert spread[0][-1] > 4.0 * spread[1][-1]
    assert spread[1][0] == 0.0
    assert len(poses) == len(path)
