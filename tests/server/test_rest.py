"""REST for programs: commands under the rules of the lease, health, metrics, and the schema of the settings."""

from collections.abc import Iterator

import pytest
from prometheus_client.parser import text_string_to_metric_families
from starlette.testclient import TestClient

from server.api import create_app
from server.config import Config
from server.rest.health import SILENT, checks_of
from server.views import Status
from tests.server.live_session import HandSession
from tests.server.test_bridge import drive

HERE = "http://127.0.0.1:8000"
COMMANDS = "/api/v1/commands"


@pytest.fixture
def session() -> HandSession:
    """A robot that stands upright and has told of its battery."""
    session = HandSession()
    session.advance(2.5)
    return session


@pytest.fixture
def client(session: HandSession) -> Iterator[TestClient]:
    """A program on this machine."""
    with TestClient(create_app(session.bridge), base_url=HERE) as client:
        yield client


def figures(client: TestClient) -> dict[str, float]:
    """Name to value of everything that Prometheus would collect; labels are left out."""
    families = text_string_to_metric_families(client.get("/api/v1/metrics").text)
    return {sample.name: sample.value for family in families for sample in family.samples}


def test_a_program_drives_by_repeating_itself_and_silence_stops(client, session):
    before = session.bridge.look().distance
    for _ in range(30):
        word = {"type": "drive", "speed": 0.3, "turn": 0.0, "seen": session.bridge.t}
        answer = client.post(COMMANDS, json=word, headers={"X-Crunch-Client": "laptop"})
        assert answer.status_code == 200
        assert answer.json()["viewer"] == "laptop (REST)"
        session.advance(0.1)
    assert session.bridge.look().distance > before + 0.3
    session.advance(4.0)
    at_rest = session.bridge.look().distance
    session.advance(2.0)
    assert session.bridge.look().distance < at_rest + 0.1
    assert not session.bridge.status().driver.leased


def test_a_refused_command_is_409_with_the_reason(client, session):
    assert client.post(COMMANDS, json={"type": "stop"}).json()["stopped_by"] == "somebody (REST)"
    word = {"type": "drive", "speed": 0.3, "turn": 0.0, "seen": session.bridge.t}
    answer = client.post(COMMANDS, json=word, headers={"X-Crunch-Client": "laptop"})
    assert (answer.status_code, answer.json()) == (409, {"detail": "stopped: press Resume first"})
    old = client.post(COMMANDS, json={**word, "seen": session.bridge.t - 5.0}, headers={"X-Crunch-Client": "laptop"})
    assert old.status_code == 409
    assert "too old" in old.json()["detail"]


def test_only_stop_needs_no_name(client, session):
    drive = {"type": "drive", "speed": 0.3, "turn": 0.0, "seen": session.bridge.t}
    for word in (drive, {"type": "ask"}, {"type": "resume"}, {"type": "arm", "armed": True}):
        answer = client.post(COMMANDS, json=word)
        assert (answer.status_code, "X-Crunch-Client" in answer.json()["detail"]) == (400, True)
        assert session.bridge.status().driver.viewer is None
    assert client.post(COMMANDS, json={"type": "stop"}).status_code == 200


def test_a_client_with_a_key_is_no_other_of_its_name(client, session):
    def say(**headers: str) -> tuple[int, str | None]:
        word = {"type": "drive", "speed": 0.1, "turn": 0.0, "seen": session.bridge.t}
        answer = client.post(COMMANDS, json=word, headers={"X-Crunch-Client": "laptop"} | headers)
        return answer.status_code, session.bridge.status().driver.viewer

    key = {"X-Crunch-Key": "3f2b-of-its-own"}
    status, driver = say(**key)
    assert driver is not None
    assert (status, key["X-Crunch-Key"] in driver) == (200, False), "the key is not shown"
    assert say()[0] == say(**{"X-Crunch-Key": "guessed"})[0] == 409
    posing = driver.removesuffix(")").replace("(", "").replace(",", "")
    assert say(**{"X-Crunch-Client": posing})[0] == 409
    assert say(**key) == (200, driver)


def test_no_program_can_speak_for_a_page(client, session):
    drive(session, 0.0)
    page = session.bridge.status().driver.viewer
    client.post(COMMANDS, json={"type": "release"}, headers={"X-Crunch-Client": page})
    assert session.bridge.status().driver.viewer == page


@pytest.mark.parametrize(
    "body",
    [
        "",
        "[]",
        "null",
        '{"type": "fly"}',
        '{"type": "ping", "sent": 1}',
        '{"type": "stop", "now": true}',
        '{"type": "drive", "speed": NaN, "turn": 0, "seen": 1}',
        '{"type": "drive", "speed": 1e999, "turn": 0, "seen": 1}',
        '{"type": "drive", "speed": "fast", "turn": 0, "seen": 1}',
    ],
)
def test_nonsense_is_422_with_its_place(client, body):
    answer = client.post(COMMANDS, content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert all({"type", "loc", "msg"} == set(mistake) for mistake in answer.json()["detail"])


@pytest.mark.parametrize("name", ["", "a" * 41, "<b>", "a/b", "näme".encode()])
def test_a_name_is_short_and_plain(client, session, name):
    answer = client.post(COMMANDS, json={"type": "stop"}, headers={"X-Crunch-Client": name})
    assert answer.status_code == 422
    assert session.bridge.status().driver.stopped_by is None


def test_a_page_of_others_cannot_command(client, session):
    answer = client.post(COMMANDS, json={"type": "stop"}, headers={"Origin": "http://evil.example"})
    assert answer.status_code == 403
    assert session.bridge.status().driver.stopped_by is None


def test_health_is_200_while_all_is_well_and_503_when_the_robot_is_silent(client, session):
    answer = client.get("/api/v1/health")
    assert (answer.status_code, answer.json()["ok"]) == (200, True)
    session.link.time += SILENT + 0.5
    answer = client.get("/api/v1/health")
    assert answer.status_code == 503
    assert [check["name"] for check in answer.json()["checks"] if not check["ok"]] == ["robot"]


def failing(status: Status) -> set[str]:
    """Names of the checks that do not hold."""
    return {check.name for check in checks_of(status) if not check.ok}


def test_each_check_can_fail(session, tmp_path):
    status = session.bridge.status()
    assert failing(status) == set()
    worse = status.model_copy(deep=True)
    worse.link.connected, worse.link.error, worse.link.lost_percent = False, "virtual:room: no such device", 40.0
    worse.link.silence_s = None
    worse.robot.state, worse.filter.state = "fallen", "failed"
    assert failing(worse) == {"link", "robot", "radio", "balance", "filter"}
    worse.recording = str(tmp_path / "gone" / "run.rlog")
    assert "recording" in failing(worse), "the folder has been taken away"
    worse.recording = str(tmp_path / "run.rlog")
    assert {check.name: check.detail for check in checks_of(worse)}["recording"].startswith(str(tmp_path))


def test_metrics_are_the_status(client, session):
    status = session.bridge.status()
    found = figures(client)
    assert found["crunch_battery_volts"] == status.robot.battery_volts
    assert found["crunch_link_frames_total"] == status.link.counters["frames"]
    assert found["crunch_filter_particles"] == status.filter.particles
    assert found["crunch_stopped"] == 0.0
    client.post(COMMANDS, json={"type": "stop"})
    assert figures(client)["crunch_stopped"] == 1.0


def test_metrics_leave_out_what_the_robot_has_not_told():
    with TestClient(create_app(HandSession().bridge), base_url=HERE) as client:
        found = figures(client)
    assert "crunch_battery_volts" not in found
    assert found["crunch_link_connected"] == 1.0


def test_metrics_come_in_either_format(client):
    plain = client.get("/api/v1/metrics")
    assert plain.headers["content-type"].startswith("text/plain; version=0.0.4")
    open_metrics = client.get("/api/v1/metrics", headers={"Accept": "application/openmetrics-text; version=1.0.0"})
    assert open_metrics.headers["content-type"].startswith("application/openmetrics-text")
    assert open_metrics.text.endswith("# EOF\n")


def test_the_settings_schema_describes_the_settings(client):
    schema = client.get("/api/v1/config/schema").json()
    assert set(schema["properties"]) == set(Config.model_fields)
    assert schema["$defs"]["WebParams"]["properties"]["port"]["default"] == 8000
