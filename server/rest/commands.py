"""REST for programs that drive or stop: one command word per request, under the same rules as a page's.

Who may move the robot is decided by `server.control`; a refused word is answered 409 with the reason. Uses its siblings
`answers`, `cockpit` and `views`.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, HTTPException

from server.cockpit import PREFIX, Cockpit
from server.control import Refused
from server.rest.answers import refusal
from server.views import DriverStatus
from server.words import CommandWord

NAME = r"^[A-Za-z0-9 ._-]+$"
EXAMPLES: dict[str, Any] = {
    "stop": {"summary": "Stand still; from anyone, at any time", "value": {"type": "stop"}},
    "drive": {
        "summary": "Drive, if repeated within the lease; `seen` is the newest `t` that you know",
        "value": {"type": "drive", "speed": 0.2, "turn": 0.0, "seen": 61.3},
    },
    "goal": {
        "summary": "Drive to a place, as long as `hold` follows within the lease",
        "value": {"type": "goal", "x": 2.0, "y": 1.5, "speed": 0.3, "seen": 61.3},
    },
    "hold": {"summary": "You still watch the way to the goal", "value": {"type": "hold", "seen": 61.4}},
    "ask": {"summary": "Ask the driver for the lease", "value": {"type": "ask"}},
    "resume": {"summary": "End a stop", "value": {"type": "resume"}},
}


def command_routes(cockpit: Cockpit) -> APIRouter:
    """The one route that changes what the robot does."""
    router = APIRouter(prefix=PREFIX)

    @router.post("/commands", tags=["driving"], responses={409: refusal("Refused", "stopped: press Resume first")})
    async def command(
        word: Annotated[CommandWord, Body(discriminator="type", openapi_examples=EXAMPLES)],
        x_crunch_client: Annotated[
            str, Header(max_length=40, pattern=NAME, description="who speaks, as viewers see it", examples=["laptop"])
        ] = "somebody",
    ) -> DriverStatus:
        """Say one word of the stream's, without a stream; answers who drives after it.

        The lease is the same: who drives repeats itself within 300 ms, and silence stops the robot.
        """
        try:
            cockpit.hear(f"{x_crunch_client} (REST)", word)  # a name that no page can have
        except Refused as refused:
            raise HTTPException(409, str(refused)) from None
        return cockpit.status().driver

    return router
