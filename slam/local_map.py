"""The rolling occupancy grid around the robot, in which sonar and infra-red meet (Crunch thesis, 2.1).

The grid keeps the odometry frame's orientation and moves by whole cells, so that nothing is ever resampled; the
thesis's own way, transform and resample at every move, stands beside it as `resample = true`. Fusion is
pseudo-Bayesian: log odds add up and are clamped low, so that new readings overrule strong priors quickly. Uses its
sibling `sweep_filling`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.grid import Grid
from slam.params import Params
from slam.pose import between
from slam.rangefinder import RingParams
from slam.sweep_filling import sweeps_between

SONAR, INFRARED, BEAM = 0, 1, 2
MAX_REACH = 20.0  # m; farther walls would make the comparison of maps slow, and no robot here sees them
STRIDE = 4  # cells that the robot may be off the middle before the window moves
MODELS = {"sonar": SONAR, "infrared": INFRARED, "beam": BEAM}


class LocalMapParams(Params):
    """Size of the local map and strength of the evidence, as log odds per reading."""

    reach: float | None = Field(default=None, gt=0.0, le=MAX_REACH)  # m to the border; None follows the sensors
    reach_share: float = Field(
        default=2.0 / 3.0, gt=0.0, le=1.0
    )  # of the longest sensor's range, where reach follows the sensors
    farthest: float = Field(default=MAX_REACH, gt=0.0, le=MAX_REACH)  # m, of a reach that follows the sensors
    bridge: float = Field(
        default=2.0, ge=0.0
    )  # times the robot's motion between two sweeps that a wall may go on for, which they fill in; 0 fills nothing
    finest_cell: float = Field(default=0.025, ge=0.01)  # m
    cells_per_reach: int = Field(default=80, gt=10, le=500)  # bounds the grid of far-seeing sensors
    clamp: float = Field(default=2.5, gt=0.0)
    beam_hit: float = Field(default=0.9, ge=0.0)
    beam_miss: float = Field(default=0.35, ge=0.0)
    sonar_hit: float = Field(default=0.10, ge=0.0)
    sonar_miss: float = Field(default=0.12, ge=0.0)
    sonar_silent_miss: float = Field(default=0.4, ge=0.0, le=1.0)  # share of sonar_miss when there was no echo
    sonar_silent_reach: float = Field(default=0.33, ge=0.0, le=1.0)  # share of max_range freed when there was no echo
    silent_reach: float = Field(default=0.875, ge=0.0, le=1.0)  # the same for infra-red and laser beams
    sonar_arc: float = Field(default=0.04, gt=0.0)  # m, half the thickness of the arc where an echo may come from
    sonar_margin: float = Field(default=0.06, ge=0.0)  # m before the echo that are not called free
    footprint: float = Field(default=0.09, ge=0.0)  # m around the robot that are free because its decks are there
    resample: bool = False  # the thesis's transform-and-resample at every move


class Evidence(NamedTuple):
    """The parameters as the kernels take them."""

    clamp: float
    beam_hit: float
    beam_miss: float
    sonar_hit: float
    sonar_miss: float
    sonar_silent_miss: float
    sonar_silent_reach: float
    silent_reach: float
    sonar_arc: float
    sonar_margin: float


class Ring(NamedTuple):
    """A ring of rangefinders as the kernels take it; `model` is SONAR, INFRARED or BEAM, bearings are (n,) rad."""

    model: int
    bearings: np.ndarray
    offset: float
    height: float
    half_angle: float
    min_range: float
    max_range: float


class Beam(NamedTuple):
    """One reading on the floor: start and bearing in the grid's frame, free up to `free` m, a wall at `echo` or inf."""

    x: float
    y: float
    bearing: float
    free: float
    echo: float


@njit(cache=True)
def shift_cells(cells, columns, rows):
    """Cells after the window moved by whole columns and rows; what comes into view is unknown (0)."""
    n = cells.shape[0]
    moved = np.zeros_like(cells)
    for row in range(max(0, -rows), min(n, n - rows)):
        for column in range(max(0, -columns), min(n, n - columns)):
            moved[row, column] = cells[row + rows, column + columns]
    return moved


@njit(cache=True)
def resample_cells(cells, resolution, x, y, theta):
    """Cells of the window after the robot moved by (x, y, theta) in the window's frame, bilinearly (thesis, 2.1)."""
    n = cells.shape[0]
    middle = 0.5 * (n - 1)
    cos, sin = math.cos(theta), math.sin(theta)
    moved = np.zeros_like(cells)
    for row in range(n):
        u0 = x / resolution + middle - sin * (row - middle) - cos * middle
        v0 = y / resolution + middle + cos * (row - middle) - sin * middle
        for column in range(n):
            u, v = u0 + cos * column, v0 + sin * column
            if 0.0 <= u < n - 1 and 0.0 <= v < n - 1:
                i, j = int(v), int(u)
                down, right = v - i, u - j
                above = cells[i, j] + right * (cells[i, j + 1] - cells[i, j])
                below = cells[i + 1, j] + right * (cells[i + 1, j + 1] - cells[i + 1, j])
                moved[row, column] = above + down * (below - above)
            elif -1.0 < u < n and -1.0 < v < n:  # on the border, beyond which cells are unknown
                i, j = math.floor(v), math.floor(u)
                for di in range(2):
                    for dj in range(2):
                        if 0 <= i + di < n and 0 <= j + dj < n:
                            share = (1.0 - abs(v - i - di)) * (1.0 - abs(u - j - dj))
                            moved[row, column] += share * cells[i + di, j + dj]
    return moved


@njit(cache=True)
def fuse_beam(grid, beam, sigma, evidence):
    """Add a thin beam: free up to its end, and a Gaussian bump of `sigma` m along it where the wall is."""
    n = grid.cells.shape[0]
    resolution = grid.resolution
    x, y = beam.x - grid.x, beam.y - grid.y
    cos, sin = math.cos(beam.bearing), math.sin(beam.bearing)
    steps = int(beam.free / resolution) + 1 if beam.free > 0.0 else 0
    for step in range(steps):
        row = math.floor((y + step * resolution * sin) / resolution)
        column = math.floor((x + step * resolution * cos) / resolution)
        if row < 0 or column < 0 or row >= n or column >= n:
            break
        grid.cells[row, column] = max(-evidence.clamp, grid.cells[row, column] - evidence.beam_miss)
    if not math.isfinite(beam.echo):
        return
    width = max(1, int(sigma / resolution + 0.5))
    last_row, last_column = -1, -1
    for step in range(-width, width + 1):
        distance = beam.echo + step * resolution
        row, column = math.floor((y + distance * sin) / resolution), math.floor((x + distance * cos) / resolution)
        if row < 0 or column < 0 or row >= n or column >= n or (row == last_row and column == last_column):
            continue
        last_row, last_column = row, column
        weight = evidence.beam_hit * math.exp(-0.5 * (step * resolution / sigma) ** 2)
        grid.cells[row, column] = min(evidence.clamp, grid.cells[row, column] + weight)


@njit(cache=True)
def sector_chord(dy, reach, cos_left, sin_left, cos_right, sin_right):
    """From where to where, along x, a line `dy` beside the tip of a sector of radius `reach` may lie in the sector."""
    high = math.sqrt(max(0.0, reach * reach - dy * dy))
    low = -high
    if sin_right > 0.0:
        high = min(high, cos_right * dy / sin_right)
    elif sin_right < 0.0:
        low = max(low, cos_right * dy / sin_right)
    if sin_left > 0.0:
        low = max(low, cos_left * dy / sin_left)
    elif sin_left < 0.0:
        high = min(high, cos_left * dy / sin_left)
    return min(low, reach), max(high, -reach)  # what is farther off may be too many cells to count


@njit(cache=True)
def fuse_cone(grid, beam, half_angle, miss_weight, evidence):
    """Add a sonar cone: free before its end, fading towards the echo, and an arc where the echo may come from.

    Weights fall with the square of the angle off the axis, for which 2 (1 - cos) stands in.
    """
    n = grid.cells.shape[0]
    resolution, arc, clamp = grid.resolution, evidence.sonar_arc, evidence.clamp
    x, y = beam.x - grid.x, beam.y - grid.y
    cos, sin = math.cos(beam.bearing), math.sin(beam.bearing)
    cos_left, sin_left = math.cos(beam.bearing + half_angle), math.sin(beam.bearing + half_angle)
    cos_right, sin_right = math.cos(beam.bearing - half_angle), math.sin(beam.bearing - half_angle)
    edge = math.cos(half_angle)
    sharpness = 2.0 / (half_angle * half_angle)
    end = beam.echo if math.isfinite(beam.echo) else beam.free
    reach = end + arc if math.isfinite(beam.echo) else end
    bulge = reach / edge  # the triangle that holds the sector
    first_row = int((y + bulge * min(0.0, sin_left, sin_right)) / resolution) - 1
    last_row = int((y + bulge * max(0.0, sin_left, sin_right)) / resolution) + 1
    for row in range(max(0, first_row), min(n, last_row + 1)):
        dy = (row + 0.5) * resolution - y
        low, high = sector_chord(dy, reach, cos_left, sin_left, cos_right, sin_right)
        first_column, last_column = math.floor((x + low) / resolution) - 1, math.floor((x + high) / resolution) + 1
        for column in range(max(0, first_column), min(n, last_column + 1)):
            dx = (column + 0.5) * resolution - x
            along = dx * cos + dy * sin
            square = dx * dx + dy * dy
            if along <= 0.0 or square > reach * reach or along * along < edge * edge * square:
                continue
            distance = math.sqrt(square)
            aim = 1.0 - sharpness * (1.0 - along / max(distance, 1e-9))
            if distance < beam.free:
                value = grid.cells[row, column] - miss_weight * aim * (1.0 - distance / end)
                grid.cells[row, column] = max(-clamp, value)
            elif abs(distance - beam.echo) <= arc:
                grid.cells[row, column] = min(clamp, grid.cells[row, column] + evidence.sonar_hit * aim)


@njit(cache=True)
def clear_disc(grid, x, y, radius, clamp):
    """Mark the disc under the robot at (x, y) as free."""
    n = grid.cells.shape[0]
    u, v, resolution = x - grid.x, y - grid.y, grid.resolution
    for row in range(max(0, int((v - radius) / resolution)), min(n, int((v + radius) / resolution) + 1)):
        for column in range(max(0, int((u - radius) / resolution)), min(n, int((u + radius) / resolution) + 1)):
            dx, dy = (column + 0.5) * resolution - u, (row + 0.5) * resolution - v
            if dx * dx + dy * dy <= radius * radius:
                grid.cells[row, column] = -clamp


@njit(cache=True)
def fuse_ring(grid, pose, tilt, ring, ranges, evidence):
    """Add one sweep (n,) of a ring on a body at `pose` (x, y, theta) of the grid's frame that leans forward by `tilt`.

    A leaning beam is projected on the floor; one that ends where it meets the floor speaks only of what is before it.
    """
    lean = ring.height * math.sin(tilt)  # the leaning body carries its sensors forward
    base_x, base_y = pose[0] + lean * math.cos(pose[2]), pose[1] + lean * math.sin(pose[2])
    for i in range(ring.bearings.size):
        echo = ranges[i]
        if math.isnan(echo) or echo < ring.min_range:
            continue
        slope = math.sin(tilt) * math.cos(ring.bearings[i])  # sine of the beam's angle below the horizon
        flat = math.sqrt(1.0 - slope * slope)
        floor = 0.9 * ring.height / slope if slope > 1e-3 else math.inf
        if echo > ring.max_range or echo > floor:
            echo = math.inf
        bearing = pose[2] + ring.bearings[i]
        x, y = base_x + ring.offset * math.cos(bearing), base_y + ring.offset * math.sin(bearing)
        has_echo = math.isfinite(echo)
        if ring.model == SONAR:
            free = (
                echo - evidence.sonar_margin if has_echo else min(evidence.sonar_silent_reach * ring.max_range, floor)
            )
            miss_weight = evidence.sonar_miss * (1.0 if has_echo else evidence.sonar_silent_miss)
            fuse_cone(grid, Beam(x, y, bearing, free * flat, echo * flat), ring.half_angle, miss_weight, evidence)
        else:
            sigma = 0.012 + 0.04 * (min(echo, ring.max_range) / 0.8) ** 2 if ring.model == INFRARED else 0.02
            free = echo - 1.2 * sigma if has_echo else min(evidence.silent_reach * ring.max_range, floor)
            fuse_beam(grid, Beam(x, y, bearing, free * flat - grid.resolution, echo * flat), sigma, evidence)


def ring_arrays(params: RingParams) -> Ring:
    """The ring as the kernels take it."""
    return Ring(
        MODELS[params.model],
        params.bearings,
        params.offset,
        params.height,
        params.half_angle,
        params.min_range,
        params.max_range,
    )


class LocalMap:
    """A square of cells that follows the robot; poses are (3,) in the odometry frame.

    `reach` is how far walls are looked for; a `border` (m) lies around it, for looks from where the robot was before.
    """

    def __init__(self, params: LocalMapParams, sensors: dict[str, RingParams], border: float = 0.0):
        longest = max(ring.max_range for ring in sensors.values())
        followed = min(max(1.0, params.reach_share * longest), params.farthest)
        self.reach = params.reach if params.reach is not None else followed
        self.resolution = max(params.finest_cell, self.reach / params.cells_per_reach)
        half = round((self.reach + border) / self.resolution) + STRIDE
        self.cells = np.zeros((2 * half, 2 * half), np.float32)
        self.half = half
        self.columns, self.rows = -half, -half  # of cell (0, 0)'s corner, in whole cells from the frame's origin
        self.frame = np.zeros(3) if params.resample else None  # odometry-frame pose of a map that is resampled
        self.rings = {name: ring_arrays(ring) for name, ring in sensors.items()}
        self.footprint = params.footprint
        self.bridge = params.bridge
        self.swept: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # pose and ranges of each ring's last sweep
        self.evidence = Evidence(*(getattr(params, name) for name in Evidence._fields))

    def move(self, pose: np.ndarray) -> None:
        """Follow the robot to `pose` (3,), a few cells at a time."""
        if self.frame is not None:
            x, y, turn = between(self.frame, pose)
            self.cells = resample_cells(self.cells, self.resolution, x, y, turn)
            self.frame = np.array(pose, float)
            return
        columns = math.floor(pose[0] / self.resolution) - self.half - self.columns
        rows = math.floor(pose[1] / self.resolution) - self.half - self.rows
        if max(abs(columns), abs(rows)) > STRIDE:
            self.cells = shift_cells(self.cells, columns, rows)
            self.columns += columns
            self.rows += rows

    def in_grid(self, pose: np.ndarray) -> tuple[float, float, float]:
        """`pose` (3,) of the odometry frame in the grid's frame, which is the odometry's unless it is resampled."""
        x, y, theta = pose if self.frame is None else between(self.frame, pose)
        return float(x), float(y), float(theta)

    def fuse(self, sensor: str, ranges: np.ndarray, pose: np.ndarray, tilt: float = 0.0) -> None:
        """Add one sweep (n,) of `sensor` taken at `pose` (3,), here or a little back.

        KeyError for an unknown sensor, ValueError for another number of ranges than it has.
        """
        ring = self.rings[sensor]
        if len(ranges) != ring.bearings.size:
            raise ValueError(f"{sensor} has {ring.bearings.size} beams, not {len(ranges)}")
        if self.bridge > 0.0 and ring.model != SONAR:
            now = np.array(pose, float), np.array(ranges, float)
            before, self.swept[sensor] = self.swept.get(sensor, now), now
            for place, filled in sweeps_between(ring.bearings, before, now, self.bridge, self.resolution):
                fuse_ring(self.grid(), self.in_grid(place), tilt, ring, filled, self.evidence)
        grid, seat = self.grid(), self.in_grid(pose)
        fuse_ring(grid, seat, tilt, ring, ranges, self.evidence)
        clear_disc(grid, seat[0], seat[1], self.footprint, self.evidence.clamp)

    def grid(self) -> Grid:
        """The map as it is now; its cells are the map's own."""
        resolution = self.resolution
        return Grid(self.cells, resolution, self.columns * resolution, self.rows * resolution)
