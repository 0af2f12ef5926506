"""The command as a person starts it: where it cannot run it says why in one line, and it leaves in order."""

import json
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.client import connect

from firmware.virtual import load_plan, load_world
from server.config import Config
from server.control import ControlParams
from server.demo import run_demo
from server.errors import UserError
from server.live import LiveOptions, listening, page_address
from server.messages import Ranges, Wheels
from server.recorded import open_log
from server.recording import Kind, Reader
from server.sessions import free_name
from server.stream import decode
from tests.firmware.avr_tools import need_simavr
from tests.served import PATIENCE, demo, wait_until


def test_a_taken_port_is_told_in_one_line_with_the_remedy():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=rf"port {port} .*--port 0"), listening("127.0.0.1", port):
            pass
        command = [sys.executable, "-m", "server", "demo", "--no-browser", "--port", str(port)]
        run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert run.returncode == 2
    assert run.stdout == ""
    assert len(run.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("host", ["no.such.host.invalid", "203.0.113.7"])
def test_a_host_that_is_not_ours_is_told_with_the_remedy(host):
    with pytest.raises(UserError, match=r"127\.0\.0\.1|--port"), listening(host, 0):
        pass


def test_address_carries_the_token_and_brackets():
    assert page_address("127.0.0.1", 8000, None) == "http://127.0.0.1:8000/"
    assert page_address("::1", 80, None) == "http://[::1]:80/"
    assert page_address("0.0.0.0", 8000, "abc").endswith(":8000/?token=abc")


def test_recordings_never_overwrite_one_another(tmp_path):
    names = []
    for _ in range(3):
        path = free_name(tmp_path)
        path.touch(exist_ok=False)
        names.append(path)
    assert len(set(names)) == 3


@pytest.mark.parametrize(
    ("world", "plan", "place", "route"),
    [
        (None, None, "demo", "demo"),
        ("corridor50", None, "corridor50", "corridor50"),
        (None, "corridor50", "corridor50", "corridor50"),
    ],
)
def test_world_and_plan_of_a_demo_follow_from_one_another(monkeypatch, world, plan, place, route):
    robots = []
    monkeypatch.setattr("server.live.run", lambda *given: robots.append(given[3]) or 0)
    assert run_demo(LiveOptions(Config()), world=world, plan=plan) == 0
    (robot,) = robots
    np.testing.assert_array_equal(robot.world.segments, load_world(place).segments)
    np.testing.assert_array_equal(robot.driver.plan.points, load_plan(route).points)


def test_a_world_without_room_for_a_tour_has_no_autopilot(monkeypatch, tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_text(
        "start = [0.0, 0.0, 0.0]\nwalls = [[[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2]]]\n"
    )
    served = []
    monkeypatch.setattr("server.live.run", lambda *given: served.append(given) or 0)
    assert run_demo(LiveOptions(Config()), world=str(cell)) == 0
    assert served[0][3:] == (None, False, True), "a virtual robot with no driver of its own"
    with pytest.raises(UserError, match=r"--autopilot needs a plan .*--plan"):
        run_demo(LiveOptions(Config()), autopilot=True, world=str(cell))


def test_people_have_the_same_time_in_a_fast_session():
    fast = ControlParams().at_speed(5.0)
    assert (fast.lease, fast.stale, fast.max_speed) == (1.5, 7.5, 0.5)
    assert fast.refresh == ControlParams().refresh, "the radio and the board's own rule are in the robot's time"


def test_demo_serves_records_and_leaves_in_order(tmp_path):
    with demo(tmp_path) as served:
        status = wait_until(lambda: (now := served.status())["robot"]["battery_volts"] and now)
        assert status["link"]["connected"]
        assert status["driver"]["autopilot"] is False
        recording = served.recording()
        address = served.address.replace("http", "ws", 1) + "api/v1/stream"
        with connect(address, open_timeout=PATIENCE) as viewer:
            drive_a_little(viewer, decode(viewer.recv(decode=False))[1])
        view = served.address.replace("http", "ws", 1) + "viser"
        with connect(view, open_timeout=PATIENCE, subprotocols=viser_protocol(served.address)) as scene:
            assert len(scene.recv(decode=False)) > 0, "the 3-D view speaks through our own address"
    reader = Reader(recording)
    records = list(reader)
    assert reader.truncated_at is None
    assert reader.header.configuration["crunch"]["filter"]["particles"] == 300
    assert {record.kind for record in records} == {Kind.RX, Kind.TX, Kind.MARK}
    marks = [json.loads(record.data) for record in records if record.kind == Kind.MARK]
    assert {"drive", "stop"} <= {mark.get("command") for mark in marks}
    assert marks[-1]["command"] == "stop", "the last word to the robot"


def test_demo_drives_the_real_boards_and_is_told_where_they_go(tmp_path):
    need_simavr()
    with demo(tmp_path, "--avr") as served:
        wait_until(lambda: served.status()["robot"]["battery_volts"])
        with connect(served.address.replace("http", "ws", 1) + "api/v1/stream", open_timeout=PATIENCE) as viewer:
            way = driven_distance(viewer, 0.3)
        recording = served.recording()
    assert way >= 0.3
    log = open_log(recording)
    readings = [message for message in log.messages() if isinstance(message, (Wheels, Ranges))]
    assert {type(message) for message in readings} == {Wheels, Ranges}


def driven_distance(viewer, wanted: float) -> float:
    """Forward until odometry has gone so many metres; how many it has."""
    first, way = None, 0.0
    while way < wanted:
        sequence, header, _ = decode(viewer.recv(decode=False))
        viewer.send(json.dumps({"type": "ack", "seq": sequence}))
        if header.get("topic") == "pose":
            viewer.send(json.dumps({"type": "drive", "speed": 0.3, "turn": 0.0, "seen": header["t"] - header["age"]}))
            first = first or header["odometry"]
            way = float(np.hypot(header["odometry"][0] - first[0], header["odometry"][1] - first[1]))
    return way


def drive_a_little(viewer, hello: dict) -> None:
    """A driver's words, each in front of the picture just received, until the server has obeyed one."""
    assert hello["kind"] == "hello"
    is_driving = False
    while not is_driving:
        sequence, header, _ = decode(viewer.recv(decode=False))
        viewer.send(json.dumps({"type": "ack", "seq": sequence}))
        if header["topic"] == "pose":
            viewer.send(json.dumps({"type": "drive", "speed": 0.1, "turn": 0.0, "seen": header["t"] - header["age"]}))
        is_driving = header["topic"] == "status" and header["driver"]["viewer"] == hello["viewer"]


def viser_protocol(address: str) -> list:
    """The subprotocol of the wheel that serves the page; asking for the page starts the view."""
    import viser

    with urllib.request.urlopen(address + "viser/", timeout=PATIENCE) as page:
        assert b"<html" in page.read()[:2000].lower()
    return [f"viser-v{viser.__version__}"]


def test_the_web_folder_is_found():
    from server.api import WEB

    assert (WEB / "index.html").is_file()
    assert Path(WEB).name == "web"
