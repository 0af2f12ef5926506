"""The real command in a process of its own, for tests that look at it from outside."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

PATIENCE = 300.0  # s; a first start compiles, and a busy machine takes its time


class Served(NamedTuple):
    """A running `crunch demo`: its process, the page's address, and the folder that it runs in."""

    process: subprocess.Popen[str]
    address: str
    folder: Path

    def status(self) -> dict[str, Any]:
        """GET /api/v1/status."""
        with urllib.request.urlopen(self.address + "api/v1/status", timeout=PATIENCE) as answer:
            return json.load(answer)

    def recording(self) -> Path:
        """The session's recording."""
        return self.folder / self.status()["recording"]


@contextlib.contextmanager
def demo(folder: Path, *flags: str) -> Iterator[Served]:
    """`crunch demo` on a free port; it must leave in order when it is interrupted, unless the test has killed it."""
    command = [sys.executable, "-m", "server", "demo", "--no-browser", "--particles", "300", *flags]
    if "--port" not in flags:
        command += ["--port", "0"]
    errors = folder / "stderr.txt"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    with (
        errors.open("a") as stderr,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True, cwd=folder, env=environment) as run,
    ):
        try:
            yield Served(run, address_of(run, errors), folder)
        finally:
            was_running = run.poll() is None
            if was_running:
                run.send_signal(signal.SIGINT)
            try:
                run.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                run.kill()
                raise
        if was_running:
            assert run.returncode == 0, errors.read_text()
        assert "Traceback" not in errors.read_text(), errors.read_text()


def address_of(run: subprocess.Popen[str], errors: Path) -> str:
    """What the command says about its page."""
    assert run.stdout is not None
    for line in run.stdout:
        if line.startswith("Crunch's page: "):
            return line.split()[2]
    raise AssertionError(f"it ended without a page: {errors.read_text()}")


def wait_until(holds: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """The first true answer; what is awaited comes in its own time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if answer := holds():
            return answer
        time.sleep(0.05)
    raise AssertionError("it did not happen in time")
