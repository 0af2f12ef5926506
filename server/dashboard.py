"""The view in three dimensions: viser's server behind our own address, its switches, and clicks that propose a goal.

viser runs its own thread and loop on a loopback port that nobody sees. It is started when somebody first opens the
view, and costs nothing while nobody looks. Nothing in it moves the robot: a click on the floor is a proposal, which
whoever drives confirms on our own page. Uses its sibling `scene`.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from server.messages import Snapshot
from server.scene import (
    LAYERS,
    OPEN,
    WHEEL_RADIUS,
    SceneLayer,
    draw_body,
    draw_pole,
    heading_and_tilt,
    place_on_floor,
)

if TYPE_CHECKING:
    import viser

log = logging.getLogger(__name__)

PATIENCE = 20.0  # s that a proposal is shown
OUTDATED = -math.inf


class Dashboard:
    """The view; `update` is called by the session at its own rate and does nothing while nobody looks."""

    def __init__(self, propose: Callable[[float, float], None] | None = lambda x, y: None):
        """`propose` is told, in the event loop, of a place on the floor (m, world) that somebody clicked."""
        self.propose = propose
        self.server: viser.ViserServer | None = None
        self.robot: viser.FrameHandle | None = None
        self.switches: dict[str, viser.GuiCheckboxHandle] = {}
        self.drawn: dict[str, object] = {}  # layer -> the key that it was drawn with
        self.newest: Snapshot | None = None
        self.proposed = OUTDATED  # when, in the session's time
        self.starting = asyncio.Lock()

    @property
    def port(self) -> int:
        """Of viser's own server on loopback."""
        assert self.server is not None
        return self.server.get_port()

    @property
    def is_watched(self) -> bool:
        """Whether anybody has the view open."""
        return self.server is not None and bool(self.server.get_clients())

    async def start(self, snapshot: Snapshot) -> None:
        """Start viser if it does not run yet, and draw what whoever comes next is to see."""
        async with self.starting:
            if self.server is None:
                self.server = await asyncio.to_thread(open_server)
                self.furnish(self.server, snapshot.robot)
                log.info("the 3-D view runs behind /viser/, on 127.0.0.1:%d", self.port)
        self.server.initial_camera.position, self.server.initial_camera.look_at = behind(snapshot)
        self.draw(snapshot)

    def stop(self) -> None:
        """End viser's thread."""
        if self.server is not None:
            with contextlib.redirect_stdout(io.StringIO()):
                self.server.stop()
            self.server = None
            self.drawn.clear()

    def update(self, snapshot: Snapshot) -> None:
        """Show a snapshot to those who look."""
        if self.is_watched:
            self.draw(snapshot)

    def draw(self, snapshot: Snapshot) -> None:
        """Place the robot and draw the layers that have changed; assigning only queues, so this is cheap."""
        assert self.server is not None
        assert self.robot is not None
        self.newest = snapshot
        x, y, theta = (float(value) for value in snapshot.pose)
        self.robot.position = (x, y, WHEEL_RADIUS)
        self.robot.wxyz = heading_and_tilt(theta, float(np.nan_to_num(snapshot.tilt)))
        with self.server.atomic():
            for layer in LAYERS:
                if self.switches[layer.name].value:
                    self.draw_layer(layer, snapshot)
            if self.proposed != OUTDATED and not 0.0 <= snapshot.t - self.proposed < PATIENCE:
                self.withdraw()

    def draw_layer(self, layer: SceneLayer, snapshot: Snapshot) -> None:
        """Draw a layer, unless it is drawn so already."""
        assert self.server is not None
        key = layer.key(snapshot)
        if self.drawn.get(layer.name, self) != key:
            self.drawn[layer.name] = key
            layer.draw(self.server.scene, snapshot)

    def furnish(self, server: viser.ViserServer, robot: str) -> None:
        """The floor, the body, a switch for each layer, buttons for the camera, and the click."""
        server.scene.set_up_direction("+z")
        server.scene.add_grid(
            "/floor", infinite_grid=True, cell_size=0.5, section_size=5.0, cell_color=(50, 52, 58),
            section_color=(92, 98, 110), fade_distance=60.0,
        )  # fmt: skip
        self.robot = draw_body(server.scene, robot)
        server.gui.add_button("Look from behind the robot").on_click(lambda event: self.look(event.client, behind))
        server.gui.add_button("Look from above").on_click(lambda event: self.look(event.client, above))
        with server.gui.add_folder("Layers"):
            for layer in LAYERS:
                self.add_switch(server, layer)
        if self.propose is not None:
            self.listen(server)

    def listen(self, server: viser.ViserServer) -> None:
        """Take clicks on the floor for proposals."""
        loop = asyncio.get_running_loop()

        @server.scene.on_click()
        def click(event: viser.SceneClickEvent) -> None:  # in a thread of viser's
            place = place_on_floor(event.ray_origin, event.ray_direction)
            if place is not None:
                event.client.add_notification(
                    "Objective proposed",
                    f"{place[0]:.1f}, {place[1]:.1f} m. Whoever drives confirms it on Crunch's page.",
                    auto_close_seconds=6.0,
                )
                loop.call_soon_threadsafe(self.take_proposal, place)

    def add_switch(self, server: viser.ViserServer, layer: SceneLayer) -> None:
        """A layer's node and the switch that shows and hides it, for all who look."""
        node = server.scene.add_frame(layer.name, show_axes=False, visible=layer.is_on)
        switch = server.gui.add_checkbox(layer.label, layer.is_on, hint=layer.hint)
        self.switches[layer.name] = switch

        @switch.on_update
        def turn(_: viser.GuiEvent) -> None:
            node.visible = switch.value

    def look(self, client: viser.ClientHandle | None, view: Callable[[Snapshot], Camera]) -> None:
        """Move one viewer's camera."""
        if client is not None and self.newest is not None:
            with client.atomic():
                client.camera.position, client.camera.look_at = view(self.newest)

    def take_proposal(self, place: tuple[float, float]) -> None:
        """Mark a clicked place, and hand it on."""
        if self.server is None or self.newest is None or self.propose is None:
            return
        draw_pole(self.server.scene, "/proposal", place, OPEN)
        self.proposed = self.newest.t
        self.propose(*place)

    def withdraw(self) -> None:
        """Take the proposal's mark away."""
        assert self.server is not None
        self.proposed = OUTDATED
        self.server.scene.remove_by_name("/proposal")


Camera = tuple[tuple[float, float, float], tuple[float, float, float]]  # position and what it looks at


def open_server() -> viser.ViserServer:
    """A viser server on loopback, on any free port."""
    import viser

    with contextlib.redirect_stdout(io.StringIO()):  # it announces an address that is not for people
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    return server


def behind(snapshot: Snapshot) -> Camera:
    """Behind the robot and above it."""
    x, y, theta = (float(value) for value in snapshot.pose)
    u, v = math.cos(theta), math.sin(theta)
    return (x - 1.7 * u, y - 1.7 * v, 1.4), (x + 0.5 * u, y + 0.5 * v, 0.1)


def above(snapshot: Snapshot) -> Camera:
    """So high above the path's middle that all of it is in view; a little aside, since straight down has no up."""
    places = np.vstack([snapshot.path[:, :2], snapshot.pose[:2]])
    low, high = places.min(axis=0), places.max(axis=0)
    x, y = (float(value) for value in 0.5 * (low + high))
    height = 5.0 + 0.8 * float((high - low).max())
    return (x, y - 0.05 * height, height), (x, y, 0.0)
