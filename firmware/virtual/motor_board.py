"""The motor board's own C compiled for this machine: bytes in, milliseconds, bytes and powers out.

There is no robot around it. Nothing here knows the host's side.
"""

from __future__ import annotations

from typing import Any

from firmware.virtual.native import native

FULL_BATTERY = 12.6  # V
FULL_SCALE = 20.0  # V of the battery at the converter's end
MAX_COUNT = 1023
READINGS = 5  # that are summed, one every ms
FULL_POWER = 10_000
OUTBOX_BYTES = 128
POWER_ON_RESET = 1  # MCUCSR: PORF


class MotorBoard:
    """A motor board that was just switched on; `battery` (V) may be set at any time.

    `reset_cause` is MCUCSR at its start. What it says is there at once: the line's time is not modelled.
    """

    def __init__(self, reset_cause: int = POWER_ON_RESET) -> None:
        self.ffi, self.lib, build = native()
        self.battery = FULL_BATTERY
        self.sum = 0
        self.frame = self.ffi.new("uint8_t[]", OUTBOX_BYTES)
        self.room = self.ffi.new("uint8_t[]", OUTBOX_BYTES)
        self.outbox: Any = self.ffi.new("struct outbox *")
        self.loop: Any = self.ffi.new("struct motor_loop *")
        boot = self.ffi.new("struct boot *", {"reset_cause": reset_cause, "count": 1, "build": build})
        self.lib.outbox_init(self.outbox, self.room, OUTBOX_BYTES)
        self.lib.motor_loop_init(self.loop, boot, self.outbox)

    @property
    def time_ms(self) -> int:
        """Since it was switched on."""
        return self.loop.teller.uptime_ms

    @property
    def powers(self) -> tuple[float, float]:
        """What the left and the right motor have now, -1 to 1."""
        left, right = (ramp.power / FULL_POWER for ramp in self.loop.ramps)
        return left, right

    def receive(self, data: bytes) -> None:
        """Bytes from the host, all at once."""
        for byte in data:
            self.lib.motor_loop_receive(self.loop, byte)

    def run(self, ms: int) -> bytes:
        """What it says in the next milliseconds."""
        return b"".join(self._step() for _ in range(ms))

    def _step(self) -> bytes:
        self.loop.teller.uptime_ms += 1
        self.sum += min(max(round(self.battery / FULL_SCALE * MAX_COUNT), 0), MAX_COUNT)
        if self.time_ms % READINGS == 0:
            self.lib.motor_loop_battery(self.loop, self.sum)
            self.sum = 0
        self.lib.motor_loop_tick(self.loop)
        said = b""
        while size := self.lib.outbox_take(self.outbox, self.frame):
            said += bytes(self.ffi.buffer(self.frame, size))
        return said
