"""What a stage does to the particles of a cart that bumps: moved by its ticks, driven until a wall, weighed by the way.

Headings are drawn, ways are not: a drive that ended at a wall ended where its arc first meets one, and the particle
weighs what the logged way is worth against that, so that no particle is lost to where along its drive it is. A bump may
leave more behind than the counters tell: wheels slip along the wall, or the bumper flattens against it and the cart
stands square. Of a bumper with three switches those that are closed tell which end met the wall, or that both did. Uses
its siblings `area`, `bumps`, `cart_odometry` and `counter_random`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.area import along_arc, clearance
from slam.bumps import drive_until_contact
from slam.cart_odometry import LEFT, MIDDLE, RIGHT
from slam.counter_random import gaussian_of, uniform_of

(
    WAY, HEADING, IS_SLIP, SLIP_WAY, SLIP_TURN, SLIDE, FLATTEN, IS_BLOCKED, BLOCKED, PLACE, IS_FELT,
) = range(11)  # streams of random numbers  # fmt: skip
NEVER = 1e-12  # density (1/m) of what no error explains
BEYOND = 0.25  # m past the logged way within which a wall is looked for
TRIES = 64  # poses drawn for one start
SPREAD = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)  # 1/g, 1/g^2, 1/g^3 of g^4 = g + 1: whose
# multiples fill a cube evenly (Roberts, The unreasonable effectiveness of quasirandom sequences, 2018)
BACKWARD = 0.2  # of the slips make the logged way too short
BLOCKED_SHARE = 0.5  # of turns on the spot with a wall within reach, which is all that is known of them
FLAT = 0.02  # rad within which a bumper may meet a wall with both ends
WRONG = 0.05  # of the bumps close other switches than a particle's should
BOTH = 0.8  # of bumpers that are flat against a wall close the switches of both ends, others one of them
STEEPEST = 0.1  # cosine at which walls that are met at small angles count


class Leg(NamedTuple):
    """A stage as particles take it: `way` m (negative backwards), `turn` rad, standard deviations of both.

    `felt` are the bits of the switches closed at its end, of a bumper that has three; 0 where nothing is told of them.
    """

    way: float
    turn: float
    way_sigma: float
    turn_sigma: float
    felt: int = 0


class Touch(NamedTuple):
    """A cart's bumper, and what bumps do: lengths in m, angles in rad, as of `slam.cart_odometry.CartParams`."""

    ahead: float
    half_width: float
    slip_share: float
    slip_distance: float
    slip_turn: float
    flatten_distance: float


@njit(cache=True)
def move(area, poses, scales, leg, touch, key):
    """Move particles (n, 3) in place by a stage that needs no bumper; `scales` (n,) multiply its turn.

    Where a wall is within a turning bumper's reach, it may have stopped the turn anywhere while the wheels went on.
    """
    reach = math.hypot(touch.ahead, touch.half_width)
    for p in range(poses.shape[0]):
        way = leg.way + leg.way_sigma * gaussian_of(key, p, WAY)
        turn = leg.turn * scales[p] + leg.turn_sigma * gaussian_of(key, p, HEADING)
        is_turn = abs(leg.turn) * reach > abs(leg.way)
        if (
            is_turn
            and clearance(area, poses[p, 0], poses[p, 1]) < reach
            and uniform_of(key, p, IS_BLOCKED) < BLOCKED_SHARE
        ):
            turn *= uniform_of(key, p, BLOCKED)
        curvature = turn / way if abs(way) > 1e-6 else 0.0
        x, y, heading = along_arc(poses[p, 0], poses[p, 1], poses[p, 2], way, curvature)
        poses[p, 0], poses[p, 1] = x, y
        poses[p, 2] = wrapped(heading if abs(way) > 1e-6 else poses[p, 2] + turn)


@njit(cache=True)
def drive_to_wall(area, poses, scales, log_weights, leg, touch, key):
    """Drive particles (n, 3) until their walls, in place; add the log density (1/m) of the way and what was felt."""
    for p in range(poses.shape[0]):
        turn = leg.turn * scales[p] + leg.turn_sigma * gaussian_of(key, p, HEADING)
        curvature = turn / max(leg.way, 1e-6)
        if clearance(area, poses[p, 0], poses[p, 1]) <= 0.0:
            log_weights[p] += math.log(NEVER)
            continue
        contact = drive_until_contact(
            area, poses[p, 0], poses[p, 1], poses[p, 2], curvature, leg.way + BEYOND, touch.ahead, touch.half_width
        )
        error = leg.way - contact.way
        density = way_density(error, cosine_at(area, contact), leg.way_sigma, touch)
        poses[p, 0], poses[p, 1], poses[p, 2] = after_bump(area, contact, max(error, 0.0), touch, key, p)
        off = off_square(area, contact, poses[p, 2])
        log_weights[p] += math.log(density * felt_share(leg.felt, contact.across, off, touch) + NEVER)


@njit(cache=True)
def drive_free(area, poses, scales, log_weights, leg, touch, key):
    """Move particles (n, 3) in place by a drive that met no wall, and add the log probability that it did not."""
    for p in range(poses.shape[0]):
        turn = leg.turn * scales[p] + leg.turn_sigma * gaussian_of(key, p, HEADING)
        way = leg.way + leg.way_sigma * gaussian_of(key, p, WAY)
        curvature = turn / max(way, 1e-6)
        contact = drive_until_contact(
            area, poses[p, 0], poses[p, 1], poses[p, 2], curvature, way + BEYOND, touch.ahead, touch.half_width
        )
        more = (contact.way - way) / max(leg.way_sigma, 1e-6)
        free = 0.5 * math.erfc(-more / math.sqrt(2.0)) if contact.wall >= 0 else 1.0
        log_weights[p] += math.log((1.0 - touch.slip_share) * free + touch.slip_share * min(1.0, free + 0.5) + NEVER)
        x, y, heading = along_arc(poses[p, 0], poses[p, 1], poses[p, 2], min(way, contact.way), curvature)
        poses[p, 0], poses[p, 1], poses[p, 2] = x, y, wrapped(heading)


@njit(cache=True)
def way_density(error, cosine, sigma, touch):
    """Density (1/m) of a logged way `error` m longer than the true one: normal, or with a slip of exponential size.

    `cosine` is of the angle to the wall's normal: who meets a wall at a small angle slides along it for longer.
    """
    if not math.isfinite(error):
        return 0.0
    normal = math.exp(-0.5 * (error / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))
    size = touch.slip_distance / max(STEEPEST, cosine) if error > 0.0 else touch.slip_distance
    share = touch.slip_share * (1.0 - BACKWARD if error > 0.0 else BACKWARD)
    return (1.0 - touch.slip_share) * normal + share * math.exp(-abs(error) / size) / size


@njit(cache=True)
def felt_share(felt, across, off, touch):
    """Probability that these switches are closed where the wall is met at `across` m of the bumper, `off` rad askew.

    One where nothing is told of them (0); else those of both ends, and of each third alone, sum to one.
    """
    if felt == 0:
        return 1.0
    if abs(off) < FLAT:
        return BOTH if felt == LEFT | RIGHT else (1.0 - BOTH) / 3.0
    third = touch.half_width / 3.0
    expected = LEFT if across > third else RIGHT if across < -third else MIDDLE
    return 1.0 - WRONG if felt == expected else WRONG / 3.0


@njit(cache=True)
def off_square(area, contact, heading):
    """Angle (rad) from the normal of the wall that was met to a heading, within a quarter turn; 0 without a wall."""
    if contact.wall < 0:
        return 0.0
    x1, y1, x2, y2 = area.walls[contact.wall]
    off = wrapped(heading - math.atan2(x2 - x1, y1 - y2))
    return wrapped(off + math.pi) if abs(off) > 0.5 * math.pi else off


@njit(cache=True)
def cosine_at(area, contact):
    """Cosine of the same angle."""
    return math.cos(off_square(area, contact, contact.heading))


@njit(cache=True)
def after_bump(area, contact, overrun, touch, key, p):
    """The pose that a bump leaves a particle with, whose wheels turned `overrun` m more than its way to the wall.

    The bumper's point that met the wall stays where it is when the bumper flattens, which takes pushing; any part of
    the overrun may have been a slide along the wall.
    """
    heading = contact.heading
    if contact.wall < 0:
        return contact.x, contact.y, wrapped(heading)
    off = off_square(area, contact, heading)
    x = contact.x + touch.ahead * math.cos(heading) - contact.across * math.sin(heading)
    y = contact.y + touch.ahead * math.sin(heading) + contact.across * math.cos(heading)
    along = heading - off + math.copysign(0.5 * math.pi, off)  # the wall's direction, the way that the cart drives
    slide = overrun * abs(math.sin(off)) * uniform_of(key, p, SLIDE)
    x, y = x + slide * math.cos(along), y + slide * math.sin(along)
    is_end = abs(contact.across) > touch.half_width - 1e-6
    if is_end and uniform_of(key, p, FLATTEN) > math.exp(-overrun / touch.flatten_distance):
        heading -= off
    else:
        heading += touch.slip_turn * (1.0 - math.exp(-overrun / touch.slip_distance)) * gaussian_of(key, p, SLIP_TURN)
    cos, sin = math.cos(heading), math.sin(heading)
    return x - touch.ahead * cos + contact.across * sin, y - touch.ahead * sin - contact.across * cos, wrapped(heading)


@njit(cache=True)
def start_anywhere(area, poses, scales, leg, touch, key):
    """Bumps (n, 3) of carts that began a drive anywhere on the floor and drove the logged way; its density (1/m).

    A pose drawn evenly is on such a drive if a wall is met within the way from there and the rest of the way behind is
    free: bumps come out as often as even starts make them, and the share of poses that are, over the way, is the
    density of so long a way, with the switches that were felt. Poses are drawn by the sequence of `SPREAD`. Rows that
    no try found are nan.
    """
    low_x, low_y = area.x, area.y
    width = area.spacing * (area.distances.shape[1] - 1)
    height = area.spacing * (area.distances.shape[0] - 1)
    shift_x, shift_y, shift_heading = uniform_of(key, 0, PLACE), uniform_of(key, 1, PLACE), uniform_of(key, 2, PLACE)
    drawn, n_on_floor, n_found = 0, 0, 0
    way = max(leg.way, 1e-3)
    poses[:] = np.nan
    while n_found < poses.shape[0] and drawn < TRIES * poses.shape[0]:
        drawn += 1
        x = low_x + width * ((shift_x + SPREAD[0] * drawn) % 1.0)
        y = low_y + height * ((shift_y + SPREAD[1] * drawn) % 1.0)
        if clearance(area, x, y) <= 0.0:
            continue
        n_on_floor += 1
        heading = 2.0 * math.pi * ((shift_heading + SPREAD[2] * drawn) % 1.0)
        overrun = 0.0
        if uniform_of(key, drawn, IS_SLIP) < touch.slip_share:
            overrun = -touch.slip_distance * math.log(1.0 - uniform_of(key, drawn, SLIP_WAY))
        length = max(1e-3, way - overrun + leg.way_sigma * gaussian_of(key, drawn, WAY))
        curvature = (leg.turn * scales[n_found] + leg.turn_sigma * gaussian_of(key, drawn, HEADING)) / way
        ahead = drive_until_contact(area, x, y, heading, curvature, length, touch.ahead, touch.half_width)
        if ahead.wall < 0:
            continue
        x, y, heading = along_arc(ahead.x, ahead.y, ahead.heading, -length, curvature)
        if clearance(area, x, y) <= 0.0:
            continue
        whole = drive_until_contact(area, x, y, heading, curvature, length + 0.01, touch.ahead, touch.half_width)
        if abs(whole.way - length) > 2e-3:
            continue
        x, y, heading = after_bump(area, whole, overrun, touch, key, drawn)
        off = off_square(area, whole, heading)
        if uniform_of(key, drawn, IS_FELT) >= felt_share(leg.felt, whole.across, off, touch):
            continue
        poses[n_found, 0], poses[n_found, 1], poses[n_found, 2] = x, y, heading
        n_found += 1
    return n_found / max(1, n_on_floor) / way


@njit(cache=True, inline="always")
def wrapped(angle):
    """The same angle in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
