"""REST of saved maps: keep, name, turn, label, compare, delete and restore them, and fetch them in every format.

Uses its siblings `answers`, `cockpit`, `files` and `present`, and `comparison`, `map_exports`, `map_store`, `survey`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from server.cockpit import PREFIX, Cockpit
from server.comparison import Comparison, compare, comparison_png
from server.map_exports import FORMATS, Format, Sheet, stem_of
from server.map_store import Change, MapStore, StoredMap, keep_session
from server.rest.answers import refusal
from server.rest.files import Press, answer, asked, documented
from server.rest.present import present_survey
from server.survey import Survey, in_frame
from slam.map_alignment import NO_MOTION
from slam.pose import between

Answers = dict[int | str, dict[str, Any]]

NOT_THERE: Answers = {404: refusal("No such map", "there is no map 7")}
NO_DISK: Answers = {503: refusal("The file of maps cannot be used", "crunch.db: cannot be used (disk is full)")}
CHANGED: Answers = {409: refusal("Changed by somebody else", "map 3 was changed by somebody else; look at it again")}
Number = Annotated[int, Path(ge=1, le=2**53, description="the map's number", examples=[3])]
Other = Annotated[int, Path(ge=1, le=2**53, description="the other map's number", examples=[2])]
Align = Annotated[
    bool, Query(description="find how they lie to each other; else their frames are taken as they are", examples=[True])
]


class NewMap(BaseModel):
    """What the present map is to be called."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(default="", max_length=120, examples=["Ground floor"], description="the session's name if empty")
    note: str = Field(default="", max_length=4000, examples=["Doors to the east were shut."])


def map_routes(cockpit: Cockpit, store: MapStore) -> APIRouter:
    """Saved maps."""
    router = APIRouter(prefix=f"{PREFIX}/maps", tags=["saved maps"])
    add_keeping(router, cockpit, store)
    add_changing(router, store)
    add_files(router, store)
    add_comparing(router, store)
    return router


def add_keeping(router: APIRouter, cockpit: Cockpit, store: MapStore) -> None:
    """List them and save the present one."""

    @router.get("", summary="List saved maps", responses=NO_DISK)
    async def maps(
        deleted: Annotated[bool, Query(description="list the deleted ones instead", examples=[False])] = False,
    ) -> list[StoredMap]:
        """All saved maps, the newest first."""
        return await asked(store.maps, deleted)

    @router.post(
        "",
        status_code=201,
        summary="Save the present map",
        responses={409: refusal("There is none", "there is no map yet; drive half a metre first"), **NO_DISK},
    )
    async def save(new: NewMap) -> StoredMap:
        """Keep the present map with its labels. It is on the disk when this is answered; the session goes on."""
        about, survey, labels = cockpit.status().session, present_survey(cockpit), cockpit.snapshot().labels
        return await asked(keep_session, store, survey, about, labels, new.name, new.note)

    @router.get("/{number}", summary="A saved map", responses={**NOT_THERE, **NO_DISK})
    async def info(number: Number) -> StoredMap:
        """What is known of a saved map, deleted ones included."""
        return await asked(store.info, number)


def add_changing(router: APIRouter, store: MapStore) -> None:
    """Change, delete and restore them."""

    @router.patch("/{number}", summary="Change a saved map", responses={**NOT_THERE, **CHANGED, **NO_DISK})
    async def change(number: Number, change: Change) -> StoredMap:
        """Rename it, write a note, lay its axes elsewhere, or set its labels.

        `frame` says where the map's axes stand in the world that the robot made, so that zeros take every correction
        back. Labels keep their places in the building. With `revision` nobody's change is overwritten unseen.
        """
        return await asked(store.change, number, change)

    @router.post("/{number}/straighten", summary="Straighten a map", responses={**NOT_THERE, **NO_DISK})
    async def straighten(number: Number) -> StoredMap:
        """Turn the map's axes by the least angle that lays the building's main walls along them."""
        return await asked(straightened, store, number)

    @router.delete("/{number}", summary="Delete a saved map", responses={**NOT_THERE, **NO_DISK})
    async def delete(number: Number) -> StoredMap:
        """Put it away. Nothing is erased: `restore` brings it back at any time."""
        return await asked(store.delete, number)

    @router.post("/{number}/restore", summary="Take a deletion back", responses={**NOT_THERE, **NO_DISK})
    async def restore(number: Number) -> StoredMap:
        """Bring a deleted map back as it was."""
        return await asked(store.restore, number)


def add_files(router: APIRouter, store: MapStore) -> None:
    """Their files."""
    press = Press()

    @router.get(
        "/{number}/thumbnail.png",
        summary="A map's small picture",
        response_class=Response,
        responses={200: {"content": {"image/png": {}}}, **NOT_THERE, **NO_DISK},
    )
    async def thumbnail(request: Request, number: Number) -> Response:
        """480 by 320 pixels, without words, on a transparent ground."""
        kept = await asked(store.info, number)
        tag = f"{number}-{kept.revision}-small"
        content = partial(asked, store.thumbnail, number)
        return await answer(request, tag, "thumbnail.png", "image/png", content)

    def add(name: str, made: Format) -> None:
        async def file(request: Request, number: Number) -> Response:
            kept = await asked(store.info, number)
            tag = f"{number}-{kept.revision}-{name}"
            content = partial(press.make, tag, lambda: partial(made.make, sheet_of(store, kept)), made.is_drawn)
            return await answer(request, tag, f"{stem_of(kept.name)}.{name}", made.media_type, content)

        router.add_api_route(
            f"/{{number}}/map.{name}",
            file,
            summary=f"A saved map as {name.upper()}",
            description=f"A saved map in its own frame: {made.description}.",
            name=f"saved map {name}",
            response_class=Response,
            responses={**documented(name), **NOT_THERE, **NO_DISK},
        )

    for name, made in FORMATS.items():
        add(name, made)


def add_comparing(router: APIRouter, store: MapStore) -> None:
    """Two of them, laid over each other."""
    press = Press()

    @router.get(
        "/{number}/compare/{other}.png",
        summary="Two maps in one picture",
        response_class=Response,
        responses={200: {"content": {"image/png": {}}}, **NOT_THERE, **NO_DISK},
    )
    async def picture(request: Request, number: Number, other: Other, align: Align = True) -> Response:
        """Both maps in the first one's frame: its walls blue, the other's orange over them."""
        first, second = await asked(store.info, number), await asked(store.info, other)
        found, tag = await compared(first, second, align)
        job = partial(drawing, store, first, second, found)
        content = partial(press.make, f"{tag}-picture", job)
        return await answer(request, f"{tag}-picture", "comparison.png", "image/png", content)

    @router.get("/{number}/compare/{other}", summary="Compare two maps", responses={**NOT_THERE, **NO_DISK})
    async def figures(number: Number, other: Other, align: Align = True) -> Comparison:
        """How the second map lies in the first one's frame, and which share of each one's walls the other has too."""
        first, second = await asked(store.info, number), await asked(store.info, other)
        return (await compared(first, second, align))[0]

    async def compared(first: StoredMap, second: StoredMap, is_aligned: bool) -> tuple[Comparison, str]:
        tag = f"{first.id}-{first.revision}-{second.id}-{second.revision}-{is_aligned}"
        return await press.make(tag, partial(comparing, store, first, second, is_aligned)), tag


def framed(store: MapStore, kept: StoredMap) -> Survey:
    """A saved survey in the frame that people chose for it."""
    return in_frame(store.survey(kept.id), kept.frame.pose())


def sheet_of(store: MapStore, kept: StoredMap) -> Sheet:
    """A saved map as it is exported."""
    return Sheet(framed(store, kept), [place.label() for place in kept.labels], kept.name, stem_of(kept.name))


def comparing(store: MapStore, first: StoredMap, second: StoredMap, is_aligned: bool) -> Callable[[], Comparison]:
    """The comparison of two saved maps, to be done; those of one recording are of one world."""
    same = bool(first.recording) and first.recording == second.recording
    guess = between(first.frame.pose(), second.frame.pose()) if same else NO_MOTION
    return partial(compare, framed(store, first), framed(store, second), is_aligned, guess)


def drawing(store: MapStore, first: StoredMap, second: StoredMap, found: Comparison) -> Callable[[], bytes]:
    """Two saved maps in one picture, to be drawn."""
    names = (first.name, second.name)
    return partial(comparison_png, framed(store, first), framed(store, second), found, names)


def straightened(store: MapStore, number: int) -> StoredMap:
    """A saved map, turned by its skew."""
    kept = store.info(number)
    frame = kept.frame.model_copy(update={"theta": kept.frame.theta + kept.skew_rad})
    return store.change(number, Change(frame=frame, revision=kept.revision))
