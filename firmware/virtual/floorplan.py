"""Floors painted from shapes: free space is carved out of solid rock and built up again, then its outline is traced.

A shape knows its signed distance, negative inside, so that slanted and round walls come out as exact as straight ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from firmware.virtual.contours import trace_walls
from firmware.virtual.plans import Plan
from firmware.virtual.worlds import World

RESOLUTION = 0.04  # m of the raster that outlines are traced in
TOLERANCE = 0.25  # of that, by which a traced wall may be straightened
MARGIN = 0.2  # m around a shape in which its distance matters


class Shape(Protocol):
    """A region of the floor; `bounds` (4,) are left, bottom, right, top."""

    @property
    def bounds(self) -> tuple[float, float, float, float]: ...

    def distances(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Signed distance (m) of points from its border, negative inside."""
        ...


@dataclass(frozen=True)
class Box:
    """Rectangle around (x, y), `length` along `angle` and `width` across it."""

    x: float
    y: float
    angle: float
    length: float
    width: float

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        reach = 0.5 * math.hypot(self.length, self.width)
        return self.x - reach, self.y - reach, self.x + reach, self.y + reach

    def distances(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        along = np.abs(cos * (x - self.x) + sin * (y - self.y)) - 0.5 * self.length
        across = np.abs(cos * (y - self.y) - sin * (x - self.x)) - 0.5 * self.width
        return np.hypot(along.clip(0.0), across.clip(0.0)) + np.maximum(along, across).clip(max=0.0)


@dataclass(frozen=True)
class Disc:
    """Circle around (x, y)."""

    x: float
    y: float
    radius: float

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        return self.x - self.radius, self.y - self.radius, self.x + self.radius, self.y + self.radius

    def distances(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.hypot(x - self.x, y - self.y) - self.radius


@dataclass(frozen=True)
class Ring:
    """What lies within `width` / 2 of a circle around (x, y)."""

    x: float
    y: float
    radius: float
    width: float

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        return Disc(self.x, self.y, self.radius + 0.5 * self.width).bounds

    def distances(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.abs(np.hypot(x - self.x, y - self.y) - self.radius) - 0.5 * self.width


def side(a: np.ndarray, b: np.ndarray, width: float, beyond: float = 0.0) -> Box:
    """The corridor of `width` m from a (2,) to b (2,), and `beyond` m farther at both ends."""
    x, y = 0.5 * (a + b)
    dx, dy = b - a
    return Box(float(x), float(y), math.atan2(dy, dx), math.hypot(dx, dy) + 2.0 * beyond, width)


class Floor:
    """Solid everywhere until carved; what is painted later covers what was before."""

    def __init__(self) -> None:
        self.carved: list[tuple[float, float, float, float]] = []
        self.strokes: list[tuple[Shape, bool]] = []

    def carve(self, shape: Shape) -> None:
        """Make the shape free space."""
        self.carved.append(shape.bounds)
        self.strokes.append((shape, True))

    def build(self, shape: Shape) -> None:
        """Make the shape solid."""
        self.strokes.append((shape, False))

    def world(self, plan: Plan, name: str) -> World:
        """The walls around what is free, with the start of a plan."""
        bounds = np.array(self.carved)
        corner = bounds[:, :2].min(axis=0) - MARGIN
        columns, rows = np.ceil((bounds[:, 2:].max(axis=0) + MARGIN - corner) / RESOLUTION).astype(int)
        distances = np.full((rows, columns), MARGIN)  # from free space, negative inside
        for shape, is_free in self.strokes:
            low = np.floor((np.array(shape.bounds[:2]) - MARGIN - corner) / RESOLUTION).astype(int).clip(0)
            high = np.ceil((np.array(shape.bounds[2:]) + MARGIN - corner) / RESOLUTION).astype(int)
            window = distances[low[1] : high[1], low[0] : high[0]]
            y, x = np.mgrid[low[1] : low[1] + window.shape[0], low[0] : low[0] + window.shape[1]]
            seen = shape.distances((x + 0.5) * RESOLUTION + corner[0], (y + 0.5) * RESOLUTION + corner[1])
            window[:] = np.minimum(window, seen) if is_free else np.maximum(window, -seen)
        free = np.clip(0.5 - distances / (2.0 * RESOLUTION), 0.0, 1.0)  # its outline is the walls
        return World(trace_walls(free, RESOLUTION, corner[0], corner[1], TOLERANCE), plan.start, name)
