"""The noise of a sonar is found again from readings that were made with it."""

from __future__ import annotations

import numpy as np
import pytest

from slam.sonar_noise import FEWEST, fit, fit_bands


def made(sigma: float, outliers: float, silence: float, n: int = 400, low: float = 0.5, seed: int = 1) -> np.ndarray:
    """Sets (n, 25) of ranges from `low` on."""
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(low, low + 0.5, (n, 1)) + rng.normal(0.0, sigma, (n, 25))
    strays = rng.uniform(size=ranges.shape) < outliers
    ranges[strays] = rng.uniform(0.1, 2.5, int(strays.sum()))
    ranges[rng.uniform(size=ranges.shape) < silence] = np.inf
    return ranges


@pytest.mark.parametrize(("sigma", "outliers", "silence"), [(0.01, 0.0, 0.0), (0.004, 0.03, 0.01), (0.008, 0.1, 0.2)])
def test_what_went_in_comes_out(sigma, outliers, silence):
    found = fit(made(sigma, outliers, silence))
    assert found[0] == pytest.approx(sigma, rel=0.1)  # the middle is one of the readings; strays near it count as noise
    assert found[1] == pytest.approx(outliers, abs=0.015)
    assert found[2] == pytest.approx(silence, abs=0.01)


def test_equal_readings_spread_by_their_rounding():
    assert fit(np.full((5, 25), 1.2))[0] == pytest.approx(0.001 / np.sqrt(12.0))


def test_bands_are_told_apart_and_empty_ones_left_out():
    ranges = np.concatenate([made(0.005, 0.0, 0.0, low=0.2), made(0.01, 0.05, 0.1, low=2.0), np.full((9, 25), np.inf)])
    bands = fit_bands(ranges, np.array([0.0, 1.0, 1.5, 3.0]))
    assert [(band.nearest, band.farthest, band.n_sets) for band in bands] == [(0.0, 1.0, 400), (1.5, 3.0, 400)]
    for band, sigma in zip(bands, (0.005, 0.01), strict=True):
        assert band.intervals[0, 0] <= band.sigma <= band.intervals[0, 1]
        assert band.sigma == pytest.approx(sigma, rel=0.1)


def test_one_repeat_tells_nothing():
    with pytest.raises(ValueError, match="two repeats"):
        fit_bands(np.ones((5, 1)), np.array([0.0, 2.0]))


def test_what_none_of_the_sets_shows_may_still_be():
    (band,) = fit_bands(made(0.005, 0.0, 0.0, n=100), np.array([0.0, 2.0]))
    assert band.silence == 0.0
    np.testing.assert_allclose(band.intervals[2], [0.0, 0.03])


@pytest.mark.parametrize("n", [1, 2, FEWEST - 1, FEWEST])
def test_few_sets_tell_no_interval(n):
    (band,) = fit_bands(made(0.005, 0.02, 0.02, n=n), np.array([0.0, 2.0]))
    assert band.has_intervals == (n >= FEWEST)
    assert np.isnan(band.intervals).all() == (n < FEWEST)
    if band.has_intervals:
        assert np.all(band.intervals[:, 1] > band.intervals[:, 0])


def test_intervals_hold_the_truth_as_often_as_they_say():
    held = np.zeros(3)
    for seed in range(40):
        (band,) = fit_bands(made(0.01, 0.0, 0.05, n=60, seed=seed), np.array([0.0, 2.0]), seed)
        held += [low <= truth <= high for truth, (low, high) in zip((0.01, 0.0, 0.05), band.intervals, strict=True)]
    assert held.min() >= 33, "of 40; 95 % is meant, and one in a hundred thousand such trials has fewer"
