"""Vector field histogram, sector by sector, ring by ring, cell by cell."""

from __future__ import annotations

import math

from slam.grid import probability


def turn(a, b):
    """Unsigned angle between two bearings."""
    return abs(math.remainder(a - b, 2.0 * math.pi))


def touches(bearing, sector_bearing, distance, params):
    """Whether a robot that leaves along the sector's centre touches a cell, or the cell lies in the sector."""
    off = turn(bearing, sector_bearing)
    spread = math.asin(min(1.0, (params.robot_radius + params.clearance) / distance))
    return off <= spread or off <= math.pi / params.sectors


def raw_density(grid, pose, sector, params, limit=math.inf):
    """Sum over rings of the strongest weight that a robot along the sector meets there."""
    x, y, theta = pose
    strongest = {}
    for row in range(grid.cells.shape[0]):
        for column in range(grid.cells.shape[1]):
            dx = grid.x + (column + 0.5) * grid.resolution - x
            dy = grid.y + (row + 0.5) * grid.resolution - y
            distance = math.hypot(dx, dy)
            certainty = max(0.0, 2.0 * float(probability(grid.cells[row, column])) - 1.0)
            if not 0.5 * grid.resolution <= distance < params.reach or distance > limit or certainty == 0.0:
                continue
            if touches(math.atan2(dy, dx) - theta, 2.0 * math.pi * sector / params.sectors, distance, params):
                ring = int(distance / grid.resolution)
                weight = certainty**2 * (1.0 - distance / params.reach)
                strongest[ring] = max(strongest.get(ring, 0.0), weight)
    return grid.resolution * sum(strongest.values())


def histogram(grid, pose, params, limit=math.inf):
    """Raw densities, averaged with weights that fall linearly to either side."""
    n, reach = params.sectors, params.smoothing
    raw = [raw_density(grid, pose, sector, params, limit) for sector in range(n)]
    densities = []
    for sector in range(n):
        total = sum((1 + reach - abs(k)) * raw[(sector + k) % n] for k in range(-reach, reach + 1))
        densities.append(total / (1 + reach) ** 2)
    return densities


def valleys(densities, threshold):
    """Sets of neighbouring open sectors, each in ccw order."""
    n = len(densities)
    is_open = [density < threshold for density in densities]
    if all(is_open):
        return [list(range(n))]
    found = []
    for first in range(n):
        if is_open[first] and not is_open[first - 1]:
            arc = [first]
            while is_open[(arc[-1] + 1) % n]:
                arc.append((arc[-1] + 1) % n)
            found.append(arc)
    return found
