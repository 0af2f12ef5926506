"""REST of the map that grows now: its files, and the labels that people put on it.

Uses its siblings `answers`, `cockpit` and `files`, and `labels`, `map_exports` and `survey`.
"""

from __future__ import annotations

import hashlib
from functools import partial
from typing import Annotated

from fastapi import APIRouter, HTTPException, Path, Request, Response

from server.cockpit import PREFIX, Cockpit
from server.labels import NewPlace, NoPlace, Place, place_of
from server.map_exports import FORMATS, Format, Sheet
from server.messages import Snapshot
from server.rest.answers import refusal
from server.rest.files import Press, answer, documented
from server.survey import Survey, survey_of, titled
from slam.motion import MotionParams


def present_routes(cockpit: Cockpit) -> APIRouter:
    """The present map and its labels."""
    router = APIRouter(prefix=PREFIX)
    add_files(router, cockpit)
    add_labels(router, cockpit)
    return router


def add_files(router: APIRouter, cockpit: Cockpit) -> None:
    """The map in every format."""
    press = Press()

    def add(name: str, made: Format) -> None:
        async def present(request: Request) -> Response:
            snapshot = cockpit.snapshot()
            sheet = Sheet(present_survey(cockpit, snapshot), snapshot.labels, titled(snapshot.robot))
            tag = f"{name}-{tag_of(snapshot)}"
            content = partial(press.make, tag, lambda: partial(made.make, sheet), made.is_drawn)
            return await answer(request, tag, f"map.{name}", made.media_type, content)

        router.add_api_route(
            f"/map.{name}",
            present,
            tags=["map"],
            summary=f"The present map as {name.upper()}",
            description=f"The map as it is now: {made.description}.",
            name=f"present map {name}",
            response_class=Response,
            responses=documented(name),
        )

    for name, made in FORMATS.items():
        add(name, made)


def add_labels(router: APIRouter, cockpit: Cockpit) -> None:
    """Names of places on it."""

    @router.get("/labels", tags=["map"], summary="Labels of the present map")
    async def labels() -> list[Place]:
        """The named places, where the map has them now."""
        return [place_of(label) for label in cockpit.snapshot().labels]

    @router.post(
        "/labels",
        tags=["map"],
        status_code=201,
        summary="Name a place",
        responses={409: refusal("There is no map to put it on", "there is no map yet; drive half a metre first")},
    )
    async def add(place: NewPlace) -> Place:
        """Name a place of the present map. It hangs on the nearest vertex: when the map moves, it moves along."""
        if not cockpit.status().session.running:
            raise HTTPException(409, "the session has ended; put the label on its saved map")
        snapshot = cockpit.snapshot()
        try:
            label = cockpit.labels.add(place.text, place.x, place.y, snapshot.path[: len(snapshot.observations)])
        except NoPlace as error:
            raise HTTPException(409, str(error)) from None
        return place_of(label)

    @router.delete(
        "/labels/{label}",
        tags=["map"],
        status_code=204,
        summary="Remove a label",
        responses={404: refusal("No such label", "there is no label 7")},
    )
    async def remove(label: Annotated[int, Path(description="the label's number", examples=[1])]) -> None:
        """Take a label off the present map."""
        try:
            cockpit.labels.remove(label)
        except KeyError:
            raise HTTPException(404, f"there is no label {label}") from None


def present_survey(cockpit: Cockpit, snapshot: Snapshot | None = None) -> Survey:
    """What the robot has found out so far, or had at a snapshot."""
    motion = MotionParams.model_validate(cockpit.configuration()["crunch"]["filter"]["motion"])
    return survey_of(snapshot or cockpit.snapshot(), motion)


def tag_of(snapshot: Snapshot) -> str:
    """Changes whenever the map does."""
    content = hashlib.sha256(snapshot.path.tobytes() + snapshot.profile.tobytes())
    content.update(repr((snapshot.labels, len(snapshot.observations), snapshot.vertex_times[:1])).encode())
    return content.hexdigest()[:20]
