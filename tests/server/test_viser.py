"""viser behind our own address: so many viewers and no more, fenced in like our own page, and cut off for nonsense."""

import contextlib
from collections.abc import Iterator
from concurrent.futures import CancelledError

import pytest
import viser
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from server.api import create_app
from server.dashboard import Dashboard
from server.rest.viser import MAX_VIEWERS
from tests.server.live_session import HandSession

VIEW = "ws://127.0.0.1:8000/viser"
PROTOCOL = [f"viser-v{viser.__version__}"]


@pytest.fixture
def client() -> Iterator[TestClient]:
    """A browser on this machine, and a view that starts when it is asked for."""
    session, dashboard = HandSession(), Dashboard()
    with TestClient(create_app(session.bridge, dashboard=dashboard), base_url="http://127.0.0.1:8000") as client:
        yield client
    dashboard.stop()


def test_its_page_is_fenced_in_like_our_own(client):
    ours, page = client.get("/"), client.get("/viser/")
    assert "<html" in page.text[:2000].lower()
    for name in ("Cache-Control", "X-Content-Type-Options", "Referrer-Policy"):
        assert page.headers[name] == ours.headers[name]
    rules = page.headers["Content-Security-Policy"].split("; ")
    assert {"default-src 'self'", "frame-ancestors 'self'", "base-uri 'none'", "form-action 'none'"} <= set(rules)
    assert "http" not in page.headers["Content-Security-Policy"]


@contextlib.contextmanager
def viewing(client: TestClient) -> Iterator[WebSocketTestSession]:
    """A viewer's socket; the test client cancels what is still being closed when it goes."""
    with contextlib.suppress(CancelledError), client.websocket_connect(VIEW, subprotocols=PROTOCOL) as scene:
        yield scene


def code_of_close(scene: WebSocketTestSession) -> int:
    """Why the server closed, after whatever it still said."""
    try:
        while True:
            scene.receive_bytes()
    except WebSocketDisconnect as closed:
        return closed.code


def test_so_many_viewers_and_no_more(client):
    with contextlib.ExitStack() as stack:
        for _ in range(MAX_VIEWERS):
            assert stack.enter_context(viewing(client)).receive_bytes()
        with viewing(client) as late:
            assert code_of_close(late) == 1013
    with viewing(client) as scene:
        assert scene.receive_bytes(), "who leaves makes room"


def test_text_is_no_word_of_the_view(client):
    with viewing(client) as scene:
        assert scene.receive_bytes()
        scene.send_text("hello")
        assert code_of_close(scene) == 1003
