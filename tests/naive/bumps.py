"""Bumps by small steps and by trying every wall, point by point."""

from __future__ import annotations

import math

import numpy as np


def distance(walls, x, y):
    """To the nearest point of any wall, and that point."""
    best = (math.inf, x, y)
    for x1, y1, x2, y2 in walls:
        length = math.hypot(x2 - x1, y2 - y1)
        along = ((x - x1) * (x2 - x1) + (y - y1) * (y2 - y1)) / length
        along = max(0.0, min(length, along)) / length
        near = x1 + along * (x2 - x1), y1 + along * (y2 - y1)
        best = min(best, (math.dist((x, y), near), *near))
    return best


def is_inside(walls, x, y):
    """By the winding of all walls around the place."""
    turned = 0.0
    for x1, y1, x2, y2 in walls:
        one, other = math.atan2(y1 - y, x1 - x), math.atan2(y2 - y, x2 - x)
        turned += math.remainder(other - one, 2.0 * math.pi)
    return round(turned / (2.0 * math.pi)) % 2 == 1


def crosses(wall, left, right):
    """Whether a wall and the line between two points have a point in common."""

    def side(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    one, other = wall[:2], wall[2:]
    return (
        side(one, other, left) * side(one, other, right) <= 0.0
        and side(left, right, one) * side(left, right, other) <= 0.0
    )


def bumper(x, y, heading, ahead, half_width):
    """Its left and right ends."""
    middle = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
    across = -half_width * math.sin(heading), half_width * math.cos(heading)
    return (middle[0] + across[0], middle[1] + across[1]), (middle[0] - across[0], middle[1] - across[1])


def way_until_contact(walls, pose, curvature, reach, ahead, half_width, step=2e-4):
    """Way of an arc until some wall crosses the bumper; inf without."""
    x, y, heading = pose
    for count in range(int(reach / step)):
        if any(crosses(wall, *bumper(x, y, heading, ahead, half_width)) for wall in walls):
            return count * step
        middle = heading + 0.5 * curvature * step
        x, y, heading = x + step * math.cos(middle), y + step * math.sin(middle), heading + curvature * step
    return math.inf


def in_bump_space(walls, pose, ahead, half_width, tolerance):
    """As the paper says it."""
    x, y, heading = pose
    left, right = bumper(x, y, heading, ahead, half_width)
    points = left, tuple(np.mean([left, right], axis=0)), right
    rooms = [distance(walls, *point)[0] * (1.0 if is_inside(walls, *point) else -1.0) for point in points]
    nearest = points[int(np.argmin(rooms))]
    _, near_x, near_y = distance(walls, *nearest)
    sign = 1.0 if min(rooms) > 0.0 else -1.0
    outward = sign * ((near_x - nearest[0]) * math.cos(heading) + (near_y - nearest[1]) * math.sin(heading))
    return is_inside(walls, x, y) and abs(min(rooms)) <= tolerance and outward > 0.0
