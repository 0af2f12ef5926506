"""Links to a virtual robot in this process, which lives only as time passes here, and to what else speaks on it.

They look as those of `server.transport` do.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Protocol

log = logging.getLogger(__name__)

Receive = Callable[[bytes, float], None]  # bytes, and when they came
TICK = 0.01  # s between two steps of the virtual robot
SLICE = 0.02  # s that it lives at a time,
BUSY = 0.05  # and s of the clock after which everybody else has a turn
LONGEST_STEP = 1.0  # s that it catches up at most after this process slept


class Virtual(Protocol):
    """What a virtual robot offers: it lives only while it is advanced."""

    def advance(self, seconds: float) -> bytes:
        """Lives on for some time; the bytes that reached the host meanwhile."""
        ...

    def write(self, data: bytes) -> None:
        """Bytes from the host."""
        ...


class VirtualLink:
    """A virtual robot in this process, in real time or `speed` times as fast; then `now` runs as fast as it does."""

    reconnects = 0

    def __init__(self, robot: Virtual, spec: str = "virtual:", speed: float = 1.0) -> None:
        self.robot = robot
        self.spec = spec
        self.speed = speed
        self.origin = time.monotonic()
        self.is_connected = False
        self.sides: list[SideLink] = []
        self.received = self.sent = 0
        from firmware.virtual.pace import Pace  # with the simulator, which only who has such a robot pays for

        self.pace = Pace()

    @property
    def error(self) -> str:
        """That the machine is too slow, while it is."""
        return self.pace.complaint

    def now(self) -> float:
        """The robot's time, counted from the host's monotonic clock at its birth."""
        return self.origin + (time.monotonic() - self.origin) * self.speed

    def write(self, data: bytes) -> bool:
        """Hands the bytes to the robot's radio."""
        self.robot.write(data)
        self.sent += len(data)
        return True

    def summary(self) -> dict:
        """State and counts for people."""
        counts = {"received": self.received, "sent": self.sent, "dropped": 0}
        return {"spec": self.spec, "connected": self.is_connected, "reconnects": 0, **counts, "error": self.error}

    async def run(self, receive: Receive) -> None:
        """Lets the robot live as time passes; where the machine cannot, time is left out and `error` tells it."""
        self.is_connected = True
        seen, owed = self.now(), 0.0
        try:
            while True:
                await asyncio.sleep(TICK)
                now = self.now()
                lost = max(0.0, owed + now - seen - LONGEST_STEP * self.speed)
                if self.pace.note((now - seen) / self.speed, lost / self.speed):
                    log.warning("%s: %s", self.spec, self.error)
                data, owed = self.live(owed + now - seen - lost)
                seen = now
                if data:
                    self.received += len(data)
                    receive(data, now)
                for side in self.sides:
                    side.hand_over(now)
        finally:
            self.is_connected = False

    def live(self, seconds: float) -> tuple[bytes, float]:
        """What the robot says in these seconds, and those that there was no time for."""
        parts, end = [], time.monotonic() + BUSY
        while seconds > 0.0 and (not parts or time.monotonic() < end):
            step = min(seconds, SLICE * self.speed)
            parts.append(self.robot.advance(step))
            seconds -= step
        return b"".join(parts), seconds


class SideLink:
    """Another line of a virtual robot that lives on a `VirtualLink`: `tell` takes bytes, `ask` gives what it said."""

    reconnects = 0
    error = ""

    def __init__(self, main: VirtualLink, spec: str, tell: Callable[[bytes], None], ask: Callable[[], bytes]) -> None:
        self.main = main
        self.spec = spec
        self.speed = main.speed
        self.tell, self.ask = tell, ask
        self.receive: Receive | None = None
        self.received = self.sent = 0
        main.sides.append(self)

    @property
    def is_connected(self) -> bool:
        """As the robot itself."""
        return self.receive is not None and self.main.is_connected

    def now(self) -> float:
        """The robot's time."""
        return self.main.now()

    def write(self, data: bytes) -> bool:
        """Hands the bytes to what is at the other end."""
        self.tell(data)
        self.sent += len(data)
        return True

    def hand_over(self, now: float) -> None:
        """What was said since the last time, to whoever listens."""
        data = self.ask()
        if data and self.receive is not None:
            self.received += len(data)
            self.receive(data, now)

    def summary(self) -> dict:
        """State and counts for people."""
        counts = {"received": self.received, "sent": self.sent, "dropped": 0}
        return {"spec": self.spec, "connected": self.is_connected, "reconnects": 0, **counts, "error": ""}

    async def run(self, receive: Receive) -> None:
        """Listens until cancelled."""
        self.receive = receive
        try:
            await asyncio.Event().wait()
        finally:
            self.receive = None
