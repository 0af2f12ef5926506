"""The likeliest values of a few parameters by a cost that takes milliseconds, and how sure each is.

Costs are less log likelihoods, rough by a share of a unit where something discrete in them changes. So they are not
followed point by point: a quadratic is fitted to them over the region that is likely at all, again and again around the
place that the last one found. Intervals are those of the profile likelihood: where the least cost, all others let go,
has risen by what a share allows, and wider where the runs themselves vary more than the model has it (Huber, The
behavior of maximum likelihood estimates under nonstandard conditions, 1967). Parameters are counted from a first
guess, positive ones by their logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

Cost = Callable[[np.ndarray], float]
Costs = Callable[[np.ndarray], np.ndarray]
CHI_SQUARE = 2.706  # its 90 % quantile of one degree: twice what the log likelihood falls to an interval's ends
FLATTEST = 0.02  # of a parameter's own curvature, that of any mixture of parameters
WIDEST = 5.0  # of the doubt beforehand that a parameter is looked for on both sides
DESCENTS = 10  # steps down the slope before the first quadratic,
ROUNDS = 4  # quadratics after one another,
NARROW = 0.7  # sigmas within which a quadratic is fitted,
SAMPLES = 1.7  # places for each number that a quadratic has,
BROAD = 10.0  # units of cost over which places count less and less,
FARTHEST = 3.0  # sigmas that a quadratic's bottom is believed to be away
HOPELESS = 1e6  # the cost of values with which nothing can be computed
SHARES = (1.0, 0.6, 0.3)  # of the way to it that are tried
RIDGE = np.linspace(-2.4, 2.4, 13)  # sigmas at which a profile is looked at


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
    """The likeliest values by `costs` of values (n,) in the order of the unknowns, and intervals of those `wanted`.

    The costs (m,) are of what came one after the other; errors of the model hang together over a `block` of them.

    What is believed beforehand counts, so that a parameter which the runs do not tell stays what it was.
    """

    def whole(place: np.ndarray) -> float:
        found = float(np.sum(costs(values_at(unknowns, place)))) + 0.5 * float(place @ place)
        return found if math.isfinite(found) else HOPELESS

    best, hessian = searched(whole, np.zeros(len(unknowns)))
    rows = [row for row, unknown in enumerate(unknowns) if unknown.name in wanted]
    wider = excess(lambda place: costs(values_at(unknowns, place)), best, hessian, block)
    ends = np.array([profile(whole, best, hessian, row) for row in rows])
    ends = best[rows, None] + wider[rows, None] * (ends - best[rows, None])
    chosen = [unknowns[row] for row in rows]
    intervals = np.array([[one.at(end) for end in pair] for one, pair in zip(chosen, ends, strict=True)])
    found = values_at(unknowns, best)
    gain = float(np.sum(costs(values_at(unknowns, np.zeros(len(unknowns)))) - costs(found)))
    left = np.ptp(ends, axis=1) / (2.0 * math.sqrt(CHI_SQUARE))
    return Learned(tuple(one.name for one in chosen), found[rows], intervals, gain, left)


def values_at(unknowns: Sequence[Unknown], place: np.ndarray) -> np.ndarray:
    """Values (n,) so many sigmas (n,) from the guesses."""
    return np.array([unknown.at(float(off)) for unknown, off in zip(unknowns, place, strict=True)])


def searched(cost: Cost, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The place (n,) of least cost near `start`, and the second derivatives (n, n) there."""
    best = descended(cost, start)
    hessian = curvature(cost, best)
    rng = np.random.default_rng(len(start))  # the same places each time
    for _ in range(ROUNDS):
        best, hessian = by_quadratic(cost, best, hessian, rng)
    return best, hessian


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


def curvature(cost: Cost, place: np.ndarray) -> np.ndarray:
    """Second derivatives (n, n) of a cost by differences, over steps that raise it by about one half."""
    n, least = len(place), cost(place)
    steps = np.diag([step_of(cost, place, row) for row in range(n)])
    around = [(cost(place + step), cost(place - step)) for step in steps]
    hessian = np.empty((n, n))
    for i in range(n):
        hessian[i, i] = (sum(around[i]) - 2.0 * least) / steps[i, i] ** 2
        for j in range(i):
            both = cost(place + steps[i] + steps[j]) + cost(place - steps[i] - steps[j]) + 2.0 * least
            mixed = 0.5 * (both - sum(around[i]) - sum(around[j]))
            hessian[i, j] = hessian[j, i] = mixed / (steps[i, i] * steps[j, j])
    return upright(hessian)


def upright(hessian: np.ndarray) -> np.ndarray:
    """Second derivatives (n, n) that bend up everywhere.

    Directions that seem to bend down count as barely told, and no parameter is told less than beforehand (1).
    """
    scale = np.sqrt(np.maximum(np.diag(hessian), 1.0))
    values, vectors = np.linalg.eigh(hessian / np.outer(scale, scale))
    return (vectors * np.maximum(values, FLATTEST)) @ vectors.T * np.outer(scale, scale)


def step_of(cost: Cost, place: np.ndarray, row: int) -> float:
    """A step along one parameter that raises the cost by one half and more to both sides."""
    step, direction, least = 4e-3, np.eye(len(place))[row], cost(place)
    while step < 1.0 and min(cost(place + step * direction), cost(place - step * direction)) < least + 0.5:
        step *= 2.0
    return step


def by_quadratic(
    cost: Cost, place: np.ndarray, hessian: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The bottom (n,) of a quadratic fitted to the cost where a first one is low, and its second derivatives (n, n)."""
    n = len(place)
    to_place = np.linalg.inv(np.linalg.cholesky(hessian)).T  # from coordinates in which the first one is round
    rows, columns = np.triu_indices(n)
    half = round(0.5 * SAMPLES * (1 + n + len(rows)))
    drawn = NARROW * rng.standard_normal((half, n))
    drawn = np.vstack([np.zeros(n), drawn, -drawn])
    costs = np.array([cost(place + to_place @ one) for one in drawn])
    weights = np.exp(-0.5 * (costs - costs.min()) / BROAD)  # the root of what each counts
    products = drawn[:, rows] * drawn[:, columns] * np.where(rows == columns, 0.5, 1.0)
    design = np.column_stack([np.ones(len(drawn)), drawn, products])
    found = np.linalg.lstsq(design * weights[:, None], costs * weights, rcond=None)[0]
    round_one = np.zeros((n, n))
    round_one[rows, columns] = round_one[columns, rows] = found[1 + n :]
    values, vectors = np.linalg.eigh(round_one)
    round_one = (vectors * np.maximum(values, FLATTEST)) @ vectors.T
    move = -np.linalg.solve(round_one, found[1 : 1 + n])
    move *= min(1.0, FARTHEST / max(float(np.linalg.norm(move)), 1e-12))
    back = np.linalg.inv(to_place)
    trials = [np.clip(place + to_place @ (share * move), -WIDEST, WIDEST) for share in SHARES]
    trials.append(place + to_place @ drawn[int(np.argmin(costs))])
    return min(trials, key=cost), upright(back.T @ round_one @ back)


def excess(costs: Costs, best: np.ndarray, hessian: np.ndarray, block: int) -> np.ndarray:
    """By how much (n,) estimates vary more than the curvature has it, at least 1; from the slopes block by block."""
    n = len(best)
    inverse = np.linalg.inv(hessian)
    slopes = []
    for row, step in enumerate(0.5 * np.sqrt(np.diag(inverse))):
        off = np.zeros(n)
        off[row] = step
        change = (costs(best + off) - costs(best - off)) / (2.0 * step)
        slopes.append(np.add.reduceat(change, np.arange(0, len(change), block)))
    scores = np.array(slopes)
    scores = scores - scores.mean(axis=1, keepdims=True)
    varied = inverse @ (scores @ scores.T + np.eye(n)) @ inverse  # what is believed beforehand varies by 1
    return np.sqrt(np.maximum(np.diag(varied) / np.diag(inverse), 1.0))


def profile(cost: Cost, best: np.ndarray, hessian: np.ndarray, row: int) -> tuple[float, float]:
    """Where the least cost for a held parameter rises by what 90 % allow, below and above its best place.

    The others follow the quadratic; what the cost does along them is smoothed by a polynomial of the fourth degree, for
    a noise's likelihood is not as steep above as below.
    """
    inverse = np.linalg.inv(hessian)
    sigma = math.sqrt(inverse[row, row])
    direction = inverse[:, row] / sigma
    costs = np.array([cost(best + step * direction) for step in RIDGE])
    curve = np.polynomial.Polynomial.fit(RIDGE, costs, 4, w=np.exp(-0.25 * (costs - costs.min()) / BROAD))
    steps = np.linspace(2.0 * RIDGE[0], 2.0 * RIDGE[-1], 2001)
    inside = np.abs(steps) <= RIDGE[-1]
    heights = np.where(inside, curve(steps), np.inf)
    lowest = int(np.argmin(heights))
    allowed = heights[lowest] + 0.5 * CHI_SQUARE
    below = np.flatnonzero(heights[:lowest] > allowed)
    above = np.flatnonzero(heights[lowest:] > allowed)
    low, high = steps[below[-1]], steps[lowest + above[0]]
    return float(best[row] + sigma * low), float(best[row] + sigma * high)
