"""What a few parameters may be by a cost that takes milliseconds: their medians, and how sure each is.

Costs are less log likelihoods. They need not be smooth, nor as steep on both sides: a noise that is too large costs
soon, one that is too small may hardly cost anything where other errors can stand in for it, and a quadratic at the
bottom says nothing of that. So places are drawn and weighed by what they cost, from ever better normal ones (adaptive
multiple importance sampling: Cornuet et al., Scandinavian Journal of Statistics 39, 2012). Intervals are wider where
the runs themselves vary more than the model has it (Huber, The behavior of maximum likelihood estimates under
nonstandard conditions, 1967). Parameters are counted from a first guess, positive ones by their logarithm. Uses its
sibling `resampling`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from slam.resampling import effective_sample_size, normalize

Cost = Callable[[np.ndarray], float]
Costs = Callable[[np.ndarray], np.ndarray]
SHARES = (0.05, 0.5, 0.95)  # of what is believed, below the ends of an interval and the estimate
NORMAL = 1.645  # sigmas of a normal belief from its middle to an interval's ends
WIDEST = 5.0  # of the doubt beforehand that a parameter is looked for on both sides
DESCENTS = 10  # steps down the slope before the first draw,
ROUNDS = 8  # draws after one another,
SAMPLES = 200  # places in each,
ENOUGH = 4  # places for each parameter that must count for a covariance: if fewer do, weights are flattened
HALVINGS = 20  # after which that power is known
TAILS = 8.0  # degrees of freedom of what is drawn, whose tails are longer than normal ones
BROADER = 1.2  # variance of what is drawn, as a multiple of what was found
LEAST = 1e-8  # variance below which nothing is drawn
HOPELESS = 1e6  # the cost of values with which nothing can be computed


class Unknown(NamedTuple):
    """A parameter to be found: its first guess, and how far off that may be, one sigma; the logarithm if `is_share`."""

    name: str
    guess: float
    doubt: float
    is_share: bool = True

    def at(self, place: float) -> float:
        """The value so many sigmas from the guess."""
        return self.guess * math.exp(self.doubt * place) if self.is_share else self.guess + self.doubt * place


class Learned(NamedTuple):
    """Parameters by name: estimates (n,), their 90 % intervals (n, 2), and the log likelihood's gain over the guess.

    `left` (n,) is the share of the doubt there was beforehand that the runs leave: near 1 they tell nothing.
    """

    names: tuple[str, ...]
    values: np.ndarray
    intervals: np.ndarray
    gain: float
    left: np.ndarray

    def value(self, name: str) -> float:
        """One parameter's estimate."""
        return float(self.values[self.names.index(name)])

    def interval(self, name: str) -> tuple[float, float]:
        """The ends of its 90 % interval."""
        low, high = self.intervals[self.names.index(name)]
        return float(low), float(high)


def fitted(costs: Costs, unknowns: Sequence[Unknown], wanted: Sequence[str], block: int) -> Learned:
    """What is likely by `costs` of values (n,) in the order of the unknowns: medians and intervals of those `wanted`.

    The costs (m,) are of what came one after the other; errors of the model hang together over a `block` of them.

    What is believed beforehand counts, so that a parameter which the runs do not tell stays what it was.
    """

    def whole(place: np.ndarray) -> float:
        found = float(np.sum(costs(values_at(unknowns, place)))) + 0.5 * float(place @ place)
        return found if math.isfinite(found) else HOPELESS

    places, weights = sampled(whole, descended(whole, np.zeros(len(unknowns))))
    middle, covariance = moments(places, weights)
    wider = excess(lambda place: costs(values_at(unknowns, place)), middle, covariance, block)
    rows = [row for row, unknown in enumerate(unknowns) if unknown.name in wanted]
    ends, medians = np.empty((len(rows), 2)), middle.copy()
    for own, row in enumerate(rows):
        low, medians[row], high = quantiles(places[:, row], weights, SHARES)
        ends[own] = medians[row] + wider[row] * (np.array([low, high]) - medians[row])
    chosen = [unknowns[row] for row in rows]
    intervals = np.array([[one.at(end) for end in pair] for one, pair in zip(chosen, ends, strict=True)])
    found = values_at(unknowns, medians)
    gain = float(np.sum(costs(values_at(unknowns, np.zeros(len(unknowns)))) - costs(found)))
    return Learned(tuple(one.name for one in chosen), found[rows], intervals, gain, np.ptp(ends, axis=1) / (2 * NORMAL))


def values_at(unknowns: Sequence[Unknown], place: np.ndarray) -> np.ndarray:
    """Values (n,) so many sigmas (n,) from the guesses."""
    return np.array([unknown.at(float(off)) for unknown, off in zip(unknowns, place, strict=True)])


def sampled(cost: Cost, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (k, n) around `start` and what each weighs (k,), together 1.

    Each draw is from a t distribution with the moments that all draws before amount to; what a place weighs is its
    likelihood by the density of all draws together.
    """
    n = len(start)
    rng = np.random.default_rng(n)  # the same places each time
    middle, covariance = start, np.diag([step_of(cost, start, row) ** 2 for row in range(n)])
    places, logs, weights, draws = np.empty((0, n)), np.empty(0), np.empty(0), []
    for _ in range(ROUNDS):
        root = np.linalg.cholesky(BROADER * covariance)
        draws.append((middle, root))
        stretch = np.sqrt(TAILS / rng.chisquare(TAILS, (SAMPLES, 1)))
        drawn = np.clip(middle + stretch * rng.standard_normal((SAMPLES, n)) @ root.T, -WIDEST, WIDEST)
        places, logs = np.vstack([places, drawn]), np.append(logs, [-cost(place) for place in drawn])
        densities = np.array([log_density(places, *draw) for draw in draws])
        weights = flattened(logs - np.logaddexp.reduce(densities), ENOUGH * n)
        middle, covariance = moments(places, weights)
    return places, weights


def log_density(places: np.ndarray, middle: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Of a t distribution around `middle` (n,), at places (k, n), but for a constant; `root` (n, n) of its spread."""
    off = np.linalg.solve(root, (places - middle).T)
    return -0.5 * (TAILS + len(middle)) * np.log1p(np.sum(off**2, axis=0) / TAILS) - np.sum(np.log(np.diag(root)))


def flattened(logs: np.ndarray, enough: float) -> np.ndarray:
    """Weights (k,) by their logarithms (k,), of which so many count as `enough`, by a power below 1 where it needs be.

    Where few of all places count, a flat weight errs to the side of too wide an interval.
    """
    weights = normalize(logs)
    if effective_sample_size(weights) >= enough:
        return weights
    power, step = 0.5, 0.25
    for _ in range(HALVINGS):
        counts = effective_sample_size(normalize(power * logs)) >= enough
        power, step = power + step if counts else power - step, 0.5 * step
    return normalize(power * logs)


def moments(places: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n,) and covariance (n, n) of places (k, n) that weigh so much (k,)."""
    middle = weights @ places
    off = places - middle
    return middle, (off * weights[:, None]).T @ off + LEAST * np.eye(len(middle))


def quantiles(values: np.ndarray, weights: np.ndarray, shares: Sequence[float]) -> np.ndarray:
    """Below which (m,) shares (m,) of all that values (k,) weigh (k,) are."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(shares, below, values[order])


def descended(cost: Cost, start: np.ndarray) -> np.ndarray:
    """Down the slope from a place (n,), each parameter counted in steps that matter to it."""
    steps = np.array([step_of(cost, start, row) for row in range(len(start))])
    found = minimize(
        lambda counted: cost(start + steps * counted),
        np.zeros(len(start)),
        jac=lambda counted: slope(cost, start + steps * counted, 0.3 * steps) * steps,
        method="L-BFGS-B",
        bounds=[((-WIDEST - at) / step, (WIDEST - at) / step) for at, step in zip(start, steps, strict=True)],
        options={"maxiter": DESCENTS},
    )
    place = start + steps * found.x
    return place if cost(place) < cost(start) else start


def slope(cost: Cost, place: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """First derivatives (n,) of a cost by central differences over steps (n,)."""
    found = np.empty(len(place))
    for row, step in enumerate(steps):
        off = np.zeros(len(place))
        off[row] = 0.5 * step
        found[row] = (cost(place + off) - cost(place - off)) / step
    return found


def step_of(cost: Cost, place: np.ndarray, row: int) -> float:
    """A step along one parameter that raises the cost by one half and more to both sides."""
    step, direction, least = 4e-3, np.eye(len(place))[row], cost(place)
    while step < 1.0 and min(cost(place + step * direction), cost(place - step * direction)) < least + 0.5:
        step *= 2.0
    return step


def excess(costs: Costs, best: np.ndarray, covariance: np.ndarray, block: int) -> np.ndarray:
    """By how much (n,) estimates vary more than their covariance (n, n) has it, at least 1; by slopes of blocks."""
    n = len(best)
    slopes = []
    for row, step in enumerate(0.5 * np.sqrt(np.diag(covariance))):
        off = np.zeros(n)
        off[row] = step
        change = (costs(best + off) - costs(best - off)) / (2.0 * step)
        slopes.append(np.add.reduceat(change, np.arange(0, len(change), block)))
    scores = np.array(slopes)
    scores = scores - scores.mean(axis=1, keepdims=True)
    varied = covariance @ (scores @ scores.T + np.eye(n)) @ covariance  # what is believed beforehand varies by 1
    return np.sqrt(np.maximum(np.diag(varied) / np.diag(covariance), 1.0))
