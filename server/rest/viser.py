"""viser's page and socket under our own address, behind the same checks as everything else, which viser has not.

Uses its siblings `dashboard` and `guard`.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import logging
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import websockets
from fastapi import APIRouter, Request, Response, WebSocket, WebSocketDisconnect

from server.dashboard import Dashboard
from server.guard import shield
from server.messages import Snapshot

log = logging.getLogger(__name__)

MAX_VIEWERS = 8  # each of them gets the whole scene
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' data: blob:; worker-src 'self' data: blob:; "
    "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)  # viser's page is one file with everything in it, and evaluates the text of its panel


def viser_routes(dashboard: Dashboard, look: Callable[[], Snapshot]) -> APIRouter:
    """The routes /viser/ (page) and /viser (socket, handed through)."""
    router = APIRouter()
    seats = asyncio.Semaphore(MAX_VIEWERS)

    @router.get("/viser/", include_in_schema=False)
    async def page(request: Request) -> Response:
        await dashboard.start(look())
        compressed = await asyncio.to_thread(client_page)
        if "gzip" in request.headers.get("accept-encoding", ""):
            response = Response(compressed, media_type="text/html", headers={"Content-Encoding": "gzip"})
        else:
            response = Response(gzip.decompress(compressed), media_type="text/html")
        shield(response, POLICY)
        return response

    @router.websocket("/viser")
    async def socket(ours: WebSocket) -> None:
        protocols = [websockets.Subprotocol(name) for name in ours.scope.get("subprotocols", [])]
        if seats.locked():
            await ours.accept(next(iter(protocols), None))
            await ours.close(1013, "too many viewers")
            return
        async with seats:
            await show(ours, protocols)

    async def show(ours: WebSocket, protocols: list[websockets.Subprotocol]) -> None:
        """Connect a viewer with viser for as long as both like."""
        await dashboard.start(look())
        theirs = websockets.connect(
            f"ws://127.0.0.1:{dashboard.port}",
            subprotocols=protocols, compression=None, max_size=None, max_queue=2, ping_interval=None,
        )  # fmt: skip
        with contextlib.suppress(OSError, websockets.InvalidHandshake):
            async with theirs as upstream:
                try:
                    await ours.accept(upstream.subprotocol)
                    await hand_through(ours, upstream)
                finally:
                    upstream.transport.abort()  # a farewell takes turns, and we may be cancelled in one

    return router


@lru_cache
def client_page() -> bytes:
    """viser's own page as its wheel brings it, compressed."""
    import viser

    page = Path(viser.__file__).parent / "client" / "build" / "index.html"
    return gzip.compress(page.read_bytes(), 6)


class Closed(Exception):
    """One side of a handed-through socket has gone."""


async def hand_through(ours: WebSocket, theirs: websockets.ClientConnection) -> None:
    """Copy messages both ways until one side closes."""

    async def up() -> None:
        while True:
            event = await ours.receive()
            if event["type"] == "websocket.disconnect":
                raise Closed
            if event.get("bytes") is None:  # text, which is no word of viser's
                await ours.close(1003, "not understood")
                raise Closed
            await theirs.send(event["bytes"])

    async def down() -> None:
        async for message in theirs:
            await ours.send_bytes(message if isinstance(message, bytes) else message.encode())
        raise Closed

    try:
        async with asyncio.TaskGroup() as group:
            group.create_task(up())
            group.create_task(down())
    except* (Closed, WebSocketDisconnect, websockets.ConnectionClosed, RuntimeError):
        log.debug("a 3-D viewer has gone")
