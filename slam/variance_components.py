"""Maximum likelihood of variance components: how large several independent causes of one set of residuals are.

Residuals r of a block are Gaussian with covariance sum_c s_c^2 K_c, where K_c (m, m) is what cause c does to them at
unit size; blocks are independent and share the sizes s (Patterson and Thompson 1971 for the problem; Gilmour, Thompson
and Cullis, Biometrics 51, 1995, for the average information that steers the search). Sizes are searched as logarithms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CHI_SQUARE = 3.84  # its 95 % quantile of one degree: twice what the log likelihood falls to an interval's ends
NOTHING, HUGE = math.log(1e-4), math.log(10.0)  # sizes beyond which a component is called absent or unbounded
ROUNDS = 60
CLOSE = 1e-4  # of the log likelihood, which no decision here depends on


class Block(NamedTuple):
    """Residuals (m,) and, for each of c causes, what it does to them at unit size (c, m, m)."""

    residuals: np.ndarray
    kernels: np.ndarray


class Estimate(NamedTuple):
    """Logarithms (c,) of the sizes, their log likelihood, and the average information (c, c) about them."""

    log_sizes: np.ndarray
    value: float
    information: np.ndarray


def log_likelihood(blocks: Sequence[Block], log_sizes: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Value, gradient (c,) and average information (c, c) with respect to the logarithms of the sizes."""
    variances = np.exp(2.0 * log_sizes)
    value, gradient = 0.0, np.zeros(log_sizes.size)
    information = np.zeros((log_sizes.size, log_sizes.size))
    for residuals, kernels in blocks:
        covariance = np.tensordot(variances, kernels, 1)
        factor = np.linalg.cholesky(covariance)
        inverse = np.linalg.inv(covariance)
        pulled = inverse @ residuals
        value -= float(np.sum(np.log(np.diag(factor)))) + 0.5 * float(residuals @ pulled)
        value -= 0.5 * residuals.size * math.log(2.0 * math.pi)
        moved = kernels @ pulled
        gradient += variances * (moved @ pulled - np.tensordot(kernels, inverse, 2))
        moved *= variances[:, None]
        information += 2.0 * moved @ inverse @ moved.T
    return value, gradient, information


def maximise(blocks: Sequence[Block], start: np.ndarray, held: Sequence[int] = ()) -> Estimate:
    """The sizes of greatest likelihood from `start` (c,) on, those of the components `held` staying as they are."""
    free = np.setdiff1d(np.arange(start.size), held)
    here = np.array(start, float)
    value, gradient, information = log_likelihood(blocks, here)
    damping = 1e-3
    for _ in range(ROUNDS):
        within = information[np.ix_(free, free)]
        damped = within + np.diag(damping * (1.0 + np.diag(within)))
        step = np.zeros(here.size)
        step[free] = np.clip(np.linalg.solve(damped, gradient[free]), -1.0, 1.0)
        there = np.clip(here + step, NOTHING - 1.0, HUGE + 1.0)
        new_value, new_gradient, new_information = log_likelihood(blocks, there)
        if new_value < value - 1e-9:
            damping *= 10.0
            continue
        gained = new_value - value
        here, value, gradient, information = there, new_value, new_gradient, new_information
        damping *= 0.3
        if gained < CLOSE:
            break
    return Estimate(here, value, information)


def interval(blocks: Sequence[Block], best: Estimate, which: int, excess: float = 1.0) -> tuple[float, float]:
    """95 % interval of the size of component `which`, from the profile likelihood.

    `excess` is how many times the likelihood of the truth falls short of the best by more than chi square allows, as it
    does where residuals are less independent than they are taken for. The lower end is 0 where absence is as likely,
    the upper one infinite where nothing bounds it.
    """
    return (
        math.exp(end(blocks, best, which, -1.0, excess)),
        math.exp(end(blocks, best, which, 1.0, excess)),
    )


def end(blocks: Sequence[Block], best: Estimate, which: int, sign: float, excess: float) -> float:
    """Logarithm of one end of the interval: bracketed, then by secants on the root of the drop, nearly a line."""
    limit = NOTHING if sign < 0.0 else HUGE
    start = max(float(best.log_sizes[which]), NOTHING)
    if sign * (limit - start) <= 0.0:
        return sign * math.inf
    at = best.log_sizes.copy()

    def root_drop(log_size: float) -> float:
        nonlocal at
        at[which] = log_size
        found = maximise(blocks, at, [which])
        at = found.log_sizes
        return math.sqrt(max(0.0, best.value - found.value))

    wanted = math.sqrt(0.5 * CHI_SQUARE * excess)
    near, near_drop = start, 0.0
    step = min(2.0, max(0.05, 1.5 * wanted / math.sqrt(best.information[which, which] + 1e-9)))
    while True:
        far = near + sign * step if abs(limit - near) > step else limit
        far_drop = root_drop(far)
        if far_drop >= wanted:
            break
        if far == limit:
            return sign * math.inf
        near, near_drop = far, far_drop
        step *= 1.5
    for _ in range(3):
        middle = near + (far - near) * (wanted - near_drop) / (far_drop - near_drop)
        drop = root_drop(middle)
        if abs(drop - wanted) < 0.02:
            return middle
        if drop < wanted:
            near, near_drop = middle, drop
        else:
            far, far_drop = middle, drop
    return near + (far - near) * (wanted - near_drop) / (far_drop - near_drop)
