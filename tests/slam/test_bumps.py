"""First contacts and the bump space agree with their slow twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.area import area_of, is_inside
from slam.bumps import HEADINGS, band_of, bumper_gap, drive_until_contact, in_bump_space
from slam.cart_odometry import CartParams
from tests.naive import bumps as naive
from tests.slam.cart_areas import CUT, PILLAR, RECTANGLE

CART = CartParams()
AHEAD, HALF = CART.bumper_ahead, 0.5 * CART.bumper_width


def poses_within(area, n, seed):
    """(n, 3) with the whole cart on the floor."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < n:
        x, y, heading = rng.uniform([0.0, 0.0, -math.pi], [1.5, 1.15, math.pi])
        ends = naive.bumper(x, y, heading, AHEAD, HALF)
        is_free = naive.distance(area.walls, x, y)[0] > 0.15 and all(is_inside(area.walls, *end) for end in ends)
        if is_free and is_inside(area.walls, x, y):
            found.append((x, y, heading))
    return np.array(found)


def first_contact(area, pose, curvature, reach):
    return drive_until_contact(area, pose[0], pose[1], pose[2], curvature, reach, AHEAD, HALF)


@pytest.mark.parametrize("outlines", [RECTANGLE, PILLAR])
@pytest.mark.parametrize("curvature", [0.0, 0.7, -2.0])
def test_contacts_agree_with_small_steps(outlines, curvature):
    area = area_of(outlines)
    for pose in poses_within(area, 12, seed=5):
        contact = first_contact(area, pose, curvature, 1.2)
        slow = naive.way_until_contact(area.walls, pose, curvature, 1.2, AHEAD, HALF)
        assert contact.way == slow or abs(contact.way - slow) < 1.5e-3


def test_a_contact_tells_where_on_the_bumper_and_which_wall():
    area = area_of(RECTANGLE)
    straight = drive_until_contact(area, 0.5, 0.5, 0.0, 0.0, 3.0, AHEAD, HALF)
    assert straight.way == pytest.approx(1.0 - AHEAD)
    assert (straight.x, straight.y, straight.heading) == pytest.approx((1.5 - AHEAD, 0.5, 0.0))
    assert straight.wall == 1
    left = drive_until_contact(area, 0.5, 0.5, -0.3, 0.0, 3.0, AHEAD, HALF)
    right = drive_until_contact(area, 0.5, 0.5, 0.3, 0.0, 3.0, AHEAD, HALF)
    assert left.across == pytest.approx(HALF)
    assert right.across == pytest.approx(-HALF)
    assert drive_until_contact(area, 0.5, 0.5, 0.0, 0.0, 0.5, AHEAD, HALF).wall == -1


def test_a_thin_corner_between_the_bumpers_ends_is_felt():
    spike = np.array([[1.0, 0.51], [1.4, 0.5], [1.4, 0.52]])
    contact = drive_until_contact(area_of([*RECTANGLE, spike]), 0.5, 0.5, 0.0, 0.0, 3.0, AHEAD, HALF)
    assert contact.way == pytest.approx(0.5 - AHEAD)
    assert contact.across == pytest.approx(0.01)


def test_a_wall_behind_the_axle_is_none_and_one_before_it_is_felt_at_once():
    walls = area_of(RECTANGLE).walls
    assert bumper_gap(walls, 1.6, 0.5, 0.0, AHEAD, HALF)[0] == math.inf
    assert bumper_gap(walls, 1.45, 0.5, 0.0, AHEAD, HALF)[0] == pytest.approx(0.05 - AHEAD)
    assert drive_until_contact(area_of(RECTANGLE), 1.45, 0.5, 0.0, 0.0, 3.0, AHEAD, HALF).way == 0.0


@pytest.mark.parametrize("outlines", [CUT, PILLAR])
def test_bump_space_is_as_the_paper_says_it(outlines):
    area = area_of(outlines)
    poses = np.random.default_rng(8).uniform([-0.1, -0.1, -4.0], [1.6, 1.3, 4.0], (4000, 3))
    found = in_bump_space(area, poses, CART, 0.03)
    true = [naive.in_bump_space(area.walls, pose, AHEAD, HALF, 0.03) for pose in poses]
    assert 0.02 < np.mean(found) < 0.3
    assert np.mean(found != true) < 0.01  # those at the band's edges, for the lattice's distances are rounded


@pytest.mark.parametrize("outlines", [CUT, PILLAR])
def test_every_contact_is_in_bump_space(outlines):
    area = area_of(outlines)
    contacts = [first_contact(area, pose, 0.3, 3.0) for pose in poses_within(area, 60, seed=6)]
    ends = np.array([(contact.x, contact.y, contact.heading) for contact in contacts])
    at_ends = np.array([abs(abs(contact.across) - HALF) < 1e-6 for contact in contacts])
    assert at_ends.sum() > 40  # the three points miss a corner between them
    assert np.all(in_bump_space(area, ends[at_ends], CART, 0.01))
    turned = ends + [0.0, 0.0, math.pi]
    assert not np.any(in_bump_space(area, turned, CART, 0.01))


def test_the_band_is_the_bump_space_summed_over_headings():
    area = area_of(PILLAR)
    band = band_of(area, CART, 0.001)
    assert band.shares.shape == area.distances.shape
    headings = 2.0 * math.pi * (np.arange(HEADINGS) + 0.5) / HEADINGS
    rng = np.random.default_rng(3)
    near = np.argwhere(np.abs(area.distances) < 0.12)
    for row, column in rng.permutation(near)[:200]:
        place = [area.x + area.spacing * column, area.y + area.spacing * row]
        poses = np.column_stack([np.tile(place, (HEADINGS, 1)), headings])
        tolerance = max(0.001, area.spacing)  # no thinner than the nodes stand apart
        assert band.shares[row, column] == pytest.approx(in_bump_space(area, poses, CART, tolerance).mean())
    far = (area.distances > math.hypot(AHEAD, HALF) + area.spacing) | (area.distances <= 0.0)
    assert not band.shares[far].any()
