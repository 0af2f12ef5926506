"""Maps laid over each other: the motion is found whatever the frames, and the shares say what truly agrees."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.map_alignment import Wall, agreement, align, moved, nearest, refine, walls_of
from slam.pose import between, compose, inverse
from tests.naive import map_alignment as naive

# An L of corridors with a niche and a pillar: no turn or shift but the true one fits.
CORNERS = "0 0, 12 0, 12 7, 10 7, 10 2, 6 2, 6 3, 4.5 3, 4.5 2, 0 2, 0 0", "2 0.8, 2.5 0.8, 2.5 1.3, 2 0.8"
BUILDING = [np.array([corner.split() for corner in wall.split(",")], float) for wall in CORNERS]
POSES = [(0.0, 0.0, 0.0), (3.0, -20.0, 0.5), (-8.0, 4.0, 3.0), (1.0, 1.0, -1.7), (0.2, 0.1, 0.05)]


def noisy(wall: Wall, seed: int, share: float = 1.0, sigma: float = 0.03) -> Wall:
    """Some of the walls, with errors."""
    rng = np.random.default_rng(seed)
    kept = rng.random(len(wall.points)) < share
    return Wall(wall.points[kept] + rng.normal(0.0, sigma, (int(kept.sum()), 2)), wall.normals[kept])


def test_nearest_agrees_with_looking_at_all():
    rng = np.random.default_rng(3)
    for radius in (0.1, 0.7, 5.0):
        points, others = rng.uniform(-3.0, 3.0, (60, 2)), rng.uniform(-3.0, 3.0, (50, 2))
        rows, distances = nearest(points, others, radius)
        expected_rows, expected = naive.nearest(points, others, radius)
        np.testing.assert_array_equal(rows, expected_rows)
        np.testing.assert_allclose(distances, expected)
    assert nearest(points, np.zeros((0, 2)), 1.0)[0].tolist() == [-1] * 60


@pytest.mark.parametrize("pose", POSES)
def test_the_motion_between_two_surveys_is_found(pose):
    first = noisy(walls_of(BUILDING), 1, 0.6)
    second = moved(noisy(walls_of(BUILDING), 2, 0.6), inverse(np.array(pose)))
    error = between(np.array(pose), align(first, second))
    assert np.hypot(*error[:2]) < 0.02
    assert abs(error[2]) < math.radians(0.3)


@pytest.mark.parametrize("pose", POSES)
def test_a_part_finds_its_place_in_the_whole(pose):
    whole = walls_of(BUILDING)
    part = noisy(whole, 5)
    inside = part.points[:, 0] > 5.0
    part = moved(Wall(part.points[inside], part.normals[inside]), inverse(np.array(pose)))
    found = align(whole, part)
    error = between(np.array(pose), found)
    assert np.hypot(*error[:2]) < 0.05
    shares = agreement(whole, moved(part, found))
    assert shares.second > 0.98
    assert 0.3 < shares.first < 0.8


def test_agreement_counts_walls_within_the_tolerance_both_ways():
    line = walls_of([np.array([[0.0, 0.0], [10.0, 0.0]])])
    half = walls_of([np.array([[0.0, 0.1], [5.0, 0.1]])])
    shares = agreement(line, half)
    assert shares.first == pytest.approx(0.5, abs=0.02)
    assert shares.second == 1.0
    assert shares.median == pytest.approx(0.1, abs=0.01)
    assert agreement(line, half, 0.05)[:2] == (0.0, 0.0)
    assert all(math.isnan(share) for share in agreement(line, walls_of([]))[:2])


def test_where_the_walls_do_not_tell_the_guess_does():
    room = walls_of([np.array([[-3.0, -1.0], [3.0, -1.0], [3.0, 1.0], [-3.0, 1.0], [-3.0, -1.0]])])
    for guess in (np.array([0.1, -0.1, 0.05]), np.array([0.1, -0.1, math.pi - 0.05])):
        found = align(room, noisy(room, 4), guess)
        assert abs(math.remainder(found[2] - guess[2], 2.0 * math.pi)) < 0.1
        assert np.hypot(*found[:2]) < 0.02


def test_maps_without_walls_are_left_where_they_are():
    wall = walls_of(BUILDING)
    np.testing.assert_array_equal(align(wall, walls_of([])), np.zeros(3))
    np.testing.assert_array_equal(align(walls_of([np.zeros((3, 2))]), wall), np.zeros(3))


def test_refining_mends_a_small_error_and_slides_nowhere_along_a_corridor():
    corridor = walls_of([np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([[0.0, 2.0], [10.0, 2.0]])])
    pose = refine(corridor, corridor, np.array([0.1, 0.15, 0.02]))
    assert abs(pose[1]) < 1e-3
    assert abs(pose[2]) < 1e-3
    assert abs(pose[0]) < 0.12


def test_walls_are_spaced_evenly_with_unit_normals():
    wall = walls_of([np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])], 0.05)
    gaps = np.hypot(*np.diff(wall.points, axis=0).T)
    assert gaps.max() < 0.051
    np.testing.assert_allclose(np.hypot(*wall.normals.T), 1.0)
    np.testing.assert_allclose(np.abs(wall.normals[0]), [0.0, 1.0], atol=1e-12)


def test_moving_there_and_back_changes_nothing():
    wall, pose = walls_of(BUILDING), np.array([1.0, -2.0, 0.7])
    back = moved(moved(wall, pose), inverse(pose))
    np.testing.assert_allclose(back.points, wall.points, atol=1e-12)
    np.testing.assert_allclose(back.normals, wall.normals, atol=1e-12)
    np.testing.assert_allclose(compose(pose, inverse(pose)), np.zeros(3), atol=1e-12)
