"""Families: members are like their heads, nobody is left out, and maps grow with what is open, not with particles."""

from __future__ import annotations

import numpy as np
import pytest

from slam.evaluate import absolute_error
from slam.families import FamilyParams, families_of, join, look_back
from slam.grid_filter import GridFilter, GridFilterParams
from slam.path_tree import PathTree
from slam.pose import wrap
from tests.naive import families as naive
from tests.slam.laser_world import around, odometry_of, ring, seen_at

PARAMS = FamilyParams()


def grown(n, levels, spread, rng):
    """A tree of n particles that walk at random, and are resampled now and then."""
    tree = PathTree(n, np.zeros(3))
    poses = np.zeros((n, 3))
    for level in range(levels):
        poses = poses + [0.4, 0.0, 0.0] + spread * rng.standard_normal((n, 3))
        leaves = tree.leaves
        start = tree.grow()
        tree.nodes.poses[start : tree.n_nodes], tree.nodes.parents[start : tree.n_nodes] = poses, leaves
        tree.settle()
        if level % 5 == 3:
            ancestors = np.sort(rng.integers(0, n, n))
            tree.resample(ancestors)
            poses = poses[ancestors]
    return tree


def is_like(path, head, params):
    """Two paths, compared one vertex after the other at lags 0, 1, 2, 4, ..."""
    lags = [0, *(lag for lag in (2**k for k in range(20)) if lag < len(path))]
    for lag in lags:
        off = path[-1 - lag] - head[-1 - lag]
        wide = params.before if lag else 1.0
        if np.hypot(off[0], off[1]) > wide * params.near + 1e-6 or abs(wrap(off[2])) > wide * params.turn + 1e-6:
            return False
    return True


@pytest.mark.parametrize("seed", range(6))
def test_members_are_like_their_heads_and_heads_unlike_one_another(seed):
    rng = np.random.default_rng(seed)
    tree = grown(40, int(rng.integers(1, 40)), 0.003 * (1 + seed), rng)
    families, heads = families_of(tree, PARAMS)
    paths = [tree.path(p) for p in range(40)]
    assert families[heads].tolist() == list(range(len(heads)))
    for p, family in enumerate(families):
        assert is_like(paths[p], paths[heads[family]], PARAMS)
        assert not any(is_like(paths[p], paths[head], strict(PARAMS)) for head in heads[:family]), (
            "the first it is like"
        )


@pytest.mark.parametrize("seed", range(6))
def test_kernels_are_as_their_slow_twins(seed):
    rng = np.random.default_rng(100 + seed)
    tree = grown(25, int(rng.integers(2, 50)), 0.02, rng)
    lags = np.array([0, 1, 2, 4, 8, 16, 32, 64])
    histories = np.empty((25, len(lags), 3), np.float32)
    look_back(tree.nodes, tree.leaves, tree.n_levels, lags, histories)
    assert np.array_equal(histories, naive.look_back([tree.path(p) for p in range(25)], lags))
    families, heads = np.empty(25, np.int64), np.empty(25, np.int64)
    n = join(histories, 0.03, 0.02, 3.0, families, heads)
    assert (families.tolist(), heads[:n].tolist()) == naive.join(histories, 0.03, 0.02, 3.0)


def strict(params):
    return params.model_copy(update={"near": params.near - 2e-6, "turn": params.turn - 2e-6})


def test_none_are_alike_where_they_must_not_be_and_all_where_they_are():
    rng = np.random.default_rng(1)
    tree = grown(30, 10, 0.0, rng)
    assert families_of(tree, FamilyParams(near=0.0))[1].tolist() == list(range(30))
    families, heads = families_of(tree, PARAMS)
    assert set(families) == {0}
    assert heads.tolist() == [0]


def filtered(particles, near):
    """A filter that has gone around the ring once and a half."""
    rng, walls = np.random.default_rng(2), ring()
    poses = around(1.5, step=0.4)
    odometry = odometry_of(poses, rng, turn_noise=0.004, distance_noise=0.01)
    found = GridFilter(GridFilterParams(particles=particles, families=FamilyParams(near=near)), seed=1)
    for k, (pose, told) in enumerate(zip(poses, odometry, strict=True)):
        found.extend(told, seen_at(pose, walls, k))
    return found, poses


def test_memory_grows_more_slowly_than_the_particles_and_the_path_is_as_good():
    few, many, own = (filtered(n, near) for n, near in ((10, 0.02), (80, 0.02), (80, 0.0)))
    assert many[0].maps.n_patches < 4.0 * few[0].maps.n_patches
    assert many[0].maps.n_patches < 0.6 * own[0].maps.n_patches
    assert own[0].maps.cells.table.shape[0] == 80
    for found, poses in (many, own):
        path = found.estimate(1).path.astype(float)
        assert absolute_error(path, poses).translation.rmse < 0.2
