"""The motor board's real ATmega32 program under simavr: bytes in, milliseconds, bytes and what its pins do out."""

from __future__ import annotations

from typing import Any, NamedTuple

from firmware.virtual.avr.programs import ProgramError, programs, simulator
from firmware.virtual.motor_board import FULL_BATTERY

MS_CYCLES = 16_000
SENT = 512  # bytes that are kept between two looks
BATTERY_CHANNEL, DIVIDER = 3, 4.0
DDRD = 0x31  # in the data space


class Half(NamedTuple):
    """Half of the bridge: Timer1's output and the pin that it is on, and the pins of port B for the directions."""

    output: int
    enable: int
    forward: int
    reverse: int


LEFT, RIGHT = Half(0, 5, 0, 1), Half(1, 4, 2, 3)


class AvrMotorBoard:
    """A motor board that was just switched on, with its battery and its line; `battery` (V) may be set at any time.

    Raises ProgramError where the programs do not build or simavr is missing.
    """

    def __init__(self) -> None:
        elf = programs().motor
        self.ffi, self.lib, _ = simulator()
        self.wiring = self.ffi.new("struct wiring *")
        made = self.lib.microcontroller_new(bytes(elf), self.wiring)
        if made == self.ffi.NULL:
            raise ProgramError(f"simavr cannot read {elf}")
        self.mcu: Any = self.ffi.gc(made, self.lib.microcontroller_free)
        self.sent = self.ffi.new(f"struct sent_byte[{SENT}]")
        self.battery = FULL_BATTERY
        self.time_ms = 0  # since it was switched on

    @property
    def powers(self) -> tuple[float, float]:
        """What the bridge gives the left and the right motor, -1 to 1."""
        return self._power(LEFT), self._power(RIGHT)

    def receive(self, data: bytes) -> None:
        """Bytes from the host; it hears them at the line's rate."""
        self.lib.microcontroller_receive(self.mcu, data, len(data))

    def run(self, ms: int) -> bytes:
        """What it says in the next milliseconds."""
        said = bytearray()
        self.lib.microcontroller_voltage(self.mcu, BATTERY_CHANNEL, self.battery / DIVIDER)
        for _ in range(ms):
            self.time_ms += 1
            if not self.lib.microcontroller_run(self.mcu, self.time_ms * MS_CYCLES):
                raise ProgramError(f"the board's program has crashed at {self.time_ms} ms")
            count = self.lib.microcontroller_take_sent(self.mcu, self.sent)
            said += bytes(self.sent[i].byte for i in range(count))
        return bytes(said)

    def is_high(self, port: str, bit: int) -> bool:
        """Whether the program drives a pin high."""
        return self.lib.microcontroller_output(self.mcu, port.encode(), bit)

    def _power(self, half: Half) -> float:
        """An enable pin that the timer does not have is high for all of the time or none of it."""
        is_driven = self.lib.microcontroller_peek(self.mcu, DDRD) >> half.enable & 1
        share = self.lib.microcontroller_pwm(self.mcu, half.output) or float(self.is_high("D", half.enable))
        return is_driven * share * (self.is_high("B", half.forward) - self.is_high("B", half.reverse))
