"""REST of sessions: what runs, what ran, and the words that begin, name and end one.

Who keeps the sessions is a `SessionKeeper`. Uses its siblings `answers`, `cockpit` and `views`.
"""

from __future__ import annotations

from typing import Any, Protocol

from fastapi import APIRouter, HTTPException
from pydantic import BaseModel, ConfigDict, Field

from server.cockpit import PREFIX
from server.errors import UserError
from server.rest.answers import refusal
from server.views import SessionStatus

LONGEST_NAME = 80
MOST_SETTINGS = 200  # more than there are


class SessionSummary(SessionStatus):
    """A session with what came of it."""

    duration_s: float = Field(examples=[312.4])
    vertices: int = Field(examples=[92])
    path_length_m: float = Field(examples=[46.1])
    map: str | None = Field(default=None, examples=["7"], description="of the stored maps, once it has ended")
    map_error: str = Field(
        default="",
        examples=[""],
        description="why the map was not kept; POST recordings/{name}/maps makes it again",
    )


class NewSession(BaseModel):
    """What a new session is called, and what settings it has of its own."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(default="", max_length=LONGEST_NAME, examples=["Third floor, east"])
    settings: dict[str, Any] = Field(
        default_factory=dict,
        max_length=MOST_SETTINGS,
        examples=[{"crunch.filter.particles": 2000}],
        description="keys as in config.toml, of the tables crunch and estimator; others stay as they are",
    )


class SessionName(BaseModel):
    """What people call a session."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(max_length=LONGEST_NAME, examples=["Third floor, east"])


class NotRunning(UserError):
    """No session runs."""


class SessionKeeper(Protocol):
    """Who begins and ends sessions."""

    def summaries(self) -> list[SessionSummary]:
        """All sessions of this server, the newest first."""
        ...

    def rename(self, name: str) -> SessionSummary:
        """Call the present session something else."""
        ...

    async def begin(self, name: str = "", settings: dict[str, Any] | None = None) -> SessionSummary:
        """End the session that runs, and begin a new one; UserError for settings or a folder that cannot be used."""
        ...

    async def end(self) -> SessionSummary:
        """End the session that runs; NotRunning if none does."""
        ...


def session_routes(keeper: SessionKeeper) -> APIRouter:
    """Begin, name and end sessions."""
    router = APIRouter(prefix=f"{PREFIX}/sessions", tags=["sessions"])

    @router.get("", summary="List the sessions")
    async def sessions() -> list[SessionSummary]:
        """The sessions since the server was started, the newest first."""
        return keeper.summaries()

    @router.get("/current", summary="The present session")
    async def current() -> SessionSummary:
        """The newest session; `running` is false when it has ended."""
        return keeper.summaries()[0]

    @router.patch("/current", summary="Name the present session")
    async def rename(name: SessionName) -> SessionSummary:
        """Call the newest session, and its recording, something that people remember."""
        return keeper.rename(name.name.strip())

    @router.post(
        "",
        status_code=201,
        summary="Begin a session",
        responses={409: refusal("The settings or the folder cannot be used", "settings: `crunch.filer` is no setting")},
    )
    async def begin(new: NewSession) -> SessionSummary:
        """Begin a session with a recording, a path filter and a map of its own.

        A session that still runs is ended first, as by `/sessions/current/end`.
        """
        try:
            return await keeper.begin(new.name.strip(), new.settings)
        except UserError as error:
            raise HTTPException(409, str(error)) from None

    @router.post(
        "/current/end",
        summary="End the session",
        responses={409: refusal("None runs", "no session runs")},
    )
    async def end() -> SessionSummary:
        """Stop the robot, close the recording and keep the map. Until a session begins, nobody can drive."""
        try:
            return await keeper.end()
        except NotRunning as error:
            raise HTTPException(409, str(error)) from None

    return router
