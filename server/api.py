"""The web server: REST documents, the live stream with the page's commands, and the page itself.

Sees snapshots and a status, never a robot: the session behind it is a `Cockpit`. What may move the robot is decided by
`control`, who may connect by `guard`. Nothing is fetched from elsewhere, the documentation page included. Uses its
siblings `dashboard`, `guard`, `maps`, `stream` and `views`.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
from pathlib import Path
from typing import Any, Protocol

from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import JSONResponse
from fastapi.staticfiles import StaticFiles
from fastapi_offline import FastAPIOffline
from pydantic import ValidationError

from server.control import WORDS, AckWord, CommandWord, PingWord, Refused
from server.dashboard import Dashboard, add_viser
from server.guard import Guard
from server.maps import FloorMap, draw_png, map_json
from server.messages import Snapshot
from server.stream import Hub, Viewer, encode
from server.views import Profile, Status, path_length

log = logging.getLogger(__name__)

WEB = Path(__file__).resolve().parents[1] / "web"
MAX_VIEWERS = 16
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


class Cockpit(Protocol):
    """What the web server needs of a session."""

    hub: Hub

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


def create_app(cockpit: Cockpit, token: str | None = None, dashboard: Dashboard | None = None) -> FastAPI:
    """The application for one session; with a `token` nothing is answered without it."""
    app = FastAPIOffline(
        title="Crunch", version=cockpit.status().version, description=DESCRIPTION, docs_url="/docs", redoc_url=None
    )
    add_documents(app, cockpit)
    add_stream(app, cockpit)
    if dashboard is not None:
        add_viser(app, dashboard, cockpit.snapshot)
    add_page(app)
    app.add_middleware(Guard, token=token)
    return app


def add_documents(app: FastAPI, cockpit: Cockpit) -> None:
    """The routes of REST."""
    artist = Artist()

    @app.get("/api/v1/status", tags=["state"])
    async def status() -> Status:
        """Battery, tilt, link, filter, driver and map at a glance."""
        return cockpit.status()

    @app.get("/api/v1/config", tags=["state"])
    async def config() -> dict[str, Any]:
        """The settings that the session runs with, defaults included."""
        return cockpit.configuration()

    @app.get("/api/v1/profile", tags=["map"])
    async def profile() -> Profile:
        """How settled the path is at each vertex."""
        snapshot = cockpit.snapshot()
        return Profile(profile=[float(share) for share in snapshot.profile], fixed_depth=snapshot.fixed_depth)

    @app.get("/api/v1/map.json", tags=["map"], response_class=JSONResponse, responses={200: MAP_JSON_EXAMPLE})
    async def map_document() -> Response:
        """The best path and the walls seen from it, for programs."""
        snapshot = cockpit.snapshot()
        content = await asyncio.to_thread(map_json, floor_of(snapshot), snapshot.robot)
        return Response(content, media_type="application/json", headers={"Cache-Control": "no-cache"})

    @app.get("/api/v1/map.png", tags=["map"], response_class=Response, responses={200: {"content": {"image/png": {}}}})
    async def map_picture(request: Request) -> Response:
        """The best map, drawn to be looked at; drawn anew when a vertex was added."""
        tag, picture = await artist.picture(cockpit.snapshot())
        headers = {"ETag": tag, "Cache-Control": "no-cache"}
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        return Response(picture, media_type="image/png", headers=headers)


MAP_JSON_EXAMPLE: dict[str, Any] = {
    "content": {
        "application/json": {
            "example": {
                "format": "crunch-map-1",
                "robot": "crunch",
                "frame": "world",
                "settled": 1,
                "path": [[0.0, 0.0, 0.0], [0.5, 0.01, 0.03]],
                "walls": [[[0.4, 0.9], [0.45, 0.9], [0.5, 0.91]]],
            }
        }
    }
}


def floor_of(snapshot: Snapshot) -> FloorMap:
    """The snapshot's best map, as it is drawn and stored."""
    walls = [curve for curve in snapshot.walls if len(curve) > 1]
    return FloorMap(snapshot.path, walls, min(snapshot.fixed_depth + 1, len(snapshot.path)))


class Artist:
    """Draws the map in a thread, one picture at a time, and keeps the last."""

    def __init__(self):
        self.lock = asyncio.Lock()
        self.tag = ""
        self.drawn = b""

    async def picture(self, snapshot: Snapshot) -> tuple[str, bytes]:
        """An entity tag and a PNG of the snapshot's map."""
        tag = f'"{len(snapshot.path)}-{snapshot.fixed_depth}-{snapshot.resamplings}-{snapshot.affinity:.6g}"'
        async with self.lock:
            if tag != self.tag:
                title = f"{snapshot.robot.capitalize()}: {path_length(snapshot.path):.1f} m"
                figures = f"{len(snapshot.path)} vertices, {snapshot.n_particles} particles"
                self.drawn = await asyncio.to_thread(draw_png, floor_of(snapshot), title, figures)
                self.tag = tag
            return self.tag, self.drawn


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
                viewer.put("notice", encode("notice", {"kind": "pong", "sent": word.sent}))
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
