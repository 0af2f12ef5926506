"""Vector field histogram: from the local map to a direction and a speed (Crunch thesis, 2.2).

Cells count with the square of their certainty, falling linearly to zero at `reach`. Obstacles are widened by the
robot's radius and the clearance, then summed along each direction. Valleys are the arcs whose density stays below the
threshold; the robot steers through the one nearest to the goal. Bearings are in the robot's frame; sector 0 is centred
on straight ahead. After Borenstein and Koren, The vector field histogram, IEEE Transactions on Robotics and Automation
7, 1991; the widening and the place in a wide valley are those of VFH+ (Ulrich and Borenstein, ICRA 1998).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.grid import Grid
from slam.params import Params
from slam.pose import wrap


class VfhParams(Params):
    """Densities are metres of certain wall on the way, discounted with distance."""

    sectors: int = Field(default=72, ge=8, le=720)  # of the polar histogram
    reach: float = Field(default=1.0, gt=0.0, le=20.0)  # m; obstacles beyond do not count
    threshold: float = Field(default=0.01, gt=0.0)  # m; density that closes a sector
    radial_sum: bool = False  # all cells of a direction add up (thesis); otherwise the strongest of each ring
    smoothing: int = Field(default=1, ge=0, le=100)  # neighbours on either side that a sector is averaged with
    robot_radius: float = Field(default=0.076, ge=0.0)  # m
    clearance: float = Field(default=0.12, ge=0.0)  # m, added to the robot's radius
    wide_valley_deg: float = Field(
        default=60.0, gt=0.0, le=180.0
    )  # a wider valley is entered half of this off its side
    commitment: float = Field(
        default=0.5, ge=0.0, le=1.0
    )  # weight of the last bearing against the goal's in a choice of ways
    max_speed: float = Field(default=0.3, gt=0.0)  # m/s
    stop_density: float = Field(default=0.02, gt=0.0)  # m; density straight ahead at which the robot only turns

    @property
    def half_width(self) -> float:
        """What obstacles are widened by, m."""
        return self.robot_radius + self.clearance


class Steering(NamedTuple):
    """Where to go: bearing in the robot's frame, or None if no way is open; speed m/s; the valley's edges."""

    bearing: float | None
    speed: float
    valley: tuple[float, float] | None


class Way(NamedTuple):
    """A bearing in a valley, and by how much the valley's near side misses the goal (0 if it holds it), both in rad."""

    bearing: float
    detour: float
    valley: tuple[float, float]


@njit(cache=True)
def widened_obstacles(grid, pose, reach, limit, half_width, n_sectors, adds_up):
    """Weight (rings, sectors) of the strongest obstacle of each ring that a robot on its way along the sector touches.

    Rings are one cell deep. The weight is certainty^2 (1 - distance / reach); the certainty of a cell is 2 p - 1, that
    is tanh(log odds / 2), and 0 if it is rather free. Cells beyond `limit` m do not count, nor do those within half a
    cell of the robot's centre, which have no bearing. With `adds_up` all cells of a ring count, not only the strongest.
    """
    resolution = grid.resolution
    n_rows, n_columns = grid.cells.shape
    sector_width = 2.0 * math.pi / n_sectors
    polar = np.zeros((int(reach / resolution) + 1, n_sectors))
    u, v = pose[0] - grid.x, pose[1] - grid.y
    first_row, last_row = int(max(0.0, (v - reach) / resolution)), int(max(-1.0, (v + reach) / resolution))
    first_column, last_column = int(max(0.0, (u - reach) / resolution)), int(max(-1.0, (u + reach) / resolution))
    for row in range(first_row, min(n_rows, last_row + 1)):
        for column in range(first_column, min(n_columns, last_column + 1)):
            if grid.cells[row, column] <= 0.0:
                continue
            x, y = (column + 0.5) * resolution - u, (row + 0.5) * resolution - v
            distance = math.sqrt(x * x + y * y)
            if distance >= reach or distance > limit or distance < 0.5 * resolution:
                continue
            weight = math.tanh(0.5 * grid.cells[row, column]) ** 2 * (1.0 - distance / reach)
            ring = int(distance / resolution)
            sector = (math.atan2(y, x) - pose[2]) / sector_width
            spread = math.asin(min(1.0, half_width / distance)) / sector_width
            # every sector whose centre lies in the widened cell, and the one that holds the cell itself
            first = min(math.ceil(sector - spread), round(sector))
            last = max(math.floor(sector + spread), round(sector))
            for k in range(first, last + 1):
                present = polar[ring, k % n_sectors]
                polar[ring, k % n_sectors] = present + weight if adds_up else max(present, weight)
    return polar


class Vfh:
    """Steers around what the local map holds; remembers nothing."""

    def __init__(self, params: VfhParams):
        self.params = params
        self.sector_width = 2.0 * math.pi / params.sectors
        self.kernel = triangle(params.smoothing)
        self.neighbours = np.arange(params.sectors)[:, None] + np.arange(-params.smoothing, params.smoothing + 1)
        self.neighbours %= params.sectors

    def histogram(self, grid: Grid, pose: np.ndarray, limit: float = math.inf) -> np.ndarray:
        """Obstacle density (sectors,) around the robot at `pose` (3,) in the grid's frame; ccw from straight ahead.

        Obstacles farther than `limit` m do not count: whoever has a goal nearer than the reach gives its distance.
        """
        params = self.params
        x, y, theta = (float(value) for value in pose)
        polar = widened_obstacles(
            grid, (x, y, theta), params.reach, limit, params.half_width, params.sectors, params.radial_sum
        )
        densities = grid.resolution * polar.sum(axis=0)
        return densities[self.neighbours] @ self.kernel

    def valleys(self, densities: np.ndarray) -> list[tuple[float, float]]:
        """Edges (start, end) of the open arcs, counter-clockwise: start in (-pi, pi], start < end < start + 2 pi.

        Arcs come in the order of their starts from straight ahead. Without any obstacle there is one, (-pi, pi).
        """
        is_open = densities < self.params.threshold
        if is_open.all():
            return [(-math.pi, math.pi)]
        firsts = np.flatnonzero(is_open & ~np.roll(is_open, 1))
        lasts = np.flatnonzero(is_open & ~np.roll(is_open, -1))
        if firsts.size > 0 and lasts[0] < firsts[0]:  # an arc across sector 0 ends first and starts last
            lasts = np.roll(lasts, -1)
        starts = wrap((firsts - 0.5) * self.sector_width)
        widths = ((lasts - firsts) % is_open.size + 1) * self.sector_width
        return [(float(start), float(start + width)) for start, width in zip(starts, widths, strict=True)]

    def steer(self, densities: np.ndarray, goal_bearing: float, last_bearing: float | None = None) -> Steering:
        """Direction through the valley nearest to the goal, and a speed that falls with what lies straight ahead.

        `last_bearing` is what was chosen before, seen from the present heading: of two ways round an obstacle that are
        about as good, the robot then keeps to the one it has begun.
        """
        ways = [way for valley in self.valleys(densities) for way in self.ways(valley, goal_bearing)]
        if not ways:
            return Steering(None, 0.0, None)
        begun = goal_bearing if last_bearing is None else last_bearing
        commitment = 0.0 if last_bearing is None else self.params.commitment

        def cost(way: Way) -> tuple[bool, float]:
            return way.detour > 0.0, way.detour + commitment * abs(float(wrap(way.bearing - begun)))

        best = min(ways, key=cost)
        return Steering(best.bearing, self.speed(float(densities[0]), best.bearing), best.valley)

    def ways(self, valley: tuple[float, float], goal_bearing: float) -> list[Way]:
        """Bearings to consider in one valley: the goal's if the valley holds it, else those beside its two sides.

        A narrow valley is entered in its middle, a wide one at least half of `wide_valley` off its sides.
        """
        start, end = valley
        width = end - start
        if width >= 2.0 * math.pi - 1e-9:
            return [Way(float(wrap(goal_bearing)), 0.0, valley)]
        margin = 0.5 * min(width, math.radians(self.params.wide_valley_deg))
        into = (goal_bearing - start) % (2.0 * math.pi)
        if into <= width:
            return [Way(float(wrap(start + min(max(into, margin), width - margin))), 0.0, valley)]
        return [
            Way(float(wrap(start + margin)), 2.0 * math.pi - into, valley),
            Way(float(wrap(end - margin)), into - width, valley),
        ]

    def speed(self, density_ahead: float, bearing: float) -> float:
        """Forward speed in m/s: less with obstacles straight ahead, less in turns, none beyond a right angle."""
        return self.params.max_speed * self.room(density_ahead) * max(0.0, 1.0 - abs(bearing) / (0.5 * math.pi))

    def room(self, density: float) -> float:
        """The share of full speed that an obstacle of this density on the way leaves."""
        return max(0.0, 1.0 - density / self.params.stop_density)


def triangle(reach: int) -> np.ndarray:
    """Weights (2 reach + 1,) that fall linearly from the middle and sum to one.

    The weights of Borenstein and Koren's equation 5; its divisor 2 l + 1 would raise the densities l-fold.
    """
    weights = 1.0 + reach - np.abs(np.arange(-reach, reach + 1))
    return weights / weights.sum()
