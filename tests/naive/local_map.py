"""The local map with every cell of the grid asked in turn, and beams marched point by point."""

from __future__ import annotations

import math

import numpy as np

from slam.local_map import INFRARED, SONAR
from tests.naive import pose as se2


def cell_of(grid, x, y):
    """Row and column of the cell at a place, or None outside."""
    row, column = math.floor((y - grid.y) / grid.resolution), math.floor((x - grid.x) / grid.resolution)
    rows, columns = grid.cells.shape
    return (row, column) if 0 <= row < rows and 0 <= column < columns else None


def shift_cells(cells, columns, rows):
    """What each place held before, by its name."""
    old = {(row - rows, column - columns): value for (row, column), value in np.ndenumerate(cells)}
    moved = np.zeros_like(cells)
    for place in np.ndindex(*cells.shape):
        moved[place] = old.get(place, 0.0)
    return moved


def resample_cells(cells, resolution, x, y, theta):
    """Each new cell takes from every old one, by how far their centres are apart along both axes."""
    n = cells.shape[0]
    centres = (np.arange(n) + 0.5 - 0.5 * n) * resolution
    moved = np.zeros(cells.shape)
    for row, column in np.ndindex(n, n):
        place = se2.compose((x, y, theta), (centres[column], centres[row], 0.0))
        near_rows = np.maximum(0.0, 1.0 - np.abs(centres - place[1]) / resolution)
        near_columns = np.maximum(0.0, 1.0 - np.abs(centres - place[0]) / resolution)
        moved[row, column] = near_rows @ cells @ near_columns
    return moved


def fuse_beam(grid, beam, sigma, evidence):
    """A miss at every point, one cell apart, that was seen free; a hit for every cell of the bump."""

    def cell_at(distance):
        return cell_of(grid, beam.x + distance * math.cos(beam.bearing), beam.y + distance * math.sin(beam.bearing))

    if beam.free > 0.0:
        for step in range(int(beam.free / grid.resolution) + 1):
            place = cell_at(step * grid.resolution)
            if place is None:
                break
            grid.cells[place] = max(-evidence.clamp, grid.cells[place] - evidence.beam_miss)
    if math.isinf(beam.echo):
        return
    width = max(1, int(sigma / grid.resolution + 0.5))
    bump = {}
    for step in range(-width, width + 1):
        bump.setdefault(cell_at(beam.echo + step * grid.resolution), step * grid.resolution)
    for place, off in bump.items():
        if place is not None:
            hit = evidence.beam_hit * math.exp(-0.5 * (off / sigma) ** 2)
            grid.cells[place] = min(evidence.clamp, grid.cells[place] + hit)


def fuse_cone(grid, beam, half_angle, miss_weight, evidence):
    """Every cell's centre in polar coordinates around the sensor."""
    end = beam.free if math.isinf(beam.echo) else beam.echo
    for row, column in np.ndindex(*grid.cells.shape):
        dx = grid.x + (column + 0.5) * grid.resolution - beam.x
        dy = grid.y + (row + 0.5) * grid.resolution - beam.y
        distance, off = math.hypot(dx, dy), math.remainder(math.atan2(dy, dx) - beam.bearing, 2.0 * math.pi)
        if abs(off) > half_angle:
            continue
        aim = 1.0 - 2.0 * (1.0 - math.cos(off)) / half_angle**2
        value = float(grid.cells[row, column])
        if distance < beam.free:
            grid.cells[row, column] = max(-evidence.clamp, value - miss_weight * aim * (1.0 - distance / end))
        elif abs(distance - beam.echo) <= evidence.sonar_arc:
            grid.cells[row, column] = min(evidence.clamp, value + evidence.sonar_hit * aim)


def clear_disc(grid, x, y, radius, clamp):
    """Every cell whose centre lies in the disc."""
    for row, column in np.ndindex(*grid.cells.shape):
        centre = (grid.x + (column + 0.5) * grid.resolution, grid.y + (row + 0.5) * grid.resolution)
        if math.dist(centre, (x, y)) <= radius:
            grid.cells[row, column] = -clamp


def lean(tilt):
    """Rotation (3, 3) of a body that leans forward, about its left axis on the floor."""
    cos, sin = math.cos(tilt), math.sin(tilt)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])


def beam_in_space(tilt, ring, i):
    """Foot (3,) and direction (3,) of one sensor of a leaning body at the origin."""
    along = np.array([math.cos(ring.bearings[i]), math.sin(ring.bearings[i]), 0.0])
    return lean(tilt) @ (ring.offset * along + [0.0, 0.0, ring.height]), lean(tilt) @ along


def sigma_of(ring, echo):
    """Spread of a beam's end: 1.2 cm near and 5.2 cm at 0.8 m for the GP2D12, 2 cm for a laser."""
    return 0.012 + 0.04 * (min(echo, ring.max_range) / 0.8) ** 2 if ring.model == INFRARED else 0.02


def trusted(ring, echo):
    """An echo, inf for none or one from too far, None for what says nothing."""
    if math.isnan(echo) or echo < ring.min_range:
        return None
    return math.inf if echo > ring.max_range else echo


def free_upright(ring, echo, evidence):
    """How far an upright sensor's reading says that nothing stands, along its bearing."""
    if ring.model == SONAR:
        silent = evidence.sonar_silent_reach * ring.max_range
        return silent if math.isinf(echo) else echo - evidence.sonar_margin
    return evidence.silent_reach * ring.max_range if math.isinf(echo) else echo - 1.2 * sigma_of(ring, echo)
