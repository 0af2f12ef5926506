"""What all routes of REST answer when they cannot do as asked: one shape, documented once.

Knows no robot and no route.
"""

from __future__ import annotations

from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field


class Refusal(BaseModel):
    """Why a request was not obeyed, for a person to read."""

    detail: str = Field(examples=["stopped: press Resume first"])


def refusal(description: str, example: str) -> dict[str, Any]:
    """How a route documents one of its error answers."""
    content = {"application/json": {"example": {"detail": example}}}
    return {"model": Refusal, "description": description, "content": content}


GUARDED: dict[int | str, dict[str, Any]] = {
    401: {"description": "The token is missing or wrong", "content": {"text/plain": {"example": "A token is needed"}}},
    403: {
        "description": "Asked from a page or under a name that is not the server's own",
        "content": {"text/plain": {"example": "This server answers to localhost only."}},
    },
    413: refusal("More than 256 kB were sent", "Content Too Large"),
}  # what may be answered on every route, mostly by `server.guard`


async def answer_nonsense(_: Request, error: Exception) -> JSONResponse:
    """422 with the place and kind of each mistake; what was sent is not repeated, since JSON cannot hold all of it."""
    assert isinstance(error, RequestValidationError)
    mistakes = [{key: mistake[key] for key in ("type", "loc", "msg")} for mistake in error.errors()]
    return JSONResponse({"detail": mistakes}, 422)
