"""Maps that a laser draws: occupancy grids of one particle or many, which scans clear and raise walls in.

Uses its siblings `laser_scan` and `tree_map`, whose cells and patches they are.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.laser_scan import Scan
from slam.params import Params
from slam.pose import transform
from slam.scan_matching import turned
from slam.tree_map import Rule, Run, TreeMaps, clear, hit, on_all

COARSEST = 64  # beams, of which one clears the cells next to the laser


class LaserMapParams(Params):
    """Cells, and how a scan changes them."""

    resolution: float = Field(default=0.05, gt=0.0)  # m per cell
    free: float = Field(default=0.4, ge=0.0)  # log odds that a beam takes from a cell it passes,
    occupied: float = Field(default=0.9, ge=0.0)  # and adds to the one it ends in,
    most: float = Field(default=4.0, gt=0.0)  # up to this
    memory: float = Field(default=500.0, ge=1.0)  # ends that a cell's wall is the mean of


@njit(cache=True, nogil=True)
def draw_scan(cells, scan, clears, poses, rule, first, end):
    """Draw a scan into the maps of particles first..end, which took it at `poses` (n, 3).

    Near the laser neighbours cross the same cells, so that only every second, fourth, ... of them clears these.
    """
    for p in range(first, end):
        x, y = poses[p, 0], poses[p, 1]
        cos, sin = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        for k in range(scan.swept.shape[0] if clears else 0):
            dx, dy = turned(cos, sin, scan.swept[k, 0], scan.swept[k, 1])
            fellows = k & -k if k > 0 else COARSEST
            begin = 0.5 * cells.resolution / (scan.spacing * fellows) if fellows < COARSEST else 0.0
            clear(cells, p, x, y, x + dx, y + dy, begin, rule)
        for k in range(scan.points.shape[0]):
            dx, dy = turned(cos, sin, scan.points[k, 0], scan.points[k, 1])
            nx, ny = turned(cos, sin, scan.normals[k, 0], scan.normals[k, 1])
            hit(cells, p, x + dx, y + dy, nx, ny, rule)


class LaserMaps(TreeMaps):
    """Maps of n particles that scans are drawn into."""

    def __init__(self, n_particles: int, params: LaserMapParams):
        super().__init__(n_particles, params.resolution)
        self.rule = Rule(params.free, params.occupied, params.most, params.memory)

    def draw(self, scan: Scan, poses: np.ndarray, clears: bool = True, run: Run | None = None) -> None:
        """Draw a scan that the particles took at poses (n, 3); unless it `clears`, only its walls.

        `run` shares the particles out among threads.
        """
        poses = np.ascontiguousarray(poses, float)
        swept = scan.swept if clears else scan.swept[:0]
        starts = np.ascontiguousarray(poses[:, :2])
        self.prepare(starts, transform(poses[:, None], swept), transform(poses[:, None], scan.points), run)
        on_all(run, len(poses), lambda first, end: draw_scan(
            self.cells, scan, clears, poses, self.rule, first, end
        ))  # fmt: skip
