"""The web server: REST documents, the live stream with the page's commands, and the page itself.

Sees snapshots and a status, never a robot: the session behind it is a `Cockpit`. What may move the robot is decided by
`control`, who may connect by `guard`. Nothing is fetched from elsewhere, the documentation page included. Uses its
siblings `cockpit`, `dashboard`, `guard`, `stream` and those of `rest`:
`answers`, `commands`, `health`, `metrics`, `state`.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Response, WebSocket, WebSocketDisconnect
from fastapi.exceptions import RequestValidationError
from fastapi.staticfiles import StaticFiles
from fastapi_offline import FastAPIOffline
from pydantic import ValidationError

from server.cockpit import Cockpit
from server.control import Refused
from server.dashboard import Dashboard, add_viser
from server.guard import Guard
from server.rest.answers import GUARDED, answer_nonsense
from server.rest.commands import command_routes
from server.rest.health import health_routes
from server.rest.metrics import metrics_routes
from server.rest.state import state_routes
from server.stream import Viewer, encode
from server.words import WORDS, AckWord, CommandWord, PingWord

log = logging.getLogger(__name__)

WEB = Path(__file__).resolve().parents[1] / "web"
MAX_VIEWERS = 64
MAX_WORDS_PER_SECOND = 200
MAX_NONSENSE = 20  # words that cannot be understood, before the line is cut
MAX_WORD_BYTES = 4096
PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
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
        responses=GUARDED,
    )  # fmt: skip
    app.add_exception_handler(RequestValidationError, answer_nonsense)
    for routes in (state_routes, command_routes, health_routes, metrics_routes):
        app.include_router(routes(cockpit))
    for router in further:
        app.include_router(router)
    add_stream(app, cockpit)
    if dashboard is not None:
        add_viser(app, dashboard, cockpit.snapshot)
    add_page(app)
    app.add_middleware(Guard, token=token)
    return app


class Gone(Exception):
    """The viewer has left, or was shown the door."""


def add_stream(app: FastAPI, cockpit: Cockpit) -> None:
    """The WebSocket: frames to the page, words from it."""
    numbers = itertools.count(1)

    @app.websocket("/api/v1/stream")
    async def stream(socket: WebSocket) -> None:
        await socket.accept()
        if len(cockpit.hub.viewers) >= MAX_VIEWERS:
            await socket.close(1013, "too many viewers")
            return
        viewer = Viewer(f"viewer-{next(numbers)}", socket.send_bytes)
        viewer.put("notice", encode("notice", {"kind": "hello", "viewer": viewer.name}))
        cockpit.hub.join(viewer)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(viewer.run())
                await listen(socket, viewer, cockpit)
                raise Gone
        except* (Gone, WebSocketDisconnect, RuntimeError) as reasons:
            report_unexpected(reasons)
        finally:
            cockpit.hub.leave(viewer)
            cockpit.left(viewer.name)


def report_unexpected(reasons: BaseExceptionGroup) -> None:
    """Sending on a closed socket raises RuntimeError; any other one is ours and must be seen."""
    for reason in reasons.exceptions:
        if isinstance(reason, RuntimeError) and "close" not in str(reason) and "Unexpected ASGI" not in str(reason):
            raise reason


class Patience:
    """Counts a viewer's words: too many at once, or too much nonsense, and the line is cut."""

    def __init__(self):
        self.second = 0
        self.words = 0
        self.nonsense = 0

    def allows(self, t: float, is_nonsense: bool) -> bool:
        """Whether to go on listening after another word at time t."""
        if int(t) != self.second:
            self.second, self.words = int(t), 0
        self.words += 1
        self.nonsense += is_nonsense
        return self.words <= MAX_WORDS_PER_SECOND and self.nonsense <= MAX_NONSENSE


async def listen(socket: WebSocket, viewer: Viewer, cockpit: Cockpit) -> None:
    """Obey a page's words until it leaves, floods or talks nonsense."""
    patience = Patience()
    loop = asyncio.get_running_loop()
    while True:
        event = await socket.receive()
        if event["type"] == "websocket.disconnect":
            return
        word = understand(event.get("text"))
        if not patience.allows(loop.time(), word is None):
            log.warning("%s was cut off: too many words", viewer.name)
            await socket.close(1008, "too many words")
            return
        match word:
            case None:
                viewer.put("notice", encode("notice", {"kind": "refused", "reason": "not understood"}))
            case AckWord():
                viewer.acknowledge(word.seq)
            case PingWord():
                viewer.put("notice", encode("notice", pong(word, cockpit)))
            case _:
                obey(viewer, word, cockpit)


def understand(text: str | None) -> Any:
    """A page's word, or None for nonsense."""
    if text is None or len(text) > MAX_WORD_BYTES:
        return None
    try:
        return WORDS.validate_json(text)
    except ValidationError:
        return None


def pong(word: PingWord, cockpit: Cockpit) -> dict[str, Any]:
    """The answer to a ping: with the session's time, so that the viewer knows how old a picture is."""
    return {"kind": "pong", "sent": word.sent, "t": round(cockpit.t, 4), "speed": cockpit.speed}


def obey(viewer: Viewer, word: CommandWord, cockpit: Cockpit) -> None:
    """Hand a command on; tell the viewer if it was refused."""
    try:
        cockpit.hear(viewer.name, word)
    except Refused as refused:
        viewer.put("notice", encode("notice", {"kind": "refused", "word": word.type, "reason": str(refused)}))


class Page(StaticFiles):
    """The page's files: asked for anew each time, allowed to load nothing from elsewhere."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        """A file with the page's headers."""
        response = super().file_response(*args, **kwargs)
        response.headers["Cache-Control"] = "no-cache"
        response.headers["Content-Security-Policy"] = PAGE_POLICY
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        return response


def add_page(app: FastAPI) -> None:
    """The page itself, at the root."""
    app.mount("/", Page(directory=WEB, html=True), name="page")
