"""Who may talk to the server: a check in front of every route and socket.

On a loopback address only loopback names are answered, so that a web page elsewhere cannot reach the robot through a
name that it points at this machine. On any other address a token is needed: in the address once, then as a cookie, or
as a bearer token. A WebSocket must come from a page of ours, where the browser says from where it comes. `shield` keeps
pages of ours from others.
"""

from __future__ import annotations

import ipaddress
import secrets
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

COOKIE = "crunch_token"
LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


def is_loopback(host: str) -> bool:
    """Whether a server bound to `host` is reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def shield(response: Response, policy: str) -> None:
    """Headers of a page of ours: asked for anew each time, with nothing loaded that `policy` does not name."""
    response.headers["Cache-Control"] = "no-cache"
    response.headers["Content-Security-Policy"] = policy
    response.headers["X-Content-Type-Options"] = "nosniff"
    response.headers["Referrer-Policy"] = "no-referrer"


class Guard:
    """ASGI middleware; `token` is None on loopback addresses."""

    def __init__(self, app: ASGIApp, token: str | None):
        self.app = app
        self.token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is allowed; refuse the rest before the application sees it."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refusal = self.refusal(scope)
        if refusal is None:
            await self.app(scope, receive, send)
        elif scope["type"] == "http":
            await refusal(scope, receive, send)
        else:
            await receive()  # the connect event
            await send({"type": "websocket.close", "code": 1008})  # before accepting: an HTTP 403

    def refusal(self, scope: Scope) -> Response | None:
        """What to answer instead of the application, or None."""
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if self.token is None and hostname(host) not in LOOPBACK_NAMES:
            return PlainTextResponse("This server answers to localhost only.", 403)
        if not is_same_origin(headers, host) and (scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS):
            return PlainTextResponse("This page may not talk to the robot.", 403)
        return self.token_refusal(scope, headers, self.token) if self.token is not None else None

    def token_refusal(self, scope: Scope, headers: Headers, token: str) -> Response | None:
        """None with a good token; a token in a page's address becomes a cookie."""
        if any(secrets.compare_digest(offered.encode(), token.encode()) for offered in offered_tokens(headers)):
            return None
        query = parse_qs(scope["query_string"].decode("latin-1"))
        if secrets.compare_digest(query.pop("token", [""])[0].encode(), token.encode()):
            if scope["type"] == "websocket" or scope["method"] != "GET":
                return None
            address = scope["path"] + ("?" + urlencode(query, doseq=True) if query else "")
            response = RedirectResponse("/" + address.lstrip("/"), 303, {"Cache-Control": "no-store"})
            response.set_cookie(COOKIE, token, httponly=True, samesite="strict")
            return response
        return PlainTextResponse(
            "A token is needed: open the address with ?token=... that the server printed when it started.", 401
        )


SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})


def hostname(host: str) -> str:
    """The name in a Host header, without port and brackets; empty for nonsense."""
    try:
        return urlsplit("//" + host).hostname or ""
    except ValueError:
        return ""


def is_same_origin(headers: Headers, host: str) -> bool:
    """Whether a browser's Origin is this server's own; programs that are no browsers send none."""
    origin = headers.get("origin")
    return origin is None or origin.split("://", 1)[-1].lower() == host.lower()


def offered_tokens(headers: Headers) -> list[str]:
    """Tokens in the cookie and in the Authorization header."""
    offered = []
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    if cookie is not None:
        offered.append(cookie.value)
    scheme, _, bearer = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        offered.append(bearer.strip())
    return offered
