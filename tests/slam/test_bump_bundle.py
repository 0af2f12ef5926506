"""Least squares over bumps: derivatives are those of the cost, motions those of a twin, and biases are found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_bundle import KINDS, BumpBundle, composed, covariances_of, motions_of
from slam.bump_mapper import BumpMapperParams
from slam.bump_refinement import legs_of
from slam.bump_swarm import COLUMNS, PHI
from slam.cart_odometry import CartParams, Stage
from slam.pose import between
from slam.pose_graph import descend, relative_jacobians
from tests.naive import bumps_felt as naive
from tests.slam.bump_world import AREAS, run

CART = CartParams()
MODEL = BumpMapperParams().model(CART)


def bundle_of(seed: int, bumps: int = 8) -> tuple[BumpBundle, np.ndarray, np.ndarray]:
    """A bundle of a short run, poses beside the truth, and unknowns beside what is right."""
    rng = np.random.default_rng(seed)
    stages, truth = run(AREAS["square"], seed, bumps)
    legs, bumpers = legs_of(stages)
    nodes = truth[np.sort(np.concatenate([legs.bounds]))]
    lines = np.zeros((4, COLUMNS))
    lines[:, PHI] = [-0.5 * math.pi, 0.0, 0.5 * math.pi, math.pi]
    beyond = np.array([0.0, 1.5, 1.5, 0.0])
    outward = np.column_stack([np.cos(lines[:, PHI]), np.sin(lines[:, PHI])])
    ends = nodes[1::2]
    gaps = beyond - ends[:, :2] @ outward.T + 2.0 * (np.cos(ends[:, 2:] - lines[:, PHI]) < 0.2)
    felt = np.full(len(nodes), -1)
    felt[1::2] = np.where(bumpers > 0, np.argmin(gaps, axis=1), -1)
    shared = np.concatenate([[0.01, -0.02], np.column_stack([lines[:, PHI], beyond]).reshape(-1)])
    bundle = BumpBundle(legs, felt, lines, MODEL, (0.03, 0.04))
    off = rng.normal(0.0, 0.003, nodes.shape)
    return bundle, nodes + off, shared + rng.normal(0.0, 0.003, len(shared))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_derivatives_are_those_of_the_cost(seed):
    bundle, nodes, shared = bundle_of(seed)
    _, terms, border = bundle.linearize(nodes, shared)
    for b in range(len(shared)):
        sides = []
        for off in (1e-6, -1e-6):
            moved = shared.copy()
            moved[b] += off
            sides.append(bundle.linearize(nodes, moved)[0])
        slope = (sides[0] - sides[1]) / 2e-6
        assert border.gradient[b] == pytest.approx(slope, abs=2e-3 * (1.0 + abs(slope))), b
    gradient = border.pose_gradients.copy()
    by_a, by_b = np.empty((3, 3)), np.empty((3, 3))
    for leg in range(len(nodes) - 1):
        relative_jacobians(nodes[leg], nodes[leg + 1], by_a, by_b)
        gradient[leg] += by_a.T @ terms.gradients[leg]
        gradient[leg + 1] += by_b.T @ terms.gradients[leg]
    for k in range(len(nodes)):
        for axis in range(3):
            sides = []
            for off in (1e-7, -1e-7):
                moved = nodes.copy()
                moved[k, axis] += off
                sides.append(bundle.linearize(moved, shared)[0])
            slope = (sides[0] - sides[1]) / 2e-7
            assert gradient[k, axis] == pytest.approx(slope, abs=5e-3 * (1.0 + abs(slope))), (k, axis)


@pytest.mark.parametrize("veer", [0.0, 0.3])
def test_a_motion_is_its_stages_one_after_the_other(veer):
    rng, cart = np.random.default_rng(4), CART._replace(veer=veer)
    for _ in range(20):
        stages = rng.integers(-300, 300, (4, 3)).astype(float)
        biases = rng.normal(0.0, 0.05, 2)
        out = np.empty(3)
        composed(stages, biases, MODEL._replace(veer=veer), 0.0, 0.0, -1, out)
        off = between(naive.composed(stages, biases, cart), out)
        np.testing.assert_allclose(off, 0.0, atol=1e-9)


def test_covariances_are_symmetric_and_slips_are_the_larger_ones():
    stages, _ = run(AREAS["square"], 1, 5)
    legs, _ = legs_of(stages)
    covariances = np.empty((KINDS, len(legs.bounds) - 1, 3, 3))
    covariances_of(legs, MODEL, covariances)
    np.testing.assert_allclose(covariances, np.swapaxes(covariances, 2, 3), atol=1e-12)
    assert np.all(np.linalg.eigvalsh(covariances) > 0.0)
    is_drive = np.arange(len(legs.bounds) - 1) % 2 == 0
    assert np.all(covariances[1, is_drive, 2, 2] >= covariances[0, is_drive, 2, 2] + MODEL.slip_turn**2 - 1e-9)
    assert np.all(covariances[2, ~is_drive, 2, 2] > covariances[0, ~is_drive, 2, 2])
    assert np.all(covariances[3, is_drive, 2, 2] >= covariances[0, is_drive, 2, 2] + MODEL.drag_turn**2 - 1e-9)
    np.testing.assert_array_equal(covariances[3, ~is_drive], covariances[0, ~is_drive])


def test_lines_that_are_held_stay_and_hold_the_poses():
    stages, _ = run(AREAS["square"], 3, 12)
    bundle, nodes, shared = bundle_of(3, 12)
    lines = np.zeros((4, COLUMNS))
    lines[:, PHI] = shared[2::2]
    held = np.array([True, False, True, False])
    there = BumpBundle(legs_of(stages)[0], bundle.felt, lines, MODEL, (0.03, 0.04), held)
    before, _, _ = there.linearize(nodes, shared)
    _, found, after = descend(there, nodes, shared, 15)
    assert after < before
    np.testing.assert_array_equal(found[[2, 3, 6, 7]], shared[[2, 3, 6, 7]])
    assert np.all(found[[8, 9]] != shared[[8, 9]])


def test_legs_are_drives_and_what_lies_between():
    stages = [Stage(1, -5, -5), Stage(0, 9, 9, 2), Stage(1, -3, -3), Stage(2, 4, -4), Stage(0, 7, 7), Stage(1, -1, -1)]
    legs, bumpers = legs_of(stages)
    assert legs.bounds.tolist() == [1, 2, 4, 5]
    assert bumpers.tolist() == [2, 0]
    assert legs.slips_last.tolist() == [True, False, False]
    motions, by_biases = np.empty((3, 3)), np.empty((3, 3, 2))
    motions_of(legs, np.zeros(2), MODEL, motions, by_biases)
    assert motions[0] == pytest.approx([9 * CART.tick, 0.0, 0.0])
    assert motions[1, 2] == pytest.approx(-8 * CART.tick / CART.wheelbase)


def test_descent_finds_the_wheelbase_of_a_long_run():
    """The cart of seed 11 differs from what was told; 150 bumps in known tellings show by how much."""
    bundle, nodes, shared = bundle_of(11, 150)
    shared[:2] = 0.0
    before = bundle.linearize(nodes, shared)[0]
    _, found, cost = descend(bundle, nodes, shared, 40)
    assert cost < before
    from tests.slam.bump_world import SmallCart

    cart = SmallCart(AREAS["square"], 11)
    assert found[0] == pytest.approx(CART.wheelbase / cart.own.wheelbase - 1.0, abs=0.012)
