"""`crunch serve`: one process, one task group; robot and page live and die together.

The links, the path filter's worker, the passing of time, the recording's syncs and the web server are its members. When
one ends, however it ends, the motors are stopped while the links are still open, and all the others end too. Uses its
siblings `bridge` (what runs), `sessions` (from one to the next), `render_queue` (recordings for viewers) and `replay`
(warming the kernels up).
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import secrets
import signal
import socket
import sys
import time
import webbrowser
from collections.abc import Callable, Coroutine, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from fastapi import APIRouter

from server.api import create_app
from server.bridge import Autopilot, Bridge
from server.config import Config, navigation_of
from server.control import Control
from server.errors import UserError
from server.explorer import Explorer
from server.explorer import warm_up as warm_up_exploring
from server.guard import is_loopback
from server.layers import tile_view
from server.map_store import DATABASE, MapStore, keep_session
from server.messages import Snapshot
from server.navigator import warm_up as warm_up_planning
from server.render_queue import RenderQueue
from server.replay import warm_up
from server.rest.maps import map_routes
from server.rest.present import present_survey
from server.rest.recordings import recording_routes
from server.rest.sessions import session_routes
from server.robots.kinds import LASER, ROBOTS, mouse_lines
from server.session import session_of
from server.sessions import Sessions
from server.shelf import Shelf
from server.transport import Link, open_link
from server.views import SessionStatus

log = logging.getLogger(__name__)

TICK_PERIOD = 0.02  # s
FRAME_PERIOD = 0.05  # s
SYNC_PERIOD = 1.0  # s
RECORDINGS = Path("recordings")
LONGEST_GOODBYE = 2  # s that viewers are given to close


@dataclass(frozen=True)
class LiveOptions:
    """How to serve; what the robot is and does stands in the configuration."""

    config: Config
    robot: str = "crunch"
    host: str = "127.0.0.1"
    port: int = 8000
    seed: int = 0
    threads: int = 1
    recordings: Path | None = RECORDINGS
    name: str = ""  # of the first session
    opens_browser: bool = False


def run_serve(
    links: Sequence[str],
    options: LiveOptions,
    laser: str | None = None,
    autopilot: bool = False,
    mice: Sequence[str] = (),
) -> int:
    """Serve the robot at the other end of the links until Ctrl-C; exit code. UserError for a link that is none."""
    kind = ROBOTS[options.robot]
    if not links:
        raise UserError("no link given; name one, as in --link serial:/dev/ttyUSB0")
    if kind.has_laser != (laser is not None):
        missing = "needs its laser's line too; name it, as in --laser serial:/dev/ttyACM0"
        raise UserError(f"{options.robot} {missing if kind.has_laser else 'has no laser; leave out --laser'}")
    if autopilot and not kind.explores:
        raise UserError(f"a real {options.robot} has no autopilot; leave out --autopilot")
    check_mouse_lines(options, len(mice))
    opened = {f"link{number}": open_link(spec) for number, spec in enumerate(links)}
    if laser is not None:
        opened[LASER] = open_link(laser)
    opened |= {link_id: open_link(spec) for link_id, spec in zip(mouse_lines(len(mice)), mice, strict=True)}
    return run(options, lambda: opened, Control(options.config.control), autopilot=autopilot)


def check_mouse_lines(options: LiveOptions, given: int) -> None:
    """UserError where there are other mice than the settings tell of."""
    most = ROBOTS[options.robot].mice
    if given > most:
        remedy = f"give {most} at most" if most else "leave out --mouse"
        raise UserError(f"{options.robot} has not so many mice; {remedy}")
    if not most:
        return
    params = getattr(options.config, options.robot).mice
    known = len(params.mice) if params else 0
    if given != known:
        raise UserError(
            f"--mouse is given {given} times, but {options.robot}.mice tells where {known} sit; make them as many "
            "(docs/maze-runner.md)"
        )


def run(
    options: LiveOptions,
    make_links: Callable[[], dict[str, Link]],
    control: Control,
    own: Autopilot | None = None,
    autopilot: bool = False,
    is_virtual: bool = False,
) -> int:
    """Serve until told to leave; `own` is the robot's own driver, and `autopilot` whether one drives at first."""
    with listening(options.host, options.port) as listener:
        warm_kernels(options)
        live = Live(options, make_links(), control, own, autopilot, is_virtual)
        live.sessions.open(options.name)
        try:
            asyncio.run(live.run(listener))
        finally:
            live.sessions.close()
    return 0


class Finished(Exception):
    """Somebody asked the session to end."""


class Live:
    """The one task group."""

    def __init__(
        self,
        options: LiveOptions,
        links: dict[str, Link],
        control: Control,
        own: Autopilot | None = None,
        autopilot: bool = False,
        is_virtual: bool = False,
    ):
        kind, params = ROBOTS[options.robot], getattr(options.config, options.robot)
        robot, navigation = kind.fold(params), navigation_of(options.config, options.robot)
        self.options = options
        self.links = links
        control.runs_itself = kind.bumps
        self.bridge = Bridge(robot, session_of(options.robot, robot, params), links, control, {}, navigation)
        if kind.explores:
            own = Explorer(options.config.explorer, navigation, ThreadPoolExecutor(1, "explorer"))
        if own is not None:
            self.bridge.autopilot, control.autopilot, own.autopilot = own, autopilot, autopilot
        self.bridge.is_virtual = is_virtual
        self.sessions = Sessions(
            self.bridge, options.config, options.seed, options.threads, options.recordings, options.robot
        )
        self.maps = MapStore((options.recordings or RECORDINGS) / DATABASE)
        if options.recordings is not None:  # who wants no recordings wants nothing kept unasked
            self.sessions.keep_map = self.keep_map
        self.shelf = Shelf(options.recordings or RECORDINGS, self.recording)
        self.renderer = RenderQueue(self.shelf.folder)
        self.token = None if is_loopback(options.host) else secrets.token_urlsafe(16)
        self.server: uvicorn.Server | None = None

    async def run(self, listener: socket.socket) -> None:
        """Live until `leave` is called or something breaks; an error of the robot or the page ends up here."""
        self.server = make_server(create_app(self.bridge, self.token, self.bridge.dashboard, self.routers()))
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, self.leave)
        try:
            async with asyncio.TaskGroup() as group:
                # The links come last: when all are cancelled, the members before them can still say stop.
                for work in (self.serve(listener), self.tick(), self.publish(), self.sessions.run(), self.sync()):
                    group.create_task(self.member(work))
                for link_id, link in self.links.items():
                    group.create_task(link.run(functools.partial(self.bridge.receive, link_id)))
        except* Finished:
            log.info("the session has ended")
        finally:
            self.bridge.dashboard.stop()
            self.renderer.close()

    def routers(self) -> list[APIRouter]:
        """The routes to what is kept beside the session."""
        return [
            session_routes(self.sessions),
            map_routes(self.bridge, self.maps),
            recording_routes(self.shelf, self.renderer, self.maps),
        ]

    def recording(self) -> str | None:
        """The name of the recording that is being written."""
        return self.bridge.about.recording if self.bridge.about.running else None

    def keep_map(self, snapshot: Snapshot, about: SessionStatus) -> str | None:
        """The map of a session that ends is kept without anybody's asking, if there is one."""
        survey = present_survey(self.bridge, snapshot)
        return str(keep_session(self.maps, survey, about, snapshot.labels).id) if len(survey.path) else None

    def leave(self) -> None:
        """Stop the robot, then let everything end in order."""
        self.bridge.halt()
        if self.server:
            self.server.should_exit = True

    async def member(self, work: Coroutine[Any, Any, None]) -> None:
        """A member of the group: however it ends, the robot stands still afterwards."""
        try:
            await work
        finally:
            self.bridge.halt()

    async def serve(self, listener: socket.socket) -> None:
        """The web server; asked to leave rather than cut off, so that viewers are told."""
        assert self.server is not None
        serving = asyncio.ensure_future(self.server.serve([listener]))
        try:
            await self.announce(listener, serving)
            await asyncio.shield(serving)
        except asyncio.CancelledError:
            self.server.should_exit = True
            await serving
            raise
        raise Finished

    async def announce(self, listener: socket.socket, serving: asyncio.Future) -> None:
        """Say where the page is, once it is there."""
        assert self.server is not None
        while not self.server.started and not serving.done():
            await asyncio.sleep(0.02)
        address = page_address(self.options.host, listener.getsockname()[1], self.token)
        print(f"Crunch's page: {address}   (Ctrl-C ends)", flush=True)
        if self.options.opens_browser:
            await asyncio.to_thread(webbrowser.open, address)

    async def tick(self) -> None:
        """The driver's lease; and how late the loop is to look after it."""
        clock = asyncio.get_running_loop().time
        while True:
            self.bridge.tick()
            due = clock() + TICK_PERIOD
            await asyncio.sleep(TICK_PERIOD)
            self.bridge.pulse.beat(clock() - due)

    async def publish(self) -> None:
        """The viewers' frames."""
        while True:
            self.bridge.publish()
            await asyncio.sleep(FRAME_PERIOD)

    async def sync(self) -> None:
        """The recording onto the disk, off the loop."""
        while True:
            await asyncio.sleep(SYNC_PERIOD)
            await self.sessions.sync()


class PageServer(uvicorn.Server):
    """uvicorn without its own signal handling: the task group has one for all."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the signals alone."""
        yield


def make_server(app: Any) -> PageServer:
    """uvicorn for the application, on a socket that is already open."""
    return PageServer(
        uvicorn.Config(
            app,
            lifespan="off",
            log_config=None,
            access_log=False,
            ws_max_size=1 << 16,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=LONGEST_GOODBYE,
            server_header=False,
        )
    )


@contextlib.contextmanager
def listening(host: str, port: int) -> Iterator[socket.socket]:
    """An open socket on an address; UserError if it cannot be had."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise UserError(
            f"--host {host}: {error.strerror or error}; use 127.0.0.1 or an address of this machine"
        ) from None
    with listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
            listener.listen(128)
        except OSError as error:
            remedy = "choose another with --port, or --port 0 for any free one"
            raise UserError(f"port {port} on {host} cannot be used ({error.strerror}); {remedy}") from None
        yield listener


def page_address(host: str, port: int, token: str | None) -> str:
    """What to open in a browser."""
    if host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")


def warm_kernels(options: LiveOptions) -> None:
    """Compile the kernels before anybody waits for the loop; on the first start this takes a while."""
    print("Preparing (the first start compiles for about a minute) ...", file=sys.stderr, flush=True)
    started = time.perf_counter()
    params, navigation = getattr(options.config, options.robot), navigation_of(options.config, options.robot)
    warm_up(params, 1)
    warm_up_planning(navigation)
    if ROBOTS[options.robot].explores:
        warm_up_exploring(options.config.explorer, navigation)
    ROBOTS[options.robot].fold(params).snapshot()
    tile_view(0, [[np.zeros((3, 2))]])
    log.info("kernels were ready after %.1f s", time.perf_counter() - started)
