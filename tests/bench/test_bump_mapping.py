"""The benchmark of maps from bumps: a run and a merge give what the tables tell, and laid maps are laid rightly."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.bump_mapping import Case, felt_points, laid, laser_walls, run
from server.formats.laser import LaserLog
from slam.bump_mapper import BumpMapperParams
from slam.cart_odometry import LEFT, MIDDLE, RIGHT, CartParams, bumper_points
from slam.pose import transform


def test_a_run_tells_errors_of_map_live_map_and_dead_reckoning():
    record = run(Case(15, params=BumpMapperParams(n_particles=300, n_islands=2)), 1)
    assert record["raw_error"] > 0.0
    for name in ("error", "live_error"):
        assert 0.0 < record[name] < 1.0
    assert record["good"] == (record["error"] < 0.05)
    assert not (record["missed"] if record["good"] else record["needless"])
    assert 0.0 < record["covered"] <= 1.0
    assert {**run(Case(15, params=BumpMapperParams(n_particles=300, n_islands=2)), 1), "bump_ms": 0, "refine_s": 0} == {
        **record, "bump_ms": 0, "refine_s": 0,
    }  # fmt: skip


def test_maps_are_laid_by_their_paths():
    rng = np.random.default_rng(1)
    places, walls = rng.normal(size=(9, 2)), [rng.normal(size=(4, 2))]
    pose = np.array([0.3, -2.0, 1.2])
    np.testing.assert_allclose(laid(places, transform(pose, places), walls)[0], transform(pose, walls[0]), atol=1e-9)


def test_a_side_switch_puts_the_bump_halfway_to_that_side():
    poses = np.array([[0.1, 0.2, 0.3]] * 3)
    left, middle, right = bumper_points(poses[:1], CartParams())[0]
    points = felt_points(poses, np.array([LEFT, MIDDLE, RIGHT]), CartParams())
    np.testing.assert_allclose(points, [0.5 * (left + middle), middle, 0.5 * (right + middle)])


def test_beams_end_where_the_laser_saw_walls():
    bearings = np.array([0.0, np.pi / 2, np.pi])
    log = LaserLog(Path("x"), np.zeros(2), np.zeros((2, 3)), np.array([0.5]), np.array([[1.0, np.inf, 9.0]]), bearings,
                   np.array([0.1, 0.0, 0.0]), np.zeros(3, bool))  # fmt: skip
    ends = laser_walls(log, np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    np.testing.assert_allclose(ends, [[2.1, 0.0]], atol=1e-12)
