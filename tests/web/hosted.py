"""A session served from the test's own process, so that a test can add to it: layers, a long map, silence."""

import asyncio
import contextlib
import dataclasses
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from server.api import create_app
from server.live import listening, make_server
from server.messages import Snapshot
from server.robots.crunch import Crunch
from slam.walls import Walls, curves
from tests.server.live_session import PARAMS, STEP, HandSession

FRAME_PERIOD = 0.05  # s
SPACING = 0.5  # m between two vertices
HOLD_UP = 0.3  # s between two turns of the loop that are no fault of ours
REACH = 1.8  # m that walls are seen from the middle of a corridor


class LongDrive(Crunch):
    """A robot that has already driven up and down a building's corridors, and goes on as its virtual body does."""

    def __init__(self, n_vertices: int):
        super().__init__(PARAMS)
        self.path, self.seen_curves, self.seen_walls = corridors(n_vertices)

    def snapshot(self) -> Snapshot:
        """The body's present with the long drive's map."""
        n = len(self.path)
        return dataclasses.replace(
            super().snapshot(),
            path=self.path, vertex_curves=self.seen_curves, observations=self.seen_walls, particles=self.particles(),
            vertex_times=np.arange(n, dtype=float), vertex_odometry=self.path, fixed_depth=n // 2,
            profile=np.linspace(0.0, 1.0, n), spread=np.linspace(0.0, 0.6, n),
        )  # fmt: skip

    def particles(self) -> np.ndarray:
        """Many, around the newest vertex."""
        return self.path[-1] + np.random.default_rng(0).normal(0.0, 0.3, (500, 3))

    def shift(self, x: float, y: float) -> None:
        """The whole path is believed elsewhere."""
        self.path = self.path + [x, y, 0.0]


def corridors(n_vertices: int) -> tuple[np.ndarray, list[list[np.ndarray]], list[Walls]]:
    """Poses (n, 3) up and down corridors of 25 m, 2 m wide and 3 m apart, and the walls seen from each."""
    rng = np.random.default_rng(0)
    along = SPACING * np.arange(n_vertices)
    lane, place = np.divmod(along, 25.0)
    is_back = lane % 2 == 1
    path = np.stack([np.where(is_back, 25.0 - place, place), 3.0 * lane, np.where(is_back, np.pi, 0.0)], axis=1)
    angles = 2.0 * np.pi * np.arange(120) / 120
    with np.errstate(divide="ignore"):
        exact = 1.0 / np.abs(np.sin(angles))
    walls = []
    for _ in range(n_vertices):
        distances = np.where(exact < REACH, exact + rng.normal(0.0, 0.01, 120), np.inf)
        walls.append(Walls(distances, np.minimum(distances, REACH)))
    return path, [curves(seen) for seen in walls], walls


class Hosted(HandSession):
    """A hand-made session with a page, living in a thread of its own while the test looks on."""

    def __init__(self, n_vertices: int = 0):
        self.n_vertices = n_vertices
        super().__init__()
        self.is_mute = False  # nothing is published
        self.held_up = 0.0  # when (time.monotonic) the loop last stood still, because of something else on this machine
        self.address = ""

    def make_robot(self) -> Crunch:
        """One that has driven far, if so many vertices are wanted."""
        return LongDrive(self.n_vertices) if self.n_vertices else super().make_robot()

    @contextlib.contextmanager
    def served(self) -> Iterator["Hosted"]:
        """While it lives; what went wrong in it is raised here."""
        with ThreadPoolExecutor(1) as thread:
            living = thread.submit(lambda: asyncio.run(self.live()))
            while not self.address and not living.done():
                time.sleep(0.01)
            try:
                yield self
            finally:
                self.server.should_exit = True
                living.result()

    async def live(self) -> None:
        """Page, robot and time, until the test is done."""
        with listening("127.0.0.1", 0) as listener:
            self.server = make_server(create_app(self.bridge))
            self.address = f"http://127.0.0.1:{listener.getsockname()[1]}/"
            going = asyncio.create_task(self.go_on())
            going.add_done_callback(lambda _: setattr(self.server, "should_exit", True))
            await self.server.serve([listener])
            going.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await going

    async def go_on(self) -> None:
        """Let time pass as it does, and show it."""
        start = time.monotonic() - self.link.time
        due, turned = 0.0, time.monotonic()
        while True:
            before, turned = turned, time.monotonic()
            if turned - before > HOLD_UP:
                self.held_up = turned
            while self.link.time < time.monotonic() - start:
                self.advance(STEP)
            if self.link.time >= due and not self.is_mute:
                due = self.link.time + FRAME_PERIOD
                self.bridge.publish()
            await asyncio.sleep(0.5 * STEP)
