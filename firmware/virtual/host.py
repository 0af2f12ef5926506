"""The boards' C compiled for this machine, and the body that they move.

Every command goes through the drive board's own C and every byte comes out of the boards' own framing; the body leans,
slips, sags and bumps as `body.c` says. Nothing here knows the host's side.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from firmware.virtual.native import native
from firmware.virtual.on_air import OnAir
from firmware.virtual.radio import Radio
from firmware.virtual.worlds import World

Drift = Literal["none", "low", "medium", "high"]
STATES = ("disarmed", "armed", "fallen", "link_lost", "fault")

# Per square root of a metre: distance (share), turn (rad); biases of a run: distance, turn (rad/m), rotation (share).
DRIFTS: dict[str, tuple[float, float, float, float, float]] = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    "low": (0.02, math.radians(1.0), 0.01, math.radians(0.10), 0.01),
    "medium": (0.04, math.radians(2.0), 0.02, math.radians(0.25), 0.02),
    "high": (0.06, math.radians(3.0), 0.03, math.radians(0.50), 0.03),
}


class HostCrunch(OnAir):
    """A C robot, a radio, and the truth about where it was; `drift` names how wheels and floor differ.

    `advance` and `write` are the two ends of the link; `time` is simulated seconds since the start. A hand holds it
    upright until its drive board has armed.
    """

    def __init__(
        self,
        world: World,
        start: np.ndarray,
        seed: int = 0,
        drift: Drift = "none",
        radio: Radio | None = None,
    ):
        super().__init__(radio, seed)
        ffi, lib, build = native()
        self.world = world
        self.lib: Any = lib
        self.ffi = ffi
        self.robot: Any = ffi.new("struct robot *")
        lib.robot_init(self.robot, world.caster, ffi.new("double[3]", [float(v) for v in start]), seed % 2**64, build)
        lib.body_set_slip(ffi.addressof(self.robot, "body"), *DRIFTS[drift])
        self.rows = bytearray()

    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
        return self.lib.robot_time(self.robot)

    @property
    def body(self) -> Any:
        """The C body that both builds move."""
        return self.robot.body

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

    @property
    def accepted(self) -> tuple[int, int, int]:
        """How many drives, stops and arms of the host the drive board has obeyed so far."""
        drive = self.robot.drive
        return drive.drives_accepted, drive.stops_accepted, drive.arms_accepted

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) and true poses (n, 3) at every odometry frame that the drive board has sampled so far."""
        rows = np.frombuffer(bytes(self.rows), float).reshape(-1, 4)
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def stand(self) -> bool:
        """Lets the drive board arm, and the hand go; then time begins. False if it does not arm."""
        return self.lib.robot_stand(self.robot)

    def steer(self, speed: float, turn: float) -> None:
        """The plan's driver commands the drive board beside the radio."""
        self.lib.robot_steer(self.robot, speed, turn)

    def reset_boards(self) -> None:
        """Somebody presses reset on both boards: all begins anew but for their EEPROMs."""
        self.lib.robot_reset_boards(self.robot)

    def receive(self, data: bytes) -> None:
        """Bytes that reached the boards."""
        self.lib.robot_receive(self.robot, data, len(data))

    def run(self, ms: int) -> bytes:
        robot = self.robot
        self.lib.robot_advance(robot, ms)
        if robot.truth_rows:
            self.rows += self.ffi.buffer(robot.truth, robot.truth_rows * 32)
        return bytes(self.ffi.buffer(robot.bytes, robot.outbox.size)) if robot.outbox.size else b""
