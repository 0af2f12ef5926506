"""REST of recordings: listed, named, fetched, mapped, deleted and taken back; and the socket that plays one."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from server.api import create_app
from server.map_store import MapStore
from server.render_queue import RenderQueue
from server.rest.recordings import UNREADABLE, recording_routes
from server.shelf import Shelf
from server.stream import decode
from tests.server.live_session import HandSession
from tests.server.rendered import annotated, drive

HERE = "http://127.0.0.1:8000"
RECORDINGS = "/api/v1/recordings"
SOCKETS = f"{HERE.replace('http', 'ws')}{RECORDINGS}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive with a name, one that runs, and a diary."""
    folder = tmp_path_factory.mktemp("recordings")
    plain = drive(folder / "plain.rlog", 12.0)
    annotated(plain, folder / "drive.rlog", [(1.0, {"name": "Third floor"})])
    plain.rename(folder / "running.rlog")
    (folder / "diary.rlog").write_text("today it rained")
    return folder


@pytest.fixture
def client(folder: Path) -> Iterator[TestClient]:
    """A program on this machine."""
    queue, maps = RenderQueue(folder, grace=0.0), MapStore(folder / "crunch.db")
    shelf = Shelf(folder, lambda: "running")
    app = create_app(HandSession().bridge, further=[recording_routes(shelf, queue, maps)])
    with TestClient(app, base_url=HERE) as client:
        yield client
    queue.close()
    maps.close()
    shelf.close()


def test_recordings_are_listed_with_their_state(client):
    found = {one["id"]: one for one in client.get(RECORDINGS).json()}
    assert set(found) == {"drive", "running", "diary"}
    assert (found["drive"]["name"], found["drive"]["running"]) == ("Third floor", False)
    assert found["drive"]["duration_s"] == pytest.approx(12.0, abs=0.1)
    assert found["running"]["running"]
    assert "give a file that crunch has recorded" in found["diary"]["error"]


def test_a_recording_is_fetched_as_it_is(client, folder):
    answer = client.get(f"{RECORDINGS}/drive/file")
    assert answer.content == (folder / "drive.rlog").read_bytes()
    assert 'filename="drive.rlog"' in answer.headers["content-disposition"]


def test_a_recording_is_named_deleted_and_restored(client):
    assert client.patch(f"{RECORDINGS}/drive", json={"name": " Cellar "}).json()["name"] == "Cellar"
    assert client.delete(f"{RECORDINGS}/drive").status_code == 204
    assert client.get(f"{RECORDINGS}/drive").status_code == 404
    assert client.post(f"{RECORDINGS}/drive/restore").json()["name"] == "Cellar"
    assert client.patch(f"{RECORDINGS}/drive", json={"name": ""}).json()["name"] == "Third floor"


@pytest.mark.parametrize("name", ["none", "..", "%2e%2e", ".trash", "..%2fdrive"])
@pytest.mark.parametrize(("method", "below"), [("GET", ""), ("GET", "/file"), ("DELETE", ""), ("POST", "/restore")])
def test_a_name_that_nothing_has_is_404(client, folder, name, method, below):
    before = sorted(folder.rglob("*.rlog"))
    assert client.request(method, f"{RECORDINGS}/{name}{below}").status_code in (404, 405)
    assert sorted(folder.rglob("*.rlog")) == before


def test_the_running_recording_is_not_deleted(client):
    answer = client.delete(f"{RECORDINGS}/running")
    assert answer.status_code == 409
    assert "end the session first" in answer.json()["detail"]


def test_a_recordings_map_is_kept(client):
    kept = client.post(f"{RECORDINGS}/drive/maps", json={}).json()
    assert (kept["name"], kept["recording"]) == ("Third floor", "drive")
    assert kept["vertices"] >= 3
    assert client.post(f"{RECORDINGS}/drive/maps", json={"name": "Again"}).json()["name"] == "Again"
    refused = client.post(f"{RECORDINGS}/diary/maps", json={})
    assert refused.status_code == 409
    assert "not the beginning" in refused.json()["detail"]
    assert client.post(f"{RECORDINGS}/none/maps", json={}).status_code == 404


def test_the_socket_plays_and_understands_nothing_that_drives(client):
    topics: set[str] = set()
    refused = None
    with client.websocket_connect(f"{SOCKETS}/drive/stream") as socket:
        socket.send_text('{"type": "drive", "speed": 0.3, "turn": 0.0, "seen": 0.0}')
        socket.send_text('{"type": "speed", "factor": 20.0}')
        while not (refused and {"pose", "path", "status", "local", "replay"} <= topics):
            sequence, header, _ = decode(socket.receive_bytes())
            socket.send_text(json.dumps({"type": "ack", "seq": sequence}))
            topics.add(header["topic"])
            refused = refused or (header.get("kind") == "refused" and header["reason"])
    assert refused == "not understood"


@pytest.mark.parametrize(("name", "told"), [("none", "there is no recording none"), ("diary", "not the beginning")])
def test_the_socket_tells_why_there_is_nothing_to_play(client, name, told):
    with client.websocket_connect(f"{SOCKETS}/{name}/stream") as socket, pytest.raises(WebSocketDisconnect) as end:
        socket.receive_bytes()
    assert end.value.code == UNREADABLE
    assert told in end.value.reason


def test_a_name_of_many_bytes_is_refused_in_a_reason_that_fits(client):
    with (
        client.websocket_connect(f"{SOCKETS}/{'ü' * 100}/stream") as socket,
        pytest.raises(WebSocketDisconnect) as closed,
    ):
        socket.receive_bytes()
    assert closed.value.code == UNREADABLE
    assert closed.value.reason.startswith("there is no recording üüü")
    assert 121 <= len(closed.value.reason.encode()) <= 123, "what a closing frame holds"
