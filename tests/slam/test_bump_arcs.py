"""Round walls: circles are found through bumpers that touch them, and arcs only where the walls are round."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_arcs import Rounded, arc_of, candidates, fit_circle, with_arcs
from slam.bump_mapper import BumpMapperParams
from slam.bump_refinement import Refined, legs_of, refine, tell
from slam.bump_swarm import COLUMNS, HIGH, HITS, LOW, PHI, X, Y
from slam.cart_odometry import CartParams
from tests.slam.bump_world import AREAS, edges_of, run

CART = CartParams()
PARAMS = BumpMapperParams()
MODEL = PARAMS.model(CART)
TRUE = np.array([0.4, -0.2, 0.5])


def bumps_on_circle(n: int, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """Poses (n, 3) whose bumper's farther end is on the circle, at bearings over 200 degrees."""
    rng = np.random.default_rng(seed)
    bearings = rng.uniform(-1.7, 1.7, n)
    side = rng.choice([-1.0, 1.0], n)
    headings = bearings + side * rng.uniform(0.2, 0.9, n)
    ends = TRUE[:2] + (TRUE[2] + noise * rng.standard_normal(n))[:, None] * np.column_stack(
        [np.cos(bearings), np.sin(bearings)]
    )
    forward = np.column_stack([np.cos(headings), np.sin(headings)])
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    across = -np.sign(np.sin(headings - bearings)) * 0.5 * CART.bumper_width  # the end that leads
    return np.column_stack([ends - CART.bumper_ahead * forward - across[:, None] * left, headings])


def test_a_circle_is_found_through_the_bumpers_ends():
    circle = fit_circle(bumps_on_circle(30), CART, MODEL.contact)
    assert circle is not None
    np.testing.assert_allclose(circle, TRUE, atol=1e-6)


def test_strays_do_not_pull_a_circle():
    poses = bumps_on_circle(40, 0.004, 3)
    poses[:3, :2] *= 0.6
    circle = fit_circle(poses, CART, MODEL.contact)
    assert circle is not None
    np.testing.assert_allclose(circle, TRUE, atol=0.01)


def test_bumps_on_a_straight_wall_make_no_circle():
    places = np.linspace(0.0, 1.0, 20)
    assert fit_circle(np.column_stack([np.zeros(20), places, np.full(20, 0.3)]), CART, MODEL.contact) is None


def test_an_arc_leaves_out_the_widest_gap_between_its_bumps():
    arc = arc_of(TRUE, bumps_on_circle(60), CART)
    assert arc.hits == 60
    assert arc.low == pytest.approx(-1.7, abs=0.2)
    assert arc.sweep == pytest.approx(3.4, abs=0.3)
    np.testing.assert_allclose(np.hypot(*(arc.curve - TRUE[:2]).T), TRUE[2])
    assert np.max(np.hypot(*np.diff(arc.curve, axis=0).T)) < 0.06


def outline(facets: int) -> np.ndarray:
    """A room of 1.1 x 0.8 m with a round end of so many facets."""
    bearings = -0.5 * math.pi + np.arange(1, facets) * math.pi / facets
    end = np.array([1.1, 0.4]) + 0.4 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return np.vstack([[(0.0, 0.0), (1.1, 0.0)], end, [(1.1, 0.8), (0.0, 0.8)]])


def rounded(true: np.ndarray, told: np.ndarray, seed: int) -> tuple[Refined, Rounded]:
    """A run of 70 bumps in a true outline, refined from its true path and the walls that another tells; and arcs."""
    stages, truth = run([true], seed, 70)
    legs, bumpers = legs_of(stages)
    nodes = truth[legs.bounds]
    edges = edges_of([told])
    lines = np.zeros((len(edges), COLUMNS))
    lines[:, X], lines[:, Y] = 0.5 * (edges[:, 0] + edges[:, 2]), 0.5 * (edges[:, 1] + edges[:, 3])
    along = edges[:, 2:] - edges[:, :2]
    lines[:, PHI] = np.arctan2(along[:, 1], along[:, 0]) - 0.5 * math.pi
    lines[:, HIGH] = 0.5 * np.hypot(*along.T)
    lines[:, LOW], lines[:, HITS] = -lines[:, HIGH], 5.0
    felt = np.full(len(bumpers), -1)
    tell(nodes[1::2], bumpers, lines, MODEL, felt)
    start = Refined(nodes, felt, lines, np.zeros(2), 0.0)
    state = refine(legs, bumpers, start, MODEL, PARAMS.spreads, PARAMS.refinement)
    return state, with_arcs(legs, state, MODEL, CART, PARAMS.spreads, PARAMS.refinement)


def test_a_round_end_that_was_told_as_straight_walls_becomes_an_arc():
    """In one run at least of three; where stretches were joined into long ones it may stay straight."""
    found = [rounded(outline(24), outline(4), seed)[1] for seed in (1, 2, 3)]
    radii = [max(each.arcs, key=lambda arc: arc.hits).radius for each in found if each.arcs]
    assert radii, found
    assert np.median(np.abs(np.array(radii) - 0.4)) < 0.03, radii
    assert any(np.any(each.is_replaced) for each in found)


def test_straight_walls_stay_straight_though_arcs_were_tried():
    """Those of an octagon, whose facets of 0.6 m stand off a circle by no more than 6 cm."""
    room = AREAS["octagon"][0]
    tried = 0
    for seed in (1, 2, 3):
        state, found = rounded(room, room, seed)
        tried += len(candidates(state, MODEL, CART))
        assert found.arcs == [], (seed, found.arcs)
        assert not np.any(found.is_replaced)
    assert tried > 0
