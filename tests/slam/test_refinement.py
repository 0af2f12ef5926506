"""Refinement: a path falls back onto the walls it saw, and never does worse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.motion import MotionParams
from slam.odometry_chain import motion_terms
from slam.pose import between, compose
from slam.refinement import Chain, Refinement, RefinementParams, refine
from slam.wall_matching import WallPoints

MOTION = MotionParams(turn_noise=0.03, distance_noise=0.03, turn_bias=0.02, scale_bias=0.02)


def ring(n_laps: float = 2.2, spacing: float = 0.5) -> np.ndarray:
    """True poses (n, 3) of a drive round an 8 x 5 m rectangle."""
    corners = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0]])
    sides = np.array([8.0, 5.0, 8.0, 5.0])
    poses = []
    for way in np.arange(0.0, n_laps * sides.sum(), spacing):
        rest, side = way % sides.sum(), 0
        while rest >= sides[side]:
            rest, side = rest - sides[side], side + 1
        poses.append([*corners[side] + rest * np.array([math.cos(side * math.pi / 2), math.sin(side * math.pi / 2)]),
                      side * math.pi / 2])  # fmt: skip
    return np.array(poses)


def seen_walls(poses: np.ndarray, reach: float = 1.6) -> WallPoints:
    """What stands within reach of each pose: corridor walls every 5 cm, and pillars at irregular places."""
    rng = np.random.default_rng(3)
    points, normals = [], []
    for low, high, out in ((0.8, 0.8, -1.0), (-0.8, -0.8, 1.0)):
        x0, x1, y0, y1 = low, 8.0 - high, low, 5.0 - high
        for x in np.arange(x0, x1, 0.05):
            points += [(x, y0), (x, y1)]
            normals += [(0.0, out), (0.0, -out)]
        for y in np.arange(y0, y1, 0.05):
            points += [(x0, y), (x1, y)]
            normals += [(out, 0.0), (-out, 0.0)]
    for _ in range(40):
        side, way = rng.integers(2), rng.uniform()
        x, y = (8.0 * way, 0.7 - 0.4 * side) if rng.integers(2) else (0.7 - 0.4 * side, 5.0 * way)
        for offset in np.arange(-0.15, 0.151, 0.05):
            points += [(x + offset, y), (x, y + offset)]
            normals += [(0.0, 1.0), (1.0, 0.0)]
    places, facing = np.array(points), np.array(normals)
    found, turned, starts = [], [], [0]
    for pose in poses:
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        turn = np.array([[cos, -sin], [sin, cos]])
        local = (places - pose[:2]) @ turn
        near = np.hypot(*local.T) < reach
        found.append(local[near])
        turned.append(facing[near] @ turn)
        starts.append(starts[-1] + int(near.sum()))
    return WallPoints(np.concatenate(found), np.concatenate(turned), np.array(starts, np.int64))


def perturbed(poses: np.ndarray, rng: np.random.Generator, turn: float, length: float) -> np.ndarray:
    """The same drive with errors of `turn` rad and `length` m in every motion."""
    path = [poses[0]]
    for motion in between(poses[:-1], poses[1:]):
        path.append(compose(path[-1], motion + rng.normal(size=3) * [length, 0.0, turn]))
    return np.array(path)


@pytest.mark.parametrize("seed", range(3))
def test_a_perturbed_path_comes_back_onto_noise_free_walls(seed):
    truth = ring()
    start = perturbed(truth, np.random.default_rng(seed), 0.004, 0.004)
    refined = refine(start, Chain.along(truth), seen_walls(truth), MOTION, RefinementParams(rounds=10))
    np.testing.assert_allclose(between(truth, refined.path), 0.0, atol=2e-3)


def test_the_cost_never_rises():
    truth = ring()
    start = perturbed(truth, np.random.default_rng(1), 0.01, 0.01)
    walls = seen_walls(truth)
    costs = [
        refine(start, Chain.along(start), walls, MOTION, RefinementParams(rounds=1, steps=steps)).cost
        for steps in (1, 2, 4, 8, 16)
    ]
    assert costs == sorted(costs, reverse=True)


@pytest.mark.parametrize("is_square", [True, False])
def test_a_square_building_is_refined_as_one_from_the_guess_on(is_square):
    truth = ring()
    rng = np.random.default_rng(5)
    guess = truth + rng.normal(0.0, [0.03, 0.03, 0.01], truth.shape)
    anyhow = rng.uniform(-np.pi, np.pi, len(truth))
    directions = np.exp(-4j * truth[:, 2] if is_square else 1j * anyhow)

    def problem() -> Refinement:
        return Refinement(Chain.along(guess), seen_walls(truth), MOTION, RefinementParams(), directions)

    assert (problem().squareness(guess) > 0.0) == is_square
    found = problem().refine(guess).path
    np.testing.assert_array_equal(found, problem().run(guess, is_square=is_square).path)
    assert not np.array_equal(found, problem().run(guess, is_square=not is_square).path)


def test_where_nothing_is_compiled_a_building_is_square_or_not_all_the_same(monkeypatch):
    """Uncompiled, the kernel sums in numpy's numbers, whose comparisons choose nothing out of a list."""
    monkeypatch.setattr("slam.refinement.motion_terms", motion_terms.py_func)
    truth = ring(0.5)
    refinement = Refinement(
        Chain.along(truth), seen_walls(truth), MOTION, RefinementParams(), np.exp(-4j * truth[:, 2])
    )
    assert refinement.squareness(truth) > 0.0
    for is_square in (refinement.squareness(truth) > 0.0, refinement.squareness(truth) < 0.0):
        assert np.all(np.isfinite(refinement.run(truth, is_square=is_square).path))
