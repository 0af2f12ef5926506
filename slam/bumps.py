"""Where a bumper meets walls: the first contact of a drive, and the bump space of the paper.

Bump space is a band inside the perimeter in which the cart faces outward: the poses at which a bump can have been
(Dye, Mapping with only a bumper, part 3). Uses its sibling `area`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.area import BETWEEN, Area, along_arc, clearance, outward_normal
from slam.cart_odometry import CartParams

CHORD = 0.01  # m of an arc that are taken for straight where a wall is near
MENDED = 3  # times
HEADINGS = 72  # so many that the bumper's ends move by less than a band's width from one to the next


class Contact(NamedTuple):
    """A drive's end at a wall: `way` m until then (inf: none), the pose, where across the bumper (m, left positive).

    `wall` is the row of the wall met, -1 for none.
    """

    way: float
    x: float
    y: float
    heading: float
    across: float
    wall: int


@njit(cache=True)
def bumper_gap(walls, x, y, heading, ahead, half_width):
    """How far a bumper may go straight on from a cart's pose: gap (m), where across it meets, and the wall; inf, 0, -1.

    The gap is negative where a wall stands between the bumper and the axle.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    best, best_across, best_wall = math.inf, 0.0, -1
    for wall in range(walls.shape[0]):
        x1, y1, x2, y2 = walls[wall, 0] - x, walls[wall, 1] - y, walls[wall, 2] - x, walls[wall, 3] - y
        forward1, across1 = cos * x1 + sin * y1, cos * y1 - sin * x1
        forward2, across2 = cos * x2 + sin * y2, cos * y2 - sin * x2
        if max(forward1, forward2) < 0.0 or min(forward1, forward2) >= best:
            continue
        first, last = 0.0, 1.0  # the part of the wall that is before the bumper
        wide = across2 - across1
        if abs(wide) < 1e-12:
            if abs(across1) > half_width:
                continue
        else:
            one, other = (-half_width - across1) / wide, (half_width - across1) / wide
            first, last = max(first, min(one, other)), min(last, max(one, other))
        deep = forward2 - forward1
        if abs(deep) > 1e-12:  # and before the axle
            if deep > 0.0:
                first = max(first, -forward1 / deep)
            else:
                last = min(last, -forward1 / deep)
        if first > last:
            continue
        nearest = first if deep > 0.0 else last
        forward = forward1 + nearest * deep
        if forward < best:
            best, best_across, best_wall = forward, across1 + nearest * wide, wall
    return best - ahead, best_across, best_wall


@njit(cache=True)
def drive_until_contact(area, x, y, heading, curvature, reach, ahead, half_width):
    """The first `Contact` of a bumper on an arc from a pose, within `reach` m.

    A bumper that begins within a wall has a contact at once.
    """
    way = 0.0
    sweep = 1.0 + abs(curvature) * (ahead + half_width)  # m that a bumper's end moves for each of the axle's
    doubt = half_width + BETWEEN * area.spacing
    while way < reach:
        at_x, at_y, at_heading = along_arc(x, y, heading, way, curvature)
        bumper_x, bumper_y = at_x + ahead * math.cos(at_heading), at_y + ahead * math.sin(at_heading)
        room = (clearance(area, bumper_x, bumper_y) - doubt) / sweep
        if way > 0.0 and room > CHORD:
            way += room
            continue
        middle = at_heading + 0.5 * curvature * CHORD
        gap, across, wall = bumper_gap(area.walls, at_x, at_y, middle, ahead, half_width)
        if gap <= CHORD:
            met = way + gap
            for _ in range(MENDED):  # the bumper has turned a little on the way
                end_x, end_y, end_heading = along_arc(x, y, heading, met, curvature)
                gap, across, wall = bumper_gap(area.walls, end_x, end_y, end_heading, ahead, half_width)
                if wall < 0:  # and goes past a corner after all
                    break
                met = max(0.0, met + max(-CHORD, gap))
            if wall >= 0 and met < reach:
                end_x, end_y, end_heading = along_arc(x, y, heading, met, curvature)
                return Contact(met, end_x, end_y, end_heading, across, wall)
        way += CHORD if room <= CHORD else room
    end_x, end_y, end_heading = along_arc(x, y, heading, reach, curvature)
    return Contact(math.inf, end_x, end_y, end_heading, 0.0, -1)


class Band(NamedTuple):
    """The bump space seen from above: at nodes (rows, columns), the share of headings at which the cart is in it.

    Node (0, 0) stands at (x, y), `spacing` m from its neighbours.
    """

    shares: np.ndarray
    spacing: float
    x: float
    y: float


def in_bump_space(area: Area, poses: np.ndarray, cart: CartParams, tolerance: float) -> np.ndarray:
    """Which of poses (n, 3) are in the bump space, (n,) bool, whose band is `tolerance` m wide to both sides of a wall.

    The axle stands on the floor, the bumper's left, middle or right point is within the tolerance of the perimeter and
    none farther out, and the cart faces outward there.
    """
    poses = np.ascontiguousarray(poses, float)
    return bump_space(area, poses, cart.bumper_ahead, 0.5 * cart.bumper_width, tolerance)


@njit(cache=True)
def bump_space(area, poses, ahead, half_width, tolerance):
    """The kernel of `in_bump_space`."""
    found = np.zeros(poses.shape[0], np.bool_)
    for row in range(poses.shape[0]):
        found[row] = may_touch(area, poses[row, 0], poses[row, 1], poses[row, 2], ahead, half_width, tolerance)
    return found


@njit(cache=True)
def may_touch(area, x, y, heading, ahead, half_width, tolerance):
    """Whether a single pose is in the bump space."""
    if clearance(area, x, y) <= 0.0:
        return False
    cos, sin = math.cos(heading), math.sin(heading)
    least, least_x, least_y = math.inf, 0.0, 0.0
    for side in range(-1, 2):
        point_x = x + ahead * cos - side * half_width * sin
        point_y = y + ahead * sin + side * half_width * cos
        room = clearance(area, point_x, point_y)
        if room < least:
            least, least_x, least_y = room, point_x, point_y
    if abs(least) > tolerance:
        return False
    normal_x, normal_y = outward_normal(area, least_x, least_y)
    return normal_x * cos + normal_y * sin > 0.0


def band_of(area: Area, cart: CartParams, tolerance: float) -> Band:
    """Where in an area a cart may bump; of a band thinner than the area's lattice not less than its nodes is shown."""
    tolerance = max(tolerance, area.spacing)
    return Band(band_shares(area, cart.bumper_ahead, 0.5 * cart.bumper_width, tolerance), area.spacing, area.x, area.y)


@njit(cache=True)
def band_shares(area, ahead, half_width, tolerance):
    """The kernel of `band_of`."""
    rows, columns = area.distances.shape
    reach = math.hypot(ahead, half_width) + tolerance
    shares = np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            if not 0.0 < area.distances[row, column] < reach:
                continue
            x, y = area.x + area.spacing * column, area.y + area.spacing * row
            n_inside = 0
            for k in range(HEADINGS):
                n_inside += may_touch(area, x, y, 2.0 * math.pi * (k + 0.5) / HEADINGS, ahead, half_width, tolerance)
            shares[row, column] = n_inside / HEADINGS
    return shares
