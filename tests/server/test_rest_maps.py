"""REST of maps: the present one is saved, and every format of every map can be read back by other programs' rules."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from server.api import create_app
from server.formats.g2o import read_g2o
from server.formats.ros_map import OCCUPIED, read_ros_map
from server.formats.tum import read_tum
from server.map_exports import FORMATS, stem_of
from server.map_store import MapStore
from server.rest.maps import map_routes
from tests.server.live_session import HandSession
from tests.server.surveys import room_survey
from tests.server.test_bridge import drive_for

HERE = "http://127.0.0.1:8000"
MAPS, LABELS = "/api/v1/maps", "/api/v1/labels"


@pytest.fixture(scope="module")
def driven() -> HandSession:
    """A session that has driven a few metres."""
    session = HandSession()
    drive_for(session, 8.0, 0.3, 0.3)
    return session


@pytest.fixture(scope="module")
def used(driven: HandSession, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[TestClient, MapStore]]:
    """One server for all, since the process that draws takes a while to start."""
    store = MapStore(tmp_path_factory.mktemp("store") / "crunch.db")
    app = create_app(driven.bridge, further=[map_routes(driven.bridge, store)])
    with TestClient(app, base_url=HERE) as client:
        yield client, store


@pytest.fixture
def client(used: tuple[TestClient, MapStore]) -> TestClient:
    """The server, with all maps put away."""
    client, store = used
    for kept in store.maps():
        store.delete(kept.id)
    return client


@pytest.fixture
def store(used: tuple[TestClient, MapStore], client: TestClient) -> MapStore:
    """Its maps."""
    assert client is used[0]
    return used[1]


def test_the_present_map_is_saved_with_its_labels(client, driven, store):
    x, y = driven.bridge.look().path[1, :2]
    put = client.post(LABELS, json={"text": "Here", "x": x, "y": y})
    assert put.status_code == 201
    answer = client.post(MAPS, json={"name": "Room", "note": "by hand"})
    assert answer.status_code == 201
    kept = answer.json()
    assert (kept["name"], kept["note"], kept["robot"]) == ("Room", "by hand", "crunch")
    np.testing.assert_array_equal(store.survey(kept["id"]).path, driven.bridge.look().path)
    np.testing.assert_array_equal(store.survey(kept["id"]).odometry, driven.bridge.look().vertex_odometry)
    assert [(label["text"], label["x"], label["y"]) for label in kept["labels"]] == [
        ("Here", pytest.approx(x, abs=1e-3), pytest.approx(y, abs=1e-3))
    ]
    assert client.get(MAPS).json() == [kept]
    assert client.get(f"{MAPS}/{kept['id']}").json() == kept
    assert client.delete(f"{LABELS}/{put.json()['id']}").status_code == 204
    assert client.get(LABELS).json() == []


def test_without_a_name_it_has_the_sessions_or_the_robots(client):
    assert client.post(MAPS, json={}).json()["name"].startswith("Crunch, 20")


def test_before_the_first_vertex_there_is_nothing_to_save_or_label(tmp_path):
    bridge = HandSession().bridge
    further = [map_routes(bridge, MapStore(tmp_path / "crunch.db"))]
    with TestClient(create_app(bridge, further=further), base_url=HERE) as client:
        for address, body in ((MAPS, {}), (LABELS, {"text": "a", "x": 0.0, "y": 0.0})):
            answer = client.post(address, json=body)
            assert answer.status_code == 409
            assert "no map yet" in answer.json()["detail"]
        for name in FORMATS:
            assert client.get(f"/api/v1/map.{name}").status_code == 200, name


@pytest.fixture(params=["present", "saved"])
def address(request: pytest.FixtureRequest, client: TestClient) -> str:
    """Where the formats of a map are."""
    return "/api/v1/map" if request.param == "present" else f"{MAPS}/{client.post(MAPS, json={}).json()['id']}/map"


def test_every_format_says_the_same_of_the_same_map(client, driven, address, tmp_path):
    path = driven.bridge.look().path
    documents = {name: client.get(f"{address}.{name}") for name in FORMATS}
    for name, answer in documents.items():
        assert answer.status_code == 200, name
        assert answer.headers["content-type"].startswith(FORMATS[name].media_type.partition(";")[0])
        stem = answer.headers["content-disposition"].partition('filename="')[2].rpartition(".")[0]
        assert stem.startswith("map" if address == "/api/v1/map" else "crunch-20")
        (tmp_path / f"{stem}.{name}").write_bytes(answer.content)
    (stem,) = {file.stem for file in tmp_path.iterdir()}
    assert Image.open(io.BytesIO(documents["png"].content)).size[0] > 400
    assert OCCUPIED in read_ros_map(tmp_path / f"{stem}.yaml").cells
    np.testing.assert_allclose(read_tum(tmp_path / f"{stem}.tum")[1], path, atol=1e-4)
    np.testing.assert_allclose(read_tum(tmp_path / f"{stem}.tum")[0], driven.bridge.look().vertex_times, atol=1e-5)
    graph = read_g2o(tmp_path / f"{stem}.g2o")
    np.testing.assert_allclose(graph.vertices, path, atol=1e-4)
    assert len(graph.pairs) == len(path) - 1
    document = json.loads(documents["json"].content)
    np.testing.assert_allclose(document["path"], path, atol=1e-3)
    assert len(document["spread"]) == len(path)
    assert all(len(curve) > 1 for curve in document["walls"])
    assert len(documents["csv"].text.splitlines()) == len(path) + 1
    with zipfile.ZipFile(io.BytesIO(documents["zip"].content)) as archive:
        assert archive.testzip() is None
        archive.extractall(tmp_path / "all")
    assert {file.name for file in (tmp_path / "all").iterdir()} == {
        "map.png", "map.pgm", "map.yaml", "map.json", "path.g2o", "path.tum", "profile.csv"
    }  # fmt: skip
    np.testing.assert_array_equal(
        read_ros_map(tmp_path / "all" / "map.yaml").cells, read_ros_map(tmp_path / f"{stem}.yaml").cells
    )


def test_what_has_not_changed_is_not_sent_again_and_what_has_is(client, address):
    tags = {name: {"If-None-Match": client.get(f"{address}.{name}").headers["etag"]} for name in FORMATS}
    for name, tag in tags.items():
        again = client.get(f"{address}.{name}", headers=tag)
        assert (again.status_code, again.content) == (304, b""), name
    if address.startswith(MAPS):
        assert client.patch(address.removesuffix("/map"), json={"frame": {"theta": 0.5}}).status_code == 200
        for name, tag in tags.items():
            assert client.get(f"{address}.{name}", headers=tag).status_code == 200, name


def test_a_frame_goes_into_every_file(client, store):
    number = store.save(room_survey((2.0, 1.0), world=(3.0, 1.0, 0.3)), "Room").id
    assert client.post(f"{MAPS}/{number}/straighten").json()["skew_rad"] == pytest.approx(0.0, abs=0.005)
    kept = client.get(f"{MAPS}/{number}").json()
    assert (kept["width_m"], kept["height_m"]) == pytest.approx((4.0, 2.0), abs=0.1)
    document = client.get(f"{MAPS}/{number}/map.json").json()
    points = np.concatenate([np.array(curve) for curve in document["walls"]])
    assert np.ptp(points, axis=0) == pytest.approx((4.0, 2.0), abs=0.1)
    x, y = document["path"][1][:2]
    moved = {**kept["frame"]}
    cos, sin = np.cos(moved["theta"]), np.sin(moved["theta"])
    moved["x"], moved["y"] = moved["x"] + cos * x - sin * y, moved["y"] + sin * x + cos * y
    assert client.patch(f"{MAPS}/{number}", json={"frame": moved}).status_code == 200
    assert client.get(f"{MAPS}/{number}/map.json").json()["path"][1][:2] == pytest.approx([0.0, 0.0], abs=2e-3)
    assert client.patch(f"{MAPS}/{number}", json={"frame": {}}).json()["frame"] == {"x": 0.0, "y": 0.0, "theta": 0.0}


def test_labels_are_set_and_go_into_picture_and_document(client, store):
    number = store.save(room_survey(), "Room").id
    before = client.get(f"{MAPS}/{number}/map.png").content
    place = {"text": "5 $ & <b>", "x": 1.0, "y": 0.5}
    assert client.patch(f"{MAPS}/{number}", json={"labels": [place]}).json()["labels"] == [{**place, "id": 1}]
    assert client.get(f"{MAPS}/{number}/map.json").json()["labels"] == [place]
    assert client.get(f"{MAPS}/{number}/map.png").content != before


def test_two_drives_through_one_building_are_laid_over_each_other(client, store):
    first = store.save(room_survey((2.0, 1.0)), "Monday").id
    second = store.save(room_survey((2.0, 1.0), world=(5.0, -3.0, 1.2)), "Tuesday").id
    found = client.get(f"{MAPS}/{first}/compare/{second}").json()
    assert min(found["first_share"], found["second_share"]) > 0.99
    assert found["median_distance_m"] < 0.02
    apart = client.get(f"{MAPS}/{first}/compare/{second}", params={"align": False}).json()
    assert apart["first_share"] == 0.0
    assert (apart["x"], apart["theta"]) == (0.0, 0.0)
    picture = client.get(f"{MAPS}/{first}/compare/{second}.png")
    assert picture.headers["content-type"] == "image/png"
    assert Image.open(io.BytesIO(picture.content)).size[0] > 400


def test_a_deletion_is_taken_back(client, store):
    number = store.save(room_survey(), "Room").id
    assert client.delete(f"{MAPS}/{number}").json()["is_deleted"] is True
    assert client.get(MAPS).json() == []
    assert client.get(MAPS, params={"deleted": True}).json()[0]["id"] == number
    assert client.post(f"{MAPS}/{number}/restore").json()["is_deleted"] is False
    assert [kept["id"] for kept in client.get(MAPS).json()] == [number]


def test_what_is_not_there_or_not_so_is_refused(client, store):
    number = store.save(room_survey(), "Room").id
    for method, address in (
        ("GET", "999"), ("PATCH", "999"), ("DELETE", "999"), ("POST", "999/restore"), ("POST", "999/straighten"),
        ("GET", "999/map.png"), ("GET", "999/thumbnail.png"), ("GET", f"{number}/compare/999"),
        ("GET", f"{number}/compare/999.png"),
    ):  # fmt: skip
        answer = client.request(method, f"{MAPS}/{address}", json={} if method == "PATCH" else None)
        assert answer.status_code == 404, address
        assert "999" in answer.json()["detail"]
    assert client.delete(f"{LABELS}/999").status_code == 404
    stale = client.patch(f"{MAPS}/{number}", json={"name": "x", "revision": 7})
    assert stale.status_code == 409
    for body in ({"name": ""}, {"nme": "x"}, {"frame": {"x": 1e9}}, {"labels": [{"text": "a\nb", "x": 0, "y": 0}]}):
        assert client.patch(f"{MAPS}/{number}", json=body).status_code == 422, body


def test_a_store_that_cannot_be_used_is_told(driven, tmp_path):
    (tmp_path / "crunch.db").write_bytes(b"no database at all" * 100)
    app = create_app(driven.bridge, further=[map_routes(driven.bridge, MapStore(tmp_path / "crunch.db"))])
    with TestClient(app, base_url=HERE) as client:
        answer = client.get(MAPS)
        assert answer.status_code == 503
        assert "crunch.db" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("Ground floor, east", "ground-floor-east"),
        ("../../etc", "etc"),
        ("Küche", "k-che"),
        ('"\r\n', "map"),
        ("床", "map"),
    ],
)
def test_names_of_files_are_plain(name, stem):
    assert stem_of(name) == stem
