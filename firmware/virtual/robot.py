"""The virtual Crunch: a robot in a world that speaks the real one's bytes.

Every command goes through the drive board's own C and every byte comes out of the boards' own framing; the body leans,
slips, sags and bumps as `body.c` says. Nothing here knows the host's side.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from firmware.virtual.native import native
from firmware.virtual.on_air import OnAir
from firmware.virtual.plans import Driver, Plan
from firmware.virtual.radio import Radio
from firmware.virtual.worlds import World

Drift = Literal["none", "low", "medium", "high"]
HOST_PRIORITY = 3.0  # s for which a host's drive command keeps the plan waiting
STATES = ("disarmed", "armed", "fallen", "link_lost", "fault")

# Per square root of a metre: distance (share), turn (rad); biases of a run: distance, turn (rad/m), rotation (share).
DRIFTS: dict[str, tuple[float, float, float, float, float]] = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    "low": (0.02, math.radians(1.0), 0.01, math.radians(0.10), 0.01),
    "medium": (0.04, math.radians(2.0), 0.02, math.radians(0.25), 0.02),
    "high": (0.06, math.radians(3.0), 0.03, math.radians(0.50), 0.03),
}


class Crunch(OnAir):
    """What both robots have: a C robot, a radio, and the truth about where it was.

    `advance` and `write` are the two ends of the link; `time` is simulated seconds since the start.
    """

    def __init__(self, world: World, start: np.ndarray, seed: int, radio: Radio | None):
        super().__init__(radio, seed)
        ffi, lib, build = native()
        self.world = world
        self.lib: Any = lib
        self.ffi = ffi
        self.robot: Any = ffi.new("struct robot *")
        lib.robot_init(self.robot, world.caster, ffi.new("double[3]", [float(v) for v in start]), seed % 2**64, build)
        self.rows = bytearray()

    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
        return self.lib.robot_time(self.robot)

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,), heading in (-pi, pi]."""
        place = self.lib.robot_place(self.robot)
        return np.array([place.x, place.y, math.remainder(place.heading, 2.0 * math.pi)])

    @property
    def tilt(self) -> float:
        """True lean (rad), forward positive."""
        return self.lib.robot_place(self.robot).tilt

    @property
    def state(self) -> str:
        """The drive board's state: disarmed, armed, fallen, link_lost or fault."""
        return STATES[self.robot.drive.loop.supervisor.state]

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) and true poses (n, 3) at every odometry frame that the drive board has sampled so far."""
        rows = np.frombuffer(bytes(self.rows), float).reshape(-1, 4)
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def receive(self, data: bytes) -> None:
        """Bytes that reached the boards."""
        self.lib.robot_receive(self.robot, data, len(data))

    def run(self, ms: int) -> bytes:
        robot = self.robot
        self.lib.robot_advance(robot, ms)
        if robot.truth_rows:
            self.rows += self.ffi.buffer(robot.truth, robot.truth_rows * 32)
        return bytes(self.ffi.buffer(robot.bytes, robot.outbox.size)) if robot.outbox.size else b""


class VirtualCrunch(Crunch):
    """A balancing Crunch with physics.

    It starts at `start`, at the plan's first waypoint or at the world's start, armed and upright: a hand holds it while
    the drive board learns its gyro and arms, then time begins. With `armed=False` the hand goes on holding it until a
    command arms it. With a plan it drives by itself while `autopilot` is true; a valid drive command from the host
    takes over for 3 s, a stop until the host drives or arms again. `drift` names how wheels and floor differ.
    """

    def __init__(
        self,
        world: World,
        start: np.ndarray | tuple[float, float, float] | None = None,
        seed: int = 0,
        drift: Drift = "medium",
        radio: Radio | None = None,
        plan: Plan | None = None,
        armed: bool = True,
    ):
        if drift not in DRIFTS:
            raise ValueError(f"no drift {drift!r}; known are {', '.join(DRIFTS)}")
        if start is None:
            start = plan.start if plan is not None else world.start
        super().__init__(world, np.asarray(start, float), seed, radio)
        self.lib.body_set_slip(self.ffi.addressof(self.robot, "body"), *DRIFTS[drift])
        if armed and not self.lib.robot_stand(self.robot):
            raise RuntimeError("the drive board does not arm: see its supervisor")
        self.driver = Driver(plan) if plan is not None else None
        self.autopilot = plan is not None
        self.commands = (0, 0, 0)
        self.plan_waits_until = -math.inf

    @property
    def finished(self) -> bool:
        """True when the plan has been driven to its end."""
        return self.driver is not None and self.driver.finished

    def push(self, newtons: float) -> None:
        """A hand that pushes the decks forward until told otherwise."""
        self.robot.body.push = newtons

    def pick_up(self) -> None:
        """A hand sets the robot upright where it stands and holds it until the drive board arms."""
        self.robot.body.is_held = True

    def step(self, ms: int) -> bytes:
        if self.driver is not None:
            self.steer(ms * 1e-3)
        return super().step(ms)

    def steer(self, seconds: float) -> None:
        """Lets the plan's driver command the drive board, unless the host does."""
        assert self.driver is not None
        drive = self.robot.drive
        commands = (drive.drives_accepted, drive.stops_accepted, drive.arms_accepted)
        if commands != self.commands:
            self.yield_to_host(commands)
        if not self.autopilot or self.time < self.plan_waits_until:
            return
        body = self.robot.body
        if self.plan_waits_until > -math.inf:
            self.driver.rejoin(body.x, body.y)
            self.plan_waits_until = -math.inf
        self.lib.robot_steer(self.robot, *self.driver.step(body.x, body.y, body.heading, seconds))

    def yield_to_host(self, commands: tuple[int, int, int]) -> None:
        """Who drives after new commands: (drives, stops, arms) accepted so far."""
        _, stops, arms = self.commands
        if commands[1] != stops:
            self.plan_waits_until = math.inf
        elif commands[2] != arms and self.plan_waits_until == math.inf:
            self.plan_waits_until = self.time
        else:
            self.plan_waits_until = self.time + HOST_PRIORITY
        self.commands = commands
