"""The path tree against paths kept in full: same paths, same profile, nothing counted wrongly, nothing leaked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.path_tree import STRIDE, PathTree, climb
from slam.resampling import systematic
from tests.naive.path_tree import Paths

ROOT = np.array([1.0, -2.0, 0.5])


def extend(tree, poses):
    """A vertex at `poses` (n, 3) for every particle."""
    start = tree.grow()
    tree.nodes.poses[start : tree.n_nodes] = poses
    tree.nodes.parents[start : tree.n_nodes] = tree.leaves
    tree.settle()


def live(tree, field):
    """A field of all nodes, level by level."""
    starts = tree.nodes.starts
    return [getattr(tree.nodes, field)[starts[level] : starts[level + 1]] for level in range(tree.n_levels)]


class Both:
    """The tree and its twin, driven alike."""

    def __init__(self, n_particles, seed=0):
        self.rng = np.random.default_rng(seed)
        self.tree = PathTree(n_particles, ROOT)
        self.twin = Paths(n_particles, ROOT)

    def extend(self):
        poses = self.rng.normal(size=(self.tree.leaves.size, 3)).astype(np.float32)
        extend(self.tree, poses)
        self.twin.extend(poses)

    def resample(self, ancestors):
        ancestors = np.sort(ancestors)
        self.tree.resample(ancestors)
        self.twin.resample(ancestors)

    def check(self):
        check_paths(self.tree, self.twin)
        check_counts(self.tree, self.twin)
        check_boxes(self.tree, self.twin)


def check_paths(tree, twin):
    """Every particle's path, by parents and by jumps."""
    paths = np.array([twin.path(particle) for particle in range(tree.leaves.size)])
    for particle, path in enumerate(paths):
        np.testing.assert_allclose(tree.path(particle), path, atol=1e-6)
    np.testing.assert_allclose(tree.newest(np.arange(tree.leaves.size)), paths[:, -1], atol=1e-6)
    for level, poses in enumerate(live(tree, "poses")):
        rows = tree.leaves.copy()
        climb(tree.nodes, rows, rows.size, tree.n_levels - 1, level)
        np.testing.assert_allclose(poses[rows], paths[:, level], atol=1e-6)


def check_counts(tree, twin):
    """Profile, fixed depth, and no node too many; parents in order and none without a child."""
    levels = twin.levels()
    np.testing.assert_allclose(tree.profile(), np.array(levels) / len(twin.paths))
    assert tree.fixed_depth() == twin.fixed_depth()
    assert [len(poses) for poses in live(tree, "poses")] == levels
    assert tree.n_nodes == sum(levels)
    for above, parents in zip(levels, [*live(tree, "parents")[1:], tree.leaves], strict=True):
        assert np.unique(parents).tolist() == list(range(above))
        assert np.all(np.diff(parents) >= 0)


def check_boxes(tree, twin):
    """Each level's box is the smallest that holds its nodes, or since the last resampling was."""
    for depth in range(tree.n_levels):
        np.testing.assert_allclose(tree.nodes.boxes[depth], twin.box(depth), atol=1e-6)


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
    assert both.tree.n_nodes == 11
    both.check()


def test_levels_without_survivors_of_a_wide_box_shrink_it():
    both = Both(50)
    both.extend()
    wide = both.tree.nodes.boxes[1].copy()
    inner = int(np.argmin(np.abs(live(both.tree, "poses")[1]).max(axis=1)))
    both.resample([inner] * 50)
    tight = both.tree.nodes.boxes[1]
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
    """Far more nodes and levels than there is room for at first."""
    both = Both(6)
    rows, levels = both.tree.nodes.parents.size, len(both.tree.nodes.boxes)
    for _ in range(150):
        both.extend()
    assert both.tree.nodes.parents.size > rows
    assert len(both.tree.nodes.boxes) >= 151 > levels
    both.check()


def test_resampling_for_ever_needs_no_more_nodes():
    """T + (1 to 3) N ln N nodes, whatever the number of resamplings."""
    n, steps = 50, 400
    tree, rng = PathTree(n, ROOT), np.random.default_rng(1)
    for _ in range(steps):
        extend(tree, rng.normal(size=(n, 3)))
        weights = rng.exponential(size=n)
        tree.resample(systematic(weights / weights.sum(), rng.random()))
    assert steps < tree.n_nodes < steps + 3.0 * n * math.log(n)


def test_jumps_stay_true_when_what_they_lead_to_is_packed():
    """Resampling that reaches far below the newest jumps, just before, at and after a level that has some."""
    for extra in (-1, 0, 1):
        both = Both(12, extra + 1)
        for step in range(4 * STRIDE + extra):
            both.extend()
            if step % 7 == 3:
                both.resample(both.rng.integers(0, 12, 12))
        both.resample(np.repeat([3, 4], 6))
        both.check()


def test_descending_ancestors_are_refused():
    both = Both(3)
    both.extend()
    with pytest.raises(ValueError, match="must not descend"):
        both.tree.resample(np.array([1, 0, 2]))
