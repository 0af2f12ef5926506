"""What repeated readings of a sonar at a standstill tell of it: its spread, its outliers and its silence, by range.

The middle of a set of repeats stands for its range, so that what a sonar gets wrong every time (an echo from the edge
of its cone, a ghost that stays) is not seen here: this is how much readings vary, not how true they are.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

FEWEST = 10  # sets whose draws tell an interval: n sets drawn from themselves vary too little, by 1 / (2 n) of it
GROSS = 0.04  # m off the middle from which a reading is an outlier: half the arc that the local map draws for an echo
ROUNDING = 0.001 / 12.0**0.5  # m, standard deviation of readings told to the millimetre


class SonarNoise(NamedTuple):
    """One band of ranges (m): how many sets and readings; spread (m), shares of outliers and of no echo.

    `sigma` is the standard deviation of the readings that are no outliers; `intervals` (3, 2) are the 95 % intervals of
    sigma, outliers and silence, nan for fewer than `FEWEST` sets.
    """

    nearest: float
    farthest: float
    n_sets: int
    n_readings: int
    sigma: float
    outliers: float
    silence: float
    intervals: np.ndarray

    @property
    def has_intervals(self) -> bool:
        """Whether it has sets enough for them."""
        return self.n_sets >= FEWEST


def fit_bands(ranges: np.ndarray, edges: np.ndarray, seed: int = 0, resamples: int = 200) -> list[SonarNoise]:
    """The noise in each band between `edges` (k + 1,) m that has any set of `ranges` (sets, repeats), inf for no echo.

    Sets of which more than half are silent have no range and belong to no band. Whole sets are drawn anew for the
    intervals, since the readings of one set are not independent; of what none of n sets shows, 3 / n is the interval's
    end (the rule of three). Raises ValueError for fewer than two repeats.
    """
    if ranges.ndim != 2 or ranges.shape[1] < 2:
        raise ValueError("at least two repeats of each reading are needed")
    ranges = ranges[np.mean(np.isfinite(ranges), axis=1) >= 0.5]
    middles = middles_of(ranges)
    bands = []
    for nearest, farthest in itertools.pairwise(edges):
        sets = ranges[(middles >= nearest) & (middles < farthest)]
        if len(sets) == 0:
            continue
        intervals = intervals_of(sets, np.random.default_rng(seed), resamples)
        bands.append(SonarNoise(float(nearest), float(farthest), len(sets), sets.size, *fit(sets), intervals))
    return bands


def intervals_of(sets: np.ndarray, rng: np.random.Generator, resamples: int) -> np.ndarray:
    """The 95 % intervals (3, 2) of sigma, outliers and silence of sets (n, repeats); nan for too few of them."""
    if len(sets) < FEWEST:
        return np.full((3, 2), np.nan)
    draws = np.array([fit(sets[rng.integers(0, len(sets), len(sets))]) for _ in range(resamples)])
    intervals, found = np.quantile(draws, [0.025, 0.975], axis=0).T, fit(sets)
    for kind in (1, 2):
        if found[kind] == 0.0:
            intervals[kind, 1] = min(1.0, 3.0 / len(sets))
    return intervals


def fit(sets: np.ndarray, gross: float = GROSS) -> tuple[float, float, float]:
    """Spread (m), share of outliers among the echoes, and share of silence, of sets (n, repeats) of one band.

    What lies farther than `gross` m from its set's middle is an outlier; the rest spreads at least as its rounding.
    A mixture fitted by maximum likelihood would not do: most readings of a set are equal, and a Gaussian of no width
    explains them best, to which a few millimetres are outliers already.
    """
    heard = np.isfinite(sets)
    errors = sets[heard] - np.broadcast_to(middles_of(sets)[:, None], sets.shape)[heard]
    inside = np.abs(errors) <= gross
    sigma = max(ROUNDING, float(np.sqrt(np.mean(errors[inside] ** 2))))
    return sigma, 1.0 - float(inside.mean()), 1.0 - float(heard.mean())


def middles_of(sets: np.ndarray) -> np.ndarray:
    """The median (n,) of what was heard in each set, silence left out, for it would push the middle outwards."""
    return np.nanmedian(np.where(np.isfinite(sets), sets, np.nan), axis=1) if len(sets) else np.empty(0)
