"""What goes wrong in a real session from outside: killed and hung workers, a killed server, hostile clients."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from server.recording import Reader
from server.stream import decode
from tests.served import PATIENCE, Served, demo, wait_until

DRIVING = ("--autopilot", "--speed", "6")


def vertices(served: Served) -> int:
    return served.status()["map"]["vertices"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_filter_is_replaced_while_the_session_goes_on_and_no_vertex_is_lost(tmp_path, number):
    settings = ("--set", "estimator.patience=5.0", "--set", "estimator.bound=1000")  # however many wait, none is shed
    with demo(tmp_path, *DRIVING, *settings) as served:
        before = wait_until(lambda: (count := vertices(served)) >= 6 and count)
        first = served.status()["filter"]["process_id"]
        os.kill(first, number)
        status = wait_until(lambda: (now := served.status())["filter"]["restarts"] == 1 and now)
        assert status["map"]["vertices"] >= before, "the map never shrinks"
        assert status["link"]["connected"]
        wait_until(lambda: vertices(served) >= before + 4)
        status = served.status()
        assert status["filter"]["process_id"] not in (None, first)
        assert status["filter"]["particles"] == status["filter"]["wanted_particles"] == 300
        recording = served.recording()
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)
    grown = [json.loads(record.data) for record in Reader(recording) if record.data.startswith(b'{"estimate"')]
    sizes = [mark["estimate"] for mark in grown]
    assert sizes == sorted(sizes)


def test_killed_session_replays_up_to_the_last_second(tmp_path):
    with demo(tmp_path, *DRIVING) as served:
        wait_until(lambda: vertices(served) >= 5)
        status = served.status()
        recording, worker = served.recording(), status["filter"]["process_id"]
        served.process.kill()
        served.process.wait(30)
        wait_until(lambda: not is_alive(worker))
    last = [record.t for record in Reader(recording)][-1]
    assert last > status["t"] - 1.0
    out = tmp_path / "map"
    command = [sys.executable, "-m", "server", "replay", str(recording), "--out", str(out), "--particles", "100"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    run = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert run.returncode == 0, run.stderr
    times = np.loadtxt(out / "trajectory.tum")[:, 0]
    assert times[-1] > status["t"] - 1.0
    assert json.loads((out / "report.json").read_text())["vertices"] >= status["map"]["vertices"]


def is_alive(process_id: int) -> bool:
    """Whether a process runs, rather than waiting for a parent that does not care."""
    try:
        os.kill(process_id, 0)
        return Path(f"/proc/{process_id}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except ProcessLookupError:
        return False
    except FileNotFoundError:  # no /proc: the signal has told it
        return not Path("/proc").exists()


def test_hostile_clients_are_survived(tmp_path):
    with demo(tmp_path) as served:
        stream = served.address.replace("http", "ws", 1) + "api/v1/stream"
        for origin in ("http://evil.example", "null"):
            with pytest.raises(InvalidStatus) as refused:
                connect(stream, origin=origin)  # type: ignore[arg-type]
            assert refused.value.response.status_code == 403
        attackers = [threading.Thread(target=attack, args=(stream,)) for attack in (babble, flood, sulk)]
        for attacker in attackers:
            attacker.start()
        knock(served.address)
        watch(stream, attackers)
        status = served.status()
        assert status["driver"]["viewer"] is None, "nonsense drives nothing"
        assert status["robot"]["distance_m"] < 0.3
        wait_until(lambda: served.status()["driver"]["viewers"] == 0)


def watch(stream: str, attackers: list[threading.Thread]) -> None:
    """An honest viewer goes on seeing fresh frames while others misbehave."""
    with connect(stream, open_timeout=PATIENCE) as viewer:
        seen, poses = -1.0, 0
        while poses < 20 or any(attacker.is_alive() for attacker in attackers):
            sequence, header, _ = decode(viewer.recv(timeout=PATIENCE, decode=False))
            viewer.send(json.dumps({"type": "ack", "seq": sequence}))
            if header["topic"] == "pose":
                assert header["t"] > seen
                seen, poses = header["t"], poses + 1
            for attacker in attackers:
                attacker.join(0.0)


def until_cut(stream: str, word) -> None:
    """Say the same until the server has had enough."""
    with connect(stream, open_timeout=PATIENCE) as client:
        try:
            for _ in range(5000):
                client.send(word)
            while True:
                client.recv(timeout=5)
        except (ConnectionClosed, TimeoutError):
            return


def babble(stream: str) -> None:
    rng = np.random.default_rng(0)
    until_cut(stream, rng.bytes(1000))
    until_cut(stream, "{" * 3000)
    until_cut(stream, bytes(200_000))  # more than a frame may hold


def flood(stream: str) -> None:
    until_cut(stream, '{"type":"ping","sent":1}')


def sulk(stream: str) -> None:
    """Takes nothing and acknowledges nothing."""
    with connect(stream, open_timeout=PATIENCE, max_queue=1, close_timeout=1):
        time.sleep(3.0)


def knock(address: str) -> None:
    """Bytes on the port that are no HTTP, and one that says nothing."""
    host, port = urlsplit(address).hostname or "", urlsplit(address).port or 0
    rng = np.random.default_rng(1)
    for content in (rng.bytes(5000), b"GET / HTTP/1.1\r\nHost: " + b"x" * 100_000, b"\r\n\r\n", b""):
        with socket.create_connection((host, port), 5) as line:
            line.settimeout(0.3)
            with contextlib.suppress(OSError):
                line.sendall(content)
                line.recv(100)
