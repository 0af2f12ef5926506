"""The rolling occupancy grid around the robot, in which sonar and infra-red meet (Crunch thesis, 2.1).

The grid keeps the odometry frame's orientation and moves by whole cells, so that nothing is ever resampled; the
thesis's own way, transform and resample at every move, stands beside it as `resample = true`. Fusion is
pseudo-Bayesian: log odds add up and are clamped low, so that new readings overrule strong priors quickly.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.grid import Grid
from slam.params import Params
from slam.rangefinder import RingParams

SONAR, INFRARED, BEAM = 0, 1, 2
MODELS = {"sonar": SONAR, "infrared": INFRARED, "beam": BEAM}


class LocalMapParams(Params):
    """Size of the local map and strength of the evidence, as log odds per reading."""

    reach: float | None = Field(None, gt=0.0)  # m from the robot to the border; None follows the sensors
    reach_share: float = Field(
        2.0 / 3.0, gt=0.0, le=1.0
    )  # of the longest sensor's range, where reach follows the sensors
    finest_cell: float = Field(0.025, gt=0.0)  # m
    cells_per_reach: int = Field(80, gt=10)  # bounds the grid of far-seeing sensors
    clamp: float = Field(2.5, gt=0.0)
    beam_hit: float = Field(0.9, ge=0.0)
    beam_miss: float = Field(0.35, ge=0.0)
    sonar_hit: float = Field(0.10, ge=0.0)
    sonar_miss: float = Field(0.12, ge=0.0)
    sonar_silent_miss: float = Field(0.4, ge=0.0, le=1.0)  # share of sonar_miss when there was no echo
    sonar_silent_reach: float = Field(0.33, ge=0.0, le=1.0)  # share of max_range freed when there was no echo
    silent_reach: float = Field(0.875, ge=0.0, le=1.0)  # the same for infra-red and laser beams
    sonar_arc: float = Field(0.04, gt=0.0)  # m, half the thickness of the arc where an echo may come from
    sonar_margin: float = Field(0.06, ge=0.0)  # m before the echo that are not called free
    footprint: float = Field(0.12, ge=0.0)  # m around the robot that are free because it stands there
    resample: bool = False  # the thesis's transform-and-resample at every move


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
    half = 0.5 * n
    cos, sin = math.cos(theta), math.sin(theta)
    moved = np.zeros_like(cells)
    for row in range(n):
        for column in range(n):
            forward, left = column + 0.5 - half, row + 0.5 - half
            u = cos * forward - sin * left + x / resolution + half - 0.5
            v = sin * forward + cos * left + y / resolution + half - 0.5
            i, j = math.floor(v), math.floor(u)
            for di in range(2):
                for dj in range(2):
                    if 0 <= i + di < n and 0 <= j + dj < n:
                        share = (1.0 - abs(v - i - di)) * (1.0 - abs(u - j - dj))
                        moved[row, column] += share * cells[i + di, j + dj]
    return moved


@njit(cache=True)
def fuse_beam(cells, resolution, x, y, bearing, free, hit, sigma, miss_weight, hit_weight, clamp):
    """Add one thin beam from (x, y) in grid coordinates (m): free to `free`, a wall near `hit` (inf: none)."""
    n = cells.shape[0]
    cos, sin = math.cos(bearing), math.sin(bearing)
    steps = int(free / resolution) + 1 if free > 0.0 else 0
    for step in range(steps):
        row = math.floor((y + step * resolution * sin) / resolution)
        column = math.floor((x + step * resolution * cos) / resolution)
        if row < 0 or column < 0 or row >= n or column >= n:
            break
        cells[row, column] = max(-clamp, cells[row, column] - miss_weight)
    if not math.isfinite(hit):
        return
    width = max(1, int(sigma / resolution + 0.5))
    last_row, last_column = -1, -1
    for step in range(-width, width + 1):
        distance = hit + step * resolution
        row = math.floor((y + distance * sin) / resolution)
        column = math.floor((x + distance * cos) / resolution)
        if row < 0 or column < 0 or row >= n or column >= n or (row == last_row and column == last_column):
            continue
        last_row, last_column = row, column
        weight = hit_weight * math.exp(-0.5 * (step * resolution / sigma) ** 2)
        cells[row, column] = min(clamp, cells[row, column] + weight)


@njit(cache=True)
def fuse_cone(cells, resolution, x, y, bearing, half_angle, free, echo, arc, miss_weight, hit_weight, clamp):
    """Add one sonar cone from (x, y) in grid coordinates: free before `free`, an arc at `echo` (inf: none).

    Weights fall with the square of the angle off the axis, 2 (1 - cos) standing in for it, and free evidence fades
    towards the echo.
    """
    n = cells.shape[0]
    cos, sin = math.cos(bearing), math.sin(bearing)
    edge = math.cos(half_angle)
    sharpness = 2.0 / (half_angle * half_angle)
    reach = echo + arc if math.isfinite(echo) else free
    fade = 1.0 / max(echo if math.isfinite(echo) else free, 1e-6)
    left = x + reach * min(0.0, math.cos(bearing + half_angle), math.cos(bearing - half_angle), cos)
    right = x + reach * max(0.0, math.cos(bearing + half_angle), math.cos(bearing - half_angle), cos)
    low = y + reach * min(0.0, math.sin(bearing + half_angle), math.sin(bearing - half_angle), sin)
    high = y + reach * max(0.0, math.sin(bearing + half_angle), math.sin(bearing - half_angle), sin)
    for row in range(max(0, int(low / resolution) - 1), min(n, int(high / resolution) + 2)):
        dy = (row + 0.5) * resolution - y
        for column in range(max(0, int(left / resolution) - 1), min(n, int(right / resolution) + 2)):
            dx = (column + 0.5) * resolution - x
            along = dx * cos + dy * sin
            square = dx * dx + dy * dy
            if along <= 0.0 or square > reach * reach or along * along < edge * edge * square:
                continue
            distance = math.sqrt(square)
            aim = 1.0 - sharpness * (1.0 - along / max(distance, 1e-9))
            if distance < free:
                value = cells[row, column] - miss_weight * aim * (1.0 - distance * fade)
                cells[row, column] = max(-clamp, value)
            elif abs(distance - echo) <= arc:
                cells[row, column] = min(clamp, cells[row, column] + hit_weight * aim)


@njit(cache=True)
def clear_disc(cells, resolution, x, y, radius, clamp):
    """Mark the disc under the robot as free."""
    n = cells.shape[0]
    for row in range(max(0, int((y - radius) / resolution)), min(n, int((y + radius) / resolution) + 1)):
        for column in range(max(0, int((x - radius) / resolution)), min(n, int((x + radius) / resolution) + 1)):
            dx, dy = (column + 0.5) * resolution - x, (row + 0.5) * resolution - y
            if dx * dx + dy * dy <= radius * radius:
                cells[row, column] = -clamp


@njit(cache=True)
def fuse_ring(
    cells, resolution, x, y, theta, tilt, model, bearings, offset, height, half_angle, limits, ranges, weights
):
    """Add one sweep of a ring seen from (x, y, theta) in grid coordinates by a body that leans by `tilt`.

    `limits` is (min_range, max_range); `weights` is LocalMap.weights. A beam that leans into the floor speaks only of
    the floor distance before it. Ranges are (n,): inf is no return, nan was not measured.
    """
    clamp, beam_hit, beam_miss, sonar_hit, sonar_miss = weights[0], weights[1], weights[2], weights[3], weights[4]
    silent_miss, silent_sonar, silent_beam, arc, margin = weights[5], weights[6], weights[7], weights[8], weights[9]
    top = height * math.sin(tilt)  # the leaning body carries its sensors forward
    base_x, base_y = x + top * math.cos(theta), y + top * math.sin(theta)
    for beam in range(bearings.size):
        measured = ranges[beam]
        if math.isnan(measured):
            continue
        slope = math.sin(tilt) * math.cos(bearings[beam])  # sine of the beam's angle below the horizon
        floor = height / slope if slope > 1e-3 else math.inf
        if measured < limits[0]:
            continue
        echo = measured
        if echo > limits[1] or echo > 0.9 * floor:
            echo = math.inf
        flat = math.sqrt(1.0 - slope * slope)
        bearing = theta + bearings[beam]
        start_x, start_y = base_x + offset * math.cos(bearing), base_y + offset * math.sin(bearing)
        if model == SONAR:
            if math.isfinite(echo):
                fuse_cone(
                    cells, resolution, start_x, start_y, bearing, half_angle, echo * flat - margin, echo * flat, arc,
                    sonar_miss, sonar_hit, clamp,
                )  # fmt: skip
            else:
                free = min(silent_sonar * limits[1], 0.9 * floor) * flat
                fuse_cone(
                    cells, resolution, start_x, start_y, bearing, half_angle, free, math.inf, arc,
                    sonar_miss * silent_miss, 0.0, clamp,
                )  # fmt: skip
            continue
        sigma = 0.012 + 0.04 * (min(echo, limits[1]) / 0.8) ** 2 if model == INFRARED else 0.02
        if math.isfinite(echo):
            free = echo * flat - 1.2 * sigma - resolution
        else:
            free = min(silent_beam * limits[1], 0.9 * floor) * flat
        fuse_beam(cells, resolution, start_x, start_y, bearing, free, echo * flat, sigma, beam_miss, beam_hit, clamp)


class Ring:
    """A ring of rangefinders as arrays for the kernels."""

    def __init__(self, params: RingParams):
        self.model = MODELS[params.model]
        self.bearings = params.bearings
        self.offset = params.offset
        self.height = params.height
        self.half_angle = params.half_angle
        self.limits = np.array([params.min_range, params.max_range])


class LocalMap:
    """A square of cells that follows the robot; poses are (3,) in the odometry frame."""

    def __init__(self, params: LocalMapParams, sensors: dict[str, RingParams], border: float = 0.0):
        longest = max(ring.max_range for ring in sensors.values())
        self.reach = params.reach if params.reach is not None else max(1.0, params.reach_share * longest)
        self.resolution = max(params.finest_cell, self.reach / params.cells_per_reach)
        half = round((self.reach + border) / self.resolution)
        self.cells = np.zeros((2 * half, 2 * half), np.float32)
        self.corner = np.array([-half, -half])  # of cell (0, 0), in whole cells from the odometry frame's origin
        self.rings = {name: Ring(ring) for name, ring in sensors.items()}
        self.footprint = params.footprint
        self.weights = np.array([
            params.clamp, params.beam_hit, params.beam_miss, params.sonar_hit, params.sonar_miss,
            params.sonar_silent_miss, params.sonar_silent_reach, params.silent_reach, params.sonar_arc,
            params.sonar_margin,
        ])  # fmt: skip
        self.resamples = params.resample
        self.frame = np.zeros(3)  # odometry-frame pose of the resampled map

    def move(self, pose: np.ndarray) -> None:
        """Follow the robot to `pose` (3,)."""
        if self.resamples:
            cos, sin = math.cos(self.frame[2]), math.sin(self.frame[2])
            dx, dy = pose[0] - self.frame[0], pose[1] - self.frame[1]
            turn = pose[2] - self.frame[2]
            self.cells = resample_cells(self.cells, self.resolution, cos * dx + sin * dy, cos * dy - sin * dx, turn)
            self.frame = np.array(pose, float)
            return
        half = self.cells.shape[0] // 2
        columns = math.floor(pose[0] / self.resolution) - half - int(self.corner[0])
        rows = math.floor(pose[1] / self.resolution) - half - int(self.corner[1])
        if columns or rows:
            self.cells = shift_cells(self.cells, columns, rows)
            self.corner = self.corner + np.array([columns, rows])

    def in_grid(self, pose: np.ndarray) -> tuple[float, float, float]:
        """`pose` in grid coordinates: metres from cell (0, 0)'s corner, and heading."""
        if self.resamples:
            cos, sin = math.cos(self.frame[2]), math.sin(self.frame[2])
            dx, dy = pose[0] - self.frame[0], pose[1] - self.frame[1]
            half = 0.5 * self.cells.shape[0] * self.resolution
            return cos * dx + sin * dy + half, cos * dy - sin * dx + half, pose[2] - self.frame[2]
        return (
            float(pose[0] - self.corner[0] * self.resolution),
            float(pose[1] - self.corner[1] * self.resolution),
            float(pose[2]),
        )

    def fuse(self, sensor: str, ranges: np.ndarray, pose: np.ndarray, tilt: float = 0.0) -> None:
        """Follow the robot to `pose` and add one sweep (n,) of `sensor` taken there; KeyError for an unknown sensor."""
        ring = self.rings[sensor]
        self.move(pose)
        x, y, theta = self.in_grid(pose)
        fuse_ring(
            self.cells, self.resolution, x, y, theta, tilt, ring.model, ring.bearings, ring.offset, ring.height,
            ring.half_angle, ring.limits, ranges, self.weights,
        )  # fmt: skip
        clear_disc(self.cells, self.resolution, x, y, self.footprint, self.weights[0])

    def grid(self) -> Grid:
        """The map as a Grid in the odometry frame; in the robot's frame where the map is resampled."""
        if self.resamples:
            half = 0.5 * self.cells.shape[0] * self.resolution
            return Grid(self.cells, self.resolution, -half, -half)
        return Grid(
            self.cells,
            self.resolution,
            float(self.corner[0] * self.resolution),
            float(self.corner[1] * self.resolution),
        )
