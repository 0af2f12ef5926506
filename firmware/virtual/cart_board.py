"""The bumper cart's own C compiled for this machine, with its body: bytes in, milliseconds, bytes out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firmware.virtual.native import native
from firmware.virtual.worlds import World

FRAME = 64  # bytes, more than any frame has


class HostCart:
    """A cart that was just switched on, at a pose; `parts` are what struct cart_build holds, in its order."""

    def __init__(self, world: World, pose: Sequence[float], parts: Sequence[float], seed: int):
        self.ffi, self.lib, build = native()
        self.world = world  # keeps its walls
        self.frame = self.ffi.new("uint8_t[]", FRAME)
        self.robot: Any = self.ffi.new("struct cart_robot *")
        body = self.ffi.addressof(self.robot, "body")
        walls = self.ffi.cast("struct caster *", world.caster)
        made = self.ffi.new("struct cart_build *", list(parts))
        self.lib.cart_body_init(body, walls, made, seed % 2**64, *pose)
        self.lib.cart_robot_init(self.robot, build)

    @property
    def body(self) -> Any:
        """The C body (struct cart_body)."""
        return self.robot.body

    def receive(self, data: bytes) -> None:
        """Bytes from the host, all at once."""
        for byte in data:
            self.lib.cart_loop_receive(self.robot_loop, byte)

    @property
    def robot_loop(self) -> Any:
        """The board's loop (struct cart_loop *)."""
        return self.ffi.addressof(self.robot, "loop")

    @property
    def is_running(self) -> bool:
        """Whether its supervisor lets it run."""
        return self.robot.loop.supervisor.state == self.lib.DRIVE_ARMED

    def order(self, bumps: int, seed: int, manner: int) -> None:
        """A run's command, as from a host that has just heard it."""
        self.lib.cart_robot_order(self.robot, bumps, seed, manner)

    def next_stage(self, ms: int) -> Any:
        """Lets it live until it has recorded a stage: that (struct cart_stage), or None after so many milliseconds."""
        return self.robot.ended if self.lib.cart_robot_run(self.robot, ms) else None

    def run(self, ms: int) -> bytes:
        """What it says in the next milliseconds."""
        said = b""
        for _ in range(ms):
            self.lib.cart_robot_run(self.robot, 1)
            while size := self.lib.outbox_take(self.robot.loop.teller.outbox, self.frame):
                said += bytes(self.ffi.buffer(self.frame, size))
        return said
