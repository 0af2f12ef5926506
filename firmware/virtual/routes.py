"""Ways through a world's free space: from place to place by A*, and long tours that come back to known places."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from firmware.virtual.plans import Plan, PlanError
from firmware.virtual.worlds import World

RESOLUTION = 0.10  # m
CLEARANCE = 0.25  # m that the robot's centre keeps from walls
ROOMY = 0.60  # m beyond which more room is no better
CROWDED_COST = 4.0  # times a metre's cost at the least clearance
NEIGHBOURS = [(dx, dy, math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


class FreeSpace:
    """Cells (rows, columns) that the robot's centre may enter and that connect to the world's start.

    In worlds drawn from grids, only cells known to be free count.
    """

    def __init__(self, world: World, resolution: float = RESOLUTION, clearance: float = CLEARANCE):
        self.world = world
        self.resolution = resolution
        left, bottom, right, top = world.bounds
        self.origin = np.array([left, bottom])
        self.columns = math.ceil((right - left) / resolution) + 1
        self.rows = math.ceil((top - bottom) / resolution) + 1
        centres = self.centre(np.arange(self.rows * self.columns))
        self.room = np.minimum(world.clearances(centres, ROOMY), ROOMY)
        is_open = self.room >= clearance
        if world.free is not None:
            known = np.zeros(len(is_open), bool)
            known[self.cells_of(self.spread(world.free, world.free_resolution))] = True
            is_open &= known
        self.is_free = self.connected(is_open)

    def spread(self, points: np.ndarray, side: float) -> np.ndarray:
        """Points enough to hit every cell of ours that squares of `side` around the given centres touch."""
        shifts = np.arange(-0.5 * side, 0.5 * side + 1e-9, min(side, self.resolution) / 2.0)
        return (points[:, None, None, :] + np.stack(np.meshgrid(shifts, shifts), axis=-1)).reshape(-1, 2)

    def centre(self, cells: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of cells (n,)."""
        rows, columns = np.divmod(cells, self.columns)
        return np.stack([columns, rows], axis=-1) * self.resolution + self.origin

    def cells_of(self, points: np.ndarray) -> np.ndarray:
        """Cells (n,) nearest to points (n, 2); those outside are put on the border."""
        at = np.rint((np.asarray(points, float) - self.origin) / self.resolution).astype(int)
        return at[..., 1].clip(0, self.rows - 1) * self.columns + at[..., 0].clip(0, self.columns - 1)

    def connected(self, is_open: np.ndarray) -> np.ndarray:
        """The part of the open cells that the start belongs to."""
        candidates = np.flatnonzero(is_open)
        if not len(candidates):
            raise PlanError(f"{self.world.name}: nowhere to drive: no place is {CLEARANCE} m from all walls")
        distances = np.hypot(*(self.centre(candidates) - self.world.start[:2]).T)
        first = int(candidates[np.argmin(distances)])
        reached = np.zeros(len(is_open), bool)
        reached[first] = True
        frontier = np.array([first])
        while len(frontier):
            rows, columns = np.divmod(frontier, self.columns)
            around = [
                frontier[ok] + step
                for ok, step in (
                    (columns > 0, -1),
                    (columns < self.columns - 1, 1),
                    (rows > 0, -self.columns),
                    (rows < self.rows - 1, self.columns),
                )
            ]
            found = np.unique(np.concatenate(around))
            frontier = found[is_open[found] & ~reached[found]]
            reached[frontier] = True
        return reached

    @cached_property
    def costs(self) -> list[float]:
        """Cost of a cell per metre, as a plain list: 1 with room, more near walls."""
        crowding = (ROOMY - self.room) / (ROOMY - CLEARANCE)
        return (1.0 + (CROWDED_COST - 1.0) * np.clip(crowding, 0.0, 1.0) ** 2).tolist()

    @cached_property
    def free_bytes(self) -> bytes:
        """`is_free` with the border taken away, one byte a cell, so that neighbours need no bounds check."""
        grid = self.is_free.reshape(self.rows, self.columns).copy()
        grid[[0, -1], :] = False
        grid[:, [0, -1]] = False
        return grid.astype(np.uint8).tobytes()

    def nearest(self, place: Sequence[float] | np.ndarray) -> int:
        """The free cell nearest to a place; raises PlanError if none is within a metre."""
        cells = np.flatnonzero(np.frombuffer(self.free_bytes, np.uint8))
        distances = np.hypot(*(self.centre(cells) - np.asarray(place, float)).T)
        best = int(np.argmin(distances))
        if distances[best] > 1.0:
            raise PlanError(
                f"{self.world.name}: ({place[0]:g}, {place[1]:g}) cannot be reached; name a place in the free space"
            )
        return int(cells[best])

    def path(self, start: int, goal: int) -> list[int]:
        """Cells of the cheapest way (A*, octile distance); raises PlanError if there is none."""
        free, costs, columns = self.free_bytes, self.costs, self.columns
        goal_row, goal_column = divmod(goal, columns)
        steps = [(dy * columns + dx, length) for dx, dy, length in NEIGHBOURS]
        best = {start: 0.0}
        parent = {start: start}
        heap = [(0.0, start)]
        closed = set()
        while heap:
            _, cell = heapq.heappop(heap)
            if cell == goal:
                return unwound(parent, cell)
            if cell in closed:
                continue
            closed.add(cell)
            so_far = best[cell]
            for step, length in steps:
                beside = cell + step
                if not free[beside]:
                    continue
                cost = so_far + length * costs[beside]
                if cost < best.get(beside, math.inf):
                    best[beside] = cost
                    parent[beside] = cell
                    row, column = divmod(beside, columns)
                    dx, dy = abs(column - goal_column), abs(row - goal_row)
                    heapq.heappush(heap, (cost + max(dx, dy) + 0.41421 * min(dx, dy), beside))
        raise PlanError(f"{self.world.name}: no way between two of the places")

    def way(self, start: int, goal: int) -> np.ndarray:
        """Smoothed points (n, 2) from one cell to another, about 0.2 m apart."""
        points = self.centre(np.array(self.path(start, goal)))
        for _ in range(3):  # three passes of 1 2 1, the ends held; a cell's width at most
            if len(points) > 2:
                points[1:-1] = 0.25 * points[:-2] + 0.5 * points[1:-1] + 0.25 * points[2:]
        keep = np.unique(np.append(np.arange(0, len(points), 2), len(points) - 1))
        return points[keep]


def unwound(parent: dict[int, int], cell: int) -> list[int]:
    """Cells from the start to `cell`."""
    path = [cell]
    while parent[cell] != cell:
        cell = parent[cell]
        path.append(cell)
    return path[::-1]


def route(world: World, places: Sequence[Sequence[float]], speed: float = 0.3) -> Plan:
    """Plan through a handful of places (x, y) of a floor, each leg by the cheapest way. Raises PlanError."""
    if len(places) < 2:
        raise PlanError(f"{world.name}: a route needs at least two places")
    space = FreeSpace(world)
    cells = [space.nearest(place) for place in places]
    return joined([space.way(a, b) for a, b in itertools.pairwise(cells)], speed, f"route-{world.name}")


def joined(ways: list[np.ndarray], speed: float, name: str) -> Plan:
    """One plan of several ways, each beginning where the last one ended."""
    points = np.vstack([ways[0][:1], *[way[1:] for way in ways]])
    return Plan.through(points, speed, name=name)


def landmarks(space: FreeSpace, count: int, rng: np.random.Generator) -> list[int]:
    """Free cells indoors and far from each other, the start's first: each next one is drawn among the farthest."""
    cells = np.flatnonzero(np.frombuffer(space.free_bytes, np.uint8))
    score = space.world.enclosure(space.centre(cells)) + space.room[cells] / ROOMY
    cells = cells[score >= 0.85 * score.max()]
    centres = space.centre(cells)
    chosen = [space.nearest(space.world.start[:2])]
    distances = np.hypot(*(centres - space.centre(np.array(chosen))[0]).T)
    while len(chosen) < count:
        farthest = np.argsort(distances)[-max(1, len(cells) // 50) :]
        pick = int(rng.choice(farthest))
        chosen.append(int(cells[pick]))
        distances = np.minimum(distances, np.hypot(*(centres - centres[pick]).T))
    return chosen


def tour(world: World, length: float, seed: int, places: int = 8, speed: float = 0.3) -> Plan:
    """Seeded random tour of about `length` metres that visits far places again and again. Raises PlanError."""
    space = FreeSpace(world)
    rng = np.random.default_rng([seed, 0x70])
    cells = landmarks(space, places, rng)
    here, ways, driven, visits = 0, [], 0.0, np.zeros(places)
    known: dict[tuple[int, int], np.ndarray] = {}
    while driven < length:
        visits[here] += 1.0
        weights = np.where(np.arange(places) == here, 0.0, 1.0 / (1.0 + visits) ** 2)
        there = int(rng.choice(places, p=weights / weights.sum()))
        if (here, there) not in known:
            known[here, there] = space.way(cells[here], cells[there])
            known[there, here] = known[here, there][::-1]
        ways.append(known[here, there])
        driven += float(np.sum(np.hypot(*np.diff(ways[-1], axis=0).T)))
        here = there
    return joined(ways, speed, f"tour-{world.name}-{seed}")
