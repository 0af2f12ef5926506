"""Names of places. On the live map each hangs on the vertex nearest to it, so that it moves along when the map does.

A label lives in the running session until it is removed; every change is also told to `remember`, which writes it into
the recording. Uses its sibling `layers`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import BaseModel, Field

from server.layers import View, layer
from server.messages import Label, Snapshot
from slam.pose import inverse, transform

MOST = 500  # labels of one map
PRINTABLE = r"^[^\x00-\x1f\x7f]*[^\x00-\x20\x7f][^\x00-\x1f\x7f]*$"  # one line, and something to see in it


class NewPlace(BaseModel):
    """A place to be named."""

    text: str = Field(min_length=1, max_length=80, pattern=PRINTABLE, examples=["Kitchen"])
    x: float = Field(allow_inf_nan=False, examples=[2.4], description="m, in the map's frame")
    y: float = Field(allow_inf_nan=False, examples=[-1.0], description="m, in the map's frame")


class Place(NewPlace):
    """A named place on a map."""

    id: int = Field(default=0, ge=0, examples=[1], description="0 for a new one")

    def label(self) -> Label:
        """As a message."""
        return Label(self.id, self.text, self.x, self.y)


def place_of(label: Label) -> Place:
    """As REST shows it."""
    return Place(id=label.id, text=label.text, x=round(label.x, 4), y=round(label.y, 4))


@layer("labels", every=4)
def labels_view(snapshot: Snapshot) -> View:
    """The names of places on the live map."""
    return View({"labels": [place_of(label).model_dump() for label in snapshot.labels]})


def numbered(labels: Iterable[Label]) -> tuple[Label, ...]:
    """Labels with a number of its own for each that has none; ValueError where one is given twice or there are many."""
    labels = tuple(labels)
    given = [label.id for label in labels if label.id]
    if len(set(given)) < len(given):
        raise ValueError("two labels have the same number")
    if len(labels) > MOST:
        raise ValueError(f"a map has {MOST} labels at most")
    fresh = iter(range(max(given, default=0) + 1, max(given, default=0) + 1 + len(labels)))
    return tuple(label if label.id else replace(label, id=next(fresh)) for label in labels)


@dataclass(frozen=True)
class Anchored:
    """A label's text and where it is (2,) in the frame of a vertex."""

    text: str
    vertex: int
    offset: np.ndarray


class NoPlace(Exception):
    """There is nothing yet that a label could hang on, or there are enough."""


class Labels:
    """The labels of a running session."""

    def __init__(self, remember: Callable[[dict[str, Any]], None] | None = None):
        self.anchored: dict[int, Anchored] = {}
        self.remember = remember or (lambda event: None)
        self.last = 0

    def add(self, text: str, x: float, y: float, path: np.ndarray) -> Label:
        """Name a place (world) of the map whose vertices stand at `path` (n, 3); NoPlace before there is one."""
        if not len(path):
            raise NoPlace("there is no map yet; drive half a metre first")
        if len(self.anchored) >= MOST:
            raise NoPlace(f"there are {MOST} labels already; remove one first")
        place = np.array([x, y])
        vertex = int(np.argmin(np.hypot(*(path[:, :2] - place).T)))
        self.last += 1
        self.anchored[self.last] = Anchored(text, vertex, transform(inverse(path[vertex]), place))
        dx, dy = (round(float(part), 4) for part in self.anchored[self.last].offset)
        self.remember({"id": self.last, "text": text, "vertex": vertex, "x": dx, "y": dy})
        return Label(self.last, text, x, y)

    def remove(self, number: int) -> None:
        """Forget a label; KeyError if there is none."""
        del self.anchored[number]
        self.remember({"id": number, "removed": True})

    def placed(self, path: np.ndarray) -> tuple[Label, ...]:
        """All labels where they are now that the vertices stand at `path` (n, 3)."""
        known = {number: label for number, label in self.anchored.items() if label.vertex < len(path)}
        if not known:
            return ()
        offsets = np.array([label.offset for label in known.values()])
        places = transform(path[[label.vertex for label in known.values()]], offsets).tolist()
        pairs = zip(known.items(), places, strict=True)
        return tuple(Label(number, label.text, x, y) for (number, label), (x, y) in pairs)

    def recall(self, event: dict[str, Any]) -> None:
        """Do again what a recording remembers; what it does not understand it leaves alone."""
        match event:
            case {"id": int(number), "removed": True}:
                self.anchored.pop(number, None)
            case {"id": int(number), "text": str(text), "vertex": int(vertex), "x": float(x), "y": float(y)}:
                self.anchored[number] = Anchored(text, vertex, np.array([x, y]))
                self.last = max(self.last, number)
