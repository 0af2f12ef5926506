"""REST of the present: status, settings, profile and best map.

Uses its siblings `cockpit`, `map_files`, `map_picture`, `maps` and `views`.
"""

from __future__ import annotations

import asyncio
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from server.cockpit import PREFIX, Cockpit
from server.config import Config
from server.map_files import map_json
from server.map_picture import draw_png
from server.maps import FloorMap
from server.messages import Snapshot
from server.views import Profile, Status, path_length


def state_routes(cockpit: Cockpit) -> APIRouter:
    """Status, configuration and the present map."""
    router = APIRouter(prefix=PREFIX)
    artist = Artist()

    @router.get("/status", tags=["state"])
    async def status() -> Status:
        """Battery, tilt, link, filter, driver and map at a glance."""
        return cockpit.status()

    @router.get("/config", tags=["state"], responses={200: CONFIG_EXAMPLE})
    async def config() -> dict[str, Any]:
        """The settings that the session runs with, defaults included."""
        return cockpit.configuration()

    @router.get("/config/schema", tags=["state"], responses={200: SCHEMA_EXAMPLE})
    async def config_schema() -> dict[str, Any]:
        """What can be set, with types, limits and defaults, as JSON Schema."""
        return Config.model_json_schema()

    @router.get("/profile", tags=["map"])
    async def profile() -> Profile:
        """How settled the path is at each vertex."""
        snapshot = cockpit.snapshot()
        return Profile(profile=[float(share) for share in snapshot.profile], fixed_depth=snapshot.fixed_depth)

    @router.get("/map.json", tags=["map"], response_class=JSONResponse, responses={200: MAP_JSON_EXAMPLE})
    async def map_document() -> Response:
        """The best path and the walls seen from it, for programs."""
        snapshot = cockpit.snapshot()
        content = await asyncio.to_thread(map_json, floor_of(snapshot), snapshot.robot)
        return Response(content, media_type="application/json", headers={"Cache-Control": "no-cache"})

    @router.get("/map.png", tags=["map"], response_class=Response, responses={200: {"content": {"image/png": {}}}})
    async def map_picture(request: Request) -> Response:
        """The best map, drawn to be looked at; drawn anew when a vertex was added."""
        tag, picture = await artist.picture(cockpit.snapshot())
        headers = {"ETag": tag, "Cache-Control": "no-cache"}
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        return Response(picture, media_type="image/png", headers=headers)

    return router


CONFIG_EXAMPLE: dict[str, Any] = {
    "content": {"application/json": {"example": {"preset": "default", "control": {"lease": 0.3, "max_speed": 0.5}}}}
}
SCHEMA_EXAMPLE: dict[str, Any] = {
    "content": {
        "application/json": {
            "example": {
                "title": "Config",
                "type": "object",
                "properties": {"preset": {"enum": ["default", "thesis"], "default": "default", "type": "string"}},
            }
        }
    }
}
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
