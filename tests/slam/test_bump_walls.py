"""Walls as curves: stretches meet in corners, a closed room is a closed curve, and errors of maps are what they are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_swarm import BEYOND, COLUMNS, HIGH, HITS, LOW, PHI
from slam.bump_walls import corners_of, crossing, distances, map_error, points_on, stretches, walls_of


def room(gap: float, sides: int = 4, radius: float = 0.75) -> np.ndarray:
    """Lines (sides, 10) of a regular room, felt up to `gap` m from its corners."""
    lines = np.zeros((sides, COLUMNS))
    half = radius * math.tan(math.pi / sides)
    lines[:, PHI] = np.arange(sides) * (2.0 * math.pi / sides)
    lines[:, BEYOND], lines[:, LOW], lines[:, HIGH], lines[:, HITS] = radius, gap - half, half - gap, 5.0
    return lines


@pytest.mark.parametrize("sides", [3, 4, 7, 12])
def test_a_room_is_a_closed_curve_with_its_corners(sides):
    walls = walls_of(room(0.05, sides))
    assert len(walls) == 1
    np.testing.assert_allclose(walls[0][0], walls[0][-1], atol=1e-12)
    assert len(walls[0]) == sides + 1
    np.testing.assert_allclose(np.hypot(*walls[0].T), 0.75 / math.cos(math.pi / sides), atol=1e-9)


def test_walls_far_from_a_corner_stay_apart():
    walls = walls_of(room(0.3))
    assert len(walls) == 4
    assert all(len(wall) == 2 for wall in walls)
    np.testing.assert_allclose(np.concatenate(walls).reshape(-1, 4), stretches(room(0.3)))


def test_what_one_bump_felt_is_no_wall():
    lines = room(0.05)
    lines[1, HITS] = 1.0
    assert len(walls_of(lines)) == 1
    assert len(walls_of(lines)[0]) == 4
    assert walls_of(lines[:0]) == []


def test_an_end_meets_one_other_only():
    lines = np.vstack([room(0.05), room(0.06)])
    taken = [end for one, two, _ in corners_of(stretches(lines).reshape(-1, 2, 2), 0.25) for end in (one, two)]
    assert len(taken) == len(set(taken)) > 4


def test_parallels_do_not_cross():
    one = np.array([[0.0, 0.0], [1.0, 0.0]])
    assert crossing(one, one + 0.1) is None
    met = crossing(one, np.array([[0.3, -1.0], [0.3, -0.5]]))
    assert met is not None
    np.testing.assert_allclose(met, [0.3, 0.0])


def test_the_error_of_a_map_is_its_distance_and_what_it_covers():
    true = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 1.0]])
    wall = np.array([[0.0, 0.02], [0.98, 0.02]])
    error, covered = map_error(np.array([[*wall[0], *wall[1]]]), points_on([wall]), true)
    assert error == pytest.approx(0.02, abs=1e-3)
    assert covered == pytest.approx(0.53, abs=0.02), "one of two walls, and a bit round the corner"
    assert map_error(np.zeros((0, 4)), np.zeros((0, 2)), true) == (math.inf, 0.0)
    assert np.all(np.isinf(distances(np.zeros((3, 2)), np.zeros((0, 4)))))


def test_points_lie_close_on_curves():
    points = points_on([np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]])], 0.01)
    assert np.max(np.hypot(*np.diff(points, axis=0).T)) <= 0.01
    assert np.max(distances(points, np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.5]]))) < 1e-12
