"""REST of the present: status, settings and profile. Uses its siblings `cockpit` and `views`."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from server.cockpit import PREFIX, Cockpit
from server.config import Config
from server.views import Profile, Status


def state_routes(cockpit: Cockpit) -> APIRouter:
    """Status, configuration and the present map."""
    router = APIRouter(prefix=PREFIX)

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
