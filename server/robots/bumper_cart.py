"""Bumper Cart: two rotation counters and a bumper; the program that drives it runs on the robot.

It logs stages of drive, back up, turn (`slam.cart_odometry`), which come as they end. Those that were lost on the way
are asked for again from the robot's own log. The pose is dead reckoned from the counters; every bump is a vertex, at
which the bumper's bar is all that is known of a wall. Uses its sibling `track`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from pydantic import Field

from server.channels import Calibration
from server.commands import RunCommand, StopCommand, UploadCommand
from server.errors import UserError
from server.messages import (
    Arm,
    Cart,
    CartStage,
    Effect,
    Estimate,
    Felt,
    Goal,
    Keyframe,
    Message,
    Snapshot,
    Status,
    Stop,
    nothing_known,
    shown_of,
)
from server.robots.track import Track
from slam.area import Area, area_of
from slam.bump_estimator import LocalizedCart, MappedCart
from slam.bump_localizer import BumpLocalizerParams
from slam.bump_mapper import BumpMapperParams
from slam.bumps import band_of
from slam.cart_odometry import DRIVE, LEFT, MIDDLE, RIGHT, CartParams, Stage, arc
from slam.params import Params
from slam.pose import between, compose, inverse
from slam.pose_clusters import Belief
from slam.walls import Walls

WRAP = 65_536  # ticks
PATIENCE = 1.0  # s after which stages that are missing are asked for (again)
MOST_ASKED = 50  # stages at a time
LOST = 20  # times that stages are asked for before they are given up, as where nobody hears the question,
KEPT = 192  # and stages that the robot's log holds: older ones are gone
NOTHING_SEEN = Walls(np.zeros(0), np.zeros(0))
BUILT = CartParams()


class CartBuild(Params):
    """The cart's lengths in m, as far as they are known, and how its odometry errs."""

    wheelbase: float = Field(default=BUILT.wheelbase, gt=0.0, le=1.0)
    tick: float = Field(default=BUILT.tick, gt=0.0, le=0.1)  # of a wheel's way
    bumper_width: float = Field(default=BUILT.bumper_width, gt=0.0, le=1.0)
    bumper_ahead: float = Field(default=BUILT.bumper_ahead, ge=0.0, le=1.0)  # of the middle of the axle
    switches: Literal[1, 3] = 1  # of the bumper: one for all of it, or left, middle and right
    veer: float = Field(default=BUILT.veer, ge=-1.0, le=1.0)  # rad/m that it turns when its counters say straight on
    distance_noise: float = Field(default=BUILT.distance_noise, gt=0.0, le=1.0)  # per root metre: its odometry's errors
    turn_noise: float = Field(default=BUILT.turn_noise, gt=0.0, le=3.0)  # rad per root metre
    rotation_noise: float = Field(default=BUILT.rotation_noise, gt=0.0, le=1.0)  # rad per root rad turned
    slip_length: float = Field(
        default=BUILT.slip_length, ge=0.0, le=1.0
    )  # m of a wheel's way over which it slips alike

    @classmethod
    def of(cls, cart: CartParams) -> CartBuild:
        """The build that a log tells of."""
        return cls(**{name: getattr(cart, name) for name in ("wheelbase", "tick", "bumper_width", "bumper_ahead")})

    @property
    def params(self) -> CartParams:
        """The same for `slam.cart_odometry`."""
        return BUILT._replace(**self.model_dump())


class RunParams(Params):
    """The run that the robot begins when it is armed."""

    bumps: int = Field(default=0, ge=0, le=65_535)  # after which it stands; 0: until it is stopped
    seed: int = Field(default=1, ge=0, le=65_535)  # of its random turns
    is_matched: bool = False  # whether both wheels are kept at the same count: docs/firmware.md,
    is_coarse: bool = False  # by no more than the eight powers of a Lego brick
    leash: int = Field(default=0, ge=0, le=255)  # s without a command after which it stops; 0: it needs no host


class BumperCartParams(Params):
    """Everything that makes this robot this robot."""

    build: CartBuild = CartBuild()
    run: RunParams = RunParams()
    map: str | None = None  # of where it is, as of a world: a built-in name, or a file; without one it makes its own
    localizer: BumpLocalizerParams = BumpLocalizerParams()
    mapper: BumpMapperParams = BumpMapperParams()
    battery_low: float = Field(default=6.9, ge=0.0)  # V of six cells that should be charged,
    battery_empty: float = Field(default=6.0, ge=0.0)  # and that are empty


def make_estimator(params: BumperCartParams, seed: int = 0, threads: int = 1) -> LocalizedCart | MappedCart:
    """Who finds the cart on the map that the parameters name, or makes one; UserError for a map that cannot be used."""
    cart = params.build.params
    if params.map is None:
        return MappedCart(cart, params.mapper, seed)
    return LocalizedCart(area_named(params.map), cart, params.localizer, seed)


def area_named(name: str) -> Area:
    """The area of a world, built in or in a file; UserError where there is none, or where its walls enclose nothing."""
    from firmware.virtual.worlds import load_world  # whose files are maps as well

    try:
        return area_of(load_world(name).walls)
    except ValueError as error:
        raise UserError(f"map {name}: {error}") from None


@dataclass
class Run:
    """A run's stages in their order, and when each was told (s); `truant` of them were lost for good."""

    stages: list[Stage] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    truant: int = 0


def runs_of(messages: Iterable[Message], params: BumperCartParams) -> list[Run]:
    """The runs that a log's messages tell of, those without a stage left out."""
    robot = BumperCart(params)
    for message in messages:
        robot.step(message)
    robot.finish()
    return [run for run in robot.runs if run.stages]


class BumperCart:
    """The robot as a fold: `step(message)` gives effects, `snapshot()` what a viewer needs.

    `runs` are all that it heard of; the last one goes on, or went on last.
    """

    def __init__(self, params: BumperCartParams):
        self.params = params
        self.calibration = Calibration()  # of boards that it does not have
        self.cart = params.build.params
        self.t = 0.0
        self.now: Cart | None = None
        self.odometry = np.zeros(3)
        self.distance = self.travelled = 0.0  # m since the start, and since the last vertex
        self.run: int | None = None  # its number
        self.runs = [Run()]
        self.next_number = 0  # of the stage that is to come
        self.early: dict[int, tuple[CartStage, np.ndarray]] = {}  # that came before one which is missing, and where
        self.fresh: list[Stage] = []  # since the last vertex
        self.reckoned = np.zeros(3)  # odometry at the end of the last of `stages`
        self.asked = -math.inf  # when stages were asked for last,
        self.askings = 0  # and how often, for those that are missing
        self.vertices: list[np.ndarray] = []
        self.times: list[float] = []
        self.observations: list[Walls] = []
        self.curves: list[list[np.ndarray]] = []  # the bumper's bar at each of them
        self.track = Track(self.cart)
        self.estimate: Estimate | None = None
        self.lead = 0  # the vertex since which it was localized without a break, or else the newest
        self.area = None if params.map is None else area_named(params.map)
        self.band = band_of(self.area, self.cart, params.localizer.tolerance) if self.area else None
        self.boards: dict[str, Status] = {}

    def step(self, message: Message) -> list[Effect]:
        """Take one message up; what follows from it."""
        match message:
            case Cart():
                return [*self.roll(message), *self.ask(message)]
            case CartStage():
                return self.log(message)
            case Estimate():
                self.believe(message)
            case Arm(armed=True):
                run = self.params.run
                return [RunCommand(run.bumps, run.seed, run.is_matched, run.leash, run.is_coarse)]
            case Goal() | Stop() | Arm():
                return [StopCommand()]
            case Status():
                self.boards[message.board] = message
        return []

    def roll(self, cart: Cart) -> list[Effect]:
        """Go on along the arc that the counters tell; where another run counts from 0 the board has begun anew."""
        before, self.now, self.t = self.now, cart, cart.t
        effects = self.begin(cart.run) if before is None or cart.run != before.run else []
        if before is None or (cart.run == 0 and before.run != 0):
            return effects
        left, right = (
            (after - earlier + WRAP // 2) % WRAP - WRAP // 2
            for after, earlier in ((cart.left, before.left), (cart.right, before.right))
        )
        change = arc(left, right, self.cart)
        self.odometry = compose(self.odometry, change)
        moved = float(math.hypot(change[0], change[1]))
        self.distance += moved
        self.travelled += moved
        return effects

    def begin(self, run: int) -> list[Effect]:
        """Another run has a log of its own; what waited in the one before waits no longer."""
        if run == self.run:
            return []
        effects: list[Effect] = [*self.finish()]
        self.run = run
        self.runs.append(Run())
        self.early, self.fresh = {}, []
        self.reckoned = self.odometry
        self.next_number = self.askings = 0
        return effects

    def log(self, told: CartStage) -> list[Effect]:
        """Take a stage up, or keep it until those before it are there; a bump is a vertex."""
        effects = self.begin(told.run)
        if told.number >= self.next_number:
            self.early.setdefault(told.number, (told, self.odometry))
        return [*effects, *self.take_what_follows()]

    def take_what_follows(self) -> list[Effect]:
        """Stages that are next in number; each bump among them is a vertex."""
        effects: list[Effect] = []
        while self.next_number in self.early:
            told, odometry = self.early.pop(self.next_number)
            before, self.reckoned = self.reckoned, self.reckoned_after(told, odometry)
            self.track.add(told.stage, before, self.reckoned)
            self.runs[-1].stages.append(told.stage)
            self.runs[-1].times.append(told.t)
            self.fresh.append(told.stage)
            if told.stage.kind == DRIVE and told.stage.bumper:
                effects.append(self.vertex(told))
            self.next_number += 1
            self.askings = 0
        return effects

    def reckoned_after(self, told: CartStage, odometry: np.ndarray) -> np.ndarray:
        """The odometry at the end of a stage: that of then, or, of one that was told later, along its own arc."""
        return compose(self.reckoned, arc(told.stage.left, told.stage.right, self.cart)) if told.is_kept else odometry

    def believe(self, estimate: Estimate) -> None:
        """Take up the estimator's answer."""
        belief, before = estimate.belief, self.estimate.belief if self.estimate else None
        if not (belief and belief.is_localized and before and before.is_localized):
            self.lead = len(estimate.path) - 1
        self.estimate = estimate

    def ask(self, cart: Cart) -> list[Effect]:
        """Ask for stages that the robot has logged and that have not come, and give them up after some times."""
        missing = cart.logged - self.next_number
        if missing <= 0 or cart.t - self.asked < PATIENCE:
            if missing <= 0:
                self.asked = cart.t  # patience begins when something is missing first
            return []
        self.asked = cart.t
        if self.askings >= LOST or missing > KEPT:
            return self.give_up(cart.logged)
        self.askings += 1
        return [UploadCommand(self.next_number, min(missing, MOST_ASKED))]

    def give_up(self, logged: int) -> list[Effect]:
        """Pass over stages that will not come any more, to the first one that is there or may still come."""
        first = min(self.early, default=max(self.next_number, logged - KEPT if self.askings < LOST else logged))
        self.runs[-1].truant += first - self.next_number
        self.next_number = first
        self.askings = 0
        return self.take_what_follows()

    def vertex(self, told: CartStage) -> Keyframe:
        """Where the robot bumped, by its counters."""
        waiting = [other.t for other, _ in self.early.values() if not other.is_kept]
        t = min([told.t, *waiting])  # what was told late was before what came at once
        keyframe = Keyframe(t, len(self.vertices), self.reckoned, tuple(self.fresh), self.travelled)
        self.travelled, self.fresh = 0.0, []
        self.vertices.append(self.reckoned)
        self.times.append(keyframe.t)
        self.observations.append(NOTHING_SEEN)
        self.curves.append([self.bar(told.stage.bumper)])
        return keyframe

    def bar(self, bumper: int) -> np.ndarray:
        """The stretch (2, 2) of the bumper, in the robot's frame, somewhere on which it touched."""
        half = 0.5 * self.cart.bumper_width
        ends = (half, -half)
        if self.params.build.switches == 3:
            thirds = {LEFT: (half, half / 3), MIDDLE: (half / 3, -half / 3), RIGHT: (-half / 3, -half)}
            closed = [thirds[bit] for bit in (LEFT, MIDDLE, RIGHT) if bumper & bit]
            ends = (closed[0][0], closed[-1][1])
        return np.array([[self.cart.bumper_ahead, end] for end in ends])

    def finish(self) -> list[Keyframe]:
        """The log or the session ends here: what has not come by now never will."""
        keyframes: list[Keyframe] = []
        while self.early:
            keyframes += [effect for effect in self.give_up(self.next_number) if isinstance(effect, Keyframe)]
        return keyframes

    @property
    def stages(self) -> list[Stage]:
        """Of the newest run, in their order."""
        return self.runs[-1].stages

    @property
    def truant(self) -> int:
        """Stages of the newest run that were lost for good."""
        return self.runs[-1].truant

    @property
    def goal(self) -> Goal | None:
        """None: it goes where it happens to."""
        return None

    @property
    def stop_reason(self) -> str | None:
        """Why it stood still last, in its own word; None before its first."""
        board = self.now or self.boards.get("motor")
        return board.reason if board else None

    def pose(self) -> np.ndarray:
        """The best estimate (3,) of where the robot is now, in the world."""
        if self.estimate is None:
            return self.odometry
        newest = len(self.estimate.path) - 1
        return compose(self.estimate.path[newest], between(self.vertices[newest], self.odometry))

    def felt(self) -> Felt:
        """What it did and felt, and where on a given map it may bump."""
        return Felt(*self.track.drawn(), self.laid(), self.truant, self.band)

    def walls(self) -> list[np.ndarray]:
        """Curves (k, 2) of the map that was given, or of the one so far."""
        if self.area is not None:
            return list(self.area.walls.reshape(-1, 2, 2))
        return (self.estimate.walls if self.estimate else None) or []

    def laid(self) -> np.ndarray:
        """The pose (3,) of odometry's frame in the world: that of its own start, or on a given map as it was found."""
        if self.area is None or self.estimate is None:
            return np.zeros(3)
        return compose(self.estimate.path[self.lead], inverse(self.vertices[self.lead]))

    def nothing_felt(self) -> Estimate:
        """The estimate before the first bump: on a map it may be anywhere."""
        nothing = nothing_known(self.t, self.odometry, 1)
        return nothing if self.area is None else replace(nothing, belief=Belief([], False))

    def snapshot(self) -> Snapshot:
        """The robot as a viewer sees it now; it has no local map, and no histogram."""
        estimate = self.estimate or self.nothing_felt()
        known = len(self.estimate.path) if self.estimate else 0
        return Snapshot(
            t=self.t,
            robot="bumper_cart",
            pose=self.pose(),
            odometry=self.odometry,
            tilt=math.nan,
            distance=self.distance,
            local_map=np.zeros((0, 0), np.float32),
            local_resolution=0.01,
            local_origin=np.zeros(2),
            local_pose=self.odometry,
            beams={},
            curves=[],
            densities=np.zeros(0),
            threshold=0.0,
            valleys=[],
            goal=None,
            goal_bearing=None,
            steering=None,
            walls=self.walls(),
            vertex_curves=self.curves[:known],
            observations=self.observations[:known],
            vertex_times=np.array(self.times[:known]),
            vertex_odometry=np.array(self.vertices[:known]).reshape(-1, 3),
            cart=self.now,
            felt=self.felt(),
            looked=self.t,
            battery_limits=(self.params.battery_low, self.params.battery_empty),
            boards=dict(self.boards),
            **shown_of(estimate),
        )
