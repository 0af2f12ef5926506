"""Layers: what viewers are shown of a robot, topic by topic, each made by one function of a snapshot.

A new layer is one function here or beside (`@layer("name")`, or `Layers.add` for one that knows more than the snapshot)
and one in the page (`web/layers.js`). A layer that answers None is none of this robot's: its panel is hidden. What has
not changed since it was last shown is not sent again. Knows no robot. Uses its sibling `stream`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from server.messages import Snapshot
from server.stream import Hub
from slam.thinning import needed

CENTIMETRE, MILLIMETRE = 0.01, 0.001
FURTHEST = 32767
TILE = 16  # vertices


class View(NamedTuple):
    """The fields and arrays of one frame."""

    fields: dict[str, Any]
    arrays: dict[str, np.ndarray] = {}  # noqa: RUF012 (a default that nobody changes)


Look = Callable[[Snapshot], View | None]


class Layer(NamedTuple):
    """A topic, the function that makes it, and how many turns of the publication (20 Hz) it waits between two looks."""

    look: Look
    every: int


LAYERS: dict[str, Layer] = {}  # filled by `layer` when the modules with the functions are imported


def layer(name: str, every: int = 2) -> Callable[[Look], Look]:
    """Show what the function makes of a snapshot as topic `name`, looking on every `every`-th turn."""

    def register(look: Look) -> Look:
        LAYERS[name] = Layer(look, every)
        return look

    return register


class Layers:
    """The layers of one session, and what of them its viewers have."""

    def __init__(self, hub: Hub):
        self.hub = hub
        self.layers = dict(LAYERS)
        self.tiles = Tiles(hub)
        self.turn = 0
        self.missing: set[str] = set()  # layers that the robot has not

    def add(self, name: str, look: Look, every: int = 2) -> None:
        """A further layer of this session only; `look` may know more than the snapshot."""
        self.layers[name] = Layer(look, every)

    def names(self, snapshot: Snapshot) -> list[str]:
        """The topics that this robot has."""
        if self.turn == 0:
            self.missing = {name for name, layer in self.layers.items() if layer.look(snapshot) is None}
        return ["pose", *(name for name in self.layers if name not in self.missing), "tile"]

    def begin(self) -> None:
        """Another session begins: nothing of what was shown holds any more."""
        self.hub.begin()
        self.tiles = Tiles(self.hub)

    def show(self, snapshot: Snapshot, is_last: bool = False) -> None:
        """Publish what has changed; called 20 times a second. A last look leaves no layer for later."""
        for name, layer in self.layers.items():
            if is_last or self.turn % layer.every == 0:
                view = layer.look(snapshot)
                if view is None:
                    self.missing.add(name)
                    self.hub.forget(name)
                else:
                    self.missing.discard(name)
                    self.hub.publish(name, *view)
        self.tiles.show(snapshot)
        self.turn += 1


class Tiles:
    """The walls of 16 vertices at a time, each in its vertex's own frame, as topics `tile/0`, `tile/1`, ...

    What a vertex saw never changes: only a tile that got a vertex more is sent again, and viewers put the walls where
    the path has their vertices now.
    """

    def __init__(self, hub: Hub):
        self.hub = hub
        self.shown = 0  # vertices

    def show(self, snapshot: Snapshot) -> None:
        """Publish the tiles that changed."""
        curves = snapshot.vertex_curves
        for tile in range(self.shown // TILE, -(-len(curves) // TILE)):
            if max(self.shown, TILE * tile) < min(len(curves), TILE * (tile + 1)):
                self.hub.publish(f"tile/{tile}", *tile_view(TILE * tile, curves[TILE * tile : TILE * (tile + 1)]))
        self.shown = len(curves)


def tile_view(first: int, vertices: list[list[np.ndarray]]) -> View:
    """Walls of the vertices from `first` on, to the centimetre; `counts` (v,) is how many curves each vertex has."""
    kept = [[curve[needed(curve, CENTIMETRE)] for curve in curves if len(curve) > 1] for curves in vertices]
    counts = np.array([len(curves) for curves in kept], np.uint16)
    packed = pack_curves([curve for curves in kept for curve in curves])
    return View({"first": first, "scale": CENTIMETRE}, {**packed, "counts": counts})


def pack_curves(curves: list[np.ndarray], unit: float = CENTIMETRE) -> dict[str, np.ndarray]:
    """Curves, each (k, 2) in metres, as `points` (n, 2) in units and `lengths` of the curves; empty ones go."""
    curves = [curve for curve in curves if len(curve)]
    lengths = np.array([len(curve) for curve in curves], np.uint16)
    return {"points": pack_points(np.concatenate(curves) if curves else np.zeros((0, 2)), unit), "lengths": lengths}


def pack_points(points: np.ndarray, unit: float = CENTIMETRE) -> np.ndarray:
    """Points (n, 2) in metres as units in 16 bits: of centimetres up to 327 m."""
    return np.clip(np.round(points / unit), -FURTHEST, FURTHEST).astype(np.int16)


def fine_unit(points: np.ndarray) -> float:
    """Millimetres where points (..., 2) in metres fit into 16 bits of them, else centimetres."""
    return MILLIMETRE if np.abs(points).max(initial=0.0) < MILLIMETRE * FURTHEST else CENTIMETRE
