"""REST documents, the stream's manners, and who is let in."""

import asyncio
import contextlib
import json
from collections.abc import Iterator, MutableMapping
from typing import Any

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from server.api import MAX_BODY, MAX_VIEWERS, create_app
from server.conversation import MAX_NONSENSE
from server.guard import is_loopback
from server.stream import decode
from server.views import Status
from tests.server.live_session import HandSession
from tests.server.test_bridge import drive_for

HERE = "http://127.0.0.1:8000"
STREAM = "ws://127.0.0.1:8000/api/v1/stream"


@pytest.fixture(scope="module")
def driven() -> HandSession:
    """A session that has driven a few metres."""
    session = HandSession()
    drive_for(session, 8.0, 0.3, 0.3)
    return session


@pytest.fixture
def client(driven: HandSession) -> Iterator[TestClient]:
    """A browser on this machine."""
    with TestClient(create_app(driven.bridge), base_url=HERE) as client:
        yield client


def frames_until(socket, topic: str, kind: str | None = None) -> dict:
    """The header of the next frame of a topic; all are acknowledged on the way."""
    for _ in range(40):
        sequence, header, _ = decode(socket.receive_bytes())
        socket.send_text(json.dumps({"type": "ack", "seq": sequence}))
        if header["topic"] == topic and (kind is None or header["kind"] == kind):
            return header
    raise AssertionError(f"no {topic}")


def code_of_close(socket) -> int:
    """Why the server closed, after whatever it still said."""
    try:
        while True:
            socket.receive_bytes()
    except WebSocketDisconnect as closed:
        return closed.code


def test_status_is_what_the_schema_says(client):
    status = Status.model_validate(client.get("/api/v1/status").json())
    assert status.robot.name == "crunch"
    assert status.map.vertices >= 3


def test_map_document_and_picture_are_the_same_map(client, driven):
    document = client.get("/api/v1/map.json").json()
    assert document["format"] == "crunch-map-1"
    assert len(document["path"]) == len(driven.bridge.look().path)
    assert all(len(curve) > 1 for curve in document["walls"])
    picture = client.get("/api/v1/map.png")
    assert picture.headers["content-type"] == "image/png"
    assert picture.content.startswith(b"\x89PNG")


def test_an_unchanged_map_is_not_drawn_or_sent_again(client):
    first = client.get("/api/v1/map.png")
    again = client.get("/api/v1/map.png", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_profile_and_configuration(client, driven):
    profile = client.get("/api/v1/profile").json()
    assert len(profile["profile"]) == len(driven.bridge.look().path)
    assert client.get("/api/v1/config").json()["crunch"]["filter"]["particles"] == 100


def test_nothing_is_fetched_from_elsewhere(client):
    for address in ("/", "/docs", "/style.css", "/main.js"):
        page = client.get(address)
        assert page.status_code == 200
        for scheme in ("http://", "https://", "//cdn", "@import"):
            assert scheme not in page.text.replace("http://www.w3.org", ""), f"{address} refers to {scheme}"
    assert "default-src 'self'" in client.get("/").headers["content-security-policy"]
    assert client.get("/static-offline-docs/swagger-ui-bundle.js").status_code == 200


def test_stream_greets_shows_and_obeys(client, driven):
    driven.bridge.left("anna")
    driven.bridge.hub.newest.clear()
    with client.websocket_connect(STREAM) as socket:
        name = frames_until(socket, "notice", "hello")["viewer"]
        socket.send_text(json.dumps({"type": "ping", "sent": 12.5}))
        assert frames_until(socket, "notice", "pong")["sent"] == 12.5
        seen = driven.bridge.t
        socket.send_text(json.dumps({"type": "ask"}))
        assert frames_until(socket, "status")["driver"]["viewer"] == name
        socket.send_text(json.dumps({"type": "drive", "speed": 0.2, "turn": 0.0, "seen": seen - 5.0}))
        assert "too old" in frames_until(socket, "notice", "refused")["reason"]
        socket.send_text(json.dumps({"type": "stop"}))
        assert frames_until(socket, "status")["driver"]["stopped_by"] == name
        socket.send_text(json.dumps({"type": "resume"}))
        assert frames_until(socket, "status")["driver"]["stopped_by"] is None
    assert driven.bridge.control.driver is None, "who leaves gives the lease back"
    assert not driven.bridge.hub.viewers


def test_what_becomes_of_a_goal_is_told_with_its_number(client, driven):
    driven.bridge.left("anna")
    with client.websocket_connect(STREAM) as socket:
        seen = driven.bridge.t
        for word in (
            {"type": "goal", "id": 6, "x": 1.0, "y": 0.0, "seen": seen - 5.0},
            {"type": "goal", "id": 7, "x": 1.0, "y": 0.0, "seen": seen},
            {"type": "hold", "id": 7, "seen": seen},
            {"type": "cancel"},
            {"type": "hold", "id": 7, "seen": seen},
        ):
            socket.send_text(json.dumps(word))
        refused = frames_until(socket, "notice", "refused")
        assert (refused["word"], refused["id"]) == ("goal", 6)
        ended = frames_until(socket, "notice", "ended")
        assert (ended["word"], ended["id"]) == ("hold", 7)


@pytest.mark.parametrize("words", ["{", "[]", '{"type":"fly"}', "x" * 10_000])
def test_nonsense_is_answered_and_then_cut_off(client, words):
    with client.websocket_connect(STREAM) as socket:
        for _ in range(MAX_NONSENSE + 1):
            socket.send_text(words)
        assert code_of_close(socket) == 1008


def test_bytes_and_floods_are_cut_off(client):
    for flood in (lambda socket: socket.send_bytes(bytes(100)), lambda socket: socket.send_text('{"type":"release"}')):
        with client.websocket_connect(STREAM) as socket:
            for _ in range(500):
                flood(socket)
            assert code_of_close(socket) == 1008


@pytest.mark.parametrize("in_pieces", [False, True])
@pytest.mark.parametrize("address", ["/api/v1/commands", "/api/v1/status", "/"])
def test_a_large_request_is_refused_unread(driven, address, in_pieces):
    """Whether its length is told or only counted: what is parsed on the loop keeps everybody waiting."""
    piece, taken, answered = b"[" * 16384, [], []

    async def receive() -> dict:
        taken.append(len(piece))
        return {"type": "http.request", "body": piece, "more_body": len(taken) < 64}

    async def send(message: MutableMapping[str, Any]) -> None:
        answered.append(message)

    headers = [(b"host", b"127.0.0.1:8000"), (b"content-type", b"application/json")]
    if not in_pieces:
        headers.append((b"content-length", b"56000000"))
    scope = {
        "type": "http", "method": "POST", "path": address, "raw_path": address.encode(), "query_string": b"",
        "headers": headers, "scheme": "http", "server": ("127.0.0.1", 8000), "root_path": "",
    }  # fmt: skip
    asyncio.run(create_app(driven.bridge)(scope, receive, send))
    assert sum(taken) <= (MAX_BODY + len(piece) if in_pieces else 0)
    if not in_pieces or address == "/api/v1/commands":
        assert answered[0]["status"] == 413


def test_too_many_viewers_are_told_to_come_later(client):
    with contextlib.ExitStack() as stack:
        for _ in range(MAX_VIEWERS):
            stack.enter_context(client.websocket_connect(STREAM))
        with client.websocket_connect(STREAM) as late:
            assert code_of_close(late) == 1013


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:9999", "null", "https://evil.example:8000"]
)
@pytest.mark.parametrize("address", [STREAM, "ws://127.0.0.1:8000/viser"])
def test_pages_of_others_get_no_socket(client, origin, address):
    with pytest.raises(WebSocketDisconnect), client.websocket_connect(address, headers={"origin": origin}):
        pass


def test_our_own_page_gets_a_socket(client):
    with client.websocket_connect(STREAM, headers={"origin": HERE, "host": "127.0.0.1:8000"}) as socket:
        assert decode(socket.receive_bytes())[1]["kind"] == "hello"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "", "[", "localhost.:1"]
)
def test_only_loopback_names_are_answered_on_loopback(client, host):
    assert client.get("/api/v1/status", headers={"host": host}).status_code == 403


@pytest.mark.parametrize("host", ["localhost:8000", "127.0.0.1", "[::1]:8000", "LOCALHOST"])
def test_this_machines_own_names_are_answered(client, host):
    assert client.get("/api/v1/status", headers={"host": host}).status_code == 200


def test_token_opens_everything_and_nothing_opens_without(driven):
    app = create_app(driven.bridge, token="correct horse")
    with TestClient(app, base_url="http://robot.local:8000", follow_redirects=False) as client:
        for page in ("/", "/api/v1/status", "/api/v1/map.png", "/docs", "/viser/", "/style.css"):
            assert client.get(page).status_code == 401
            assert client.get(page, headers={"authorization": "Bearer wrong"}).status_code == 401
        address = "ws://robot.local:8000/api/v1/stream"
        with pytest.raises(WebSocketDisconnect), client.websocket_connect(address):
            pass
        assert client.get("/api/v1/status", headers={"authorization": "Bearer correct horse"}).status_code == 200
        answer = client.get("/?token=correct%20horse&x=1")
        assert (answer.status_code, answer.headers["location"]) == (303, "/?x=1")
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        client.cookies.update(answer.cookies)
        assert client.get("/api/v1/status").status_code == 200
        with client.websocket_connect(address, headers={"origin": "http://robot.local:8000"}) as socket:
            assert decode(socket.receive_bytes())[1]["kind"] == "hello"
        with pytest.raises(WebSocketDisconnect), client.websocket_connect(address, headers={"origin": "http://evil"}):
            pass


def test_redirect_after_the_token_stays_here(driven):
    app = create_app(driven.bridge, token="t")
    with TestClient(app, base_url="http://robot.local", follow_redirects=False) as client:
        assert client.get("http://robot.local//evil.example/?token=t").headers["location"].startswith("/evil.example")


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("localhost", True),
        ("127.9.9.9", True),
        ("0.0.0.0", False),
        ("robot", False),
    ],
)
def test_loopback_addresses(host, expected):
    assert is_loopback(host) is expected
