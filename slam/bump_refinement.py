"""Refine what a particle filter found of a run of bumps: descend, look again which wall each bump met, join walls.

Several particles' findings are refined, and the one of least cost is told. In its cost are that of the squares
(`bump_bundle`), that of each wall, that of what contradicts itself (drives through walls, bumps where drives passed),
and what the filter found unlikely, which knows of all places a cart might have been.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.bump_bundle import STRAY_SHARE, BumpBundle, Legs
from slam.bump_swarm import (
    BEYOND,
    HIGH,
    HITS,
    LOW,
    PHI,
    STEEPEST,
    VAR_BEYOND,
    VAR_PHI,
    Model,
    X,
    Y,
    innovation,
    passed,
    sided,
    was_free,
)  # fmt: skip
from slam.cart_odometry import DRIVE, Stage
from slam.params import Params
from slam.pose import wrap
from slam.pose_graph import descend


class BumpRefinementParams(Params):
    """How long is refined, and what a wall costs."""

    steps: int = Field(default=15, ge=1)  # of each descent
    rounds: int = Field(default=6, ge=1)  # of looking again which wall was met
    wall_cost: float = Field(default=8.0, ge=0.0)  # nats that one more wall must save
    alike: float = Field(default=0.5, gt=0.0)  # rad between walls that may be one
    near: float = Field(default=20.0, gt=0.0)  # nats a bump that one line for two may cost at first


class Refined(NamedTuple):
    """Poses `nodes` (2 t, 3) before and after each of t drives; the wall `felt` (t,) at its end, -1 for none.

    `lines` (m, 10) as in `slam.bump_swarm`; `biases` (2,); `cost` in nats, with walls and drives through them.
    """

    nodes: np.ndarray
    felt: np.ndarray
    lines: np.ndarray
    biases: np.ndarray
    cost: float

    @property
    def bumped(self) -> np.ndarray:
        """Poses (t, 3) at the drives' ends."""
        return self.nodes[1::2]


def legs_of(stages: Sequence[Stage]) -> tuple[Legs, np.ndarray]:
    """Legs between the nodes of a run up to its last drive, and the switches (t,) closed at the drives' ends."""
    ends = np.array([row for row, stage in enumerate(stages) if stage.kind == DRIVE], np.int64)
    bumpers = np.array([stages[row].bumper for row in ends], np.int64)
    bounds = np.sort(
        np.concatenate([ends, ends + 1])
    )  # each drive is a leg of its own; the start of the first is node 0
    is_drive = np.arange(len(bounds) - 1) % 2 == 0
    bumps = np.repeat(bumpers > 0, 2)[: len(bounds) - 1]
    table = np.array([stage[:3] for stage in stages], float).reshape(-1, 3)
    return Legs(table, bounds, is_drive & bumps), bumpers


@njit(cache=True)
def tell(bumped, bumpers, lines, model, felt):
    """Which line each bump met most likely, -1 for none; `felt` (t,) is what was told, and is changed."""
    for k in range(bumped.shape[0]):
        felt[k] = -1
        if bumpers[k] == 0:
            continue
        best = STRAY_SHARE
        for j in range(lines.shape[0]):
            delta = bumped[k, 2] - lines[j, PHI]
            if math.cos(delta) < STEEPEST:
                continue
            off, _, _, place = innovation(lines[j], bumped[k], model)
            gap = max(lines[j, LOW] - place, place - lines[j, HIGH], 0.0)
            density = math.exp(-0.5 * (off / model.contact) ** 2 - gap / model.reach) * sided(delta, bumpers[k])
            if density > best:
                best = density
                felt[k] = j


@njit(cache=True)
def n_passed(pieces, lines):
    """How many drives lead through walls where they were felt."""
    count = 0
    for row in range(pieces.shape[0]):
        for j in range(lines.shape[0]):
            if lines[j, HITS] > 1.0 and passed(lines[j], pieces[row]):
                count += 1
    return count


@njit(cache=True)
def n_denied(bumped, felt, lines, pieces, model):
    """How many bumps are at places that a drive, earlier or later, passed well over."""
    count = 0
    for k in range(bumped.shape[0]):
        if felt[k] < 0:
            continue
        line = lines[felt[k]]
        place = innovation(line, bumped[k], model)[3]
        cos, sin = math.cos(line[PHI]), math.sin(line[PHI])
        x, y = line[X] + line[BEYOND] * cos - place * sin, line[Y] + line[BEYOND] * sin + place * cos
        if was_free(pieces, pieces.shape[0], x, y, model):
            count += 1
    return count


def extents(lines: np.ndarray, bumped: np.ndarray, felt: np.ndarray, model: Model) -> np.ndarray:
    """Lines (m, 10) with where they were felt, and how often."""
    lines = lines.copy()
    lines[:, LOW], lines[:, HIGH], lines[:, HITS] = math.inf, -math.inf, 0.0
    for pose, j in zip(bumped, felt, strict=True):
        if j >= 0:
            place = innovation(lines[j], pose, model)[3]
            lines[j, LOW], lines[j, HIGH] = min(lines[j, LOW], place), max(lines[j, HIGH], place)
            lines[j, HITS] += 1.0
    return lines


def kept(lines: np.ndarray, felt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines that something felt, and `felt` in their new numbers."""
    used = np.flatnonzero(np.bincount(felt[felt >= 0], minlength=len(lines)) > 0)
    renamed = np.full(len(lines) + 1, -1)
    renamed[used] = np.arange(len(used))
    return lines[used], renamed[felt]


def settled(
    legs: Legs, state: Refined, model: Model, spreads: tuple[float, float], params: BumpRefinementParams
) -> Refined:
    """The state after one descent; its cost has the walls in it, but not yet drives through them."""
    lines, felt = kept(state.lines, state.felt)
    at_nodes = np.full(2 * len(felt), -1)
    at_nodes[1::2] = felt
    bundle = BumpBundle(legs, at_nodes, lines, model, spreads)
    shared = np.concatenate([state.biases, lines[:, [PHI, BEYOND]].reshape(-1)])
    nodes, shared, cost = descend(bundle, state.nodes, shared, params.steps)
    lines = lines.copy()
    lines[:, PHI], lines[:, BEYOND] = shared[2::2], shared[3::2]
    lines[:, VAR_PHI], lines[:, VAR_BEYOND] = 0.0, model.contact**2
    lines = extents(lines, nodes[1::2], felt, model)
    strays = int(np.sum((felt < 0) & legs.slips_last[::2]))
    cost += params.wall_cost * len(lines) - math.log(STRAY_SHARE) * strays
    return Refined(nodes, felt, lines, shared[:2], cost)


def refine(
    legs: Legs, bumpers: np.ndarray, start: Refined, model: Model, spreads: tuple[float, float],
    params: BumpRefinementParams,
) -> Refined:  # fmt: skip
    """The best state found from a start, whose cost is added: descents, with walls told again and joined in between."""
    best = settled(legs, start, model, spreads, params)
    tried: set[tuple[float, float]] = set()
    for _ in range(params.rounds):
        felt = best.felt.copy()
        tell(best.bumped, bumpers, best.lines, model, felt)
        trial = best
        if np.any(felt != best.felt) and np.any(felt >= 0):
            trial = settled(legs, best._replace(felt=felt), model, spreads, params)
        trial = joined(legs, min(trial, best, key=lambda state: state.cost), model, spreads, params, tried)
        if not trial.cost < best.cost - 0.1:
            break
        best = trial
    return best._replace(cost=best.cost + contradictions(best, model) + start.cost)


def contradictions(state: Refined, model: Model) -> float:
    """What drives through walls cost, and bumps where drives passed, in nats."""
    pieces = pieces_of(state.nodes, model)
    through = n_passed(pieces, state.lines)
    denied = n_denied(state.bumped, state.felt, state.lines, pieces, model)
    return -math.log(model.missed) * through - math.log(model.again) * denied


def joined(
    legs: Legs, state: Refined, model: Model, spreads: tuple[float, float], params: BumpRefinementParams,
    tried: set[tuple[float, float]],
) -> Refined:  # fmt: skip
    """The state with pairs of walls made one where that costs less than two; no pair is tried twice."""
    while True:
        pairs = [pair for pair in alike(state, model, params) if pair[3] not in tried]
        if not pairs:
            return state
        _, i, j, name = min(pairs, key=lambda pair: pair[0])
        tried.add(name)
        felt = np.where(state.felt == j, i, state.felt)
        trial = settled(legs, state._replace(felt=felt), model, spreads, params)
        if trial.cost < state.cost:
            state = trial


def alike(state: Refined, model: Model, params: BumpRefinementParams):
    """Pairs of walls that may be one: what it would cost with the poses as they are, their rows, and their names."""
    for i, one in enumerate(state.lines):
        for j, other in enumerate(state.lines):
            if i == j or one[HITS] < other[HITS] or (one[HITS] == other[HITS] and i > j):
                continue
            if abs(float(wrap(one[PHI] - other[PHI]))) > params.alike:
                continue
            off = np.array([innovation(one, pose, model)[0] for pose in state.bumped[state.felt == j]])
            cost = 0.5 * float(np.sum(np.square(off / model.contact)))
            if cost < params.near * len(off):
                yield cost, i, j, (round(float(one[X] + one[Y]), 6), round(float(other[X] + other[Y]), 6))


def pieces_of(nodes: np.ndarray, model: Model) -> np.ndarray:
    """Ways (2 t, 4) of the bumper's middle as two chords of each drive."""
    start, end = nodes[0::2], nodes[1::2]
    turn = wrap(end[:, 2] - start[:, 2])
    half = np.hypot(*(end - start)[:, :2].T) / (2.0 * np.cos(0.25 * turn))
    heading = start[:, 2] + 0.25 * turn
    middle = np.column_stack([start[:, :2] + half[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]),
                              start[:, 2] + 0.5 * turn])  # fmt: skip
    first, between, last = (
        pose[:, :2] + model.ahead * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
        for pose in (start, middle, end)
    )
    return np.stack([np.hstack([first, between]), np.hstack([between, last])], axis=1).reshape(-1, 4)
