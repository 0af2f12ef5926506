"""Occupancy grids of many particles that share what they have in common: patches of cells, copied when written to.

Every particle has a table of patches. A child begins with its parent's, so that all that lies behind the last common
ancestor of all particles (the trunk of the path tree) is stored once, and a branch of the crown owns the patches that
were written since it parted. Memory grows with the map, and with what the branches see in the open.

A cell holds the log odds that it is occupied, and a *surfel*: the mean of the ends of beams that fell into it, and of
the normals of their walls, which says where in the cell the wall stands. Few cells have one: bits tell which.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.grid import Grid

SIDE, SHIFT, MASK = 32, 5, 31  # cells along a patch, and how a cell's number is split
NONE = -1  # in a table: nothing was seen there
HITS, X, Y, NORMAL_X, NORMAL_Y = range(5)  # of a surfel
FIRST_PATCHES = 256
FIRST_ROWS = 8  # of a table
Run = Callable[[Callable[[int, int], None]], object]  # a task of particles first..end, on all of them
MARGIN = 2  # patches by which a table grows beyond what is needed
STRIDE = 8  # steps of a beam between two at which a survey looks


class Cells(NamedTuple):
    """What the particles' maps hold.

    `table` (n, rows, columns) int32 names each particle's patches, the first of which begins at the world's cell
    (`row`, `column`); `odds` (patches, 32, 32) and `surfels` (patches, 32, 32, 5) float32; bit j of `filled`
    (patches, 32) uint32 is set where row i's cell j has a surfel; `resolution` m per cell.
    """

    table: np.ndarray
    odds: np.ndarray
    surfels: np.ndarray
    filled: np.ndarray
    row: int
    column: int
    resolution: float


class Pool(NamedTuple):
    """How many tables name each patch (patches,), and the free ones: the first `top[0]` of `free` (patches,)."""

    references: np.ndarray
    free: np.ndarray
    top: np.ndarray


class Rule(NamedTuple):
    """How a scan changes log odds, their bound, and how many ends a surfel remembers."""

    free: float
    occupied: float
    most: float
    memory: float


@njit(cache=True, inline="always")
def cell_of(x, resolution):
    """The row or column of a coordinate."""
    return math.floor(x / resolution)


@njit(cache=True, inline="always")
def patch_at(cells, particle, row, column):
    """The particle's patch at a cell of the world, or -1."""
    r, c = (row - cells.row) >> SHIFT, (column - cells.column) >> SHIFT
    if r < 0 or c < 0 or r >= cells.table.shape[1] or c >= cells.table.shape[2]:
        return NONE
    return cells.table[particle, r, c]


@njit(cache=True, inline="always")
def steps_of(dx, dy, resolution):
    """How many steps a beam takes, none longer than a cell."""
    return int(max(abs(dx), abs(dy)) / resolution) + 1


@njit(cache=True, inline="always")
def need(low_row, high_row, low_column, high_column, needed, box):
    """Note that these patches will be written: in `needed` (rows, columns), or else only in the `box` (4,)."""
    box[0], box[1] = min(box[0], low_row), max(box[1], high_row)
    box[2], box[3] = min(box[2], low_column), max(box[3], high_column)
    for r in range(max(0, low_row), min(high_row + 1, needed.shape[0])):
        for c in range(max(0, low_column), min(high_column + 1, needed.shape[1])):
            needed[r, c] = True


@njit(cache=True, nogil=True)
def survey(cells, starts, cleared, ends, needed, boxes, low, high):
    """Note the patches that particles low..high write, and the `boxes` (n, 4) of them.

    Beams go from `starts` (n, 2); they clear up to `cleared` (n, k, 2) and hit at `ends` (n, m, 2). A beam's rows and
    columns never turn back, so that all between two of its steps lies in the rectangle of these.
    """
    resolution = cells.resolution
    for p in range(low, high):
        there, box = needed[p], boxes[p]
        for k in range(cleared.shape[1]):
            x, y = starts[p, 0], starts[p, 1]
            dx, dy = cleared[p, k, 0] - x, cleared[p, k, 1] - y
            steps = steps_of(dx, dy, resolution)
            r, c = (cell_of(y, resolution) - cells.row) >> SHIFT, (cell_of(x, resolution) - cells.column) >> SHIFT
            s = 0
            while s < steps:
                s = min(s + STRIDE, steps)
                share = s / steps
                to_r = (cell_of(y + share * dy, resolution) - cells.row) >> SHIFT
                to_c = (cell_of(x + share * dx, resolution) - cells.column) >> SHIFT
                if to_r != r or to_c != c or s <= STRIDE:
                    need(min(r, to_r), max(r, to_r), min(c, to_c), max(c, to_c), there, box)
                    r, c = to_r, to_c
        for k in range(ends.shape[1]):
            r = (cell_of(ends[p, k, 1], resolution) - cells.row) >> SHIFT
            c = (cell_of(ends[p, k, 0], resolution) - cells.column) >> SHIFT
            need(r, r, c, c, there, box)


@njit(cache=True)
def claim(cells, pool, particle, needed):
    """Give a particle patches of its own where `needed` (rows, columns); False, some of it done, where room ends."""
    for r in range(needed.shape[0]):
        for c in range(needed.shape[1]):
            old = cells.table[particle, r, c]
            if not needed[r, c] or (old != NONE and pool.references[old] == 1):
                continue
            if pool.top[0] == 0:
                return False
            pool.top[0] -= 1
            new = pool.free[pool.top[0]]
            pool.references[new] = 1
            if old == NONE:
                cells.odds[new] = 0.0
                cells.surfels[new] = 0.0
                cells.filled[new] = 0
            else:
                cells.odds[new] = cells.odds[old]
                cells.surfels[new] = cells.surfels[old]
                cells.filled[new] = cells.filled[old]
                pool.references[old] -= 1
            cells.table[particle, r, c] = new
    return True


@njit(cache=True)
def descend(table, pool, ancestors):
    """The tables of the children of `ancestors` (m,); patches that no child names become free."""
    children = np.empty((ancestors.size, table.shape[1], table.shape[2]), np.int32)
    for child in range(ancestors.size):
        for r in range(table.shape[1]):
            for c in range(table.shape[2]):
                patch = table[ancestors[child], r, c]
                children[child, r, c] = patch
                if patch != NONE:
                    pool.references[patch] += 1
    for parent in range(table.shape[0]):
        for r in range(table.shape[1]):
            for c in range(table.shape[2]):
                patch = table[parent, r, c]
                if patch != NONE:
                    pool.references[patch] -= 1
                    if pool.references[patch] == 0:
                        pool.free[pool.top[0]] = patch
                        pool.top[0] += 1
    return children


@njit(cache=True, nogil=True)
def clear(cells, particle, x, y, end_x, end_y, begin, rule):
    """Lower the log odds of the cells from `begin` m on along a beam, up to the one before its end's."""
    resolution = cells.resolution
    dx, dy = end_x - x, end_y - y
    steps = steps_of(dx, dy, resolution)
    length = math.hypot(dx, dy)
    first = math.ceil(begin / length * steps) if length > 0.0 else steps
    end_row, end_column = cell_of(end_y, resolution), cell_of(end_x, resolution)
    last_row, last_column = end_row, end_column
    for s in range(first, steps):
        share = s / steps
        row, column = cell_of(y + share * dy, resolution), cell_of(x + share * dx, resolution)
        if row == last_row and column == last_column:
            continue
        last_row, last_column = row, column
        if row == end_row and column == end_column:
            continue
        patch = patch_at(cells, particle, row, column)
        i, j = (row - cells.row) & MASK, (column - cells.column) & MASK
        cells.odds[patch, i, j] = max(-rule.most, cells.odds[patch, i, j] - rule.free)


@njit(cache=True, nogil=True)
def hit(cells, particle, x, y, normal_x, normal_y, rule):
    """Raise the log odds of the cell that a beam ended in, and take up where; without a normal only the odds."""
    row, column = cell_of(y, cells.resolution), cell_of(x, cells.resolution)
    patch = patch_at(cells, particle, row, column)
    i, j = (row - cells.row) & MASK, (column - cells.column) & MASK
    cells.odds[patch, i, j] = min(rule.most, cells.odds[patch, i, j] + rule.occupied)
    if normal_x == 0.0 and normal_y == 0.0:
        return
    cells.filled[patch, i] |= np.uint32(1 << j)
    surfels = cells.surfels
    hits = min(surfels[patch, i, j, HITS] + 1.0, rule.memory)
    surfels[patch, i, j, HITS] = hits
    surfels[patch, i, j, X] += (x - surfels[patch, i, j, X]) / hits
    surfels[patch, i, j, Y] += (y - surfels[patch, i, j, Y]) / hits
    surfels[patch, i, j, NORMAL_X] += (normal_x - surfels[patch, i, j, NORMAL_X]) / hits
    surfels[patch, i, j, NORMAL_Y] += (normal_y - surfels[patch, i, j, NORMAL_Y]) / hits


def on_all(run: Run | None, n: int, task: Callable[[int, int], None]) -> None:
    """Run task(first, end) over n particles, shared out among threads where there is a `run` that does that."""
    if run is None:
        task(0, n)
    else:
        run(task)


class TreeMaps:
    """The maps of n particles: `prepare` them for a scan, write with the kernels, `inherit` at a resampling."""

    def __init__(self, n_particles: int, resolution: float):
        half = FIRST_ROWS // 2 * SIDE
        self.cells = Cells(
            np.full((n_particles, FIRST_ROWS, FIRST_ROWS), NONE, np.int32),
            np.empty((FIRST_PATCHES, SIDE, SIDE), np.float32),
            np.empty((FIRST_PATCHES, SIDE, SIDE, 5), np.float32),
            np.empty((FIRST_PATCHES, SIDE), np.uint32),
            -half, -half, resolution,
        )  # fmt: skip
        free = np.arange(FIRST_PATCHES, dtype=np.int32)
        self.pool = Pool(np.zeros(FIRST_PATCHES, np.int32), free, np.array([FIRST_PATCHES]))

    @property
    def n_patches(self) -> int:
        """How many patches there are in all maps, shared ones counted once."""
        return len(self.pool.free) - int(self.pool.top[0])

    def prepare(self, starts: np.ndarray, cleared: np.ndarray, ends: np.ndarray, run: Run | None = None) -> None:
        """Let every particle own what beams from `starts` (n, 2) will write: clear up to (n, k, 2), hit at (n, m, 2).

        `run` shares the particles out among threads. ValueError for a beam that ends nowhere.
        """
        if not (np.all(np.isfinite(starts)) and np.all(np.isfinite(cleared)) and np.all(np.isfinite(ends))):
            raise ValueError("beams must begin and end somewhere")
        needed = self.survey(starts, cleared, ends, run)
        for particle in range(len(starts)):
            while not claim(self.cells, self.pool, particle, needed[particle]):
                self.grow()

    def survey(self, starts: np.ndarray, cleared: np.ndarray, ends: np.ndarray, run: Run | None) -> np.ndarray:
        """The patches (n, rows, columns) that will be written, in tables that hold them all."""
        while True:
            needed, boxes = np.zeros(self.cells.table.shape, np.bool_), np.zeros((len(starts), 4), np.int64)
            on_all(run, len(starts), lambda low, high: survey(
                self.cells, starts, cleared, ends, needed, boxes, low, high  # noqa: B023 (run at once)
            ))  # fmt: skip
            box = np.stack([boxes[:, 0].min(), boxes[:, 1].max(), boxes[:, 2].min(), boxes[:, 3].max()])
            sizes = self.cells.table.shape
            beyond = np.array([-box[0], box[1] + 1 - sizes[1], -box[2], box[3] + 1 - sizes[2]])
            if not np.any(beyond > 0):
                return needed
            self.widen(np.where(beyond > 0, beyond + MARGIN, 0))

    def widen(self, by: np.ndarray) -> None:
        """Add by[0] rows below and by[1] above to the tables, and by[2] and by[3] columns left and right."""
        table = np.pad(self.cells.table, ((0, 0), (by[0], by[1]), (by[2], by[3])), constant_values=NONE)
        row, column = self.cells.row - SIDE * int(by[0]), self.cells.column - SIDE * int(by[2])
        self.cells = self.cells._replace(table=table, row=row, column=column)

    def grow(self) -> None:
        """Make room for twice as many patches."""
        n, top = len(self.pool.free), int(self.pool.top[0])
        free = np.concatenate([self.pool.free[:top], np.arange(n, 2 * n, dtype=np.int32), np.zeros(n - top, np.int32)])
        self.pool = Pool(np.concatenate([self.pool.references, np.zeros(n, np.int32)]), free, np.array([top + n]))
        odds, surfels = np.empty((2 * n, SIDE, SIDE), np.float32), np.empty((2 * n, SIDE, SIDE, 5), np.float32)
        filled = np.empty((2 * n, SIDE), np.uint32)
        odds[:n], surfels[:n], filled[:n] = self.cells.odds, self.cells.surfels, self.cells.filled
        self.cells = self.cells._replace(odds=odds, surfels=surfels, filled=filled)

    def inherit(self, ancestors: np.ndarray) -> None:
        """The particles become the children of `ancestors` (m,), and share their maps."""
        self.cells = self.cells._replace(table=descend(self.cells.table, self.pool, ancestors))

    def grid(self, particle: int) -> Grid:
        """A particle's log odds as one grid, from the first patch seen to the last; 0 where nothing was seen."""
        table = self.cells.table[particle]
        rows, columns = np.nonzero(table != NONE)
        if not rows.size:
            return Grid(np.zeros((0, 0), np.float32), self.cells.resolution, 0.0, 0.0)
        low, left = int(rows.min()), int(columns.min())
        cells = np.zeros((int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1, SIDE, SIDE), np.float32)
        cells[rows - low, columns - left] = self.cells.odds[table[rows, columns]]
        whole = cells.transpose(0, 2, 1, 3).reshape(cells.shape[0] * SIDE, cells.shape[1] * SIDE)
        resolution = self.cells.resolution
        x, y = resolution * (self.cells.column + SIDE * left), resolution * (self.cells.row + SIDE * low)
        return Grid(whole, resolution, x, y)
