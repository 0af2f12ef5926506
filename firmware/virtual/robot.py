"""The virtual Crunch: a robot in a world that speaks the real one's bytes, and drives by a plan if it has one.

Which build of the boards moves it is chosen in `builds` and matters nowhere here; nothing knows the host's side.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware.virtual.builds import Build, boards_of
from firmware.virtual.host import Drift
from firmware.virtual.on_air import OnAir
from firmware.virtual.plans import Driver, Plan
from firmware.virtual.radio import Radio
from firmware.virtual.worlds import World

HOST_PRIORITY = 3.0  # s for which a host's drive command keeps the plan waiting


class VirtualCrunch(OnAir):
    """A balancing Crunch with physics.

    It starts at `start`, at the plan's first waypoint or at the world's start, armed and upright: a hand holds it while
    the drive board learns its gyro and arms, then time begins. With `armed=False` the hand goes on holding it until a
    command arms it. With a plan it drives by itself while `autopilot` is true; a valid drive command from the host
    takes over for 3 s, a stop until the host drives or arms again. `drift` names how wheels and floor differ, `build`
    what the boards are: their C on this machine, or their real programs.
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
        build: Build = "host",
    ):
        super().__init__(radio, seed)
        if start is None:
            start = plan.start if plan is not None else world.start
        self.world = world
        self.boards = boards_of(build, world, np.asarray(start, float), seed, drift)
        if armed and not self.boards.stand():
            raise RuntimeError("the drive board does not arm: see its supervisor")
        self.driver = Driver(plan) if plan is not None else None
        self.autopilot = plan is not None
        self.commands = (0, 0, 0)
        self.plan_waits_until = -math.inf

    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
        return self.boards.time

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,), heading in (-pi, pi]."""
        return self.boards.pose

    @property
    def tilt(self) -> float:
        """True lean (rad), forward positive."""
        return self.boards.tilt

    @property
    def state(self) -> str:
        """The drive board's state: disarmed, armed, fallen, link_lost or fault."""
        return self.boards.state

    @property
    def body(self) -> Any:
        """The C body, for hands that push it."""
        return self.boards.body

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) and true poses (n, 3) at every odometry frame so far."""
        return self.boards.truth()

    def receive(self, data: bytes) -> None:
        """Bytes that reached the boards."""
        self.boards.receive(data)

    def run(self, ms: int) -> bytes:
        return self.boards.run(ms)

    @property
    def finished(self) -> bool:
        """True when the plan has been driven to its end."""
        return self.driver is not None and self.driver.finished

    def push(self, newtons: float) -> None:
        """A hand that pushes the decks forward until told otherwise."""
        self.body.push = newtons

    def pick_up(self) -> None:
        """A hand sets the robot upright where it stands and holds it until the drive board arms."""
        self.body.is_held = True

    def step(self, ms: int) -> bytes:
        if self.driver is not None:
            self.steer(ms * 1e-3)
        return super().step(ms)

    def steer(self, seconds: float) -> None:
        """Lets the plan's driver command the drive board, unless the host does."""
        assert self.driver is not None
        commands = self.boards.accepted
        if commands != self.commands:
            self.yield_to_host(commands)
        if not self.autopilot or self.time < self.plan_waits_until:
            return
        body = self.body
        if self.plan_waits_until > -math.inf:
            self.driver.rejoin(body.x, body.y)
            self.plan_waits_until = -math.inf
        self.boards.steer(*self.driver.step(body.x, body.y, body.heading, seconds))

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
