"""Variance components: the likelihood is the formula's, its maximum the closed form's, intervals cover as they say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.variance_components import CHI_SQUARE, Block, interval, log_likelihood, maximise

SIZES = np.array([0.3, 0.1])


def random_block(seed, m=30, sizes=SIZES):
    """A random walk seen with white noise: two components that are told apart by their correlations."""
    rng = np.random.default_rng(seed)
    rows = np.tril(np.ones((m, m)))
    residuals = rows @ rng.normal(0.0, sizes[0], m) + rng.normal(0.0, sizes[1], m)
    return Block(residuals, np.array([rows @ rows.T, np.eye(m)]))


def test_the_value_is_the_gaussian_log_density():
    block = random_block(1)
    covariance = SIZES[0] ** 2 * block.kernels[0] + SIZES[1] ** 2 * block.kernels[1]
    sign, log_determinant = np.linalg.slogdet(2.0 * math.pi * covariance)
    expected = -0.5 * (log_determinant + block.residuals @ np.linalg.solve(covariance, block.residuals))
    value, _, _ = log_likelihood([block, block], np.log(SIZES))
    assert sign == 1.0
    assert value == pytest.approx(2.0 * expected, rel=1e-12)


def test_the_gradient_is_the_slope_and_the_information_about_its_variance():
    gradients = []
    for seed in range(400):
        blocks = [random_block(seed)]
        _, gradient, information = log_likelihood(blocks, np.log(SIZES))
        gradients.append(gradient)
        if seed < 3:
            for c in range(2):
                step = 1e-5 * np.eye(2)[c]
                up, down = (log_likelihood(blocks, np.log(SIZES) + sign * step)[0] for sign in (1.0, -1.0))
                assert gradient[c] == pytest.approx((up - down) / 2e-5, rel=1e-4, abs=1e-4)
            assert np.all(np.linalg.eigvalsh(information) > 0.0)
    assert np.all(np.abs(np.mean(gradients, axis=0)) < 4.0 * np.std(gradients, axis=0) / math.sqrt(400))


def test_one_white_component_is_the_root_mean_square():
    residuals = np.random.default_rng(3).normal(0.0, 0.2, 50)
    best = maximise([Block(residuals, np.eye(50)[None])], np.zeros(1))
    assert math.exp(best.log_sizes[0]) == pytest.approx(math.sqrt(np.mean(residuals**2)), rel=1e-3)


def test_a_held_component_stays():
    best = maximise([random_block(4)], np.log([0.5, 0.05]), [1])
    assert best.log_sizes[1] == math.log(0.05)
    assert maximise([random_block(4)], best.log_sizes).value >= best.value


def test_the_ends_of_an_interval_are_as_much_less_likely_as_chi_square_says():
    blocks = [random_block(seed) for seed in range(3)]
    best = maximise(blocks, np.log(SIZES))
    for excess in (1.0, 2.0):
        for size in interval(blocks, best, 0, excess):
            at = best.log_sizes.copy()
            at[0] = math.log(size)
            drop = best.value - maximise(blocks, at, [0]).value
            assert drop == pytest.approx(0.5 * CHI_SQUARE * excess, rel=0.05)


def test_an_absent_component_has_no_lower_end_and_an_unseen_one_no_upper():
    blocks = [random_block(5, sizes=np.array([0.3, 0.0]))]
    best = maximise(blocks, np.log(SIZES))
    low, high = interval(blocks, best, 1)
    assert low == 0.0
    assert 0.0 < high < 0.5
    unseen = [Block(block.residuals, np.append(block.kernels, 1e-12 * block.kernels[1:], axis=0)) for block in blocks]
    best = maximise(unseen, np.log([0.3, 0.1, 0.1]))
    assert interval(unseen, best, 2) == (0.0, math.inf)


def test_intervals_cover_the_truth_as_often_as_they_say():
    hits = []
    for seed in range(80):
        blocks = [random_block(seed, m=25), random_block(1000 + seed, m=25)]
        best = maximise(blocks, np.log([0.1, 0.1]))
        hits.append([low <= size <= high for size, (low, high) in zip(SIZES, intervals(blocks, best), strict=True)])
    for share in np.mean(hits, axis=0):
        assert share == pytest.approx(0.95, abs=4.0 * math.sqrt(0.95 * 0.05 / 80))


def intervals(blocks, best):
    """Of both components."""
    return [interval(blocks, best, which) for which in range(2)]
