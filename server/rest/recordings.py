"""REST of recordings: list, name, fetch, delete and restore them, make their maps, and play them to a viewer.

Uses its siblings `answers`, `cockpit`, `conversation`, `map_store`, `player`, `replay_cache`,
`shelf`, `stream` and `survey`.
"""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path, Response, WebSocket
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from server.cockpit import PREFIX
from server.conversation import close_reason, converse, tell
from server.errors import UserError
from server.map_store import MapStore, StoredMap
from server.messages import Label
from server.player import PERIOD, REPLAY_WORDS, Player, Renderer
from server.replay_cache import CacheReader
from server.rest.answers import refusal
from server.shelf import Busy, NoSuchRecording, Recording, Shelf
from server.stream import Viewer
from server.survey import Survey, unpack

MAX_VIEWERS = 16  # of all replays together
LONGEST_TITLE = 80
UNKNOWN: dict[int | str, dict[str, Any]] = {404: refusal("There is none of that name", "there is no recording run-1")}
UNREADABLE = 4004  # code of a socket that is closed because the recording cannot be played

Name = Annotated[str, Path(examples=["run-20260101-120000"], description="the recording's id")]


class Title(BaseModel):
    """What people call a recording."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(max_length=LONGEST_TITLE, examples=["Third floor, east"], description="empty: as its session")


class NewMap(BaseModel):
    """What the recording's map is to be called."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(
        default="", max_length=LONGEST_TITLE, examples=["Third floor"], description="empty: as its session"
    )


def recording_routes(shelf: Shelf, renderer: Renderer, maps: MapStore) -> APIRouter:
    """The shelf, the maps of what stands on it, and the stream of replays."""
    router = APIRouter(prefix=f"{PREFIX}/recordings", tags=["recordings"])

    @router.get("", summary="List the recordings")
    async def recordings() -> list[Recording]:
        """All recordings in the folder, the newest first."""
        return await off_the_loop(shelf.recordings)

    @router.get("/{name}", summary="Look at a recording", responses=UNKNOWN)
    async def recording(name: Name) -> Recording:
        """What one recording holds."""
        return await off_the_loop(shelf.recording, name)

    @router.patch("/{name}", summary="Name a recording", responses=UNKNOWN)
    async def rename(name: Name, title: Title) -> Recording:
        """Call a recording something that people remember; its file keeps its name."""
        return await off_the_loop(shelf.rename, name, title.name.strip())

    @router.delete(
        "/{name}",
        status_code=204,
        summary="Delete a recording",
        responses={**UNKNOWN, 409: refusal("It is being recorded", "run-1 is being recorded: end the session first")},
    )
    async def delete(name: Name) -> Response:
        """Put a recording into the trash, a folder `.trash` beside the others; `restore` takes it out again."""
        await off_the_loop(shelf.delete, name)
        return Response(status_code=204)

    @router.post(
        "/{name}/restore",
        summary="Restore a recording",
        responses={**UNKNOWN, 409: refusal("Another one has its name", "there is another recording run-1")},
    )
    async def restore(name: Name) -> Recording:
        """Take a deleted recording out of the trash."""
        return await off_the_loop(shelf.restore, name)

    @router.get(
        "/{name}/file",
        summary="Fetch a recording",
        response_class=FileResponse,
        responses={**UNKNOWN, 200: {"content": {"application/octet-stream": {}}, "description": "the .rlog file"}},
    )
    async def file(name: Name) -> FileResponse:
        """The file itself (docs/recording.md); of a session that runs, what has been recorded by now."""
        path = await off_the_loop(shelf.path, name)
        return FileResponse(path, media_type="application/octet-stream", filename=path.name)

    @router.post(
        "/{name}/maps",
        status_code=201,
        summary="Keep a recording's map",
        responses={**UNKNOWN, 409: refusal("It makes no map", "this recording has no map: nobody drove")},
    )
    async def keep_map(name: Name, new: NewMap) -> StoredMap:
        """Map a recording and keep the map; answered when that is done, about 50 times as fast as it was driven."""
        recording = await off_the_loop(shelf.recording, name)
        path = await off_the_loop(shelf.path, name)
        try:
            survey, labels = await result_of(renderer, path)
            title = new.name.strip() or recording.name or name
            return await asyncio.to_thread(
                maps.save, survey, title, session=recording.name, recording=name, labels=labels
            )
        except (UserError, ValueError) as error:
            raise HTTPException(409, str(error)) from None

    add_replay(router, shelf, renderer)
    return router


async def result_of(renderer: Renderer, path: FilePath) -> tuple[Survey, list[Label]]:
    """The map of a recording and its labels, rendered if need be; UserError where there is none."""
    cache = await renderer.open(path)
    reader = CacheReader(cache)
    try:
        while True:
            renderer.tend()
            progress = await asyncio.to_thread(reader.progress)
            if progress.complete and (result := await asyncio.to_thread(reader.result)):
                return unpack(result[0]), [Label(*fields) for fields in json.loads(result[1])]
            if renderer.state(cache, progress) == "failed":
                raise UserError(progress.error or "the recording cannot be mapped; look into the server's log")
            await asyncio.sleep(PERIOD)
    finally:
        reader.close()
        renderer.leave(cache)


def add_replay(router: APIRouter, shelf: Shelf, renderer: Renderer) -> None:
    """The WebSocket that plays a recording to a viewer."""
    numbers = itertools.count(1)
    present: set[Viewer] = set()

    @router.websocket("/{name}/stream")
    async def stream(socket: WebSocket, name: str) -> None:
        await socket.accept()
        if len(present) >= MAX_VIEWERS:
            await socket.close(1013, "too many viewers")
            return
        try:
            path = await asyncio.to_thread(shelf.path, name)
            cache = await renderer.open(path)
        except UserError as error:
            await socket.close(UNREADABLE, close_reason(str(error).removeprefix(f"{shelf.folder}/")))
            return
        viewer = Viewer(f"replay-{next(numbers)}", socket.send_bytes)
        present.add(viewer)
        tell(viewer, kind="hello", viewer=viewer.name)
        player = Player(name, cache, renderer, viewer)
        try:
            await converse(socket, viewer, REPLAY_WORDS, player.hear, player.clock, player.run())
        finally:
            present.discard(viewer)
            renderer.leave(cache)


async def off_the_loop(call: Callable[..., Any], *arguments: Any) -> Any:
    """What a call of the shelf gives, waited for in a thread; its errors as answers."""
    try:
        return await asyncio.to_thread(call, *arguments)
    except NoSuchRecording as error:
        raise HTTPException(404, str(error)) from None
    except Busy as error:
        raise HTTPException(409, str(error)) from None
    except UserError as error:
        raise HTTPException(503, str(error)) from None
