"""The path tree against paths kept in full: same paths, same profile, nothing counted wrongly, nothing leaked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.path_filter import attach_all
from slam.path_tree import PathTree, ancestor
from slam.resampling import systematic
from tests.naive.path_tree import Paths, steps_to

ROOT = np.array([1.0, -2.0, 0.5])


class Both:
    """The tree and its twin, driven alike."""

    def __init__(self, n_particles, seed=0):
        self.rng = np.random.default_rng(seed)
        self.tree = PathTree(n_particles, ROOT)
        self.twin = Paths(n_particles, ROOT)

    def extend(self):
        poses = self.rng.normal(size=(self.tree.leaves.size, 3)).astype(np.float32)
        fresh = self.tree.grow()
        attach_all(self.tree.nodes, fresh, self.tree.leaves, poses)
        self.tree.settle(fresh)
        self.twin.extend(poses)

    def resample(self, ancestors):
        self.tree.resample(np.asarray(ancestors, np.int64))
        self.twin.resample(ancestors)

    def check(self):
        check_paths(self.tree, self.twin)
        check_counts(self.tree, self.twin)
        check_boxes(self.tree, self.twin)


def check_paths(tree, twin):
    """Every particle's path, by parents and by ancestors."""
    for particle, leaf in enumerate(tree.leaves):
        path = np.array(twin.path(particle))
        np.testing.assert_allclose(tree.path(particle), path, atol=1e-6)
        for depth in range(tree.n_levels):
            np.testing.assert_allclose(tree.nodes.poses[ancestor(tree.nodes, leaf, depth)], path[depth], atol=1e-6)


def check_counts(tree, twin):
    """Profile, fixed depth, reference counts; free and live nodes are all nodes."""
    levels = twin.levels()
    np.testing.assert_allclose(tree.profile(), np.array(levels) / len(twin.paths))
    assert tree.fixed_depth() == twin.fixed_depth()
    references = tree.nodes.references
    live = np.flatnonzero(references > 0)
    assert live.size == sum(levels)
    assert sorted(references[live].tolist()) == twin.references()
    free = tree.free[: tree.n_free]
    assert sorted(np.concatenate([live, free]).tolist()) == list(range(references.size))
    assert not references[free].any()


def check_boxes(tree, twin):
    """Each level's box is the smallest that holds its nodes, or since the last resampling was."""
    for depth in range(tree.n_levels):
        np.testing.assert_allclose(tree.boxes[depth], twin.box(depth), atol=1e-6)


OPERATIONS = st.lists(
    st.one_of(
        st.none(),  # extend
        st.tuples(st.integers(1, 12), st.floats(0.0, 3.0), st.integers(0, 2**32 - 1)),  # new size, inequality, seed
    ),
    max_size=30,
)


@settings(max_examples=80)
@given(st.integers(1, 12), OPERATIONS)
def test_any_history_leaves_the_tree_as_paths_kept_in_full(n_particles, operations):
    both = Both(n_particles)
    for operation in operations:
        if operation is None:
            both.extend()
        else:
            size, inequality, seed = operation
            rng = np.random.default_rng(seed)
            weights = rng.random(both.tree.leaves.size) ** inequality
            both.resample(rng.choice(weights.size, size, p=weights / weights.sum()))
    both.check()


@pytest.mark.parametrize("seed", range(3))
def test_a_long_run_with_systematic_resampling(seed):
    both = Both(20, seed)
    for step in range(90):
        both.extend()
        if step % 3 == 2:
            weights = both.rng.exponential(size=20) ** 2
            both.resample(systematic(weights / weights.sum(), both.rng.random()))
        if step % 15 == 0:
            both.check()
    both.check()
    assert 0 < both.tree.fixed_depth() < 90


def test_at_the_start_all_share_the_root():
    tree = PathTree(7, ROOT)
    assert tree.fixed_depth() == 0
    np.testing.assert_allclose(tree.profile(), [1.0 / 7.0])
    for particle in range(7):
        np.testing.assert_allclose(tree.path(particle), [ROOT])


def test_without_resampling_nothing_is_shared_but_the_root():
    both = Both(9)
    for _ in range(6):
        both.extend()
    np.testing.assert_allclose(both.tree.profile(), [1.0 / 9.0] + [1.0] * 6)
    assert both.tree.fixed_depth() == 0


def test_one_survivor_fixes_the_path_and_frees_the_rest():
    both = Both(30)
    for _ in range(10):
        both.extend()
    both.resample([4] * 30)
    assert both.tree.fixed_depth() == 10
    assert both.tree.nodes.references.size - both.tree.n_free == 11
    both.check()


def test_levels_without_survivors_of_a_wide_box_shrink_it():
    both = Both(50)
    both.extend()
    wide = both.tree.boxes[1].copy()
    inner = int(np.argmin(np.abs(both.tree.nodes.poses[both.tree.leaves]).max(axis=1)))
    both.resample([inner] * 50)
    tight = both.tree.boxes[1]
    np.testing.assert_array_equal(tight[:2], tight[2:])
    assert np.all(tight[:2] >= wide[:2])
    assert np.all(tight[2:] <= wide[2:])


@pytest.mark.parametrize("sizes", [(3, 40), (40, 3), (1, 100), (100, 1)])
def test_the_number_of_particles_can_change(sizes):
    first, then = sizes
    both = Both(first)
    for size in (first, then, first):
        both.resample([particle % both.tree.leaves.size for particle in range(size)])
        for _ in range(5):
            both.extend()
        assert both.tree.leaves.size == size
        both.check()


def test_growing_keeps_everything():
    """Far more nodes than the first capacity holds, and more levels than the first boxes."""
    both = Both(6)
    capacity = both.tree.nodes.parent.size
    for _ in range(150):
        both.extend()
    assert both.tree.nodes.parent.size > 3 * capacity
    assert both.tree.boxes.shape[0] >= 151
    both.check()


def test_resampling_for_ever_needs_no_more_nodes():
    """Freed nodes are used again: T + (1 to 3) N ln N nodes, whatever the number of resamplings."""
    n, steps = 50, 400
    tree, rng = PathTree(n, ROOT), np.random.default_rng(1)
    for _ in range(steps):
        fresh = tree.grow()
        attach_all(tree.nodes, fresh, tree.leaves, rng.normal(size=(n, 3)))
        tree.settle(fresh)
        weights = rng.exponential(size=n)
        tree.resample(systematic(weights / weights.sum(), rng.random()))
    live = tree.nodes.references.size - tree.n_free
    assert steps < live < steps + 3.0 * n * math.log(n)
    assert tree.nodes.references.size < 4 * live


def test_an_ancestor_is_found_in_a_logarithmic_number_of_steps():
    tree = PathTree(1, ROOT)
    depth = 3000
    for _ in range(depth):
        fresh = tree.grow()
        attach_all(tree.nodes, fresh, tree.leaves, np.zeros((1, 3)))
        tree.settle(fresh)
    steps = [steps_to(tree.nodes, int(tree.leaves[0]), goal) for goal in range(0, depth + 1, 7)]
    assert max(steps) <= 3 * math.log2(depth)
