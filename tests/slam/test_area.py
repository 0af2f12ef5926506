"""Areas: distances from walls, inside and outside, and outlines of grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.area import (
    BETWEEN,
    area_of,
    clearance,
    is_inside,
    nearest_wall,
    outlines_of_grid,
    outward_normal,
    surface,
    symmetries,
)
from tests.naive import bumps as naive
from tests.slam.cart_areas import CUT, PILLAR, RECTANGLE

PLACES = np.random.default_rng(3).uniform([-0.04, -0.04], [1.54, 1.14], (300, 2))


def closed(ring):
    return np.vstack([ring, ring[:1]])


@pytest.mark.parametrize("outlines", [RECTANGLE, CUT, PILLAR])
def test_distance_and_inside_agree_with_trying_every_wall(outlines):
    area = area_of(outlines)
    for x, y in PLACES:
        distance, near_x, near_y, wall = nearest_wall(area.walls, x, y)
        assert distance == pytest.approx(naive.distance(area.walls, x, y)[0], abs=1e-12)
        assert math.dist((x, y), (near_x, near_y)) == pytest.approx(distance, abs=1e-12)
        assert naive.distance(area.walls[wall : wall + 1], near_x, near_y)[0] < 1e-12
        inside = is_inside(area.walls, x, y)
        assert inside == naive.is_inside(area.walls, x, y)
        signed = distance if inside else -distance
        assert abs(clearance(area, x, y) - signed) <= BETWEEN * area.spacing


def test_clearance_falls_on_beyond_the_lattice():
    area = area_of(RECTANGLE)
    assert clearance(area, -5.0, 0.5) == pytest.approx(-5.0, abs=area.spacing)


@pytest.mark.parametrize(
    ("place", "normal"),
    [
        ((0.1, 0.5), (-1, 0)),
        ((-0.1, 0.5), (-1, 0)),
        ((0.0, 0.5), (-1, 0)),
        ((1.3, 0.94), (1, 1)),
        ((0.75, 0.01), (0, -1)),
    ],
)
def test_normals_point_out(place, normal):
    np.testing.assert_allclose(outward_normal(area_of(CUT), *place), np.array(normal) / math.hypot(*normal), atol=1e-9)


def test_the_normal_of_an_obstacle_points_into_it():
    area = area_of([*RECTANGLE, np.array([[0.5, 0.5], [0.7, 0.5], [0.7, 0.7], [0.5, 0.7]])])
    np.testing.assert_allclose(outward_normal(area, 0.45, 0.6), [1.0, 0.0], atol=1e-9)
    assert not is_inside(area.walls, 0.6, 0.6)


def test_rings_may_be_closed_or_open():
    np.testing.assert_array_equal(area_of([closed(CUT[0])]).walls, area_of(CUT).walls)


@pytest.mark.parametrize(
    "outlines", [[], [np.zeros((2, 2))], [np.array([[0.0, 0.0], [1.0, math.nan], [1.0, 1.0]])], [np.zeros((4, 3))]]
)
def test_what_is_no_area_is_refused(outlines):
    with pytest.raises(ValueError, match="outline"):
        area_of(outlines)


def test_outlines_of_a_grid_are_those_it_was_drawn_from():
    resolution = 0.02
    rows, columns = np.indices((70, 90))
    x, y = -0.1 + resolution * (columns + 0.5), -0.05 + resolution * (rows + 0.5)
    true = area_of(PILLAR)
    free = np.reshape([is_inside(true.walls, *place) for place in zip(x.ravel(), y.ravel(), strict=True)], x.shape)
    free[68, 2] = True  # a speck elsewhere
    outlines = outlines_of_grid(free, resolution, -0.1, -0.05)
    assert len(outlines) == 2
    for ring, drawn in zip(outlines, PILLAR, strict=True):
        off = [naive.distance(true.walls, *corner)[0] for corner in ring]
        assert max(off) < 1.5 * resolution
        assert abs(surface(ring)) == pytest.approx(abs(surface(closed(drawn))), rel=0.1)
    assert len(outlines[0]) < 20  # straight walls are few pieces


def test_a_grid_without_floor_is_refused():
    with pytest.raises(ValueError, match="free"):
        outlines_of_grid(np.zeros((5, 5), bool), 0.05)


@pytest.mark.parametrize(("n", "squeeze", "found"), [(4, 0.7, 2), (4, 1.0, 4), (3, 1.0, 3), (6, 1.0, 6), (5, 0.8, 1)])
def test_symmetric_rooms_are_noticed(n, squeeze, found):
    bearings = (np.arange(n) + 0.5) * (2.0 * math.pi / n)
    room = area_of([np.column_stack([np.cos(bearings), squeeze * np.sin(bearings)]) + [0.3, 2.0]])
    motions = symmetries(room, 0.01)
    assert len(motions) == found
    for motion in motions:
        corners = room.walls[:, :2] @ np.array(
            [[math.cos(motion[2]), math.sin(motion[2])], [-math.sin(motion[2]), math.cos(motion[2])]]
        )
        assert max(naive.distance(room.walls, *corner)[0] for corner in corners + motion[:2]) < 1e-9


def test_the_papers_room_has_no_symmetry():
    assert len(symmetries(area_of(CUT), 0.05)) == 1
    np.testing.assert_array_equal(symmetries(area_of(CUT), 0.05)[0], np.zeros(3))
