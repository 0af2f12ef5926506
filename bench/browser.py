"""What `bench.dashboard` measures: a real `crunch serve` or `crunch demo` and a real headless Chromium.

Protocol clients run in a further process. Everything is on one machine, so the figures hold what the clients cost too.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import sys
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import websockets
from playwright.sync_api import Browser, Page, sync_playwright

from bench.benchmark import Row
from bench.relay import Relay, started
from server import channels
from server.errors import UserError
from server.messages import Wheels
from server.recorded import Listener
from server.recording import Kind, Reader
from server.session import Session
from server.stream import decode

PRESSES = 100
WATCHED = 20.0  # s that readings are followed to the screen
LOADS = (1, 10, 50)
LOAD_SECONDS = 20.0
DRIVE_SECONDS = 120.0
THIN = 30_000  # bytes/s
THIN_SECONDS = 40.0
TOUR = 250  # m
FLAGS = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-sync"]
GOOD = '#connection[data-state="good"]'
PAGE = r"Crunch's page: (\S+)"

FOLLOW = """(() => {  // every pose's reading time, and when the frame after the one that drew it began
  globalThis.seen = [];
  crunch.connection.addEventListener("pose", ({ detail: { header } }) => {
    requestAnimationFrame(() => requestAnimationFrame((now) =>
      seen.push([header.t - header.age, (performance.timeOrigin + now) / 1000])));
  });
})()"""
LISTEN = """(() => {
  globalThis.presses = [];
  addEventListener("keydown", (event) => {
    if (!event.repeat) presses.push((performance.timeOrigin + event.timeStamp) / 1000);
  }, true);
})()"""


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """The browser of the tests."""
    from tests.web.conftest import find_browser

    path = find_browser()
    if path is None:
        raise UserError("no Chromium found; `make setup` installs one")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=FLAGS)
        yield browser
        browser.close()


def visit(browser: Browser, address: str) -> Page:
    """The page, with the hint put away."""
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.add_init_script('localStorage.setItem("welcomed", "yes")')
    page.goto(address)
    page.wait_for_selector(GOOD, timeout=60_000)
    return page


def demo(folder: Path, *flags: str) -> contextlib.AbstractContextManager[tuple[Any, str]]:
    """A virtual robot with its page."""
    return started(["server", "demo", "--no-browser", "--port", "0", *flags], PAGE, folder)


def fetch(address: str, path: str) -> Any:
    """A document of REST."""
    with urllib.request.urlopen(address + "api/v1/" + path, timeout=10) as answer:
        return json.load(answer)


def delays_of(name: str, seconds: list[float]) -> Row:
    """A row of delays, one record each."""
    return Row(name, [{"ms": 1000.0 * delay} for delay in seconds])


# Latency.


def latency(browser: Browser, folder: Path) -> Iterator[Row]:
    """Key press to the command on the wire, and reading on the wire to the screen."""
    virtual = ["firmware.virtual", "--world", "corridor50", "--tcp", "127.0.0.1:0"]
    with started(virtual, r":(\d+);", folder) as (_, port):
        relay = Relay(int(port))
        serve = ["server", "serve", "--no-browser", "--port", "0", "--link", f"tcp://127.0.0.1:{relay.port}"]
        with started(serve, PAGE, folder) as (_, address):
            page = visit(browser, address)
            page.evaluate(LISTEN)
            for press in range(PRESSES):
                key = "ad"[press % 2]  # turning on the spot keeps it away from walls
                page.keyboard.down(key)
                page.wait_for_timeout(150)
                page.keyboard.up(key)
                page.wait_for_timeout(260)
            presses = page.evaluate("presses")
            page.evaluate(FOLLOW)
            page.wait_for_timeout(1000.0 * WATCHED)
            seen = page.evaluate("seen")
            recording = folder / fetch(address, "status")["recording"]
            page.close()
        relay.close()
    yield delays_of("key pressed, command on the wire", wire_delays(presses, relay.commands))
    yield delays_of("reading on the wire, drawn", screen_delays(recording, seen))


def wire_delays(presses: list[float], commands: list[tuple[float, bool]]) -> list[float]:
    """Seconds from each press to the first moving command after it; inf where none came before the next press."""
    moving = np.array([t for t, moves in commands if moves])
    ends = [*presses[1:], np.inf]
    found = np.searchsorted(moving, presses)
    times = [moving[at] if at < moving.size else np.inf for at in found]
    return [float(t - press) if t < end else np.inf for press, t, end in zip(presses, times, ends, strict=True)]


def screen_delays(recording: Path, seen: list[list[float]]) -> list[float]:
    """Seconds from the arrival of each odometry reading to the first picture that shows it or a later one.

    The recording tells when the bytes of a reading arrived and what time the session gave it.
    """
    reader = Reader(recording)
    listener = Listener()
    session = Session(listener, channels.Calibration())
    arrivals = []
    for record in reader:
        if record.kind == Kind.RX:
            session.receive(record.link_id, record.data, record.t)
            arrivals += [(message.t, record.t) for message in listener.take() if isinstance(message, Wheels)]
    start = reader.header.unix_ns * 1e-9
    shown = np.maximum.accumulate([reading for reading, _ in seen]) + 6e-4  # the page is told milliseconds
    drawn = np.array([t for _, t in seen]) - start
    delays = []
    for reading, arrival in arrivals:
        at = int(np.searchsorted(shown, reading))
        if drawn[0] <= arrival and at < len(shown):
            delays.append(float(drawn[at] - arrival))
    return delays


# Load.


class Sight(NamedTuple):
    """What a viewer was sent: frames and bytes by topic."""

    frames: Counter[str]
    size: Counter[str]


async def watch(address: str, seconds: float) -> Sight:
    """A viewer that acknowledges at once, and counts."""
    url = address.replace("http", "ws", 1) + "api/v1/stream"
    sight = Sight(Counter(), Counter())
    async with websockets.connect(url, max_size=None, compression=None) as socket:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for data in socket:
                    assert isinstance(data, bytes)
                    sequence, header, _ = decode(data)
                    topic = header["topic"].partition("/")[0]
                    sight.frames[topic] += 1
                    sight.size[topic] += len(data)
                    await socket.send(json.dumps({"type": "ack", "seq": sequence}))
    return sight


async def watch_all(address: str, viewers: int, seconds: float) -> list[Sight]:
    """Many viewers at once."""
    return await asyncio.gather(*(watch(address, seconds) for _ in range(viewers)))


def crowd(address: str, viewers: int, seconds: float, folder: Path) -> list[Sight]:
    """Many viewers in a process of their own."""
    command = ["bench.browser", address, str(viewers), str(seconds)]
    with started(command, r"(\[.*\])", folder) as (_, said):
        return [Sight(Counter(frames), Counter(size)) for frames, size in json.loads(said)]


def cpu_seconds(process_id: int) -> float:
    """Processor time that a process (without its children) has used."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


def load(browser: Browser, folder: Path) -> Iterator[Row]:
    """The event loop's processor and delay, and the pictures of each, for one browser and some protocol clients."""
    with demo(folder, "--autopilot", "--world", "corridor50") as (process, address):
        page = visit(browser, address)
        page.evaluate("crunch.connection.addEventListener('pose', () => poses++)")
        for viewers in LOADS:
            page.evaluate("globalThis.poses = 0")
            before, began = cpu_seconds(process.pid), time.monotonic()
            sights = crowd(address, viewers, LOAD_SECONDS, folder)
            core = 100.0 * (cpu_seconds(process.pid) - before) / (time.monotonic() - began)
            poses = page.evaluate("poses") / (time.monotonic() - began)
            rates = [sight.frames["pose"] / LOAD_SECONDS for sight in sights]
            late = fetch(address, "status")["loop"]  # of the last 20 s
            yield Row(str(viewers), [{"core": core, **late, "rate": min(rates), "rates": rates, "browser": poses}])
        page.close()


# Traffic.


def traffic(_: Browser, folder: Path) -> Iterator[Row]:
    """What one viewer is sent during a drive, by topic."""
    with demo(folder, "--autopilot") as (_, address):
        [(frames, size)] = crowd(address, 1, DRIVE_SECONDS, folder)
    for topic, n_bytes in [*size.most_common(), ("all", size.total())]:
        n_frames = frames[topic] if topic in frames else frames.total()
        yield Row(topic, [{"frames": n_frames / DRIVE_SECONDS, "kilobytes": n_bytes / DRIVE_SECONDS / 1000.0}])


# A thin link, a large map.


def thin(browser: Browser, folder: Path) -> Iterator[Row]:
    """Ages of the pose on the page over a link of 30 kB/s while the robot drives."""
    with demo(folder, "--autopilot") as (_, address):
        time.sleep(THIN_SECONDS)  # some map to be sent
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.add_init_script('localStorage.setItem("welcomed", "yes")')
        page.goto(address)
        page.wait_for_selector(GOOD)
        session = page.context.new_cdp_session(page)
        session.send("Network.enable")
        limits = {"offline": False, "latency": 40, "downloadThroughput": THIN, "uploadThroughput": THIN}
        session.send("Network.emulateNetworkConditions", limits)
        page.evaluate("crunch.connection.socket.close()")  # all is sent anew, over the thin link
        page.wait_for_selector('#connection[data-state="bad"]')
        page.wait_for_selector(GOOD)
        ages = []
        for _ in range(round(THIN_SECONDS * 10)):
            ages.append(page.evaluate("crunch.connection.age"))
            page.wait_for_timeout(100)
        vertices = page.evaluate("crunch.map.map.path.length")
        page.close()
    known = [math.nan if age is None or age > 1e6 else age for age in ages]  # not yet before the first pong
    yield Row(f"{THIN_SECONDS:.0f} s of a drive, {vertices} vertices", [{"ms": age} for age in known])


def smooth(browser: Browser, folder: Path) -> Iterator[Row]:
    """Pictures per second of the map after a drive of 250 m, while it is dragged about and zoomed."""
    with demo(folder, "--autopilot", "--world", "corridor50", "--plan", f"tour:{TOUR}", "--speed", "20") as (
        _,
        address,
    ):
        page = visit(browser, address)
        while fetch(address, "status")["driver"]["autopilot"]:  # until the tour is driven
            page.wait_for_timeout(500)
        vertices = page.evaluate("crunch.map.map.path.length")
        page.click("#map-fit")
        page.evaluate("""(() => {
            globalThis.drawn = 0;
            const draw = crunch.map.draw.bind(crunch.map);
            crunch.map.draw = (...args) => { drawn++; draw(...args); };
        })()""")
        box = page.locator("#map").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
        rates = {}
        for name, act in (("dragged", drag), ("zoomed", zoom)):
            page.mouse.move(x, y)
            before, began = page.evaluate("drawn"), time.monotonic()
            act(page, x, y)
            rates[name] = (page.evaluate("drawn") - before) / (time.monotonic() - began)
        page.close()
    for name, rate in rates.items():
        yield Row(f"{name}, {TOUR} m, {vertices} vertices", [{"rate": rate}])


def drag(page: Page, x: float, y: float) -> None:
    """Move the map about for some seconds."""
    page.mouse.down()
    for step in range(300):
        page.mouse.move(x + 200.0 * np.sin(step / 12.0), y + 120.0 * np.cos(step / 9.0))
    page.mouse.up()


def zoom(page: Page, x: float, y: float) -> None:
    """In and out for some seconds."""
    for step in range(200):
        page.mouse.wheel(0.0, 60.0 if step // 25 % 2 else -60.0)


def crowd_process(address: str, viewers: str, seconds: str) -> None:
    """The protocol clients' own process."""
    sights = asyncio.run(watch_all(address, int(viewers), float(seconds)))
    print(json.dumps([[sight.frames, sight.size] for sight in sights]), flush=True)


if __name__ == "__main__":
    crowd_process(*sys.argv[1:])
