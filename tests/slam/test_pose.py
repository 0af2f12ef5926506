"""SE(2) obeys the axioms of a group, for every shape of batch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam import pose as se2
from tests.naive import pose as naive

SHAPES = [(), (1,), (7,), (0,), (3, 4), (2, 1, 5)]
IDENTITY = np.zeros(3)


def random_poses(shape, seed):
    """Poses (*shape, 3) within 10 m, with headings from several turns."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (*shape, 3)) * [10.0, 10.0, 9.0]


def assert_same(a, b):
    """Equal positions, and headings equal up to whole turns."""
    assert a.shape == b.shape
    np.testing.assert_allclose(a[..., :2], b[..., :2], atol=1e-12)
    np.testing.assert_allclose(se2.wrap(a[..., 2] - b[..., 2]), 0.0, atol=1e-12)


def assert_wrapped(poses):
    assert np.all(poses[..., 2] > -math.pi)
    assert np.all(poses[..., 2] <= math.pi)


@pytest.mark.parametrize("shape", SHAPES)
def test_products_and_inverses_are_poses_with_wrapped_headings(shape):
    a, b = random_poses(shape, 1), random_poses(shape, 2)
    for result in (se2.compose(a, b), se2.inverse(a), se2.between(a, b)):
        assert result.shape == (*shape, 3)
        assert_wrapped(result)


@pytest.mark.parametrize("shape", SHAPES)
def test_identity_is_neutral_on_both_sides(shape):
    a = random_poses(shape, 3)
    assert_same(se2.compose(a, IDENTITY), a)
    assert_same(se2.compose(IDENTITY, a), a)


@pytest.mark.parametrize("shape", SHAPES)
def test_inverse_undoes_on_both_sides(shape):
    a = random_poses(shape, 4)
    assert_same(se2.compose(a, se2.inverse(a)), np.zeros((*shape, 3)))
    assert_same(se2.compose(se2.inverse(a), a), np.zeros((*shape, 3)))
    assert_same(se2.inverse(se2.inverse(a)), a)


@pytest.mark.parametrize("shape", SHAPES)
def test_composition_is_associative(shape):
    a, b, c = (random_poses(shape, seed) for seed in (5, 6, 7))
    assert_same(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@pytest.mark.parametrize("shape", SHAPES)
def test_between_is_what_leads_from_one_pose_to_the_other(shape):
    a, b = random_poses(shape, 8), random_poses(shape, 9)
    assert_same(se2.compose(a, se2.between(a, b)), b)


def test_composition_is_not_commutative():
    forward, left = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, math.pi / 2])
    np.testing.assert_allclose(se2.compose(left, forward), [0.0, 1.0, math.pi / 2], atol=1e-15)
    np.testing.assert_allclose(se2.compose(forward, left), [1.0, 0.0, math.pi / 2], atol=1e-15)


def test_one_pose_composes_with_a_batch():
    one, many = random_poses((), 10), random_poses((4, 5), 11)
    expected = np.array([[se2.compose(one, pose) for pose in row] for row in many])
    np.testing.assert_array_equal(se2.compose(one, many), expected)
    np.testing.assert_array_equal(se2.compose(many[:, :1], many).shape, many.shape)


def test_transform_agrees_with_composition():
    poses, points = random_poses((6,), 12), np.random.default_rng(13).normal(size=(6, 2))
    as_poses = np.column_stack([points, np.zeros(6)])
    np.testing.assert_allclose(se2.transform(poses, points), se2.compose(poses, as_poses)[:, :2], atol=1e-12)
    np.testing.assert_allclose(se2.transform(poses[0], points)[3], se2.transform(poses[0], points[3]), atol=1e-12)


def test_transform_keeps_distances():
    points = np.random.default_rng(14).normal(size=(50, 2))
    moved = se2.transform(random_poses((), 15), points)
    np.testing.assert_allclose(np.hypot(*np.diff(moved, axis=0).T), np.hypot(*np.diff(points, axis=0).T), atol=1e-12)


def test_agrees_with_matrices():
    pairs = zip(random_poses((40,), 16), random_poses((40,), 17), strict=True)
    for a, b in pairs:
        assert_same(se2.compose(a, b), naive.compose(a, b))
        assert_same(se2.inverse(a), naive.inverse(a))
        assert_same(se2.between(a, b), naive.between(a, b))


def test_wrap_gives_the_half_open_circle():
    turns = np.arange(-5, 6) * 2.0 * math.pi
    np.testing.assert_array_equal(se2.wrap(np.array([math.pi, -math.pi])), [math.pi, math.pi])
    np.testing.assert_allclose(se2.wrap(turns + 0.3), 0.3, atol=1e-14)
    angles = np.random.default_rng(18).uniform(-100.0, 100.0, 10_000)
    wrapped = se2.wrap(angles)
    assert wrapped.max() <= math.pi
    assert wrapped.min() > -math.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-12)
    np.testing.assert_array_equal(se2.wrap(wrapped), se2.wrap(se2.wrap(wrapped)))


def test_wrap_holds_next_to_the_border():
    border = np.array([math.pi, -math.pi, 3.0 * math.pi, -3.0 * math.pi])
    for angles in (border, np.nextafter(border, 100.0), np.nextafter(border, -100.0)):
        assert_wrapped(np.stack([angles, angles, se2.wrap(angles)], axis=-1))
