"""Lay a laser scan onto a particle's map: Gauss-Newton on the distances from the walls that its cells remember.

The wall near the end of a beam is the mean of all that the cells around it remember, the nearer the more: an implicit
moving least squares surface (Deschaud, IMLS-SLAM, ICRA 2018), which a wall's cells make smooth together. Uses its
siblings `scan_matching`, for the normal equations, and `tree_map`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.params import Params
from slam.scan_matching import add_term, begin_terms, mirror, solved, turned
from slam.tree_map import HITS, MASK, NONE, NORMAL_X, NORMAL_Y, SIDE, X, Y, cell_of, patch_at

LIKE = 0.5  # cosine between the normals of an end and of what may be its wall
CLEARED = -0.5  # log odds of a cell that is known to be free
SETTLED = 1e-3  # m, or a third as many rad, of a step that is the last one


class Rule(NamedTuple):
    """How ends are laid on walls: `first_reach` shrinks to `last_reach` cells, a cell in each of the `rounds` at most.

    `sigma` m is an end's deviation from its wall; from `kernel` m on it counts less and less, and one where nothing was
    seen costs `unknown` nats.
    """

    rounds: int
    first_reach: float
    last_reach: float
    sigma: float
    kernel: float
    unknown: float


class LayParams(Params):
    """How scans are laid onto maps."""

    rounds: int = Field(default=12, ge=1, le=1000)  # of finding walls and solving, at most
    first_reach: float = Field(default=4.0, gt=0.0)  # cells around an end that its wall is looked for in, at first
    last_reach: float = Field(default=2.5, gt=0.0)  # cells, in the end
    sigma: float = Field(default=0.15, gt=0.0)  # m of an end off its wall; large, for a wall's ends err together
    kernel: float = Field(default=0.15, gt=0.0)  # m off a wall from which an end counts less
    unknown: float = Field(default=0.25, ge=0.0)  # nats that an end costs where nothing was seen yet

    def rule(self) -> Rule:
        """The same, for the kernel."""
        return Rule(self.rounds, self.first_reach, self.last_reach, self.sigma, self.kernel, self.unknown)


@njit(cache=True, inline="always")
def wall_near(cells, particle, x, y, nx, ny, reach, wall):
    """Write the way from the wall near (x, y) along its normal, and the normal, into `wall` (3,); whether there is one.

    Looks `reach` cells around, for walls whose normal is like (nx, ny), or any if that is of zeros.
    """
    resolution, radius = cells.resolution, reach * cells.resolution
    radius2 = radius * radius
    last_column = cell_of(x + radius, resolution)
    like = LIKE if nx != 0.0 or ny != 0.0 else -math.inf
    off, normal_x, normal_y, surfels = 0.0, 0.0, 0.0, cells.surfels
    for r in range(cell_of(y - radius, resolution), cell_of(y + radius, resolution) + 1):
        i, c = (r - cells.row) & MASK, cell_of(x - radius, resolution)
        while c <= last_column:  # one patch after the other
            patch, j = patch_at(cells, particle, r, c), (c - cells.column) & MASK
            count = min(SIDE - j, last_column - c + 1)
            c += count
            if patch == NONE:
                continue
            filled = np.int64(cells.filled[patch, i]) >> j & (1 << count) - 1
            while filled != 0:
                if filled & 1:
                    dx, dy = x - surfels[patch, i, j, X], y - surfels[patch, i, j, Y]
                    along_x, along_y = surfels[patch, i, j, NORMAL_X], surfels[patch, i, j, NORMAL_Y]
                    near = 1.0 - (dx * dx + dy * dy) / radius2
                    if near > 0.0 and nx * along_x + ny * along_y >= like:
                        weight = near * near * surfels[patch, i, j, HITS]
                        off += weight * (dx * along_x + dy * along_y)
                        normal_x += weight * along_x
                        normal_y += weight * along_y
                filled >>= 1
                j += 1
    size = math.hypot(normal_x, normal_y)
    if size == 0.0:
        return False
    wall[0], wall[1], wall[2] = off / size, normal_x / size, normal_y / size
    return True


@njit(cache=True, inline="always")
def is_free(cells, particle, x, y):
    """Whether beams passed through the cell at (x, y) rather than ended there."""
    row, column = cell_of(y, cells.resolution), cell_of(x, cells.resolution)
    patch = patch_at(cells, particle, row, column)
    return patch != NONE and cells.odds[patch, (row - cells.row) & MASK, (column - cells.column) & MASK] < CLEARED


@njit(cache=True, nogil=True)
def lay(cells, particle, scan, pose, prior, rule, hessian):
    """Move `pose` (3,) so that a scan's ends come to lie on the particle's walls; what their misfit costs (nats).

    `prior` (3, 3) is the information on the guess, `hessian` (3, 3) is left with that on the answer. An end that a wall
    is missing for costs the most where the map is known to be free, and `unknown` where it is not known.
    """
    guess = pose.copy()
    gradient, wall = np.empty(3), np.empty(3)
    reach, cost = rule.first_reach, 0.0
    most = 0.5 * (rule.kernel / rule.sigma) ** 2
    for _ in range(rule.rounds):
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        cost = begin_terms(prior, pose, guess, gradient, hessian)
        for i in range(scan.points.shape[0]):
            px, py = turned(cos, sin, scan.points[i, 0], scan.points[i, 1])
            nx, ny = turned(cos, sin, scan.normals[i, 0], scan.normals[i, 1])
            x, y = px + pose[0], py + pose[1]
            if not wall_near(cells, particle, x, y, nx, ny, reach, wall):
                cost += most if is_free(cells, particle, x, y) else rule.unknown
                continue
            share = 1.0 / (1.0 + (wall[0] / rule.kernel) ** 2)
            cost += 0.5 * (wall[0] / rule.sigma) ** 2 * share
            weight = share * share / rule.sigma**2
            add_term(weight, wall[0], wall[1], wall[2], wall[2] * px - wall[1] * py, gradient, hessian)
        mirror(hessian)
        step = solved(hessian, gradient)
        pose -= step
        if reach <= rule.last_reach and max(math.hypot(step[0], step[1]), 3.0 * abs(step[2])) < SETTLED:
            break
        reach = max(rule.last_reach, reach - 1.0)
    return cost
