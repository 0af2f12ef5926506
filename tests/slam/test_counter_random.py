"""Counter-based numbers: known values, the right distributions, and no link between neighbouring counters."""

from __future__ import annotations

import math
import random
from statistics import NormalDist

import numpy as np
import pytest
from numba import njit, prange

from slam import counter_random
from tests.naive import counter_random as naive

N = 200_000
KEYS = ["vertex", "particle", "stream"]


@njit
def draw(kind, seed, along, n):
    """n numbers whose keys differ in one word by one; kind 0 is uniform, 1 gaussian."""
    numbers = np.empty(n)
    for i in range(n):
        vertex, particle, stream = 7, 11, 3
        if along == 0:
            vertex = i
        elif along == 1:
            particle = i
        else:
            stream = i
        if kind == 0:
            numbers[i] = counter_random.uniform(seed, vertex, particle, stream)
        else:
            numbers[i] = counter_random.gaussian(seed, vertex, particle, stream)
    return numbers


@njit(parallel=True)
def draw_parallel(seed, vertex, n):
    numbers = np.empty(n)
    for particle in prange(n):
        numbers[particle] = counter_random.gaussian(seed, vertex, particle, 0)
    return numbers


@njit
def draw_grid(seed, n_vertices, n_particles):
    numbers = np.empty((n_vertices, n_particles))
    for vertex in range(n_vertices):
        for particle in range(n_particles):
            numbers[vertex, particle] = counter_random.gaussian(seed, vertex, particle, 0)
    return numbers


def largest_distance(sample, cumulative):
    """Kolmogorov and Smirnov's statistic, times the root of n."""
    ordered = np.sort(sample)
    expected = np.array([cumulative(value) for value in ordered])
    ranks = np.arange(ordered.size + 1) / ordered.size
    return math.sqrt(ordered.size) * max(np.max(ranks[1:] - expected), np.max(expected - ranks[:-1]))


def test_generator_is_splitmix64():
    # the first outputs for seed 1234567 in the generator's published reference
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [int(counter_random.nth_output(np.uint64(1234567), n)) for n in range(4)] == expected


def test_values_never_change():
    assert counter_random.uniform(0, 0, 0, 0) == naive.uniform(0, 0, 0, 0)
    assert counter_random.uniform(1, 2, 3, 4).hex() == "0x1.c87b3d194a5c6p-2"
    assert counter_random.gaussian(1, 2, 3, 4) == pytest.approx(-0.13632389288306046, rel=1e-15)


def test_agrees_with_unbounded_integers():
    rng = random.Random(1)
    for _ in range(300):
        seed = rng.randrange(2 ** rng.randrange(1, 63))
        key = (seed, *(rng.randrange(500) for _ in range(3)))
        assert counter_random.uniform(*key) == naive.uniform(*key)
        assert counter_random.gaussian(*key) == pytest.approx(naive.gaussian(*key), rel=1e-14, abs=1e-16)


def test_every_bit_of_the_seed_counts():
    seeds = [0, 1, 2**31, 2**32, 2**53, 2**53 + 1, 2**62, 2**63 - 1]
    assert len({counter_random.uniform(seed, 0, 0, 0) for seed in seeds}) == len(seeds)
    for seed in seeds:
        assert counter_random.uniform(seed, 1, 2, 3) == naive.uniform(seed, 1, 2, 3)


@pytest.mark.parametrize("p", [2.0**-53, 1e-12, 1.38e-11, 1e-6, 0.0749, 0.075, 0.2, 0.5, 0.9, 0.9251, 1.0 - 2.0**-53])
def test_quantile_agrees_with_the_standard_library(p):
    assert counter_random.normal_quantile(p) == pytest.approx(NormalDist().inv_cdf(p), rel=1e-14, abs=1e-16)


@pytest.mark.parametrize("along", range(3), ids=KEYS)
def test_uniform_numbers_are_uniform(along):
    numbers = draw(0, 42, along, N)
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    assert numbers.mean() == pytest.approx(0.5, abs=4.0 / math.sqrt(12.0 * N))
    assert largest_distance(numbers, lambda value: value) < 1.95  # exceeded once in a thousand samples


@pytest.mark.parametrize("along", range(3), ids=KEYS)
def test_gaussian_numbers_are_standard_normal(along):
    numbers = draw(1, 43, along, N)
    deviation = 1.0 / math.sqrt(N)
    assert numbers.mean() == pytest.approx(0.0, abs=4.0 * deviation)
    assert numbers.var() == pytest.approx(1.0, abs=4.0 * deviation * math.sqrt(2.0))
    assert np.mean(numbers**3) == pytest.approx(0.0, abs=4.0 * deviation * math.sqrt(15.0))
    assert np.mean(numbers**4) == pytest.approx(3.0, abs=4.0 * deviation * math.sqrt(96.0))
    assert largest_distance(numbers, NormalDist().cdf) < 1.95


@pytest.mark.parametrize("along", range(3), ids=KEYS)
@pytest.mark.parametrize("lag", [1, 2, 3, 16, 1000])
def test_neighbouring_counters_are_uncorrelated(along, lag):
    numbers = draw(1, 44, along, N)
    bound = 4.0 / math.sqrt(N - lag)
    assert abs(np.mean(numbers[lag:] * numbers[:-lag])) < bound
    squares = (numbers**2 - 1.0) / math.sqrt(2.0)
    assert abs(np.mean(squares[lag:] * squares[:-lag])) < bound


def test_pairs_of_neighbours_fill_the_square():
    numbers = draw(0, 45, 1, N)
    counts, _, _ = np.histogram2d(numbers[:-1], numbers[1:], bins=16, range=[[0, 1], [0, 1]])
    expected = (N - 1) / 256
    chi_square = np.sum((counts - expected) ** 2) / expected
    assert abs(chi_square - 255) < 4.0 * math.sqrt(2.0 * 255)


def test_vertices_and_particles_span_no_pattern():
    numbers = draw_grid(46, 300, 300)
    transform = np.abs(np.fft.fft2(numbers)) / 300.0
    # 90,000 exponential squares: the largest is log n, plus 7 more once in a thousand times
    assert np.max(transform) ** 2 < math.log(numbers.size) + 7.0


def test_one_bit_of_the_key_changes_half_of_the_bits():
    rng = random.Random(2)
    flips = []
    for _ in range(500):
        key = [rng.randrange(2**20) for _ in range(4)]
        other = list(key)
        other[rng.randrange(4)] ^= 1 << rng.randrange(20)
        flips.append((int(counter_random.bits(*key)) ^ int(counter_random.bits(*other))).bit_count())
    assert np.mean(flips) == pytest.approx(32.0, abs=4.0 * 4.0 / math.sqrt(len(flips)))


def test_words_of_the_key_do_not_stand_in_for_each_other():
    keys = {(a, b, c, d) for a in range(6) for b in range(6) for c in range(6) for d in range(6)}
    assert len({counter_random.uniform(*key) for key in keys}) == len(keys)


def test_threads_do_not_matter():
    np.testing.assert_array_equal(draw_parallel(5, 9, 10_000), draw_grid(5, 10, 10_000)[9])
