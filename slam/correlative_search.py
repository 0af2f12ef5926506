"""Where a scan fits another best within a window, by trying all poses of a lattice (Olson, ICRA 2009).

Iterated closest points slide into the nearest valley; after a fast turn, or with no odometry, that is often the wrong
one. Here the reference's ends are painted into a grid, and every heading and shift of the window is looked up in it.
The best pose is a guess for `slam.scan_matching`, no more exact than the lattice.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.laser_scan import Scan
from slam.params import Params
from slam.scan_matching import turned

MOST_CELLS = 1000  # along either side of the grid


class SearchParams(Params):
    """The lattice, and how much an end that fits is worth."""

    resolution: float = Field(default=0.1, gt=0.0)  # m between shifts, and of a cell
    turn: float = Field(default=0.03, gt=0.0)  # rad between headings
    window: float = Field(default=3.0, gt=0.0)  # standard deviations of the guess that are searched,
    most: float = Field(default=0.6, gt=0.0)  # m at most, either way,
    most_turn: float = Field(default=0.8, gt=0.0)  # rad, likewise
    gain: float = Field(default=0.2, gt=0.0)  # nats of an end on a wall; less than 1, for ends err together


@njit(cache=True)
def paint(points, resolution, half, grid):
    """Paint ends (n, 2) into a grid (2 half, 2 half) around the laser: 1 on a wall, less beside it."""
    for i in range(points.shape[0]):
        row = math.floor(points[i, 1] / resolution) + half
        column = math.floor(points[i, 0] / resolution) + half
        for r in range(max(0, row - 1), min(2 * half, row + 2)):
            for c in range(max(0, column - 1), min(2 * half, column + 2)):
                value = 1.0 if r == row and c == column else 0.4
                if grid[r, c] < value:
                    grid[r, c] = value


@njit(cache=True)
def try_poses(points, grid, half, guess, sigmas, turns, shifts, params, best):
    """Look up every pose of the lattice about a guess (3,); the `best` (3,) is filled in, its log density returned.

    `turns` and `shifts` steps of params (resolution, turn, gain) are tried to either side.
    """
    resolution, turn, gain = params
    n, greatest = points.shape[0], -math.inf
    rows, columns = np.empty(n, np.int64), np.empty(n, np.int64)
    for heading in range(-turns, turns + 1):
        theta = guess[2] + heading * turn
        cos, sin = math.cos(theta), math.sin(theta)
        for i in range(n):
            dx, dy = turned(cos, sin, points[i, 0], points[i, 1])
            rows[i] = math.floor((dy + guess[1]) / resolution) + half
            columns[i] = math.floor((dx + guess[0]) / resolution) + half
        for up in range(-shifts, shifts + 1):
            for right in range(-shifts, shifts + 1):
                score = -0.5 * (heading * turn / sigmas[2]) ** 2
                score -= 0.5 * ((right * resolution / sigmas[0]) ** 2 + (up * resolution / sigmas[1]) ** 2)
                for i in range(n):
                    r, c = rows[i] + up, columns[i] + right
                    if 0 <= r < 2 * half and 0 <= c < 2 * half:
                        score += gain * grid[r, c]
                if score > greatest:
                    greatest = score
                    best[0] = guess[0] + right * resolution
                    best[1] = guess[1] + up * resolution
                    best[2] = theta
    return greatest


def search(scan: Scan, other: Scan, guess: np.ndarray, sigmas: np.ndarray, params: SearchParams) -> np.ndarray:
    """The likeliest pose (3,) of a scan in the other's frame, about a guess with standard deviations `sigmas` (3,)."""
    guess, best = np.asarray(guess, float), np.array(guess, float)
    if not len(scan.points) or not len(other.points):
        return best
    reach = float(np.max(other.ranges)) + 2.0 * params.resolution
    half = min(MOST_CELLS // 2, math.ceil(reach / params.resolution))
    grid = np.zeros((2 * half, 2 * half), np.float32)
    paint(other.points, params.resolution, half, grid)
    turns = math.ceil(min(params.most_turn, params.window * float(sigmas[2])) / params.turn)
    shifts = math.ceil(min(params.most, params.window * float(np.max(sigmas[:2]))) / params.resolution)
    lattice = params.resolution, params.turn, params.gain
    try_poses(scan.points, grid, half, guess, np.asarray(sigmas, float), turns, shifts, lattice, best)
    return best
