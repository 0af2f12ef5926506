"""The web server: REST documents, the live stream with the page's commands, and the page itself.

Sees snapshots and a status, never a robot: the session behind it is a `Cockpit`. What may move the robot is decided by
`control`, who may connect by `guard`. Nothing is fetched from elsewhere, the documentation page included. Uses its
siblings `cockpit`, `conversation`, `dashboard`, `guard`, `stream` and those of `rest`:
`answers`, `commands`, `health`, `metrics`, `present`, `state`, `viser`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Response, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.staticfiles import StaticFiles
from fastapi_offline import FastAPIOffline

from server.cockpit import Cockpit
from server.conversation import converse, tell
from server.dashboard import Dashboard
from server.guard import Guard, shield
from server.rest.answers import GUARDED, answer_nonsense
from server.rest.commands import command_routes
from server.rest.health import health_routes
from server.rest.metrics import metrics_routes
from server.rest.present import present_routes
from server.rest.state import state_routes
from server.rest.viser import viser_routes
from server.stream import Viewer
from server.words import WORDS

WEB = Path(__file__).resolve().parents[1] / "web"
MAX_VIEWERS = 64
MAX_BODY = 256 * 1024  # bytes of a request: parsing more would keep the loop from the robot
PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "frame-src 'self'; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)

DESCRIPTION = """
Maps and state of the robot. Lengths are in metres, angles in radians, times in seconds since the session's start.
The live stream with its commands is the WebSocket `/api/v1/stream`, described in docs/http.md.
"""


def create_app(
    cockpit: Cockpit, token: str | None = None, dashboard: Dashboard | None = None, further: Sequence[APIRouter] = ()
) -> FastAPI:
    """The application, with routes to `further` things; with a `token` nothing is answered without it."""
    app = FastAPIOffline(
        title="Crunch", version=cockpit.status().version, description=DESCRIPTION, docs_url="/docs", redoc_url=None,
        responses=GUARDED, max_body_size=MAX_BODY,
    )  # fmt: skip
    app.add_exception_handler(RequestValidationError, answer_nonsense)
    for routes in (state_routes, command_routes, health_routes, metrics_routes, present_routes):
        app.include_router(routes(cockpit))
    for router in further:
        app.include_router(router)
    add_stream(app, cockpit)
    if dashboard is not None:
        app.include_router(viser_routes(dashboard, cockpit.snapshot))
    add_page(app)
    app.add_middleware(Guard, token=token)
    return app


class Gone(Exception):
    """The viewer has left, or was shown the door."""


def add_stream(app: FastAPI, cockpit: Cockpit) -> None:
    """The WebSocket: frames to the page, words from it."""
    numbers = itertools.count(1)

    def clock() -> dict[str, float]:
        return {"t": round(cockpit.t, 4), "speed": cockpit.speed}

    @app.websocket("/api/v1/stream")
    async def stream(socket: WebSocket) -> None:
        await socket.accept()
        if len(cockpit.hub.viewers) >= MAX_VIEWERS:
            await socket.close(1013, "too many viewers")
            return
        viewer = Viewer(f"viewer-{next(numbers)}", socket.send_bytes)
        tell(viewer, kind="hello", viewer=viewer.name)
        cockpit.hub.join(viewer)
        try:
            await converse(socket, viewer, WORDS, partial(cockpit.hear, viewer.name), clock)
        finally:
            cockpit.hub.leave(viewer)
            cockpit.left(viewer.name)


class Page(StaticFiles):
    """The page's files: asked for anew each time, allowed to load nothing from elsewhere."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        """A file with the page's headers."""
        response = super().file_response(*args, **kwargs)
        shield(response, PAGE_POLICY)
        return response


def add_page(app: FastAPI) -> None:
    """The page itself, at the root."""
    app.mount("/", Page(directory=WEB, html=True), name="page")
