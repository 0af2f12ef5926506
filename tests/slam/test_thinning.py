"""A thinned curve stays within its tolerance of what it leaves out, and needs few points where it is straight."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.thinning import needed
from tests.naive import thinning as naive

CURVES = st.tuples(st.integers(0, 40), st.integers(0, 2**32 - 1)).map(
    lambda drawn: np.cumsum(np.random.default_rng(drawn[1]).normal(0.0, 0.05, (drawn[0], 2)), axis=0)
)


@given(CURVES, st.floats(0.001, 0.2))
def test_kernel_keeps_what_its_twin_keeps(curve, tolerance):
    kept = curve[needed(curve, tolerance)]
    np.testing.assert_array_equal(kept, np.array(naive.thinned([tuple(p) for p in curve], tolerance)).reshape(-1, 2))


@given(CURVES, st.floats(0.001, 0.2))
def test_what_is_left_out_lies_within_the_tolerance(curve, tolerance):
    kept = np.flatnonzero(needed(curve, tolerance))
    for first, last in itertools.pairwise(kept):
        for point in range(first, last):
            assert naive.distance(curve[point], curve[first], curve[last]) <= tolerance + 1e-12


def test_a_straight_wall_needs_its_ends():
    wall = np.column_stack([np.linspace(0.0, 3.0, 50), np.full(50, 1.0)])
    assert np.flatnonzero(needed(wall, 0.01)).tolist() == [0, 49]


def test_a_closed_curve_keeps_its_shape():
    angles = np.linspace(0.0, 2.0 * np.pi, 60)
    kept = np.flatnonzero(needed(np.column_stack([np.cos(angles), np.sin(angles)]), 0.05))
    assert 8 <= len(kept) <= 20


@pytest.mark.parametrize("n", [0, 1, 2])
def test_short_curves_stay(n):
    assert needed(np.zeros((n, 2)), 0.01).all()
