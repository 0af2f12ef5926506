"""A session at the workbench: one link, two boards, somebody who looks at them and adjusts them. Opens no port.

Nothing here drives: the boards are listened to and asked, and the motors do what they did.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from server.boards import (
    BOARDS,
    Errands,
    Heard,
    Meter,
    asking,
    board_report,
    link_report,
    settings_report,
    telemetry_report,
)
from server.channels import Calibration
from server.commands import AdjustCommand
from server.errors import UserError
from server.session import Session
from server.transport import Link, open_link

TICK = 0.05  # s
SILENCE = 5.0  # s without a frame before it is given up


@dataclass(frozen=True)
class Work:
    """What to do: `seconds` to listen at least (None: until interrupted), and the adjustments."""

    spec: str
    seconds: float | None
    commands: list[AdjustCommand] = field(default_factory=list)
    asks: bool = False  # for all settings, after the adjustments


class Workbench:
    """The boards on one link."""

    def __init__(self, link: Link, work: Work, calibration: Calibration = Calibration()):  # noqa: B008 (frozen)
        self.link = link
        self.work = work
        self.heard = Heard()
        self.session = Session(self.heard, calibration)
        self.meter = Meter()
        self.errands = Errands([*work.commands, *(asking() if work.asks else [])])
        self.start = link.now()
        self.ended: float | None = None

    @property
    def t(self) -> float:
        """Seconds of the link's clock from the start until now, or until it was over."""
        return self.link.now() - self.start if self.ended is None else self.ended

    def receive(self, data: bytes, arrival: float) -> None:
        """Bytes from the boards."""
        self.meter.received += len(data)
        self.session.receive("bench", data, max(0.0, arrival - self.start))

    def tick(self) -> None:
        """The next errand, and the rates."""
        t = self.t
        data = self.errands.due(t, self.session, self.heard)
        if data and self.link.write(data):
            self.meter.sent += len(data)
        self.meter.note(t, self.session.frames)
        is_silent = not self.session.frames and t > SILENCE
        if is_silent and self.work.seconds is not None:
            raise UserError(f"{self.link.spec}: {self.complaint()}")

    def complaint(self) -> str:
        """Why nothing is heard."""
        if self.link.error:
            return self.link.error
        versions = self.session.versions
        if versions:
            return f"the board speaks version {next(iter(versions.values()))} of the wire; flash it anew"
        if self.session.refused["source"]:
            return "a board that is none of Crunch's speaks here; for Maze Runner's: crunch serve --robot maze_runner"
        rejected = sum(decoder.rejected for decoder in self.session.decoders.values())
        wrong = f"{rejected} pieces of noise came: is the baud rate right?" if rejected else "is it switched on?"
        return f"no board was heard in {SILENCE:.0f} s; {wrong}"

    @property
    def is_over(self) -> bool:
        """All is done, and long enough was listened."""
        seconds = self.work.seconds
        return bool(self.errands.failure) or (seconds is not None and self.t >= seconds and self.errands.is_over)

    def report(self) -> dict[str, Any]:
        """All there is to tell, ready for JSON."""
        t = self.t
        return {
            "link": {
                "spec": self.link.spec,
                "connected": self.link.is_connected,
                "error": self.link.error,
                "seconds": round(t, 3),
                **link_report(self.session, self.meter, t),
            },
            "boards": {board: board_report(self.session, self.heard, board, t) for board in BOARDS},
            "telemetry": telemetry_report(self.heard),
            "settings": settings_report(self.heard),
            "answers": [
                {"board": a.board, "verb": a.verb, "setting": a.setting, "outcome": a.outcome, "value": a.value}
                for a in self.errands.done
                if a.verb != "ask"
            ],
        }

    async def run(self, watch: Callable[[], None]) -> None:
        """Listens and works until all is over; `watch` is called at each tick."""
        listening = asyncio.create_task(self.link.run(self.receive))
        try:
            while not self.is_over:
                await asyncio.sleep(TICK)
                if listening.done():
                    listening.result()
                self.tick()
                watch()
        finally:
            self.ended = self.t
            listening.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await listening


def run(work: Work, look: Callable[[Workbench], AbstractContextManager[Callable[[], None]]]) -> Workbench:
    """Does the work; `look` gives what is called at each tick. UserError where a board refuses or none is heard."""
    bench = Workbench(open_link(work.spec), work)
    with look(bench) as watch:
        asyncio.run(bench.run(watch))
    if bench.errands.failure:
        raise UserError(bench.errands.failure)
    return bench
