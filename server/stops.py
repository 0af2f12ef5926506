"""The newest stops of a session: when, why and by whom. Knows no robot and asks no clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

KEPT = 20
AGAIN = 1.0  # s within which the same said again is no other stop
DRIVE_BOARD = "drive board"
HARMLESS = ("none", "command", "link", "boot")  # a board's words for standing still because nobody drives it


class StopEntry(BaseModel):
    """One stop; `t` in seconds since the session's start."""

    model_config = ConfigDict(frozen=True)

    t: float = Field(examples=[61.3])
    reason: str = Field(examples=["pressed Stop"])
    by: str = Field(examples=["viewer-2"], description="a viewer, 'drive board', 'link', 'planner' or 'session'")


class StopLog:
    """Keeps the newest stops, and notices those that the boards and the link tell of."""

    def __init__(self, remember: Callable[[dict[str, Any]], None] = lambda entry: None):
        """`remember` is told what the robot's own bytes do not tell, so that a recording has it."""
        self.remember = remember
        self.entries: deque[StopEntry] = deque(maxlen=KEPT)
        self.board_reason = "none"
        self.was_connected = False

    def note(self, t: float, reason: str, by: str) -> None:
        """Another stop, unless it is the newest one said again."""
        entry = StopEntry(t=round(t, 3), reason=reason, by=by)
        newest = self.entries[-1] if self.entries else None
        if newest and (newest.reason, newest.by) == (reason, by) and entry.t - newest.t < AGAIN:
            return
        self.entries.append(entry)
        if by != DRIVE_BOARD:
            self.remember(entry.model_dump())

    def recall(self, entry: dict[str, Any]) -> None:
        """A stop that was remembered; ValueError if it is none."""
        self.entries.append(StopEntry.model_validate(entry))

    def watch(self, t: float, board_reason: str | None, is_connected: bool) -> None:
        """The drive board's reason for its last stop (None before its first word), and whether a link is open."""
        if board_reason is not None and board_reason != self.board_reason:
            self.board_reason = board_reason
            if board_reason not in HARMLESS:
                self.note(t, board_reason, DRIVE_BOARD)
        if self.was_connected and not is_connected:
            self.note(t, "connection lost", "link")
        self.was_connected = is_connected

    def newest(self) -> list[StopEntry]:
        """Newest first."""
        return list(reversed(self.entries))
