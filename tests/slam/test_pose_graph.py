"""Normal equations: derivatives are those of the cost, covariances those of the errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.motion import MotionParams
from slam.odometry_chain import Chain, motion_sigmas, seat_covariances
from slam.pose import between, compose
from slam.pose_covariance import Covariances
from slam.pose_graph import LoopEdges, NormalEquations, descend
from slam.refinement import Problem
from slam.wall_matching import Matching, Nearness, WallMatches, wall_points
from tests.naive import odometry_chain as naive
from tests.slam.drives import laps

MOTION = MotionParams(turn_noise=0.05, distance_noise=0.05, rotation_noise=0.02, turn_bias=0.02, scale_bias=0.03)


def noisy_path(n: int, rng: np.random.Generator) -> np.ndarray:
    """A winding path (n, 3)."""
    path = [np.array([1.0, -2.0, 0.4])]
    for _ in range(n - 1):
        path.append(compose(path[-1], rng.normal(size=3) * [0.1, 0.05, 0.5] + [0.5, 0.0, 0.0]))
    return np.array(path)


def some_problem(seed: int) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Everything pulls: motions, biases, directions, loop edges and walls; with poses and shared unknowns."""
    rng = np.random.default_rng(seed)
    drive = laps(1.3, noise=0.5, seed=seed)
    poses, n = drive.odometry, len(drive.odometry)
    walls = WallMatches(wall_points(drive.walls))
    walls.associate(poses, Nearness(1.0, 3, 8), Matching(0.5, 0.5, 0.1, 0.2))
    pairs = np.array([[0, 9], [3, 20], [12, 5]])
    edges = LoopEdges(
        pairs, between(poses[pairs[:, 0]], poses[pairs[:, 1]]) + rng.normal(size=(3, 3)) * 0.1,
        np.broadcast_to(np.diag([30.0, 40.0, 50.0]), (3, 3, 3)), 2.0,
    )  # fmt: skip
    directions = rng.normal(size=n) * np.exp(1j * rng.normal(size=n))
    problem = Problem(Chain.along(drive.odometry, drive.travelled), MOTION, [walls, edges], directions, 0.2)
    return problem, poses + rng.normal(size=poses.shape) * 0.02, rng.normal(size=3) * [0.02, 0.02, 0.3]


@pytest.mark.parametrize("seed", range(3))
def test_gradients_are_those_of_the_cost(seed):
    problem, poses, shared = some_problem(seed)
    _, terms, border = problem.linearize(poses, shared)
    equations = NormalEquations(poses, terms, border)
    gradient = np.concatenate([equations.gradient, border.gradient])
    step = 1e-6

    def cost(change: np.ndarray) -> float:
        moved = poses.copy()
        moved[1:] += change[:-3].reshape(-1, 3)
        return problem.linearize(moved, shared + change[-3:])[0]

    for k in range(0, gradient.size, 1 if gradient.size < 100 else 7):
        unit = np.zeros(gradient.size)
        unit[k] = step
        slope = (cost(unit) - cost(-unit)) / (2.0 * step)
        np.testing.assert_allclose(gradient[k], slope, rtol=1e-4, atol=1e-3)


def test_motions_cost_what_the_model_says():
    problem, poses, shared = some_problem(4)
    chain = problem.chain
    alone = Problem(chain, MOTION, [], np.zeros(len(poses), complex), 0.2)
    prior = 0.5 * float(np.sum(alone.precisions * shared**2))
    expected = naive.cost(poses, chain.motions, chain.travelled, motion_sigmas(chain, MOTION), shared[:2])
    assert alone.linearize(poses, shared)[0] - prior == pytest.approx(expected)


def test_hessian_of_exact_motions_is_that_of_the_cost():
    """Gauss and Newton leave out what residuals multiply: without residuals nothing is missing."""
    rng = np.random.default_rng(0)
    poses = noisy_path(6, rng)
    problem = Problem(Chain.along(poses), MOTION, [], np.zeros(6, complex), 0.5)
    _, terms, border = problem.linearize(poses, np.zeros(3))
    equations = NormalEquations(poses, terms, border)
    hessian = np.block([[equations.matrix.toarray(), equations.mixed], [equations.mixed.T, border.hessian]])

    def gradient(change: np.ndarray) -> np.ndarray:
        moved = poses.copy()
        moved[1:] += change[:-3].reshape(-1, 3)
        _, terms_there, border_there = problem.linearize(moved, change[-3:])
        return np.concatenate([NormalEquations(moved, terms_there, border_there).gradient, border_there.gradient])

    step = 1e-6
    units = step * np.eye(len(hessian))
    found = np.array([(gradient(unit) - gradient(-unit)) / (2.0 * step) for unit in units])
    np.testing.assert_allclose(found, hessian, rtol=1e-5, atol=1e-3 * np.abs(hessian).max())


def test_a_step_solves_the_whole_system():
    problem, poses, shared = some_problem(1)
    _, terms, border = problem.linearize(poses, shared)
    equations = NormalEquations(poses, terms, border)
    whole = np.block([[equations.matrix.toarray(), equations.mixed], [equations.mixed.T, border.hessian]])
    expected = -np.linalg.solve(whole, np.concatenate([equations.gradient, border.gradient]))
    moved, change = equations.step(0.0)
    np.testing.assert_allclose(np.concatenate([moved[1:].ravel(), change]), expected, rtol=1e-4, atol=1e-7)
    assert not moved[0].any()


def test_covariances_are_blocks_of_the_inverse():
    problem, poses, shared = some_problem(2)
    _, terms, border = problem.linearize(poses, shared)
    equations = NormalEquations(poses, terms, border)
    whole = np.block([[equations.matrix.toarray(), equations.mixed], [equations.mixed.T, border.hessian]])
    inverse = np.zeros((len(whole) + 3, len(whole) + 3))
    inverse[3:, 3:] = np.linalg.inv(whole)
    covariances = Covariances(equations)
    marginals = covariances.marginals()
    for viewer in (0, 4, len(poses) - 1):
        mixed = covariances.with_node(viewer)
        for node in range(len(poses)):
            rows, columns = slice(3 * node, 3 * node + 3), slice(3 * viewer, 3 * viewer + 3)
            np.testing.assert_allclose(marginals[node], inverse[rows, rows], rtol=1e-5, atol=1e-8)
            np.testing.assert_allclose(mixed[node], inverse[rows, columns], rtol=1e-5, atol=1e-8)
    assert np.all(np.linalg.eigvalsh(covariances.seen_from(7, marginals)[8:]) > 0.0)


def test_what_a_pose_errs_by_itself_is_added_to_it_alone():
    problem, poses, shared = some_problem(3)
    _, terms, border = problem.linearize(poses, shared)
    equations = NormalEquations(poses, terms, border)
    seats = seat_covariances(poses, problem.sigmas)
    without, covariances = Covariances(equations), Covariances(equations, seats)
    marginals = covariances.marginals()
    np.testing.assert_allclose(marginals, without.marginals() + seats)
    for viewer in (0, 6):
        seen, before = covariances.seen_from(viewer, marginals), without.seen_from(viewer, without.marginals())
        np.testing.assert_allclose(seen[viewer], 0.0, atol=1e-12, err_msg="a node sees itself where it is")
        others = np.arange(len(poses)) != viewer
        assert np.all(np.linalg.eigvalsh(seen[others] - before[others]) > -1e-12)


def test_a_pose_errs_against_its_walls_along_its_heading_as_lengths_do():
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, math.pi / 2], [0.0, 1.0, math.pi / 2]])
    sigmas = np.array([[9.0, 9.0, 9.0], [0.03, 0.04, 0.01], [0.01, 0.02, 0.01]])  # the first row means nothing
    seats = seat_covariances(poses, sigmas)
    np.testing.assert_allclose(np.diagonal(seats, axis1=1, axis2=2), [
        [0.04**2, 0.01**2, 0.03**2], [0.01**2, 0.5 * (0.04**2 + 0.02**2), 0.5 * (0.03**2 + 0.01**2)],
        [0.01**2, 0.02**2, 0.01**2],
    ], atol=1e-15)  # fmt: skip


def test_errors_are_as_large_as_the_covariances_say():
    """Mean of e' C^-1 e over drawn problems, 3 degrees of freedom: 3 within what 300 draws allow."""
    rng = np.random.default_rng(5)
    truth = noisy_path(12, rng)
    chain, pairs = Chain.along(truth), np.array([[0, 10], [2, 8]])
    sigmas, edge_sigmas = motion_sigmas(chain, MOTION), np.array([0.02, 0.03, 0.02])
    squares = []
    for _ in range(300):
        bias = rng.normal(size=2) * [MOTION.turn_bias, MOTION.scale_bias]
        motions = np.array([erring(chain, v, sigmas[v] * rng.normal(size=3), bias) for v in range(len(truth))])
        measured = between(truth[pairs[:, 0]], truth[pairs[:, 1]]) + rng.normal(size=(2, 3)) * edge_sigmas
        edges = LoopEdges(pairs, measured, np.broadcast_to(np.diag(edge_sigmas**-2.0), (2, 3, 3)))
        problem = Problem(Chain(motions, chain.travelled), MOTION, [edges], np.zeros(len(truth), complex), 0.5)
        problem.sigmas = sigmas
        poses, shared, _ = descend(problem, truth, np.zeros(3), 30)
        _, terms, border = problem.linearize(poses, shared)
        covariance = Covariances(NormalEquations(poses, terms, border)).marginals()[-1]
        error = poses[-1] - truth[-1]
        squares.append(error @ np.linalg.solve(covariance, error))
    assert np.mean(squares) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 300))


def erring(chain: Chain, v: int, errors: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """What odometry that errs so would have said of a true motion."""
    x, y, theta = chain.motions[v]
    turn = errors[0] + bias[0] * chain.travelled[v]
    direction, distance = np.arctan2(y, x) - 0.5 * turn, np.hypot(x, y)
    along = (distance - errors[1]) / (1.0 + bias[1])
    slip = np.arctan2(errors[2], distance)
    return np.array([along * np.cos(direction - slip), along * np.sin(direction - slip), theta - turn])


def test_a_wrong_loop_edge_is_let_go():
    rng = np.random.default_rng(2)
    drive = laps(2.0, noise=0.3, seed=3)
    pairs = np.array([[k, k + drive.lap] for k in range(0, drive.lap, 2)])
    motions = between(drive.truth[pairs[:, 0]], drive.truth[pairs[:, 1]]) + rng.normal(size=(len(pairs), 3)) * 0.005
    motions[5] = [2.0, -1.5, 0.7]
    precisions = np.broadcast_to(np.diag([2500.0, 2500.0, 1e4]), (len(pairs), 3, 3))

    def worst(kernel: float) -> float:
        edges = LoopEdges(pairs, motions, precisions, kernel)
        problem = Problem(
            Chain.along(drive.odometry, drive.travelled), MOTION, [edges], np.zeros(len(drive.truth), complex), 0.5
        )
        path = descend(problem, drive.truth, np.zeros(3), 50)[0]
        wrong = between(path[: -drive.lap], path[drive.lap :]) - between(
            drive.truth[: -drive.lap], drive.truth[drive.lap :]
        )
        return float(np.max(np.hypot(wrong[:, 0], wrong[:, 1])))

    assert worst(kernel=5.0) < 0.1 < worst(kernel=np.inf)
