"""Align two laser scans by their walls: iterated closest point with a point-to-line metric (Censi, ICRA 2008).

The match starts from a guess, and tells with its answer how well each direction is known. Partners are looked for
outwards from the bearing where they should be, so that it takes no map and no tree. Uses its sibling `laser_scan`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from slam.laser_scan import Scan
from slam.params import Params

SETTLED = 1e-4  # m or rad of a step that is the last one


class ScanMatchingParams(Params):
    """How two scans are aligned."""

    rounds: int = Field(default=30, ge=1, le=1000)  # of finding partners and solving, at most
    gate: float = Field(default=1.0, gt=0.0)  # m between partners in the first round
    last_gate: float = Field(default=0.1, gt=0.0)  # m, once the match has settled
    like: float = Field(default=0.5, ge=-1.0, le=1.0)  # cosine between the walls' normals at partners
    sigma: float = Field(default=0.02, gt=0.0)  # m that an end of a beam lies off its wall
    enough: float = Field(default=0.3, gt=0.0, le=1.0)  # share of the ends that must find partners


class Match(NamedTuple):
    """Pose (3,) of a scan in another's frame, `information` (3, 3) on it, and the share of its ends that met walls."""

    pose: np.ndarray
    information: np.ndarray
    share: float


class Rule(NamedTuple):
    """The parameters, for the kernel."""

    rounds: int
    gate: float
    last_gate: float
    like: float
    sigma: float


@njit(cache=True, inline="always")
def turned(cos, sin, x, y):
    """A vector in a frame that is turned by an angle."""
    return cos * x - sin * y, sin * x + cos * y


@njit(cache=True, inline="always")
def begin_terms(prior, pose, guess, gradient, hessian):
    """Begin the normal equations with what is known of the guess; its cost."""
    cost = 0.0
    for r in range(3):
        gradient[r] = 0.0
        for c in range(3):
            hessian[r, c] = prior[r, c]
            gradient[r] += prior[r, c] * (pose[c] - guess[c])
        cost += 0.5 * gradient[r] * (pose[r] - guess[r])
    return cost


@njit(cache=True, inline="always")
def add_term(weight, off, nx, ny, lever, gradient, hessian):
    """Add a point that is `off` its wall along the normal (nx, ny), with its lever about the pose; upper half only."""
    gradient[0] += weight * off * nx
    gradient[1] += weight * off * ny
    gradient[2] += weight * off * lever
    hessian[0, 0] += weight * nx * nx
    hessian[0, 1] += weight * nx * ny
    hessian[0, 2] += weight * nx * lever
    hessian[1, 1] += weight * ny * ny
    hessian[1, 2] += weight * ny * lever
    hessian[2, 2] += weight * lever * lever


@njit(cache=True, inline="always")
def mirror(hessian):
    """Complete the lower half."""
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]


@njit(cache=True, inline="always")
def bearing_row(bearings, angle):
    """The row of the bearing (n,), ascending, that is nearest to an angle or next to it."""
    low, high = 0, bearings.size - 1
    while low < high:
        middle = (low + high) // 2
        if bearings[middle] < angle:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, inline="always")
def reach_of(apart, radius):
    """The angle (rad) off its own bearing within which a point `radius` m away has all that is `apart` m from it."""
    return math.asin(apart / radius) if radius > apart else math.pi


@njit(cache=True, inline="always")
def partner(other, x, y, nx, ny, gate, like):
    """The nearest of the reference's points within `gate` whose normal is like (nx, ny); -1 where there is none."""
    points, normals, bearings = other.points, other.normals, other.bearings
    radius, angle = math.hypot(x, y), math.atan2(y, x)
    reach = reach_of(gate, radius)
    middle = bearing_row(bearings, angle)
    best, least = -1, gate * gate
    for way in (1, -1):
        j = middle if way == 1 else middle - 1
        while 0 <= j < bearings.size and way * (bearings[j] - angle) <= reach:
            dx, dy = x - points[j, 0], y - points[j, 1]
            apart2 = dx * dx + dy * dy
            if apart2 < least and nx * normals[j, 0] + ny * normals[j, 1] > like:
                best, least = j, apart2
                reach = reach_of(math.sqrt(least), radius)
            j += way
    return best


@njit(cache=True, inline="always")
def solved(a, b):
    """x of a x = b for a symmetric, positive a (3, 3), by its factors L D L'."""
    d0 = a[0, 0]
    l10, l20 = a[1, 0] / d0, a[2, 0] / d0
    d1 = a[1, 1] - l10 * l10 * d0
    l21 = (a[2, 1] - l20 * l10 * d0) / d1
    d2 = a[2, 2] - l20 * l20 * d0 - l21 * l21 * d1
    x = np.empty(3)
    y1 = b[1] - l10 * b[0]
    y2 = b[2] - l20 * b[0] - l21 * y1
    x[2] = y2 / d2
    x[1] = y1 / d1 - l21 * x[2]
    x[0] = b[0] / d0 - l10 * x[1] - l20 * x[2]
    return x


@njit(cache=True)
def align(scan, other, pose, prior, rule, hessian):
    """Move `pose` (3,) so that a scan's ends come to lie on the other's walls; how many found a partner last.

    Gauss-Newton steps of the squared distances across the other's walls (Censi 2008, equation 2), under Geman and
    McClure's kernel, which narrows from the gate to the last gate. `prior` (3, 3) is the information on the guess;
    `hessian` (3, 3) is left with that on the answer.
    """
    guess = pose.copy()
    gradient = np.empty(3)
    met, gate = 0, rule.gate
    for _ in range(rule.rounds):
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        begin_terms(prior, pose, guess, gradient, hessian)
        met = 0
        for i in range(scan.points.shape[0]):
            nx, ny = turned(cos, sin, scan.normals[i, 0], scan.normals[i, 1])
            if nx == 0.0 and ny == 0.0:
                continue
            px, py = turned(cos, sin, scan.points[i, 0], scan.points[i, 1])
            x, y = px + pose[0], py + pose[1]
            j = partner(other, x, y, nx, ny, gate, rule.like)
            if j < 0:
                continue
            met += 1
            qx, qy = other.normals[j, 0], other.normals[j, 1]
            off = qx * (x - other.points[j, 0]) + qy * (y - other.points[j, 1])
            share = 1.0 / (1.0 + (3.0 * off / gate) ** 2)
            add_term(share * share / rule.sigma**2, off, qx, qy, qy * px - qx * py, gradient, hessian)
        mirror(hessian)
        if met == 0:
            break
        step = solved(hessian, gradient)
        pose -= step
        size = max(math.hypot(step[0], step[1]), abs(step[2]))
        if gate <= rule.last_gate and size < SETTLED:
            break
        gate = max(rule.last_gate, gate * (0.7 if size > 0.3 * gate else 0.5))
    return met


def match_scans(scan: Scan, other: Scan, guess: np.ndarray, prior: np.ndarray, params: ScanMatchingParams) -> Match:
    """Pose of `scan` in the frame of `other`, from a guess (3,) of which `prior` (3, 3) is the information.

    Where too few ends find partners, the guess is the answer.
    """
    pose, information = np.array(guess, float), np.array(prior, float)
    if not len(scan.points) or not len(other.points):
        return Match(pose, information, 0.0)
    rule = Rule(params.rounds, params.gate, params.last_gate, params.like, params.sigma)
    met = align(scan, other, pose, np.array(prior, float), rule, information)
    share = met / len(scan.points)
    if share < params.enough:
        return Match(np.array(guess, float), np.array(prior, float), share)
    return Match(pose, information, share)
