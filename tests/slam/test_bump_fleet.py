"""Many carts' runs as one least squares: the same as all at once, in time that grows as their number."""

from __future__ import annotations

import numpy as np
import pytest

from slam.bump_fleet import Member, Track, bundles_of, descend_together, felt_extents, solve_chain, together, told_by
from slam.bump_mapper import BumpMapper, BumpMapperParams
from slam.bump_swarm import BEYOND, HIGH, HITS, LOW, PHI
from slam.cart_odometry import CartParams
from tests.slam.bump_world import AREAS, run

PARAMS = BumpMapperParams(n_particles=500, n_islands=1)


@pytest.fixture(scope="module")
def fleet():
    """Two carts' members and tracks, which share the lines of the first as if both had begun at one place."""
    members, tracks, lines = [], [], None
    for seed in range(2):
        stages, _ = run(AREAS["cut rectangle"], seed, 25)
        mapper = BumpMapper(CartParams(), PARAMS, seed)
        mapper.extend(stages)
        area = mapper.estimate()
        lines = area.lines if lines is None else lines
        felt = np.where(area.felt < len(lines), area.felt, -1)
        members.append(Member.of(stages, PARAMS.model(CartParams()), PARAMS.spreads))
        tracks.append(Track(area.nodes, felt, area.biases))
    assert lines is not None
    return members, tracks, lines


def test_a_chain_is_solved_as_the_whole_matrix_is():
    rng = np.random.default_rng(1)
    n, w = 7, 4
    off_diagonal = rng.normal(size=(n - 1, 3, 3))
    diagonal = np.array([part @ part.T + 9.0 * np.eye(3) for part in rng.normal(size=(n, 3, 3))])
    whole = np.zeros((3 * n, 3 * n))
    for i in range(n):
        whole[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = diagonal[i]
    for i in range(n - 1):
        whole[3 * i : 3 * i + 3, 3 * i + 3 : 3 * i + 6] = off_diagonal[i]
        whole[3 * i + 3 : 3 * i + 6, 3 * i : 3 * i + 3] = off_diagonal[i].T
    right = rng.normal(size=(n, 3, w))
    wanted = np.linalg.solve(whole, right.reshape(3 * n, w))
    solve_chain(diagonal, off_diagonal, right)
    np.testing.assert_allclose(right.reshape(3 * n, w), wanted, atol=1e-10)


def test_what_runs_tell_of_walls_is_what_the_whole_matrix_says(fleet):
    """Poses and biases summed out, walls solved, and back: the step of the dense normal equations of both carts."""
    members, tracks, lines = fleet
    walls = lines[:, [PHI, BEYOND]].reshape(-1)
    told, dense, right, at = [], [], [], []
    for bundle, track in zip(bundles_of(members, tracks, lines), tracks, strict=True):
        _, terms, border = bundle.linearize(track.nodes, np.concatenate([track.biases, walls]))
        told.append(told_by(track.nodes, terms, border, 0.01))
        n = 3 * len(track.nodes)
        unit = [told_by_dense(track.nodes, terms, border, 0.01), border.mixed.reshape(n, -1)]
        dense.append(np.block([[unit[0], unit[1]], [unit[1].T, border.hessian]]))
        right.append(np.concatenate([gradient_of(track.nodes, terms, border), border.gradient]))
        at.append(n + 2)
    size, m = sum(at) + len(walls), len(walls)
    whole, gradient, offset = np.zeros((size, size)), np.zeros(size), 0
    for matrix, part, n in zip(dense, right, at, strict=True):
        rows = np.concatenate([np.arange(offset, offset + n), np.arange(size - m, size)])
        whole[np.ix_(rows, rows)] += matrix
        gradient[rows] += part
        offset += n
    wanted = -np.linalg.solve(whole, gradient)
    reduced = [each.of_walls() for each in told]
    change = -np.linalg.solve(sum(each for each, _ in reduced), sum(each for _, each in reduced))
    found = [np.concatenate([moved.reshape(-1), biases]) for moved, biases in (each.back(change) for each in told)]
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(np.concatenate([*found, change]), wanted, atol=1e-5 * scale)


def gradient_of(nodes, terms, border) -> np.ndarray:
    """Of the cost by the poses (3 n,)."""
    return parts_of(nodes, terms, border)[2].reshape(-1)


def parts_of(nodes, terms, border):
    """Blocks on and beside the diagonal, and the gradient (n, 3)."""
    from slam.pose_graph import assemble

    diagonal, off = border.pose_hessians.copy(), np.empty((len(terms.first), 3, 3))
    gradient = border.pose_gradients.copy()
    assemble(nodes, terms.first, terms.second, terms.gradients, terms.hessians, diagonal, off, gradient)
    return diagonal, off, gradient


def told_by_dense(nodes, terms, border, damping: float) -> np.ndarray:
    """The poses' matrix (3 n, 3 n), its diagonal grown by a share."""
    from slam.pose_graph import block_matrix

    diagonal, off, _ = parts_of(nodes, terms, border)
    matrix = block_matrix(terms.first, terms.second, diagonal, off).toarray()
    matrix[np.diag_indices_from(matrix)] += damping * np.diag(matrix) + 1e-9
    return matrix


def test_the_cost_never_rises_and_biases_are_each_carts_own(fleet):
    members, tracks, lines = fleet
    _, _, before = descend_together(members, tracks, lines, 0)
    found, moved, after = descend_together(members, tracks, lines, 10)
    assert after < before
    assert not np.allclose(found[0].biases, found[1].biases)
    again = descend_together(members, tracks, lines, 10)
    assert again[1].tobytes() == moved.tobytes()


def test_a_wall_reaches_as_far_as_contacts_are_close_to_each_other(fleet):
    places = np.concatenate([np.linspace(0.0, 0.5, 26), [1.4, 1.41]])
    np.testing.assert_allclose(together(places), np.linspace(0.0, 0.5, 26))
    few = np.array([0.0, 0.4, 0.9])
    np.testing.assert_allclose(together(few), few)
    members, tracks, lines = fleet
    found = felt_extents(lines, members, tracks)
    felt = np.concatenate([track.felt for track in tracks])
    np.testing.assert_array_equal(found[:, HITS], np.bincount(felt[felt >= 0], minlength=len(lines)))
    assert np.all(found[:, LOW] <= found[:, HIGH])
