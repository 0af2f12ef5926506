"""Affinity: labels and both functions are their twins', true poses score best, the flaws of segments are known."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from slam.affinity import (
    AffinityParams,
    early_affinity,
    gaussian_points,
    label_raster,
    pattern_of,
    point_affinity,
    segment_affinity,
    wall_segments,
)
from slam.walls import Walls
from tests.naive import affinity as naive
from tests.naive import pose as se2
from tests.naive.walls import cast, random_walls, rectangle

N_RAYS, REACH, CELL, THICKNESS = 120, 1.0, 0.04, 0.25
SIZE = 2 * (math.ceil((REACH + THICKNESS) / CELL) + 1)
ROOM = np.vstack(
    [rectangle(0.0, 0.0, 3.0, 2.2), rectangle(1.2, 0.7, 0.7, 0.5), rectangle(-0.4, -0.8, 0.3, 0.7)]
)  # with two pieces of furniture


def pattern_with(spread=0.6):
    """Test points of this spread (m)."""
    params = AffinityParams(n_points=64, spread=spread, label_cell=CELL, both_free=0.22, both_wall=1.16, differ=-1.3)
    return pattern_of(params, 1.0)


PATTERN = pattern_with()


def raster(walls, states=3):
    return label_raster(walls.distances, walls.free, SIZE, CELL, THICKNESS, states, REACH)


def points_at(labels_a, labels_b, pose_a, pose_b, pattern=PATTERN):
    """point_affinity of two rasters at two poses (3,)."""
    xa, ya, theta_a = (float(value) for value in pose_a)
    xb, yb, theta_b = (float(value) for value in pose_b)
    affinity = point_affinity if pattern.early_exit == -math.inf else early_affinity
    labels, room = np.stack([labels_a, labels_b]).reshape(-1), np.empty((2, pattern.x.size), np.int32)
    return affinity(labels, SIZE, 0, 1, xa, ya, theta_a, xb, yb, theta_b, pattern, (room[0], room[1]))


def segments_at(walls_a, walls_b, pose_a, pose_b, scale=0.1):
    """segment_affinity of two vertices' walls at two poses (3,)."""
    rows_a, rows_b = wall_segments(walls_a), wall_segments(walls_b)
    xa, ya, theta_a = (float(value) for value in pose_a)
    xb, yb, theta_b = (float(value) for value in pose_b)
    return segment_affinity(rows_a, rows_b, xa, ya, theta_a, xb, yb, theta_b, scale)


def near_poses(rng):
    """Two poses a step apart, a long way from the origin."""
    pose_a = rng.uniform(-1.0, 1.0, 3) * [30.0, 30.0, 9.0]
    return pose_a, pose_a + rng.uniform(-1.0, 1.0, 3) * [0.5, 0.5, 3.0]


def poses_in_room(rng, n):
    """Poses (n, 3) on the room's free floor."""
    poses = rng.uniform(-1.0, 1.0, (20 * n, 3)) * [0.9, 0.8, math.pi]
    is_free = (
        (np.abs(poses[:, 0] + 0.4) > 0.3) | (np.abs(poses[:, 1] + 0.8) > 0.5)
    ) & ((np.abs(poses[:, 0] - 1.2) > 0.5) | (np.abs(poses[:, 1] - 0.7) > 0.4))  # fmt: skip
    return poses[is_free][:n]


def pairs_in_room(seed, n=40):
    """(pose, pose, walls, walls) of vertices at most 0.6 m apart."""
    rng = np.random.default_rng(seed)
    poses = poses_in_room(rng, 4 * n)
    seen = [cast(pose, ROOM, N_RAYS, REACH) for pose in poses]
    near = [
        (poses[i], poses[j], seen[i], seen[j])
        for i in range(len(poses)) for j in range(i) if math.dist(poses[i, :2], poses[j, :2]) < 0.6
    ]  # fmt: skip
    return [near[k] for k in rng.choice(len(near), n, replace=False)]


PAIRS = pairs_in_room(1)


# Labels


@pytest.mark.parametrize("states", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_labels_agree_with_cell_by_cell(seed, states):
    walls = random_walls(seed)
    expected = naive.label_raster(walls.distances, walls.free, SIZE, CELL, THICKNESS, states, REACH)
    np.testing.assert_array_equal(raster(walls, states), expected)


def test_three_states_do_not_claim_what_was_not_seen():
    walls = Walls(np.full(N_RAYS, math.inf), np.full(N_RAYS, 0.5))
    centres = (np.arange(SIZE) + 0.5 - 0.5 * SIZE) * CELL
    distances = np.hypot(*np.meshgrid(centres, centres))
    np.testing.assert_array_equal(raster(walls), np.where(distances < 0.5, -1, 0))
    np.testing.assert_array_equal(raster(walls, states=2), np.where(distances <= 1.25 * REACH, -1, 0))


def test_behind_a_wall_is_outside_for_its_thickness_only():
    labels = raster(Walls(np.full(N_RAYS, 0.6), np.full(N_RAYS, 0.55)))
    ahead = labels[SIZE // 2, SIZE // 2 :]
    x = (np.arange(ahead.size) + 0.5) * CELL
    np.testing.assert_array_equal(ahead[x < 0.55], -1)
    np.testing.assert_array_equal(ahead[(x > 0.64) & (x < 0.81)], 1)
    np.testing.assert_array_equal(ahead[x > 0.89], 0)


def test_turning_the_vertex_turns_its_labels():
    walls = random_walls(5)
    turned = Walls(np.roll(walls.distances, N_RAYS // 4), np.roll(walls.free, N_RAYS // 4))
    for states in (2, 3):
        here, there = np.rot90(raster(walls, states), -1), raster(turned, states)  # rows are y: this turns ccw
        assert np.mean(here != there) < 0.01  # cells halfway between two rays go to either


# Test points


@pytest.mark.parametrize("states", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_points_agree_with_point_by_point(seed, states):
    rng = np.random.default_rng(seed)
    labels_a, labels_b = raster(random_walls(seed), states), raster(random_walls(seed + 50), states)
    for _ in range(25):
        pose_a, pose_b = near_poses(rng)
        expected = naive.point_affinity(labels_a, labels_b, pose_a, pose_b, PATTERN)
        assert points_at(labels_a, labels_b, pose_a, pose_b) == pytest.approx(expected, abs=1e-12)


def test_points_beyond_the_raster_are_unknown():
    labels = np.pad(np.full((SIZE - 2, SIZE - 2), -1, np.int8), 1)
    wide = pattern_with(2.0)
    for offset in np.random.default_rng(2).uniform(-3.0, 3.0, (30, 3)):
        expected = naive.point_affinity(labels, labels, np.zeros(3), offset, wide)
        assert points_at(labels, labels, np.zeros(3), offset, wide) == pytest.approx(expected, abs=1e-12)
    assert points_at(labels, labels, np.zeros(3), np.array([9.0, 0.0, 0.0])) == 0.0


def test_scores_are_as_said():
    def full(label):
        return np.pad(np.full((SIZE - 2, SIZE - 2), label, np.int8), 1)

    near = pattern_with(0.1)
    home = np.zeros(3)
    for a, b, score in ((-1, -1, 0.22), (1, 1, 1.16), (1, -1, -1.3), (-1, 1, -1.3), (0, 1, 0.0), (-1, 0, 0.0)):
        assert points_at(full(a), full(b), home, home, near) == pytest.approx(score)


@pytest.mark.parametrize("seed", range(5))
def test_moving_both_vertices_together_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    walls_a, walls_b = random_walls(seed), random_walls(seed + 50)
    labels_a, labels_b = raster(walls_a), raster(walls_b)
    for _ in range(10):
        (pose_a, pose_b), motion = near_poses(rng), rng.uniform(-9.0, 9.0, 3)
        moved_a, moved_b = se2.compose(motion, pose_a), se2.compose(motion, pose_b)
        by_points = points_at(labels_a, labels_b, pose_a, pose_b)
        assert points_at(labels_a, labels_b, moved_a, moved_b) == pytest.approx(by_points, abs=1e-12)
        by_segments = segments_at(walls_a, walls_b, pose_a, pose_b)
        assert segments_at(walls_a, walls_b, moved_a, moved_b) == pytest.approx(by_segments, abs=1e-9)


def mean_affinity(measure, offset):
    """Mean over pairs in the room when the second pose is believed `offset` (3,) off, in its own frame."""
    return np.mean([measure(k, pose_a, se2.compose(pose_b, offset)) for k, (pose_a, pose_b, _, _) in enumerate(PAIRS)])


OFFSETS = [(0.15, 0, 0), (-0.15, 0, 0), (0, 0.15, 0), (0, -0.15, 0), (0.3, 0.3, 0), (0, 0, 0.15), (0, 0, -0.15)]


@pytest.mark.parametrize("states", [2, 3])
def test_points_tell_the_true_relative_pose(states):
    rasters = [(raster(walls_a, states), raster(walls_b, states)) for _, _, walls_a, walls_b in PAIRS]
    pattern = PATTERN if states == 3 else PATTERN._replace(both_free=1.0, both_wall=1.0, differ=-1.0)

    def measure(k, pose_a, pose_b):
        labels_a, labels_b = rasters[k]
        return points_at(labels_a, labels_b, pose_a, pose_b, pattern)

    true = mean_affinity(measure, (0.0, 0.0, 0.0))
    for offset in OFFSETS:
        assert mean_affinity(measure, offset) < true - 0.02, offset


def test_segments_tell_the_true_relative_pose():
    def measure(k, pose_a, pose_b):
        _, _, walls_a, walls_b = PAIRS[k]
        return segments_at(walls_a, walls_b, pose_a, pose_b)

    true = mean_affinity(measure, (0.0, 0.0, 0.0))
    for offset in OFFSETS:
        assert mean_affinity(measure, offset) < 0.9 * true, offset


@pytest.mark.parametrize("threshold", [-0.3, -0.1, 0.1])
def test_early_exit_returns_the_whole_mean_or_one_below_the_threshold(threshold):
    rng = np.random.default_rng(3)
    hasty = PATTERN._replace(early_exit=threshold)
    exits = 0
    for seed in range(60):
        labels_a, labels_b = raster(random_walls(seed)), raster(random_walls(seed + 100))
        pose_a, pose_b = near_poses(rng)
        whole, found = (points_at(labels_a, labels_b, pose_a, pose_b, pattern) for pattern in (PATTERN, hasty))
        assert found == pytest.approx(whole, abs=1e-12) or found < threshold
        assert found == pytest.approx(naive.point_affinity(labels_a, labels_b, pose_a, pose_b, hasty), abs=1e-12)
        exits += found != whole
    assert exits > 0


# Segments


@pytest.mark.parametrize("seed", range(6))
def test_segments_agree_with_pair_by_pair(seed):
    rng = np.random.default_rng(seed)
    walls_a, walls_b = random_walls(seed), random_walls(seed + 50)
    for _ in range(3):
        pose_a, pose_b = near_poses(rng)
        expected = naive.segment_affinity(walls_a, walls_b, pose_a, pose_b, 0.1)
        assert segments_at(walls_a, walls_b, pose_a, pose_b) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("n_rays", [120, 121, 8])
def test_segment_rows_are_the_walls_and_their_normals_point_away(n_rays):
    room = rectangle(0.0, 0.0, 1.2, 1.0)
    walls = cast(np.array([0.1, 0.05, 0.0]), room, n_rays, 2.0)
    rows = wall_segments(walls)
    assert rows.shape == (n_rays // 2, 5)
    kept = rows[rows[:, 4] > 0.0]
    assert len(kept) == len(naive.segments_of(walls))
    assert not rows[len(kept) :].any()
    np.testing.assert_allclose(np.hypot(kept[:, 2], kept[:, 3]), 1.0, atol=1e-12)
    assert np.all(np.sum(kept[:, :2] * kept[:, 2:4], axis=1) > 0.0)
    if n_rays == 120:
        assert kept[:, 4].sum() == pytest.approx(2.0 * (1.2 + 1.0), rel=0.03)


def line(bearing, length=24):
    """A straight wall across `bearing`, half a metre away."""
    rays = np.arange(-length // 2, length // 2 + 1)
    distances = np.full(N_RAYS, math.inf)
    distances[(round(bearing / (2.0 * math.pi) * N_RAYS) + rays) % N_RAYS] = 0.5 / np.cos(2.0 * math.pi * rays / N_RAYS)
    return Walls(distances, np.minimum(distances, REACH))


def test_walls_that_cross_at_right_angles_have_no_affinity():
    """The flaw that the thesis names (2.5): two such walls contradict each other, and segments do not notice."""
    home = np.zeros(3)
    middle = se2.compose((0.5, 0.0, math.pi / 2), se2.inverse((0.5, 0.0, 0.0)))  # turned about the wall's middle
    same = segments_at(line(0.0), line(0.0), home, home)
    assert same > 0.1
    assert segments_at(line(0.0), line(0.0), home, middle) == pytest.approx(0.0, abs=1e-9)
    back = se2.compose((0.5, 0.0, math.pi), se2.inverse((0.5, 0.0, 0.0)))
    assert segments_at(line(0.0), line(0.0), home, back) == pytest.approx(-same, rel=1e-6)


def test_points_do_notice_walls_that_cross_at_right_angles():
    labels = raster(line(0.0))
    middle = se2.compose((0.5, 0.0, math.pi / 2), se2.inverse((0.5, 0.0, 0.0)))
    assert points_at(labels, labels, np.zeros(3), middle) < 0.0 < points_at(labels, labels, np.zeros(3), np.zeros(3))


def test_affinity_of_segments_falls_exponentially_with_distance():
    """One segment against itself, moved along its normal."""
    distances = np.full(N_RAYS, math.inf)
    distances[:3] = 0.5 / np.cos(2.0 * math.pi * np.arange(3) / N_RAYS)
    walls = Walls(distances, np.zeros(N_RAYS))
    values = [segments_at(walls, walls, np.zeros(3), np.array([d, 0.0, 0.0])) for d in (0.0, 0.1, 0.2, 0.49, 0.51)]
    np.testing.assert_allclose(values[1:4], values[0] * np.exp([-1.0, -2.0, -4.9]), rtol=1e-6)
    assert values[4] == 0.0


# Points


def test_test_points_are_gaussian():
    points = gaussian_points(4096, 0.6)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.6 * 0.01)
    np.testing.assert_allclose(points.std(axis=0), 0.6, rtol=0.01)
    assert np.corrcoef(points.T)[0, 1] == pytest.approx(0.0, abs=0.01)
    ranks = (np.arange(4096) + 0.5) / 4096
    for axis in points.T:
        shares = [NormalDist(0.0, 0.6).cdf(value) for value in np.sort(axis)]
        np.testing.assert_allclose(shares, ranks, atol=0.01)


def test_fewer_test_points_are_the_first_of_more():
    """So that the early exit looks at an even spread, and more points cost nothing but time."""
    np.testing.assert_array_equal(gaussian_points(16, 0.6), gaussian_points(64, 0.6)[:16])
    np.testing.assert_allclose(gaussian_points(64, 1.2), 2.0 * gaussian_points(64, 0.6))
    assert np.abs(gaussian_points(64, 0.6).mean(axis=0)).max() < 0.05
