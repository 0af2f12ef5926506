"""A first view in three dimensions: viser's scene with the map's walls, the path and the robot with its true tilt.

viser runs its own thread and loop on a loopback port that nobody sees; its page and its socket are handed through our
own address, behind the same checks as everything else. It is started when somebody first opens it. Nothing in it
moves the robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import io
import logging
import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import websockets
from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect

from server.messages import Snapshot

if TYPE_CHECKING:
    import viser

log = logging.getLogger(__name__)

WHEEL_RADIUS = 0.0508  # m
WALL_HEIGHT = 0.35  # m that a wall is drawn high
WALL, SETTLED, OPEN = (86, 140, 190), (0, 114, 178), (213, 94, 0)
DECK, DARK = (240, 200, 66), (60, 60, 66)
MOST_SEGMENTS = 10_000  # more stall a computer without a graphics card


class Dashboard:
    """The scene; `update` is called by the session at its own rate and does nothing until somebody has looked."""

    def __init__(self):
        self.server: viser.ViserServer | None = None
        self.robot: viser.FrameHandle | None = None
        self.drawn: tuple[int, float] | None = None
        self.starting = asyncio.Lock()

    @property
    def port(self) -> int:
        """Of viser's own server on loopback."""
        assert self.server is not None
        return self.server.get_port()

    async def start(self, snapshot: Snapshot) -> None:
        """Start viser if it does not run yet, and draw."""
        async with self.starting:
            if self.server is None:
                self.server, self.robot = await asyncio.to_thread(open_scene)
                log.info("the 3-D view runs behind /viser/, on 127.0.0.1:%d", self.port)
        look_from_behind(self.server, snapshot.pose)
        self.update(snapshot)

    def stop(self) -> None:
        """End viser's thread."""
        if self.server is not None:
            with contextlib.redirect_stdout(io.StringIO()):
                self.server.stop()
            self.server = None

    def update(self, snapshot: Snapshot) -> None:
        """Show a snapshot; assigning only queues, so this is cheap."""
        if self.server is None or self.robot is None:
            return
        x, y, theta = (float(value) for value in snapshot.pose)
        self.robot.position = (x, y, WHEEL_RADIUS)
        self.robot.wxyz = heading_and_tilt(theta, float(snapshot.tilt))
        key = (len(snapshot.path), snapshot.affinity)
        if key != self.drawn:
            self.drawn = key
            draw_map(self.server, snapshot)


def open_scene() -> tuple[viser.ViserServer, viser.FrameHandle]:
    """A viser server on loopback with what never changes, and the frame of the robot's body."""
    import viser

    with contextlib.redirect_stdout(io.StringIO()):  # it announces an address that is not for people
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server.scene.set_up_direction("+z")
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_layout="collapsible")
    server.scene.add_grid("/floor", width=60.0, height=60.0, cell_size=0.5, section_size=5.0, cell_color=(90, 90, 90))
    return server, draw_body(server)


def look_from_behind(server: viser.ViserServer, pose: np.ndarray) -> None:
    """Let whoever opens the view next stand behind the robot and above it."""
    x, y, theta = (float(value) for value in pose)
    ahead = np.array([math.cos(theta), math.sin(theta)])
    server.initial_camera.position = (x - 1.7 * ahead[0], y - 1.7 * ahead[1], 1.4)
    server.initial_camera.look_at = (x + 0.5 * ahead[0], y + 0.5 * ahead[1], 0.1)


def draw_body(server: viser.ViserServer) -> viser.FrameHandle:
    """Two decks on four rods, two wheels and a nose, to scale, under a frame in the axle that turns and tilts."""
    scene = server.scene
    frame = scene.add_frame("/robot", show_axes=False)
    for name, height in (("lower", 0.05), ("sonar", 0.101), ("infrared", 0.152)):
        scene.add_cylinder(f"/robot/{name}", radius=0.076, height=0.008, color=DECK, position=(0.0, 0.0, height))
    for rod in range(4):
        angle = 0.25 * math.pi * (2 * rod + 1)
        place = (0.06 * math.cos(angle), 0.06 * math.sin(angle), 0.1)
        scene.add_cylinder(f"/robot/rod{rod}", radius=0.004, height=0.11, color=DARK, position=place)
    scene.add_box("/robot/nose", color=OPEN, dimensions=(0.03, 0.02, 0.012), position=(0.085, 0.0, 0.152))
    for side, y in (("left", 0.095), ("right", -0.095)):
        turned = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
        scene.add_cylinder(
            f"/robot/{side}", radius=WHEEL_RADIUS, height=0.02, color=DARK, position=(0.0, y, 0.0), wxyz=turned
        )
    return frame


def heading_and_tilt(theta: float, tilt: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a turn by theta about z, then a lean forward by tilt about the body's y."""
    a, b = math.cos(theta / 2.0), math.sin(theta / 2.0)
    c, d = math.cos(tilt / 2.0), math.sin(tilt / 2.0)
    return a * c, -b * d, a * d, b * c


def draw_map(server: viser.ViserServer, snapshot: Snapshot) -> None:
    """The walls as upright ribbons, the path as a line in two colours: settled, and still open."""
    vertices, faces = ribbons(snapshot.walls, WALL_HEIGHT)
    if len(faces):
        server.scene.add_mesh_simple("/walls", vertices, faces, color=WALL, side="double", flat_shading=True)
    if len(snapshot.path) > 1:
        points = np.column_stack([snapshot.path[:, :2], np.full(len(snapshot.path), 0.02)]).astype(np.float32)
        segments = np.stack([points[:-1], points[1:]], axis=1)[-MOST_SEGMENTS:]
        first = len(snapshot.path) - 1 - len(segments)
        is_settled = np.arange(first, first + len(segments)) < snapshot.fixed_depth
        colours = np.where(is_settled[:, None, None], np.array(SETTLED, np.uint8), np.array(OPEN, np.uint8))
        server.scene.add_line_segments("/path", segments, colours.repeat(2, axis=1), thickness=0.02)


def ribbons(curves: list[np.ndarray], height: float) -> tuple[np.ndarray, np.ndarray]:
    """Curves (k, 2) raised to upright ribbons: vertices (n, 3) float32 and triangles (m, 3) uint32, the newest kept."""
    kept, segments = [], 0
    for curve in reversed(curves):
        segments += max(0, len(curve) - 1)
        if segments > MOST_SEGMENTS:
            break
        if len(curve) > 1:
            kept.append(curve)
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), int)], 0
    for curve in kept:
        k = len(curve)
        vertices += [np.column_stack([curve, np.zeros(k)]), np.column_stack([curve, np.full(k, height)])]
        low = count + np.arange(k - 1)
        faces += [np.column_stack([low, low + 1, low + k]), np.column_stack([low + 1, low + k + 1, low + k])]
        count += 2 * k
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.uint32)


@lru_cache
def client_page() -> bytes:
    """viser's own page as its wheel brings it, compressed."""
    import viser

    page = Path(viser.__file__).parent / "client" / "build" / "index.html"
    return gzip.compress(page.read_bytes(), 6)


def add_viser(app: FastAPI, dashboard: Dashboard, look: Callable[[], Snapshot]) -> None:
    """The routes /viser/ (page) and /viser (socket, handed through)."""

    @app.get("/viser/", include_in_schema=False)
    async def page(request: Request) -> Response:
        await dashboard.start(look())
        compressed = await asyncio.to_thread(client_page)
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(compressed, media_type="text/html", headers={"Content-Encoding": "gzip"})
        return Response(gzip.decompress(compressed), media_type="text/html")

    @app.websocket("/viser")
    async def socket(ours: WebSocket) -> None:
        await dashboard.start(look())
        protocols = [websockets.Subprotocol(name) for name in ours.scope.get("subprotocols", [])]
        theirs = websockets.connect(
            f"ws://127.0.0.1:{dashboard.port}",
            subprotocols=protocols, compression=None, max_size=None, max_queue=2, ping_interval=None,
        )  # fmt: skip
        with contextlib.suppress(OSError, websockets.InvalidHandshake):
            async with theirs as upstream:
                await ours.accept(upstream.subprotocol)
                await hand_through(ours, upstream)


class Closed(Exception):
    """One side of a handed-through socket has gone."""


async def hand_through(ours: WebSocket, theirs: websockets.ClientConnection) -> None:
    """Copy messages both ways until one side closes."""

    async def up() -> None:
        while True:
            await theirs.send(await ours.receive_bytes())

    async def down() -> None:
        async for message in theirs:
            await ours.send_bytes(message if isinstance(message, bytes) else message.encode())
        raise Closed

    try:
        async with asyncio.TaskGroup() as group:
            group.create_task(up())
            group.create_task(down())
    except* (Closed, WebSocketDisconnect, websockets.ConnectionClosed, RuntimeError):
        log.debug("a 3-D viewer has gone")
