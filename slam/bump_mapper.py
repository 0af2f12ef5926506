"""The map of an unknown area from bumps and two rotation counters alone, while the cart goes and afterwards.

A particle filter (`bump_swarm`): each particle has a pose, biases of the odometry, and the walls that its bumps felt. A
bump weighs as much as it agrees with them: at a wall felt before it is likely, where a drive had passed it is not, and
so is a drive through a wall. Thus the particles whose paths close remain. `refine` makes of several of them the most
likely path and walls. The map lies in the frame of the cart's first pose.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.bump_arcs import Arc, with_arcs
from slam.bump_bundle import Legs
from slam.bump_doubt import SURE, doubt
from slam.bump_refinement import BumpRefinementParams, Refined, legs_of, refine
from slam.bump_swarm import COLUMNS, PHI, PIECES, STRAY, Model, Swarm, advance
from slam.bump_walls import walls_of
from slam.cart_odometry import DRIVE, CartParams, Stage, bumper_points, raw_path
from slam.counter_random import gaussian, uniform
from slam.params import Params
from slam.resampling import effective_particles, effective_sample_size, normalize, systematic

SQUARE = 0.05  # rad off square, up to which the bumper's middle stands for all of it
START = 64  # drives that there is room for at first
RESAMPLED = 1 << 40  # word of the keys of what is drawn for a resampling


class BumpMapperParams(Params):
    """How many particles, and what they believe of bumps, walls and odometry."""

    n_particles: int = Field(default=16000, ge=1, le=200_000)
    n_islands: int = Field(default=4, ge=1, le=64)  # that never mix, so that another map stays when one loses the way
    tries: int = Field(default=4, ge=1, le=64)  # errors of the odometry that each draws, of which it keeps one
    n_lines: int = Field(default=24, ge=1, le=120)  # that a particle can tell apart
    contact: float = Field(default=0.01, gt=0.0)  # m, standard deviation of where a felt wall is
    direction: float = Field(default=0.6, gt=0.0)  # rad, of a new wall's outward direction about the heading
    new_walls: float = Field(default=0.5, gt=0.0)  # per m driven through the unknown, at first
    settled: float = Field(default=15.0, gt=0.0)  # drives after which a new wall is half as likely
    strays: float = Field(default=0.02, gt=0.0)  # bumps that nothing explains, per m
    reach: float = Field(default=0.5, gt=0.0)  # m by which a wall goes on beyond where it was felt, on average
    missed: float = Field(default=0.03, gt=0.0, lt=1.0)  # probability that a drive passes a wall that was felt
    again: float = Field(default=0.05, gt=0.0, le=1.0)  # of a new wall where a drive had passed
    slip_share: float = Field(default=0.2, gt=0.0, lt=1.0)  # of bumps after which the wheels went on,
    slip_distance: float = Field(default=0.02, gt=0.0)  # m in the mean,
    slip_turn: float = Field(default=0.1, gt=0.0)  # rad that this turned the cart
    drag_share: float = Field(default=0.1, gt=0.0, lt=1.0)  # of bumps that the bumper feels only when the cart went on,
    drag_tried: float = Field(default=0.2, gt=0.0, lt=1.0)  # share of particles that try such a bump
    drag_distance: float = Field(default=0.2, gt=0.0)  # m in the mean,
    drag_turn: float = Field(default=0.6, gt=0.0)  # rad that it turned until it was square to the wall
    stuck_share: float = Field(default=0.06, gt=0.0, lt=1.0)  # of turns that a wall hinders
    stuck_tried: float = Field(default=0.25, gt=0.0, lt=1.0)  # share of particles that try such a turn
    flat: float = Field(default=0.2, gt=0.0)  # rad off square, below which a bump may turn the cart square
    flat_share: float = Field(default=0.5, ge=0.0, lt=1.0)  # of such bumps that do
    wheelbase_spread: float = Field(default=0.03, gt=0.0)  # by which the wheelbase may differ, as a share
    drift_spread: float = Field(default=0.04, gt=0.0)  # rad/m that a cart may turn when its counters say straight on
    n_refined: int = Field(default=2, ge=1, le=64)  # particles of each island that `refine` begins with
    refinement: BumpRefinementParams = Field(default_factory=BumpRefinementParams)

    @property
    def spreads(self) -> tuple[float, float]:
        """Standard deviations of both biases."""
        return self.wheelbase_spread, self.drift_spread

    def model(self, cart: CartParams) -> Model:
        """What the kernels go by."""
        own = {name: getattr(self, name) for name in Model._fields if name in type(self).model_fields}
        noise = {name: getattr(cart, name) for name in Model._fields if name in CartParams._fields and name not in own}
        return Model(half_width=0.5 * cart.bumper_width, ahead=cart.bumper_ahead, **noise, **own)


class BumpMap(NamedTuple):
    """What is known after t drives, in the frame of the cart's first pose.

    `nodes` (2 t, 3) are the poses before and after each drive, `is_bump` (t,) tells which ended at a wall, `contacts`
    (m, 2) are the points of the bumper that touched there; `walls` are curves (k, 2); `felt` (t,) and `lines` are what
    they come of, `biases` (2,) the odometry's; `cost` in nats, less is likelier, tells refined maps of one run apart.
    `doubt` is the probability that the map is wrong, nan where nobody asked. Round walls are `arcs`, and the last ones
    of `walls`; in `lines` they are straight stretches. Only refined maps tell of both.
    """

    nodes: np.ndarray
    is_bump: np.ndarray
    contacts: np.ndarray
    walls: list[np.ndarray]
    felt: np.ndarray
    lines: np.ndarray
    biases: np.ndarray
    cost: float
    doubt: float = math.nan
    arcs: Sequence[Arc] = ()

    @property
    def is_sure(self) -> bool:
        """Whether the doubt is small; False where nobody asked."""
        return self.doubt < SURE

    @property
    def path(self) -> np.ndarray:
        """Poses (t, 3) at the drives' ends."""
        return self.nodes[1::2]

    @property
    def segments(self) -> np.ndarray:
        """The walls' straight stretches (n, 4)."""
        return segments_of(self.walls)


def segments_of(walls: list[np.ndarray]) -> np.ndarray:
    """Straight stretches (n, 4) of curves."""
    return np.concatenate([np.zeros((0, 4)), *(np.hstack([wall[:-1], wall[1:]]) for wall in walls)])


def touches(state: Refined, cart: CartParams) -> np.ndarray:
    """Points (t, 2) of the bumper that touched at the drives' ends: an end of it where it met a wall askew."""
    points = bumper_points(state.nodes[1::2], cart)
    off = np.zeros(len(points))
    is_told = state.felt >= 0
    off[is_told] = np.sin(state.nodes[1::2, 2][is_told] - state.lines[state.felt[is_told], PHI])
    which = np.where(off > SQUARE, 2, np.where(off < -SQUARE, 0, 1))
    return points[np.arange(len(points)), which]


class BumpMapper:
    """Feed it the stages as they come; random numbers are functions of the seed, the drive and the particle."""

    def __init__(self, cart: CartParams | None = None, params: BumpMapperParams | None = None, seed: int = 0):
        self.cart = cart or CartParams()
        self.params = params or BumpMapperParams()
        self.model = self.params.model(self.cart)
        self.seed = seed
        self.stages: list[Stage] = []
        self.n_told = 0  # stages that the particles know
        self.n_drives = 0
        n, k = self.params.n_particles, self.params.n_lines
        drawn = [[gaussian(seed, RESAMPLED, p, bias) for bias in (2, 3)] for p in range(n)]
        self.swarm = Swarm(
            poses=np.zeros((n, 3)),
            biases=np.array(drawn) * self.params.spreads,
            lines=np.zeros((n, k, COLUMNS)),
            n_lines=np.zeros(n, np.int64),
            pieces=np.zeros((n, START * PIECES, 4), np.float32),
            begun=np.zeros((n, START, 3), np.float32),
            bumped=np.zeros((n, START, 3), np.float32),
            felt=np.full((n, START), STRAY, np.int8),
            log_weights=np.zeros(n),
            scores=np.zeros(n),
        )

    def add(self, stage: Stage) -> bool:
        """Take a stage; the particles move at each drive's end, and then it returns True."""
        self.stages.append(Stage(*stage))
        if stage.kind != DRIVE:
            return False
        if self.n_drives == self.swarm.felt.shape[1]:
            self.grow()
        ticks = np.array([each[:3] for each in self.stages[self.n_told :]], float)
        advance(self.swarm, ticks, stage.bumper, self.n_drives, self.seed, self.n_drives, self.model)
        self.n_told = len(self.stages)
        self.n_drives += 1
        for number, island in enumerate(self.islands):
            weights = normalize(self.swarm.log_weights[island])
            if effective_sample_size(weights) < 0.5 * len(weights):
                offset = uniform(self.seed, RESAMPLED + self.n_drives, number, 1)
                self.resample(island, island.start + systematic(weights, offset))
        return True

    def extend(self, stages: Iterable[Stage]) -> None:
        """Take several stages."""
        for stage in stages:
            self.add(stage)

    @property
    def islands(self) -> list[slice]:
        """Rows of the particles of each."""
        bounds = np.linspace(0, self.params.n_particles, min(self.params.n_islands, self.params.n_particles) + 1)
        return [slice(int(low), int(high)) for low, high in itertools.pairwise(bounds)]

    @property
    def effective_particles(self) -> float:
        """2^H of the weights, over all islands."""
        return sum(effective_particles(normalize(self.swarm.log_weights[island])) for island in self.islands)

    def grow(self) -> None:
        """Room for twice as many drives."""
        for field in ("pieces", "begun", "bumped", "felt"):
            rows = getattr(self.swarm, field)
            self.swarm = self.swarm._replace(**{field: np.concatenate([rows, np.full_like(rows, STRAY)], axis=1)})

    def resample(self, island: slice, ancestors: np.ndarray) -> None:
        """Give the particles of an island all that the particles `ancestors` have."""
        swarm, t = self.swarm, self.n_drives
        for rows in (swarm.poses, swarm.biases, swarm.lines, swarm.n_lines, swarm.scores):
            rows[island] = rows[ancestors]
        for rows, used in ((swarm.pieces, PIECES * t), (swarm.begun, t), (swarm.bumped, t), (swarm.felt, t)):
            rows[island, :used] = rows[ancestors, :used]
        swarm.log_weights[island] = 0.0

    def raw(self) -> np.ndarray:
        """Poses (s + 1, 3) of dead reckoning, at the start and after each stage."""
        return raw_path(self.stages, self.cart)

    def estimate(self) -> BumpMap:
        """The map of the particle that explained the run best so far."""
        return self.map_of(self.state(int(np.argmax(self.swarm.scores))))

    def state(self, p: int) -> Refined:
        """What particle p knows."""
        swarm, t = self.swarm, self.n_drives
        nodes = np.empty((2 * t, 3))
        nodes[0::2], nodes[1::2] = swarm.begun[p, :t], swarm.bumped[p, :t]
        felt = np.maximum(swarm.felt[p, :t].astype(np.int64), -1)
        lines = swarm.lines[p, : swarm.n_lines[p]].copy()
        return Refined(nodes, felt, lines, swarm.biases[p].copy(), -float(swarm.scores[p]))

    def map_of(self, state: Refined) -> BumpMap:
        """A state with its walls as curves."""
        is_bump = np.array([stage.bumper > 0 for stage in self.stages if stage.kind == DRIVE], bool)
        contacts = touches(state, self.cart)[is_bump]
        return BumpMap(state.nodes, is_bump, contacts, walls_of(state.lines), state.felt, state.lines, state.biases,
                       state.cost)  # fmt: skip

    def refine(self) -> BumpMap:
        """The most likely map found from the best particles whose tellings of the bumps differ."""
        if not self.n_drives:
            return self.estimate()
        legs, bumpers = legs_of(self.stages)
        refined = [
            refine(legs, bumpers, self.state(p), self.model, self.params.spreads, self.params.refinement)
            for island in self.islands
            for p in self.unlike(island)
        ]
        best = min(refined, key=lambda state: state.cost)
        return self.rounded(best, legs)._replace(doubt=doubt(best.cost, int(np.sum(bumpers > 0))))

    def rounded(self, state: Refined, legs: Legs) -> BumpMap:
        """A refined state as a map, with round walls where its lines stand for such."""
        found = with_arcs(legs, state, self.model, self.cart, self.params.spreads, self.params.refinement)
        if not found.arcs:
            return self.map_of(state)
        told = self.map_of(state._replace(nodes=found.nodes, lines=found.lines, biases=found.biases))
        walls = walls_of(found.lines[~found.is_replaced])
        return told._replace(walls=[*walls, *(arc.curve for arc in found.arcs)], arcs=found.arcs)

    def unlike(self, island: slice) -> list[int]:
        """The best particles of an island of which no two tell nearly the same walls for the bumps."""
        tellings = self.swarm.felt[:, : self.n_drives]
        chosen: list[int] = []
        for p in island.start + np.argsort(-self.swarm.scores[island], kind="stable"):
            if all(np.mean(tellings[p] != tellings[q]) > 0.1 for q in chosen):
                chosen.append(int(p))
            if len(chosen) == self.params.n_refined:
                break
        return chosen
