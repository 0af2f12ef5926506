"""Spreads and branches of the path tree against paths kept in full, and what they say about a drive."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.path_filter import PathFilter, PathFilterParams
from slam.resampling import systematic
from slam.uncertainty import branches, deviations_of, particle_deviations, spread_of
from tests.naive import uncertainty as naive
from tests.slam.drives import REACH, laps
from tests.slam.test_path_tree import ROOT, Both, extend


def grown(n_particles, n_vertices, seed):
    """A tree that was extended and now and then resampled, its twin, and weights (n_particles,)."""
    both = Both(n_particles, seed)
    for _ in range(n_vertices):
        both.extend()
        if both.rng.random() < 0.4:
            chances = both.rng.exponential(size=n_particles) ** 3
            both.resample(systematic(chances / chances.sum(), both.rng.random(), n_particles))
    weights = both.rng.exponential(size=n_particles)
    return both, weights / weights.sum()


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.integers(0, 12), st.integers(0, 2**32 - 1))
def test_deviations_are_those_of_all_paths(n_particles, n_vertices, seed):
    both, weights = grown(n_particles, n_vertices, seed)
    paths = np.array([both.twin.path(particle) for particle in range(n_particles)])
    x, y, heading, revisit = particle_deviations(both.tree.nodes, both.tree.n_levels, both.tree.leaves, weights).T
    expected_x, expected_y, mean_length, expected_revisit = naive.deviations(paths, weights)
    np.testing.assert_allclose(x, expected_x, atol=1e-5)
    np.testing.assert_allclose(y, expected_y, atol=1e-5)
    np.testing.assert_allclose(np.exp(-0.5 * heading**2), mean_length, atol=1e-6)
    np.testing.assert_allclose(revisit, expected_revisit, atol=1e-5)


def test_headings_that_differ_little_deviate_as_numbers_do():
    """Also across pi, where the numbers jump."""
    both = Both(400, 3)
    headings = np.pi + np.random.default_rng(3).normal(0.0, 0.1, 400)
    extend(both.tree, np.column_stack([np.zeros((400, 2)), np.angle(np.exp(1j * headings))]))
    found = particle_deviations(both.tree.nodes, 2, both.tree.leaves, np.full(400, 1.0 / 400))
    np.testing.assert_allclose(found[0, :3], 0.0, atol=1e-6)
    np.testing.assert_allclose(found[1, :3], [0.0, 0.0, headings.std()], rtol=1e-2)


def test_deviations_are_roots_of_variances():
    covariances = np.array([np.diag([0.04, 0.09, 0.01]), np.zeros((3, 3))]) + 1e-3 * (1.0 - np.eye(3))
    found = deviations_of(covariances)
    np.testing.assert_allclose(found, [[0.2, 0.3, 0.1], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(spread_of(found), [np.sqrt(0.13), 0.0])


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.integers(0, 12), st.integers(0, 2**32 - 1))
def test_branches_are_the_ways_of_the_drawn_particles(n_particles, n_vertices, seed):
    both, weights = grown(n_particles, n_vertices, seed)
    found = branches(both.tree, weights, 5)
    drawn = {both.twin.paths[particle] for particle in systematic(weights, 0.5, 5)}
    prefixes = {path[: depth + 1] for path in drawn for depth in range(len(path))}
    assert len(found.poses) == len(prefixes)
    assert np.all(found.parents < np.arange(len(found.parents)))
    assert np.flatnonzero(found.parents < 0).tolist() == [0]
    np.testing.assert_array_equal(found.depths[1:], found.depths[found.parents[1:]] + 1)
    np.testing.assert_allclose(found.poses[0], ROOT)
    leaves = np.flatnonzero(found.depths == n_vertices)
    ways = {tuple(map(tuple, way_to(found, leaf))) for leaf in leaves}
    assert ways == {tuple(tuple(both.twin.poses[name]) for name in path) for path in drawn} or n_vertices == 0


def way_to(found, row):
    """Poses from the root to a row of the branches."""
    way = []
    while row >= 0:
        way.append(found.poses[row].tolist())
        row = found.parents[row]
    return way[::-1]


def test_what_all_particles_share_has_no_spread():
    both = Both(8, 1)
    for _ in range(3):
        both.extend()
    both.resample([5] * 8)
    found = particle_deviations(both.tree.nodes, both.tree.n_levels, both.tree.leaves, np.full(8, 0.125))
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


def test_closing_a_lap_settles_it():
    drive = laps(n_laps=1.2, turn_bias=0.01, seed=4)
    path_filter = PathFilter(PathFilterParams(particles=400, reach=REACH), seed=2)
    worst = []
    for pose, walls, travelled in zip(drive.odometry, drive.walls, drive.travelled, strict=True):
        path_filter.extend(pose, walls, travelled)
        worst.append(path_filter.uncertainty(16).revisit_spread.max())
    assert worst[0] == 0.0
    assert worst[-1] < 0.7 * worst[drive.lap - 3]


def test_before_the_first_vertex_nothing_is_known():
    with pytest.raises(RuntimeError):
        PathFilter(PathFilterParams(particles=10)).uncertainty(4)
