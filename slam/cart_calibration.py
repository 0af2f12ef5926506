"""What a cart's own runs say about it: wheelbase, tick, how badly its odometry errs, its bumper; maximum likelihood.

Two kinds of evidence: the path that a camera above saw, stage by stage, or a known map, whose walls each bump must be
at (`BumpLocalizer` tells which, an extended Kalman filter how likely). Neither the wheelbase nor the tick shows in the
counters alone, nor does the tick with a map of unknown scale. Quantization of the counters is known and is not learned.
Large errors have a component of their own, so that what is called noise is that of ordinary stages. Uses its siblings
`area`, `bump_localizer` and `cart_odometry`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.optimize import minimize, root_scalar

from slam.area import Area, nearest_wall, outward_normal
from slam.bump_localizer import BumpLocalizer, BumpLocalizerParams
from slam.cart_odometry import DRIVE, CartParams, Stage
from slam.pose import between, wrap

BY_CAMERA = (
    "wheelbase",
    "tick",
    "distance_noise",
    "turn_noise",
    "rotation_noise",
    "slip_share",
    "slip_distance",
    "play",
)
BY_MAP = (
    "wheelbase",
    "tick",
    "distance_noise",
    "turn_noise",
    "rotation_noise",
    "bumper_width",
    "bumper_ahead",
    "tolerance",
    "play",
)
DOUBT = {
    "wheelbase": 0.1,
    "tick": 0.05,
    "bumper_width": 0.5,
    "bumper_ahead": 0.05,
}  # of a parameter's logarithm beforehand, one sigma;
DECISIONS = 3  # times that it is decided anew which bumps were slips
VAGUE = 1.0  # and of those not named here: a factor of 2.7 either way
PLAY = 0.3  # ticks that gears' play swallows when a wheel turns round: the first guess
CHI_SQUARE = 2.706  # its 90 % quantile of one degree: twice what the log likelihood falls to an interval's ends
LEAST_STAGES = 20  # below which nothing is learned
FLATTEST = 0.02  # of a parameter's own curvature, that of any mixture of parameters
WIDEST = 6.0  # logarithm of how far from the first guess a parameter is looked for
CAMERA = np.array([0.002, 0.01])  # m, rad: standard deviations of a camera's poses
WILD_SHARE, WILD_TURN = 0.05, 0.7  # of stages whose heading errs by anything, and how far (rad)
OFTEN = 0.8  # of the bumps of a cart whose bumper sticks
LOOSE = 0.03  # share of the wheelbase that it may be wrong by while bumps are placed
LOST = 0.25  # m from the localizer's pose at which the filter begins anew
KICK = np.array([0.03, 0.03, 0.3])  # m, m, rad that a slip adds to what is not known

Cost = Callable[[np.ndarray], float]


class Learned(NamedTuple):
    """Parameters by name: estimates (n,), their 90 % intervals (n, 2), and the log likelihood's gain over the guess."""

    names: tuple[str, ...]
    values: np.ndarray
    intervals: np.ndarray
    gain: float

    def value(self, name: str) -> float:
        """One parameter's estimate."""
        return float(self.values[self.names.index(name)])


def learn_from_camera(
    runs: Sequence[Sequence[Stage]], paths: Sequence[np.ndarray], guess: CartParams, camera: np.ndarray = CAMERA
) -> Learned:
    """What runs say whose poses (n + 1, 3), at the start and after each of n stages, a camera saw.

    `camera` (2,) are standard deviations of its poses (m, rad). ValueError where there are too few stages, or a path is
    not of its run's length.
    """
    for stages, path in zip(runs, paths, strict=True):
        if len(path) != len(stages) + 1:
            raise ValueError(f"a path of {len(path)} poses for {len(stages)} stages; it needs one more than those")
    table = np.concatenate(
        [np.column_stack([[s.kind == DRIVE and s.bumper > 0 for s in stages], counts(stages)]) for stages in runs]
    )
    if len(table) < LEAST_STAGES:
        raise ValueError(f"{len(table)} stages tell nothing: {LEAST_STAGES} are needed at least")
    moved = np.concatenate([between(path[:-1], path[1:]) for path in paths])
    start = np.array([*(getattr(guess, name) for name in BY_CAMERA[:-1]), PLAY])

    def cost(logs: np.ndarray) -> float:
        return camera_cost(start * np.exp(logs), table, moved, camera)

    return fitted(cost, BY_CAMERA, start)


def counts(stages: Sequence[Stage]) -> np.ndarray:
    """Rows (n, 4) of n stages: ticks of both wheels, and which way each turned round at its start, 0 if it did not."""
    ticks = np.array([(stage.left, stage.right) for stage in stages], float)
    ways = np.sign(ticks)
    before = np.vstack([ways[:1], ways[:-1]])
    return np.hstack([ticks, np.where(ways * before < 0.0, ways, 0.0)])


def camera_cost(values: np.ndarray, table: np.ndarray, moved: np.ndarray, camera: np.ndarray) -> float:
    """Less the log likelihood of motions (n, 3) that a camera saw, of stages (n, 5): is a bump, and their `counts`."""
    wheelbase, tick, distance_noise, turn_noise, rotation_noise, slip_share, slip_distance, play = values
    slip_share = min(slip_share, 0.99)
    left, right = table[:, 1] + play * table[:, 3], table[:, 2] + play * table[:, 4]
    way = 0.5 * tick * (left + right)
    turn = tick * (right - left) / wheelbase
    turned = turn + wrap(moved[:, 2] - turn)
    chord = np.hypot(moved[:, 0], moved[:, 1]) * np.sign(way)
    is_way = np.abs(way) > 0.3 * wheelbase * np.abs(turn)
    went = np.where(is_way, chord / np.maximum(np.sinc(turned / (2.0 * np.pi)), 0.1), way)
    of_way = distance_noise**2 * np.abs(way) + tick**2 / 12.0 + 2.0 * camera[0] ** 2
    off = way - went
    ordinary = np.exp(-0.5 * off**2 / of_way) / np.sqrt(2.0 * np.pi * of_way)
    slipped = np.where(off > 0.0, np.exp(-np.maximum(off, 0.0) / slip_distance) / slip_distance, 1e-9)
    share = np.where(table[:, 0] > 0.0, slip_share, 1e-3)
    ways = np.log((1.0 - share) * ordinary + share * slipped + 1e-12)
    of_turn = turn_noise**2 * np.abs(way) + rotation_noise**2 * turn**2
    of_turn = of_turn + tick**2 / (3.0 * wheelbase**2) + 2.0 * camera[1] ** 2
    error = turned - turn
    calm = np.exp(-0.5 * error**2 / of_turn) / np.sqrt(2.0 * np.pi * of_turn)
    wild = np.exp(-0.5 * (error / WILD_TURN) ** 2) / (WILD_TURN * math.sqrt(2.0 * np.pi))
    wildness = np.where(table[:, 0] > 0.0, slip_share, WILD_SHARE)
    turns = np.log((1.0 - wildness) * calm + wildness * wild)
    return -float(np.sum(ways[is_way]) + np.sum(turns))


def learn_from_map(
    runs: Sequence[Sequence[Stage]], area: Area, guess: CartParams, tolerance: float = 0.003, seed: int = 0
) -> Learned:
    """What runs on a known map say; each begins anywhere on it. ValueError where too few bumps are localized."""
    tables = [located(stages, area, guess, seed) for stages in runs]
    if sum(int(np.sum(np.isfinite(table[:, 6]))) for table in tables) < LEAST_STAGES:
        raise ValueError("too few bumps have a sure place on the map; log longer runs, or check the map")
    start = np.array([*(getattr(guess, name) for name in BY_MAP[:-2]), tolerance, PLAY])
    slips = np.array([guess.slip_share, guess.slip_distance])

    def cost(logs: np.ndarray, decides: bool = False) -> float:
        return sum(map_cost(start * np.exp(logs), slips, table, decides) for table in tables)

    place = np.zeros(len(start))
    for _ in range(DECISIONS):
        cost(place, True)
        place = searched(believed(cost, BY_MAP), place)
    return fitted(cost, BY_MAP, start, place)


def located(stages: Sequence[Stage], area: Area, guess: CartParams, seed: int) -> np.ndarray:
    """Stages (n, 15): is a bump, `counts`, is a drive; for bumps with a sure place pose (3,), wall's normal (2,) and
    distance, and whether the left end (1) or the right one (-1) met it, else nan; is a slip, and is a beginning anew.

    A cart whose wheels mostly go on after bumps is another cart to the localizer: the likelier one places the bumps.
    """
    tables = []
    for slip_share in (guess.slip_share, OFTEN):
        cart = guess._replace(wheelbase_doubt=LOOSE, slip_share=slip_share)
        localizer = BumpLocalizer(area, cart, BumpLocalizerParams(), seed)
        tables.append((placed(localizer, stages), localizer.evidence))
    return max(tables, key=lambda pair: pair[1])[0]


def placed(localizer: BumpLocalizer, stages: Sequence[Stage]) -> np.ndarray:
    """The table of `located` by one localizer."""
    area, ahead = localizer.area, localizer.cart.bumper_ahead
    table = np.full((len(stages), 15), np.nan)
    table[:, 1:5] = counts(stages)
    for row, stage in enumerate(stages):
        localizer.step(stage)
        is_bump = stage.kind == DRIVE and stage.bumper > 0
        table[row, 0], table[row, 5] = is_bump, stage.kind == DRIVE
        estimate = localizer.estimate() if is_bump else None
        if estimate is None or not estimate.is_localized:
            continue
        x, y, heading = estimate.pose
        bumper_x, bumper_y = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
        _, near_x, near_y, _ = nearest_wall(area.walls, bumper_x, bumper_y)
        normal_x, normal_y = outward_normal(area, bumper_x, bumper_y)
        off = float(wrap(heading - math.atan2(normal_y, normal_x)))
        table[row, 6:9] = estimate.pose
        table[row, 9:13] = normal_x, normal_y, normal_x * near_x + normal_y * near_y, 1.0 if off < 0.0 else -1.0
    return table


@njit(cache=True)
def map_cost(values, slips, table, decides):
    """Less the log likelihood of the bumps of a run, stages (n, 15) as of `located`, by an extended Kalman filter.

    `values` (9,) are those of `BY_MAP`, `slips` (2,) slip_share and slip_distance. What makes steps in it, which bumps
    are slips, which end met and where the filter begins anew, is decided and noted in the table only if told so.
    """
    wheelbase, tick, distance_noise, turn_noise, rotation_noise, bumper_width, ahead, tolerance, play = values
    slip_share, slip_distance = slips
    state, covariance = np.zeros(3), np.eye(3)
    is_on, cost = False, 0.0
    for row in range(table.shape[0]):
        left, right = table[row, 1] + play * table[row, 3], table[row, 2] + play * table[row, 4]
        way, turn = 0.5 * tick * (left + right), tick * (right - left) / wheelbase
        if is_on:
            direction = state[2] + 0.5 * turn
            chord = way * (math.sin(0.5 * turn) / (0.5 * turn) if abs(turn) > 1e-6 else 1.0)
            cos, sin = math.cos(direction), math.sin(direction)
            state = state + np.array([chord * cos, chord * sin, turn])
            change = np.eye(3)
            change[0, 2], change[1, 2] = -chord * sin, chord * cos
            covariance = change @ covariance @ change.T
            ticks = tick * tick if table[row, 5] > 0.0 else 0.0  # cut off once a leg: counters go on between stages
            of_turn = turn_noise**2 * abs(way) + rotation_noise**2 * turn**2 + ticks / (3.0 * wheelbase**2)
            of_way = distance_noise**2 * abs(way) + ticks / 12.0
            by_turn = np.array([-0.5 * chord * sin, 0.5 * chord * cos, 1.0])
            by_way = np.array([cos, sin, 0.0])
            covariance = covariance + of_turn * np.outer(by_turn, by_turn) + of_way * np.outer(by_way, by_way)
        if table[row, 0] == 0.0:
            continue
        if math.isnan(table[row, 6]):
            is_on = False
            continue
        told = table[row, 6:9]
        if is_on:
            normal_x, normal_y, distance = table[row, 9], table[row, 10], table[row, 11]
            cos, sin = math.cos(state[2]), math.sin(state[2])
            half = 0.5 * bumper_width
            across = normal_y * cos - normal_x * sin
            if decides and abs(across) > 0.1:  # which end meets the wall is clear unless it is square
                table[row, 12] = 1.0 if across > 0.0 else -1.0
            side = table[row, 12]
            end_x, end_y = ahead * cos - side * half * sin, ahead * sin + side * half * cos
            off = normal_x * (state[0] + end_x) + normal_y * (state[1] + end_y) - distance
            slope = np.array([normal_x, normal_y, -normal_x * end_y + normal_y * end_x])
            pulled = covariance @ slope
            variance = slope @ pulled + tolerance**2
            ordinary = (1.0 - slip_share) * math.exp(-0.5 * off * off / variance) / math.sqrt(2.0 * math.pi * variance)
            slipped = 1e-6 + slip_share * (math.exp(-off / slip_distance) / slip_distance if off > 0.0 else 0.0)
            cost -= math.log(ordinary + slipped)
            if decides:
                table[row, 13] = 1.0 if ordinary < slipped else 0.0
            if table[row, 13] > 0.0:
                forward = max(0.2, normal_x * cos + normal_y * sin)
                state = state - np.array([off / forward * cos, off / forward * sin, 0.0])
                covariance = covariance + np.diag(KICK**2)
                pulled = covariance @ slope
                variance, off = slope @ pulled + tolerance**2, 0.0
            gain = pulled / variance
            state = state - gain * off
            covariance = covariance - np.outer(gain, pulled)
            if decides:
                table[row, 14] = 1.0 if math.hypot(state[0] - told[0], state[1] - told[1]) > LOST else 0.0
            is_on = table[row, 14] == 0.0
        if not is_on:
            state, is_on = told.copy(), True
            covariance = np.diag(np.array([0.03, 0.03, 0.1]) ** 2)
    return cost


def fitted(cost: Cost, names: tuple[str, ...], start: np.ndarray, place: np.ndarray | None = None) -> Learned:
    """The likeliest place, searched as logarithms over `start` (n,) from a `place` on, and where the profile ends.

    What is believed beforehand (`DOUBT`) counts, so that a parameter which the runs do not tell stays what it was.
    """
    whole = believed(cost, names)
    best = searched(whole, np.zeros(len(names)) if place is None else place)
    intervals = np.array([profile(whole, best, whole(best), row) for row in range(len(names))])
    gain = cost(np.zeros(len(names))) - cost(best)
    return Learned(names, start * np.exp(best), start[:, None] * np.exp(intervals), gain)


def believed(cost: Cost, names: tuple[str, ...]) -> Cost:
    """The cost with that of being away from what is believed beforehand."""
    doubts = np.array([DOUBT.get(name, VAGUE) for name in names])
    return lambda place: cost(place) + 0.5 * float(np.sum((place / doubts) ** 2))


def searched(cost: Cost, start: np.ndarray) -> np.ndarray:
    """The place (n,) of least cost near `start`: down its slope, then by a simplex, which no kink stops.

    Each parameter is counted in steps that matter to it.
    """
    place = start
    for method, options in (("L-BFGS-B", {}), ("Nelder-Mead", {"maxfev": 1200, "fatol": 1e-3, "adaptive": True})):
        least = cost(place)
        steps = np.array([step_of(cost, place, least, row) for row in range(len(place))])

        def scaled(counted: np.ndarray, here: np.ndarray = place, steps: np.ndarray = steps) -> float:
            return bounded(cost)(here + steps * counted)

        simplex = np.vstack([np.zeros(len(place)), np.eye(len(place))])
        more = {"initial_simplex": simplex} if method == "Nelder-Mead" else {}
        found = place + steps * minimize(scaled, simplex[0], method=method, options=options | more).x
        place = found if cost(found) < least else place
    return place


def bounded(cost: Cost) -> Cost:
    """The cost, huge beyond `WIDEST`."""
    return lambda place: cost(place) if np.all(np.abs(place) < WIDEST) else 1e9


def profile(cost: Cost, best: np.ndarray, least: float, row: int) -> tuple[float, float]:
    """Where the least cost for a held parameter rises by what 90 % allow, below and above its best place.

    The others follow a quadratic fitted at the best place, whose curvature makes the first guess of the ends.
    """
    inverse = spread(curvature(cost, best))
    direction = inverse[:, row] / max(inverse[row, row], 1e-12)  # how the others go with it
    sigma = math.sqrt(max(inverse[row, row], 1e-12))

    def rise(step: float) -> float:
        return bounded(cost)(best + step * direction) - least - 0.5 * CHI_SQUARE

    def end(sign: float) -> float:
        reach = 1.6 * sigma
        while rise(sign * reach) < 0.0:
            reach *= 1.5
            if reach > WIDEST:
                return sign * WIDEST
        capped = lambda step: min(rise(sign * step), 1e3)  # noqa: E731
        return sign * float(root_scalar(capped, bracket=(0.0, reach), xtol=1e-5).root)

    return float(best[row] + end(-1.0)), float(best[row] + end(1.0))


def spread(hessian: np.ndarray) -> np.ndarray:
    """The inverse (n, n) of second derivatives, where directions that seem to bend down count as barely told."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1.0))  # no parameter is told less than beforehand
    values, vectors = np.linalg.eigh(hessian * np.outer(scale, scale))
    return (vectors / np.maximum(values, FLATTEST)) @ vectors.T * np.outer(scale, scale)


def curvature(cost: Cost, place: np.ndarray) -> np.ndarray:
    """Second derivatives (n, n) of a cost by central differences, over steps that raise it by about one half."""
    n, least = len(place), cost(place)
    steps = np.diag([step_of(cost, place, least, row) for row in range(n)])
    hessian = np.empty((n, n))
    for i in range(n):
        for j in range(i, n):
            corners = [cost(place + a * steps[i] + b * steps[j]) for a in (0.5, -0.5) for b in (0.5, -0.5)]
            difference = corners[0] - corners[1] - corners[2] + corners[3]
            hessian[i, j] = hessian[j, i] = difference / (steps[i, i] * steps[j, j])
    return hessian


def step_of(cost: Cost, place: np.ndarray, least: float, row: int) -> float:
    """A step along one parameter that raises the cost by about one half to the one side or the other."""
    step, direction = 1e-4, np.eye(len(place))[row]
    while step < 1.0 and min(cost(place + step * direction), cost(place - step * direction)) < least + 0.5:
        step *= 1.4
    return step
