"""The bumper cart's real ATmega32 program under simavr moves the cart's body: bytes in, milliseconds, bytes out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware.virtual.avr.programs import ProgramError, programs, simulator
from firmware.virtual.native import native
from firmware.virtual.worlds import World

MS_CYCLES = 16_000
SENT = 512  # bytes that are kept between two looks
BATTERY_CHANNEL, DIVIDER = 3, 4.0
FORWARD, REVERSE = (0, 6), (1, 7)  # pins of port C for the left and the right motor
ENABLES = (5, 4)  # of port D: PWM
SWITCHES = (2, 3, 4)  # of port B: left, middle, right; closed is low


class AvrCart:
    """A cart that was just switched on, at a pose; `parts` are what struct cart_build holds, in its order.

    Raises ProgramError where the programs do not build or simavr is missing.
    """

    def __init__(self, world: World, pose: Sequence[float], parts: Sequence[float], seed: int):
        elf = programs().cart
        self.ffi, self.lib, _ = simulator()
        self.world = world  # keeps its walls
        self.wiring = self.ffi.new("struct wiring *")
        made = self.lib.microcontroller_new(bytes(elf), self.wiring)
        if made == self.ffi.NULL:
            raise ProgramError(f"simavr cannot read {elf}")
        self.mcu: Any = self.ffi.gc(made, self.lib.microcontroller_free)
        self.sent = self.ffi.new(f"struct sent_byte[{SENT}]")
        self.time_ms = 0
        walls = self.ffi.cast("struct caster *", int(native().ffi.cast("uintptr_t", world.caster)))  # the same C
        self.body: Any = self.ffi.new("struct cart_body *")
        self.lib.cart_body_init(self.body, walls, self.ffi.new("struct cart_build *", list(parts)), seed % 2**64, *pose)

    @property
    def powers(self) -> tuple[float, float]:
        """What the bridge gives the left and the right motor, -1 to 1; a motor that is shorted has none."""
        return self._power(0), self._power(1)

    def receive(self, data: bytes) -> None:
        """Bytes from the host; it hears them at the line's rate."""
        self.lib.microcontroller_receive(self.mcu, data, len(data))

    def run(self, ms: int) -> bytes:
        """What it says in the next milliseconds."""
        said = bytearray()
        for _ in range(ms):
            self.time_ms += 1
            self._show()
            if not self.lib.microcontroller_run(self.mcu, self.time_ms * MS_CYCLES):
                raise ProgramError(f"the cart's program has crashed at {self.time_ms} ms")
            self.lib.cart_body_step(self.body, self.ffi.new("double[2]", self.powers))
            count = self.lib.microcontroller_take_sent(self.mcu, self.sent)
            said += bytes(self.sent[i].byte for i in range(count))
        return bytes(said)

    def is_high(self, port: str, bit: int) -> bool:
        """Whether the program drives a pin high."""
        return self.lib.microcontroller_output(self.mcu, port.encode(), bit)

    def _show(self) -> None:
        """What the board's pins see of the body."""
        self.lib.microcontroller_voltage(self.mcu, BATTERY_CHANNEL, self.body.volts / DIVIDER)
        closed = self.lib.cart_body_bumper(self.body)
        for number, pin in enumerate(SWITCHES):
            self.lib.microcontroller_pin(self.mcu, b"B", pin, not closed >> number & 1)
        for side in (0, 1):
            self.lib.microcontroller_turn(self.mcu, side, self.lib.cart_body_ticks(self.body, side))

    def _power(self, side: int) -> float:
        share = self.lib.microcontroller_pwm(self.mcu, side) or float(self.is_high("D", ENABLES[side]))
        return share * (self.is_high("C", FORWARD[side]) - self.is_high("C", REVERSE[side]))
