"""Files that are made when they are asked for: off the event loop, and not again while nothing changed.

Uses its siblings `map_exports` (the formats' names and types) and `map_store` (its errors).
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from anyio import BrokenWorkerProcess, to_process
from fastapi import HTTPException, Request, Response

from server.map_exports import FORMATS
from server.map_store import Conflict, NoSuchMap, StoreError

KEPT = 8  # files

T = TypeVar("T")


async def asked(call: Callable[..., T], *arguments: object) -> T:
    """What a call returns, made off the loop; the errors of saved maps as answers."""
    try:
        return await asyncio.to_thread(call, *arguments)
    except NoSuchMap as error:
        raise HTTPException(404, str(error)) from None
    except (Conflict, ValueError) as error:
        raise HTTPException(409, str(error)) from None
    except StoreError as error:
        raise HTTPException(503, str(error)) from None


async def answer(
    request: Request, tag: str, name: str, media_type: str, content: Callable[[], Awaitable[bytes]]
) -> Response:
    """A file, or 304 where the client has it; `tag` changes when the file does."""
    headers = {
        "ETag": f'"{tag}"', "Cache-Control": "no-cache", "Content-Disposition": f'inline; filename="{name}"'
    }  # fmt: skip
    if request.headers.get("if-none-match") == headers["ETag"]:
        return Response(status_code=304, headers=headers)
    return Response(await content(), media_type=media_type, headers=headers)


class Press:
    """Makes what takes long, one thing at a time, and keeps the newest few."""

    def __init__(self) -> None:
        self.lock = asyncio.Lock()
        self.made: OrderedDict[str, Any] = OrderedDict()

    async def make(self, tag: str, prepare: Callable[[], Callable[[], T]], is_heavy: bool = True) -> T:
        """What `prepare()()` returns, unless the same tag was made lately.

        `prepare` runs in a thread. What it returns runs there too or, if it is heavy, in a process of its own, so that
        the event loop, and with it the robot, never waits for a picture; it can be pickled then.
        """
        async with self.lock:
            if tag not in self.made:
                job = await asked(prepare)
                self.made[tag] = await apart(job) if is_heavy else await asked(job)
            self.made.move_to_end(tag)
            while len(self.made) > KEPT:
                self.made.popitem(last=False)
            return self.made[tag]


async def apart(job: Callable[[], T]) -> T:
    """What a job returns in another process; 503 where that breaks, or the server leaves first."""
    try:
        return await to_process.run_sync(job, cancellable=True)
    except (BrokenWorkerProcess, asyncio.CancelledError):
        raise HTTPException(503, "it could not be made this time; try again") from None


def documented(name: str) -> dict[int | str, dict[str, Any]]:
    """How a route that answers a format is documented."""
    media_type = FORMATS[name].media_type.partition(";")[0]
    content: dict[str, Any] = {media_type: {"example": EXAMPLES[name]} if name in EXAMPLES else {}}
    return {
        200: {"description": FORMATS[name].description.capitalize(), "content": content},
        304: {"description": "The client has it already, as its `If-None-Match` says"},
    }


EXAMPLES: dict[str, Any] = {
    "json": {
        "format": "crunch-map-1",
        "robot": "crunch",
        "frame": "world",
        "settled": 1,
        "path": [[0.0, 0.0, 0.0], [0.5, 0.01, 0.03]],
        "spread": [0.0, 0.02],
        "walls": [[[0.4, 0.9], [0.45, 0.9], [0.5, 0.91]]],
        "labels": [{"text": "Kitchen", "x": 2.4, "y": -1.0}],
    },
    "yaml": "image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.500000, -2.000000, 0.000000]\n",
    "g2o": "VERTEX_SE2 0 0.000000 0.000000 0.000000000\nFIX 0\n",
    "tum": "0.500000 0.000000 0.000000 0 0 0 0.000000000 1.000000000\n",
    "csv": "vertex,time,distance,nodes_per_particle,settled\n0,0.500000,0.000,0.010000,1\n",
}
