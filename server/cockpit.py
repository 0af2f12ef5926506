"""What the web server needs of a session: the face that `bridge` has for `api` and for the routes of REST.

Uses its siblings `labels`, `stream` and `views`.
"""

from __future__ import annotations

from typing import Any, Protocol

from server.labels import Labels
from server.messages import Snapshot
from server.stream import Hub
from server.views import Status
from server.words import CommandWord

PREFIX = "/api/v1"


class Cockpit(Protocol):
    """What the web server needs of a session."""

    hub: Hub
    labels: Labels

    @property
    def t(self) -> float:
        """The session's present, seconds since its start."""
        ...

    @property
    def speed(self) -> float:
        """How many of those pass in a second of the people who watch."""
        ...

    def snapshot(self) -> Snapshot:
        """What there is to see now."""
        ...

    def status(self) -> Status:
        """Everything at a glance."""
        ...

    def configuration(self) -> dict[str, Any]:
        """The settings that the session runs with."""
        ...

    def hear(self, viewer: str, word: CommandWord) -> None:
        """Obey a viewer's word; raises Refused."""
        ...

    def left(self, viewer: str) -> None:
        """A viewer has gone."""
        ...
