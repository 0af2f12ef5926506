"""Wall points and their partners: as the slow twins find them, and facing the one who saw them."""

from __future__ import annotations

import numpy as np
import pytest

from slam.pose import between
from slam.wall_matching import (
    Matching,
    Nearness,
    WallMatches,
    match,
    near_pairs,
    pull,
    wall_points,
)
from slam.walls import Walls
from tests.naive import wall_matching as naive
from tests.slam.drives import laps

MATCHING = Matching(0.4, 0.8, 0.1, 0.15)


def test_normals_face_the_vertex_that_saw_the_wall():
    points = wall_points(laps().walls)
    assert len(points.points) > 1000
    np.testing.assert_allclose(np.hypot(*points.normals.T), 1.0)
    assert np.all(np.sum(points.normals * points.points, axis=1) < 0.0)


def test_points_of_a_straight_wall_lie_on_it_and_its_ends_are_left_out():
    angles = 2.0 * np.pi * np.arange(120) / 120
    with np.errstate(divide="ignore"):
        distances = np.where(np.sin(angles) > 0.6, 1.0 / np.sin(angles), np.inf)
    walls = wall_points([Walls(distances, np.minimum(distances, 1.5))], trim=3)
    assert len(walls.points) == np.isfinite(distances).sum() - 6
    np.testing.assert_allclose(walls.points[:, 1], 1.0)
    np.testing.assert_allclose(walls.normals, np.tile([0.0, -1.0], (len(walls.points), 1)), atol=1e-12)


@pytest.mark.parametrize("distances", [np.full(16, np.inf), np.full(16, np.nan), np.r_[0.5, np.full(15, np.inf)]])
def test_walls_that_are_none_have_no_points(distances):
    walls = wall_points([Walls(distances, np.zeros(16))] * 3)
    assert walls.points.shape == (0, 2)
    assert walls.starts.tolist() == [0, 0, 0, 0]


def test_no_vertices_have_no_points():
    assert wall_points([]).starts.tolist() == [0]


@pytest.mark.parametrize(("reach", "visits", "gap"), [(0.7, 1, 8), (1.0, 3, 4), (3.0, 2, 1), (0.05, 3, 1)])
def test_pairs_are_the_slow_twins(reach, visits, gap):
    poses = laps(2.4, noise=1.0, seed=2).odometry
    pairs = np.empty((len(poses) * visits, 2), np.int64)
    n_pairs = near_pairs(poses, reach, visits, gap, pairs)
    assert [tuple(pair) for pair in pairs[:n_pairs]] == naive.near_pairs(poses, reach, visits, gap)


def test_every_visit_has_one_say():
    poses = np.zeros((60, 3))
    poses[:, 0] = 0.2 * np.abs((np.arange(60) % 20) - 10)  # to and fro
    pairs = np.empty((60 * 9, 2), np.int64)
    n_pairs = near_pairs(poses, 0.5, 9, 8, pairs)
    newest = pairs[:n_pairs][pairs[:n_pairs, 1] == 50]  # in the middle, where it turned
    assert sorted(newest[:, 0].tolist()) == [10, 30]


def test_partners_and_their_pull_are_the_slow_twins():
    drive = laps(1.5, noise=0.6, seed=1)
    walls = wall_points(drive.walls)
    for a, b in ((0, drive.lap), (3, drive.lap + 4), (1, 6)):
        pose = between(drive.odometry[a], drive.odometry[b])
        of_a, of_b = (slice(walls.starts[v], walls.starts[v + 1]) for v in (a, b))
        partners = np.empty(len(walls.points[of_b]), np.int64)
        match(walls, a, b, pose[0], pose[1], pose[2], MATCHING, partners)
        expected = naive.match(
            walls.points[of_a], walls.normals[of_a], walls.points[of_b], walls.normals[of_b], pose,
            MATCHING.gate, MATCHING.cos,
        )  # fmt: skip
        assert [p - walls.starts[a] if p >= 0 else -1 for p in partners] == expected

        def cost(at, of_a=of_a, of_b=of_b, expected=expected):
            return naive.cost(
                walls.points[of_a], walls.normals[of_a], walls.points[of_b], at, expected, MATCHING.sigma,
                MATCHING.kernel,
            )  # fmt: skip

        gradient, hessian = np.zeros(3), np.zeros((3, 3))
        found = pull(walls, b, pose[0], pose[1], pose[2], MATCHING, partners, gradient, hessian)
        assert found == pytest.approx(cost(pose))
        slopes = [(cost(pose + step) - cost(pose - step)) / 2e-6 for step in 1e-6 * np.eye(3)]
        np.testing.assert_allclose(gradient, slopes, rtol=1e-5, atol=1e-5)
        assert np.all(np.linalg.eigvalsh(hessian) >= -1e-9)


def test_the_two_sides_of_a_thin_wall_do_not_match():
    """A wall seen from the south and, 5 cm on, from the north."""
    angles = 2.0 * np.pi * np.arange(120) / 120
    with np.errstate(divide="ignore"):
        north = np.where(np.sin(angles) > 0.6, 1.0 / np.sin(angles), np.inf)
        south = np.where(np.sin(angles) < -0.6, -1.0 / np.sin(angles), np.inf)
    matches = WallMatches(wall_points([Walls(north, np.zeros(120)), Walls(south, np.zeros(120))]))
    matches.associate(np.array([[0.0, 0.0, 0.0], [0.0, 2.05, 0.0]]), Nearness(3.0, 1, 1), MATCHING)
    assert len(matches.pairs) == 2
    assert np.all(matches.partners < 0)
