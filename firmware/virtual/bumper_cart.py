"""The virtual Bumper Cart: a small cart with two rotation counters and a bumper, in a world that it runs around in.

`run_cart` lets the firmware's own program move the cart's body until it has bumped so many times, and returns the
stages that it logged and the truth beside them. Nothing here knows the host's side.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from firmware.virtual.builds import Build, cart_of
from firmware.virtual.cart_board import HostCart
from firmware.virtual.on_air import OneBoard
from firmware.virtual.polygons import inside
from firmware.virtual.radio import Radio
from firmware.virtual.worlds import World, WorldError

CartDrift = Literal["none", "low", "medium", "high"]
INCH = 0.0254  # m
LONGEST_MS = 60_000  # that a stage can take
MOST_BUMPS = 10_000
# Standard deviations, as shares: motors' lasting and passing differences, wheels' radii, slip straight on and in turns;
# then the wheelbase's own share, the play of the counters' gears in ticks,
# and the share of bumps in which the bumper's bar sticks when it is pressed at an end.
DRIFTS: dict[str, tuple[float, ...]] = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "low": (0.015, 0.005, 0.0005, 0.003, 0.01, 0.25, 0.05, 0.01),
    "medium": (0.03, 0.01, 0.001, 0.006, 0.02, 0.5, 0.1, 0.02),
    "high": (0.05, 0.02, 0.003, 0.015, 0.04, 1.0, 0.2, 0.03),
}


@dataclass(frozen=True)
class CartBuild:
    """How a cart is built; of a cart that was made, `wheelbase` is its true one.

    The paper's bumper of 3 inches covers the whole profile of the robot, so that nothing else ever collides with the
    walls: its wheels stand within it, 8 studs of Lego (64 mm) from middle to middle. `drift` names how badly its parts
    match, `switches` is 1 (any contact closes it, the paper's) or 3 (left, middle and right third of the bumper).
    """

    wheelbase: float = 0.064  # m
    bumper_width: float = 3.0 * INCH
    bumper_ahead: float = 0.09  # from the middle of the axle to the bumper's front when its switch closes
    tick: float = 0.0675 * INCH
    drift: CartDrift = "medium"
    switches: int = 1

    def __post_init__(self) -> None:
        if self.drift not in DRIFTS:
            raise ValueError(f"no drift {self.drift!r}; known are {', '.join(DRIFTS)}")
        if self.switches not in (1, 3):
            raise ValueError(f"a bumper of {self.switches} switches; it has 1 or 3")
        lengths = (self.wheelbase, self.bumper_width, self.bumper_ahead, self.tick)
        if not all(0.0 < length < 1.0 for length in lengths):
            raise ValueError(f"a cart with a length that is not between 0 and 1 m: {lengths}")


class LoggedStage(NamedTuple):
    """A stage as the cart's board records it: kind (0 drive, 1 back, 2 turn), ticks of both wheels, switches closed."""

    kind: int
    left: int
    right: int
    bumper: int


def reach(build: CartBuild) -> float:
    """Radius (m) around the middle of the axle that holds all of the cart."""
    return math.hypot(build.bumper_ahead + 0.002, 0.5 * build.bumper_width)


def random_start(world: World, seed: int, build: CartBuild | None = None) -> np.ndarray:
    """A pose (3,) anywhere in the world's free space where the cart can turn on the spot, from its seed.

    Raises WorldError where a thousand places have no room for it.
    """
    rng = np.random.default_rng([seed, 0xCA47])
    left, bottom, right, top = world.bounds
    clear = reach(build or CartBuild()) + 0.01
    for _ in range(1000):
        x, y, heading = rng.uniform((left, bottom, -math.pi), (right, top, math.pi))
        place = np.array([[x, y]])
        if inside(world.segments, place)[0] and world.clearances(place, clear + 0.1)[0] > clear:
            return np.array([x, y, heading])
    raise WorldError(f"{world.name}: no room for a cart of {clear:.2f} m around its axle; make the world larger")


class VirtualCart(OneBoard):
    """A cart at `start`, or anywhere, in a world; `build` names what it should be, `self.build` what it became.

    `board` is the build of its board's program: the C on this machine, or the real one.
    """

    def __init__(
        self,
        world: World,
        start: np.ndarray | tuple[float, float, float] | None = None,
        seed: int = 0,
        build: CartBuild | None = None,
        radio: Radio | None = None,
        board: Build = "host",
    ):
        super().__init__(radio, seed)
        wanted = build or CartBuild()
        place = random_start(world, seed, wanted) if start is None else start
        *errors, base = DRIFTS[wanted.drift]
        share = 1.0 + base * float(np.random.default_rng([seed, 0xBA5E]).standard_normal())
        self.world = world
        self.build = dataclasses.replace(wanted, wheelbase=wanted.wheelbase * share)
        lengths = (self.build.wheelbase, wanted.bumper_width, wanted.bumper_ahead, wanted.tick)
        self.board: Any = cart_of(
            board, world, [float(part) for part in place], (*lengths, *errors, wanted.switches), seed
        )

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,) of the middle of its axle."""
        body = self.board.body
        return np.array([body.x, body.y, math.remainder(body.heading, 2.0 * math.pi)])


def run_cart(
    world: World,
    seed: int,
    bumps: int = 30,
    start: np.ndarray | tuple[float, float, float] | None = None,
    build: CartBuild | None = None,
    is_matched: bool = False,
    is_coarse: bool = False,
) -> tuple[list[LoggedStage], np.ndarray]:
    """Stages that a cart logs until it has bumped so often, and true poses (n + 1, 3) at the start and after each.

    The stages begin with a drive and end with that of the last bump, or earlier where three drives in a row have met
    nothing. `is_matched` keeps both wheels at the same count; without it each motor has the same power, and the cart
    drives arcs. The paper's first program was `is_coarse` as well: it had the eight powers of a Lego brick. ValueError
    for no bumps, WorldError where there is no room for it.
    """
    if not 1 <= bumps <= MOST_BUMPS:
        raise ValueError(f"a run of {bumps} bumps; it has 1 to {MOST_BUMPS}")
    cart = VirtualCart(world, start, seed, build)
    board = cart.board
    assert isinstance(board, HostCart)
    board.order(bumps, (2 * seed + 1) & 0xFFFF, int(is_matched) | 2 * int(is_coarse))
    stages: list[LoggedStage] = []
    truth = [cart.pose]
    while board.is_running and (stage := board.next_stage(LONGEST_MS)):
        stages.append(LoggedStage(stage.kind, stage.left, stage.right, stage.bumper))
        truth.append(cart.pose)
    return stages, np.array(truth)
