"""Plywood mazes generated at random: square cells, a way from each to each, some with loops, none like another.

Walls stand between cells; each is as thick as its board. A maze is carved by a random walk that backtracks, then boards
are taken out at random so that there are loops, as in a maze that is rearranged between runs.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from firmware.virtual.worlds import World, WorldError

CELL = 0.6  # m from the middle of a wall to that of the next
BOARD = 0.012  # m of plywood
SIZES = {"small": (3, 3), "medium": (5, 4), "large": (7, 6)}  # columns, rows
LOOPS = 0.15  # of the boards left standing that are taken out

Cell = tuple[int, int]


def passages(columns: int, rows: int, rng: np.random.Generator, loops: float = LOOPS) -> set[frozenset[Cell]]:
    """Pairs of neighbouring cells (column, row) with no board between them."""
    open_pairs: set[frozenset[Cell]] = set()
    stack, seen = [(0, 0)], {(0, 0)}
    while stack:
        ways = [cell for cell in neighbours(stack[-1], columns, rows) if cell not in seen]
        if not ways:
            stack.pop()
            continue
        chosen = ways[rng.integers(len(ways))]
        open_pairs.add(frozenset((stack[-1], chosen)))
        seen.add(chosen)
        stack.append(chosen)
    standing = [pair for pair in pairs_of(columns, rows) if pair not in open_pairs]
    n_out = round(loops * len(standing))
    return open_pairs | {standing[row] for row in rng.permutation(len(standing))[:n_out]}


def neighbours(cell: Cell, columns: int, rows: int) -> list[Cell]:
    """The cells beside one, within the maze."""
    x, y = cell
    beside = [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
    return [(u, v) for u, v in beside if 0 <= u < columns and 0 <= v < rows]


def pairs_of(columns: int, rows: int) -> list[frozenset[Cell]]:
    """All pairs of neighbours, in a fixed order."""
    across = [frozenset(((x, y), (x + 1, y))) for y, x in itertools.product(range(rows), range(columns - 1))]
    return across + [frozenset(((x, y), (x, y + 1))) for y, x in itertools.product(range(rows - 1), range(columns))]


def boards(columns: int, rows: int, open_pairs: set[frozenset[Cell]], cell: float) -> np.ndarray:
    """Middles of all boards (n, 4) as x1, y1, x2, y2; neighbours in a line are one board."""
    stand: list[tuple[float, float, float, float]] = []
    for y in range(rows + 1):  # along x, between the rows y - 1 and y
        closed = [y in (0, rows) or frozenset(((x, y - 1), (x, y))) not in open_pairs for x in range(columns)]
        stand += [(first, y, last, y) for first, last in runs(closed)]
    for x in range(columns + 1):
        closed = [x in (0, columns) or frozenset(((x - 1, y), (x, y))) not in open_pairs for y in range(rows)]
        stand += [(x, first, x, last) for first, last in runs(closed)]
    return cell * np.array(stand, float)


def runs(closed: list[bool]) -> list[tuple[int, int]]:
    """First, and one past the last, of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], closed, [False]]).astype(int)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def maze(size: str | tuple[int, int], seed: int, cell: float = CELL, loops: float = LOOPS) -> World:
    """A maze of a named size, or of so many columns and rows; the robot starts in a corner, looking along a way.

    Its lower left corner is the middle of the first cell, which is where the robot stands. ValueError for a size that
    is none.
    """
    if isinstance(size, str) and size not in SIZES:
        raise ValueError(f"maze of size {size!r}; known: {', '.join(SIZES)}")
    columns, rows = SIZES[size] if isinstance(size, str) else size
    if columns < 2 or rows < 2:
        raise ValueError(f"maze of {columns} x {rows} cells; a maze has two of each at least")
    rng = np.random.default_rng(seed)
    open_pairs = passages(columns, rows, rng, loops)
    middles = boards(columns, rows, open_pairs, cell) - 0.5 * cell
    heading = 0.0 if frozenset(((0, 0), (1, 0))) in open_pairs else 0.5 * math.pi
    return World(outlines(middles, BOARD), (0.0, 0.0, heading), f"maze-{columns}x{rows}-{seed}")


def maze_named(name: str) -> World:
    """The maze `maze:SIZE:SEED`, as in maze:medium:3, or maze:8x5:3 of so many columns and rows; WorldError."""
    _, size, seed = (name.split(":") + ["", ""])[:3]
    columns, x, rows = size.partition("x")
    try:
        if name.count(":") > 2 or not (seed or "0").isdecimal():
            raise ValueError(f"seed {seed!r}")
        return maze((int(columns), int(rows)) if x and columns.isdecimal() else size or "medium", int(seed or 0))
    except ValueError as error:
        raise WorldError(
            f"{name}: names no maze ({error}); write maze:medium:3, or maze:8x5:3 for 8 x 5 cells"
        ) from None


def outlines(middles: np.ndarray, thickness: float) -> np.ndarray:
    """The four sides (4 n, 4) of boards whose middles are (n, 4), along x or y."""
    half = 0.5 * thickness
    low, high = np.minimum(middles[:, :2], middles[:, 2:]) - half, np.maximum(middles[:, :2], middles[:, 2:]) + half
    (x1, y1), (x2, y2) = low.T, high.T
    sides = [(x1, y1, x2, y1), (x2, y1, x2, y2), (x2, y2, x1, y2), (x1, y2, x1, y1)]
    return np.concatenate([np.column_stack(side) for side in sides])
