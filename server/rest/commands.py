"""REST for programs that drive or stop: one command word per request, under the same rules as a page's.

Who may move the robot is decided by `server.control`; a refused word is answered 409 with the reason. Uses its siblings
`answers`, `cockpit` and `views`.
"""

from __future__ import annotations

import hmac
import secrets
from typing import Annotated, Any

from fastapi import APIRouter, Body, Header, HTTPException

from server.cockpit import PREFIX, Cockpit
from server.control import Refused
from server.rest.answers import refusal
from server.views import DriverStatus
from server.words import CommandWord

NAMELESS = "say who you are in the header X-Crunch-Client; only stop is anybody's"
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
    secret = secrets.token_bytes(16)

    @router.post(
        "/commands",
        tags=["driving"],
        responses={
            400: refusal("Nobody said it", NAMELESS),
            409: refusal("Refused", "stopped: press Resume first"),
        },
    )
    async def command(
        word: Annotated[CommandWord, Body(discriminator="type", openapi_examples=EXAMPLES)],
        x_crunch_client: Annotated[
            str | None,
            Header(max_length=40, pattern=NAME, description="who speaks, as viewers see it", examples=["laptop"]),
        ] = None,
        x_crunch_key: Annotated[
            str | None,
            Header(
                max_length=200,
                description="a secret of the client's own: nobody without it can speak for it",
                examples=["2f6b1c9e0d"],
            ),
        ] = None,
    ) -> DriverStatus:
        """Say one word of the stream's, without a stream; answers who drives after it.

        The lease is the same: who drives repeats itself within 300 ms, and silence stops the robot. Every word but
        `stop` needs `X-Crunch-Client`; with a key besides, whoever gives the same name without it is somebody else.
        """
        if x_crunch_client is None and word.type != "stop":
            raise HTTPException(400, NAMELESS)
        try:
            cockpit.hear(speaker(x_crunch_client or "somebody", x_crunch_key, secret), word)
        except Refused as refused:
            raise HTTPException(409, str(refused)) from None
        return cockpit.status().driver

    return router


def speaker(client: str, key: str | None, secret: bytes) -> str:
    """A name that no page can have, nor a client with another key; what is shown of the key does not betray it."""
    if key is None:
        return f"{client} (REST)"
    return f"{client} (REST, {hmac.new(secret, key.encode(), 'sha256').hexdigest()[:8]})"
