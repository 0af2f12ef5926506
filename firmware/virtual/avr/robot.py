"""A Crunch whose boards are real: their ATmega32 programs under simavr move the virtual body and say the bytes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware.virtual.avr.programs import Imu, ProgramError, programs, simulator
from firmware.virtual.host import DRIFTS, STATES, Drift
from firmware.virtual.native import native
from firmware.virtual.on_air import OnAir
from firmware.virtual.radio import Radio
from firmware.virtual.worlds import World


class AvrCrunch(OnAir):
    """A Crunch with both boards under simavr: the bytes at its two ends are the real robot's.

    A hand holds it upright at `start` until a command has armed the drive board. `drift` names how wheels and floor
    differ, `imu` which gyro and accelerometer the drive board's program reads. The truth is noted by a bystander who
    hears the frames. Same seed, same bytes. Raises ProgramError where the programs do not build or simavr is missing.
    """

    def __init__(
        self,
        world: World,
        start: np.ndarray | tuple[float, float, float] | None = None,
        seed: int = 0,
        drift: Drift = "medium",
        radio: Radio | None = None,
        imu: Imu = "analogue",
    ):
        super().__init__(radio, seed)
        paths = programs(imu)
        ffi, lib, _ = simulator()
        self.ffi, self.lib, self.world = ffi, lib, world
        walls = ffi.cast("struct caster *", int(native().ffi.cast("uintptr_t", world.caster)))  # the same C made both
        place = ffi.new("double[3]", [float(v) for v in (world.start if start is None else start)])
        made = lib.avr_robot_new(bytes(paths.drive), bytes(paths.sensor), walls, place, seed % 2**64)
        if made == ffi.NULL:
            raise ProgramError(f"simavr cannot read {paths.drive} or {paths.sensor}")
        self.robot: Any = ffi.gc(made, lib.avr_robot_free)
        lib.body_set_slip(ffi.addressof(self.robot, "body"), *DRIFTS[drift])
        self.rows = bytearray()

    @property
    def time(self) -> float:
        """Simulated seconds since the boards were switched on, or since `stand`."""
        return (self.robot.now_ms - self.robot.start_ms) * 1e-3

    @property
    def body(self) -> Any:
        """The C body that both builds move."""
        return self.robot.body

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,), heading in (-pi, pi]."""
        body = self.robot.body
        return np.array([body.x, body.y, math.remainder(body.heading, 2.0 * math.pi)])

    @property
    def tilt(self) -> float:
        """True lean (rad), forward positive."""
        return self.robot.body.tilt

    @property
    def state(self) -> str:
        """The drive board's state as it was last told."""
        return STATES[self.robot.bystander.state]

    @property
    def accepted(self) -> tuple[int, int, int]:
        """How many drives, stops and arms of the host the drive board had reason to obey so far."""
        bystander = self.robot.bystander
        return bystander.drives_accepted, bystander.stops_accepted, bystander.arms_accepted

    @property
    def duties(self) -> tuple[float, float]:
        """What the bridges give the left and the right motor, -1 to 1."""
        duties = self.ffi.new("double[2]")
        self.lib.avr_robot_duties(self.robot, duties)
        return duties[0], duties[1]

    @property
    def is_off(self) -> bool:
        """Whether the drive board holds BRAKE high, so that the motors have no current."""
        return self.lib.microcontroller_output(self.robot.drive, b"C", 6)

    @property
    def collisions(self) -> int:
        """Bytes that overlapped one of the other board, or that the drive board sent while the line was granted."""
        return self.robot.collisions + self.robot.trespasses

    def truth(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) and true poses (n, 3) at every odometry frame that the drive board has told so far."""
        rows = np.frombuffer(bytes(self.rows), float).reshape(-1, 4)
        return rows[:, 0] - self.robot.start_ms * 1e-3, rows[:, 1:].copy()

    def stand(self) -> bool:
        """Lets the drive board arm, and the hand go; then time begins. False if it does not arm."""
        return self.lib.avr_robot_stand(self.robot)

    def steer(self, speed: float, turn: float) -> None:
        """The plan's driver commands the boards beside the radio."""
        self.lib.avr_robot_steer(self.robot, speed, turn)

    def receive(self, data: bytes) -> None:
        """Bytes that reached the modem; both boards hear them at the line's rate."""
        self.lib.avr_robot_receive(self.robot, data, len(data))

    def reset_boards(self) -> None:
        """Somebody presses reset on both boards: their EEPROMs stay."""
        self.lib.microcontroller_reset(self.robot.drive)
        self.lib.microcontroller_reset(self.robot.sensor)

    def force(self, channel: int, volts: float) -> None:
        """A fault: one of the drive board's ADC inputs shows these volts from now on."""
        self.robot.forced |= 1 << channel
        self.robot.forced_volts[channel] = volts

    def push(self, newtons: float) -> None:
        """A hand that pushes the decks forward until told otherwise."""
        self.robot.body.push = newtons

    def run(self, ms: int) -> bytes:
        if not self.lib.avr_robot_advance(self.robot, ms):
            raise ProgramError(f"a board's program has crashed at {self.time:.3f} s")
        bystander = self.robot.bystander
        if bystander.truth_rows:
            self.rows += self.ffi.buffer(bystander.truth, bystander.truth_rows * 32)
        return bytes(self.ffi.buffer(self.robot.bytes, self.robot.size))
