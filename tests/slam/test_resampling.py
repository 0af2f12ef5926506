"""Normalisation survives any log weights; systematic resampling is unbiased and gives everyone floor or ceil."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from slam.resampling import effective_particles, effective_sample_size, entropy, normalize, systematic
from tests.naive import resampling as naive

LOG_WEIGHTS = arrays.arrays(float, st.integers(1, 40), elements=st.floats(-1e308, 1e308) | st.just(-math.inf))


def random_weights(n, seed):
    """Weights (n,), some of them zero."""
    rng = np.random.default_rng(seed)
    weights = rng.exponential(size=n) ** 3 * (rng.random(n) < 0.7)
    weights[rng.integers(n)] += 1e-3
    return weights / weights.sum()


@given(LOG_WEIGHTS)
def test_normalized_weights_are_a_distribution(log_weights):
    weights = normalize(log_weights)
    assert np.all(weights >= 0.0)
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert weights[np.argmax(log_weights)] == weights.max()


def test_normalize_agrees_with_high_precision():
    log_weights = np.random.default_rng(1).uniform(-700.0, 700.0, 30)
    np.testing.assert_allclose(normalize(log_weights), naive.normalize(log_weights), rtol=1e-13, atol=0.0)


def test_a_common_factor_does_not_matter():
    log_weights = np.array([-3.0, 0.0, 2.0, -math.inf])
    np.testing.assert_allclose(normalize(log_weights - 1e6), normalize(log_weights), rtol=1e-9)
    np.testing.assert_allclose(normalize(log_weights + 1e6), normalize(log_weights), rtol=1e-9)


def test_impossible_particles_weigh_nothing_unless_all_are():
    np.testing.assert_array_equal(normalize(np.array([-math.inf, 5.0, -math.inf])), [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(normalize(np.full(4, -math.inf)), [0.25] * 4)
    np.testing.assert_array_equal(normalize(np.array([1e308, -1e308])), [1.0, 0.0])


@pytest.mark.parametrize("log_weights", [[], [0.0, math.nan], [0.0, math.inf], [math.nan, -math.inf]])
def test_what_is_no_log_weight_raises(log_weights):
    with pytest.raises(ValueError, match=r"normalise|log weights"):
        normalize(np.array(log_weights))


@pytest.mark.parametrize("n", [1, 2, 7, 1000])
def test_equal_weights_are_all_effective(n):
    weights = np.full(n, 1.0 / n)
    assert entropy(weights) == pytest.approx(math.log2(n), abs=1e-12)
    assert effective_particles(weights) == pytest.approx(n)
    assert effective_sample_size(weights) == pytest.approx(n)


def test_one_carrier_is_one_effective_particle():
    weights = np.array([0.0, 1.0, 0.0])
    assert effective_particles(weights) == 1.0
    assert effective_sample_size(weights) == 1.0


def test_k_equal_carriers_among_many_are_k_effective_particles():
    weights = np.concatenate([np.full(8, 0.125), np.zeros(92)])
    assert effective_particles(weights) == pytest.approx(8.0)
    assert effective_sample_size(weights) == pytest.approx(8.0)


@pytest.mark.parametrize("seed", range(20))
def test_sample_size_never_exceeds_effective_particles(seed):
    weights = random_weights(50, seed)
    assert 1.0 <= effective_sample_size(weights) <= effective_particles(weights) * (1.0 + 1e-12)
    assert effective_particles(weights) <= 50.0


def test_systematic_is_unbiased():
    weights = np.array([0.30, 0.25, 0.20, 0.15, 0.10])
    offsets = (np.arange(1000) + 0.5) / 1000  # integrate over the one random input
    counts = np.mean([np.bincount(systematic(weights, u), minlength=5) for u in offsets], axis=0)
    np.testing.assert_allclose(counts, 5 * weights, atol=1e-2)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("n_children", [1, 3, 50, 400])
def test_everyone_gets_floor_or_ceil(seed, n_children):
    weights, offset = random_weights(50, seed), np.random.default_rng(seed).random()
    ancestors = systematic(weights, offset, n_children)
    counts = np.bincount(ancestors, minlength=50)
    assert counts.sum() == n_children
    assert np.all(counts >= np.floor(n_children * weights - 1e-9))
    assert np.all(counts <= np.ceil(n_children * weights + 1e-9))
    assert np.all(np.diff(ancestors) >= 0)
    assert np.all(weights[ancestors] > 0.0)


def test_equal_weights_keep_everyone():
    for offset in (0.0, 0.3, 0.999):
        np.testing.assert_array_equal(systematic(np.full(64, 1.0 / 64.0), offset), np.arange(64))


def test_round_off_never_gives_an_impossible_particle_children():
    weights = np.concatenate([[0.0], np.full(10, 0.1 - 1e-12), np.zeros(3)])  # sums to a little less than one
    ancestors = systematic(weights, math.nextafter(1.0, 0.0), 10_000)
    assert ancestors.min() == 1
    assert ancestors.max() == 10


@pytest.mark.parametrize("seed", range(10))
def test_systematic_agrees_with_fractions(seed):
    rng = np.random.default_rng(seed)
    shares = rng.multinomial(1024, rng.dirichlet(np.full(12, 0.3)))  # dyadic, so that no sum rounds
    offset, n_children = rng.integers(256) / 256, int(rng.choice([4, 16, 64]))
    expected = naive.systematic([Fraction(int(share), 1024) for share in shares], offset, n_children)
    np.testing.assert_array_equal(systematic(shares / 1024, offset, n_children), expected)
