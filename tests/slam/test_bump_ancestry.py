"""Who descends from whom: paths are those that walking up one by one gives, and nobody is kept without need."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.bump_ancestry import NOBODY, Ancestry

SIZE, TURN = 0.15, math.radians(45.0)


def grown(rng, levels, n, orphans=0.0):
    """An ancestry, and all poses and parents that it was told."""
    ancestry, told = Ancestry(), []
    for level in range(levels):
        poses = rng.normal(0.0, 0.02, (n, 3)) + [level, 0.0, 0.0]
        parents = np.where(rng.random(n) < orphans, NOBODY, np.sort(rng.integers(0, n, n)))
        told.append((poses, parents))
        ancestry.add(poses, parents)
    return ancestry, told


def walked(told, row):
    """The path of one particle, nan before it began."""
    path = np.full((len(told), 3), np.nan)
    for level in range(len(told) - 1, -1, -1):
        poses, parents = told[level]
        path[level] = poses[row]
        row = parents[row]
        if row == NOBODY:
            break
    return path


@pytest.mark.parametrize("orphans", [0.0, 0.05])
def test_a_particles_path_is_its_ancestors(orphans):
    ancestry, told = grown(np.random.default_rng(3), 12, 40, orphans)
    for row in range(40):
        weights = np.zeros(40)
        weights[row] = 1.0
        np.testing.assert_allclose(ancestry.path(weights, SIZE, TURN), walked(told, row), atol=1e-12)


def test_a_path_of_several_is_the_mean_of_their_ancestors():
    ancestry, told = grown(np.random.default_rng(4), 6, 30)
    paths = np.array([walked(told, row) for row in range(30)])
    np.testing.assert_allclose(ancestry.path(np.full(30, 1 / 30), SIZE, TURN), paths.mean(axis=0), atol=1e-3)


def test_a_place_that_few_come_from_does_not_pull_the_path():
    ancestry = Ancestry()
    ancestry.add(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.full(2, NOBODY))
    ancestry.add(np.zeros((10, 3)), np.array([0] * 9 + [1]))
    np.testing.assert_allclose(ancestry.path(np.full(10, 0.1), SIZE, TURN)[0], 0.0, atol=1e-12)


def test_only_ancestors_are_kept():
    ancestry, told = grown(np.random.default_rng(5), 60, 50)
    rows = np.arange(50)
    for level in range(59, -1, -1):
        assert len(ancestry.levels[level].poses) == len(np.unique(rows))
        rows = told[level][1][rows]
    assert len(ancestry.levels[0].poses) < 5


def test_joined_and_chosen_particles_keep_their_own_paths():
    rng = np.random.default_rng(6)
    ancestry, told = grown(rng, 9, 20)
    other, others = grown(rng, 4, 15)  # which knows the last four bumps
    ancestry.join(other)
    rows = np.array([3, 3, 22, 34])
    ancestry.choose(rows)
    for place, row in enumerate(rows):
        weights = np.eye(4)[place]
        true = walked(told, row) if row < 20 else np.vstack([np.full((5, 3), np.nan), walked(others, row - 20)])
        np.testing.assert_allclose(ancestry.path(weights, SIZE, TURN), true, atol=1e-12)
