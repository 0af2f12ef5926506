"""Round walls in a map from bumps: chains of straight stretches that an arc explains better, felt from inside.

Of a circle about c with radius R a bump from inside tells that the end of the bumper that is farther from c is R away.
For a chain of lines an arc is fitted to the bumps that were told of them, and all poses descend again with each of
those bumps on the circle's tangent, in turns until both hold. Arc and stretches are then compared over the whole run by
Schwarz's criterion (BIC, 1978), in nats: a line has two numbers to choose and an arc three, each of which costs half
the logarithm of the number of bumps. A wall that bulges inward, as a pillar's does, stays a chain. Uses its siblings
`bump_bundle` and `bump_refinement`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slam.bump_bundle import STRAY_SHARE, BumpBundle, Legs
from slam.bump_refinement import BumpRefinementParams, Refined
from slam.bump_swarm import BEYOND, HIGH, HITS, LOW, PHI, Model, X, Y
from slam.bump_walls import BRIDGE, LEAST_BUMPS, chains_of, corners_of, stretches
from slam.cart_odometry import CartParams, bumper_points
from slam.pose import wrap
from slam.pose_graph import descend

LONGEST_CHAIN = 8  # stretches that may be one arc
LEAST_SWEEP = math.radians(30.0)  # by which their directions differ
LEAST_ON_ARC = 6  # bumps that tell of an arc
LARGEST = 2.0  # m of radius; flatter ones are straight
CONVINCING = 5.0  # nats that an arc must save besides: odds of 150 to 1
TURNS = 4  # of fitting circle and poses
NEAR = 4.0  # mean square of the bumps' distances from a first circle, in contacts' deviations, that is tried further
BULGE = 4.0  # of those deviations: what an arc may stand off a stretch that was felt as straight
FACET = math.radians(5.0)  # of the curve that is told


class Arc(NamedTuple):
    """A wall on a circle about (x, y) in m, felt from bearing `low` on counter-clockwise by `sweep`, so many `hits`."""

    x: float
    y: float
    radius: float
    low: float
    sweep: float
    hits: int

    @property
    def curve(self) -> np.ndarray:
        """Its points (k, 2), a few degrees apart."""
        bearings = self.low + np.linspace(0.0, self.sweep, 2 + int(self.sweep / FACET))
        return np.array([self.x, self.y]) + self.radius * np.column_stack([np.cos(bearings), np.sin(bearings)])


class Rounded(NamedTuple):
    """Poses `nodes` (2 t, 3) and `lines` (m, 10) of a run, its round walls, and the bumps (t,) that felt each.

    `is_replaced` (m,) are the lines that arcs stand for; `cost` is that of squares, strays and numbers, in nats.
    """

    nodes: np.ndarray
    lines: np.ndarray
    biases: np.ndarray
    arcs: list[Arc]
    groups: list[np.ndarray]
    is_replaced: np.ndarray
    cost: float


def felt_ends(poses: np.ndarray, centre: np.ndarray, cart: CartParams) -> np.ndarray:
    """The ends (n, 2) of the bumper that are farther from a centre (2,), of carts at poses (n, 3)."""
    ends = bumper_points(poses, cart)[:, [0, 2]]
    farther = np.argmax(np.hypot(*np.moveaxis(ends - centre, -1, 0)), axis=1)
    return ends[np.arange(len(ends)), farther]


def through(points: np.ndarray) -> np.ndarray:
    """Centre and radius (3,) of a circle through points (n, 2), by the squares' linear form (Kasa, 1976)."""
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    x, y, rest = np.linalg.lstsq(matrix, np.sum(points**2, axis=1), rcond=None)[0].tolist()
    return np.array([x, y, math.sqrt(max(rest + x * x + y * y, 1e-6))])


def fit_circle(poses: np.ndarray, cart: CartParams, contact: float) -> np.ndarray | None:
    """Centre and radius (3,) of the circle that bumps at poses (n, 3) felt from inside; none where it is straight.

    Gauss-Newton steps with the weights that bumps have which may be strays.
    """
    circle = through(bumper_points(poses, cart)[:, 1])
    circle = through(felt_ends(poses, circle[:2], cart))
    for _ in range(20):
        away = felt_ends(poses, circle[:2], cart) - circle[:2]
        distances = np.hypot(*away.T)
        off = distances - circle[2]
        density = np.exp(-0.5 * np.minimum(np.square(off / (3.0 * contact)), 50.0))
        weights = density / (density + STRAY_SHARE)
        jacobian = np.column_stack([-away / distances[:, None], -np.ones(len(off))])
        squares = jacobian.T @ (weights[:, None] * jacobian) + 1e-9 * np.eye(3)
        step = np.linalg.solve(squares, jacobian.T @ (weights * off))
        circle -= step
        if not np.all(np.isfinite(circle)) or not 0.0 < circle[2] < LARGEST:
            return None
        if float(np.max(np.abs(step))) < 1e-6:
            break
    return circle


def arc_of(circle: np.ndarray, poses: np.ndarray, cart: CartParams) -> Arc:
    """The part of a circle (3,) that bumps at poses (n, 3) felt: all but the widest gap between their bearings."""
    away = felt_ends(poses, circle[:2], cart) - circle[:2]
    bearings = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    gaps = np.diff(np.append(bearings, bearings[0] + 2.0 * math.pi))
    widest = int(np.argmax(gaps))
    low = float(bearings[(widest + 1) % len(bearings)])
    x, y, radius = circle.tolist()
    return Arc(x, y, radius, low, 2.0 * math.pi - float(gaps[widest]), len(poses))


def with_arcs(
    legs: Legs, state: Refined, model: Model, cart: CartParams, spreads: tuple[float, float],
    params: BumpRefinementParams,
) -> Rounded:  # fmt: skip
    """A refined state with arcs for the chains of lines where they cost less, longer chains first."""
    straight = Rounded(state.nodes, state.lines, state.biases, [], [], np.zeros(len(state.lines), bool), math.inf)
    found = None
    for chain in sorted(candidates(state, model, cart), key=len, reverse=True):
        found = found or descended(legs, state, straight, model, cart, spreads, params)
        if found is None or np.any(found.is_replaced[chain]):
            continue
        is_replaced = found.is_replaced.copy()
        is_replaced[chain] = True
        groups = [*found.groups, np.isin(state.felt, chain)]
        trial = descended(
            legs, state, found._replace(groups=groups, is_replaced=is_replaced), model, cart, spreads, params
        )
        if trial is not None and trial.cost < found.cost - CONVINCING:
            found = trial
    return found or straight


def candidates(state: Refined, model: Model, cart: CartParams) -> list[list[int]]:
    """Rows of lines, each a part of a chain that turns one way, that lie near a circle together."""
    rows = np.flatnonzero(state.lines[:, HITS] >= LEAST_BUMPS)
    ends = stretches(state.lines).reshape(-1, 2, 2)
    found: dict[tuple[int, ...], list[int]] = {}
    for links in chains_of(len(ends), corners_of(ends, BRIDGE)):
        chain = [number for number, _ in links]
        ring = [*chain, *chain] if len(chain) > 2 else chain  # of a closed curve any line may be the first
        for first in range(len(ring)):
            for last in range(first + 2, min(first + min(LONGEST_CHAIN, len(chain)), len(ring)) + 1):
                part = [int(rows[row]) for row in ring[first:last]]
                if is_near_circle(state, part, model, cart):
                    found.setdefault(tuple(sorted(part)), part)
    return list(found.values())


def is_near_circle(state: Refined, part: list[int], model: Model, cart: CartParams) -> bool:
    """Whether lines turn one way, by less than a right angle each, and all that was felt is near one circle."""
    turned = wrap(np.diff(state.lines[part, PHI]))
    if not (np.all(turned > 0.0) or np.all(turned < 0.0)) or np.max(np.abs(turned)) > 0.5 * math.pi:
        return False
    poses = state.bumped[np.isin(state.felt, part)]
    if abs(turned.sum()) < LEAST_SWEEP or len(poses) < LEAST_ON_ARC:
        return False
    circle = fit_circle(poses, cart, model.contact)
    if circle is None:
        return False
    lengths = state.lines[part, HIGH] - state.lines[part, LOW]
    if np.max(lengths**2) / (8.0 * circle[2]) > BULGE * model.contact:
        return False
    off = np.hypot(*(felt_ends(poses, circle[:2], cart) - circle[:2]).T) - circle[2]
    return float(np.median(np.square(off / model.contact))) < NEAR


def descended(
    legs: Legs, state: Refined, start: Rounded, model: Model, cart: CartParams, spreads: tuple[float, float],
    params: BumpRefinementParams,
) -> Rounded | None:  # fmt: skip
    """The run descended with the bumps of each group on an arc; none where a circle is lost."""
    nodes, biases, lines, cost, arcs = start.nodes, start.biases, start.lines.copy(), math.inf, []
    m = len(lines)
    for _ in range(TURNS if start.groups else 1):
        circles = [fit_circle(nodes[1::2][group], cart, model.contact) for group in start.groups]
        arcs = [
            arc_of(circle, nodes[1::2][group], cart)
            for circle, group in zip(circles, start.groups, strict=True)
            if circle is not None
        ]
        if len(arcs) < len(circles):
            return None
        told, felt = tangents(lines, state.felt, nodes[1::2], start.groups, arcs, cart)
        at_nodes = np.full(2 * len(felt), -1)
        at_nodes[1::2] = felt
        bundle = BumpBundle(legs, at_nodes, told, model, spreads, np.arange(len(told)) >= m)
        shared = np.concatenate([biases, told[:, [PHI, BEYOND]].reshape(-1)])
        nodes, shared, cost = descend(bundle, nodes, shared, params.steps)
        biases = shared[:2]
        lines[:, PHI], lines[:, BEYOND] = shared[2 : 2 + 2 * m : 2], shared[3 : 3 + 2 * m : 2]
    strays = int(np.sum((state.felt < 0) & legs.slips_last[::2]))
    chosen = 2 * int(np.sum(~start.is_replaced)) + 3 * len(arcs)
    cost += 0.5 * math.log(max(2, int(np.sum(legs.slips_last)))) * chosen - math.log(STRAY_SHARE) * strays
    return start._replace(nodes=nodes, lines=lines, biases=biases, arcs=arcs, cost=cost)


def tangents(
    lines: np.ndarray, felt: np.ndarray, bumped: np.ndarray, groups: list[np.ndarray], arcs: list[Arc], cart: CartParams
) -> tuple[np.ndarray, np.ndarray]:
    """Lines (m + k, 10) with one for each bump on an arc, and what every bump is told of."""
    felt, added = felt.copy(), []
    for group, arc in zip(groups, arcs, strict=True):
        centre = np.array([arc.x, arc.y])
        away = felt_ends(bumped[group], centre, cart) - centre
        felt[group] = len(lines) + len(added) + np.arange(len(away))
        for bearing in np.arctan2(away[:, 1], away[:, 0]):
            line = np.zeros(lines.shape[1])
            line[[X, Y, PHI, BEYOND, HITS]] = arc.x, arc.y, bearing, arc.radius, 1.0
            added.append(line)
    return np.vstack([lines, *added]), felt
