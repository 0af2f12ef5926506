"""A grid of cells on the floor: an array, its resolution and its origin. Row is y, column is x, cells hold log odds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Grid(NamedTuple):
    """`cells` (rows, columns) float32 log odds; `resolution` m per cell; (x, y) of cell (0, 0)'s corner."""

    cells: np.ndarray
    resolution: float
    x: float
    y: float


def probability(log_odds: np.ndarray) -> np.ndarray:
    """Probability of occupation of cells that hold log odds."""
    return 1.0 / (1.0 + np.exp(-np.asarray(log_odds, float)))
