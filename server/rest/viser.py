"""viser's page and socket under our own address, behind the same checks as everything else, which viser has not.

Uses its sibling `dashboard`.
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
from server.messages import Snapshot

log = logging.getLogger(__name__)


def viser_routes(dashboard: Dashboard, look: Callable[[], Snapshot]) -> APIRouter:
    """The routes /viser/ (page) and /viser (socket, handed through)."""
    router = APIRouter()

    @router.get("/viser/", include_in_schema=False)
    async def page(request: Request) -> Response:
        await dashboard.start(look())
        compressed = await asyncio.to_thread(client_page)
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(compressed, media_type="text/html", headers={"Content-Encoding": "gzip"})
        return Response(gzip.decompress(compressed), media_type="text/html")

    @router.websocket("/viser")
    async def socket(ours: WebSocket) -> None:
        await dashboard.start(look())
        protocols = [websockets.Subprotocol(name) for name in ours.scope.get("subprotocols", [])]
        theirs = websockets.connect(
            f"ws://127.0.0.1:{dashboard.port}",
            subprotocols=protocols, compression=None, max_size=None, max_queue=2, ping_interval=None,
        )  # fmt: skip
        with contextlib.suppress(OSError, websockets.InvalidHandshake):
            async with theirs as upstream:
                await ours.accept(upstream.subprotocol)
                await hand_through(ours, upstream)

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
            await theirs.send(await ours.receive_bytes())

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
