"""One hypothesis of where a cart is, a Gaussian, and what its stages, walls and a camera above make of it.

Counters are cut off to whole ticks and go on between stages, so that what they keep to themselves is a state as well;
so is where a map is in a camera's frame. A bump is ordinary, or wheels went on after it, which may leave the cart
square to the wall. Uses its siblings `bump_particles` and `cart_odometry`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.bump_particles import wrapped
from slam.cart_odometry import Noise, turn_variance, way_variance

NAMES = (
    "wheelbase", "tick", "distance_noise", "turn_noise", "rotation_noise", "veer", "play", "bumper_width",
    "bumper_ahead", "tolerance", "slip_share", "slip_distance", "camera_place", "camera_turn", "overrun",
    "slip_length",
)  # fmt: skip
FRAME, OWN = 5, 5  # states of the cart itself: its pose, and what both counters keep to themselves (m)
NEAR = 0.3  # sigmas within which two that came of the same go on as one: farther ones would be smeared,
LEAST_SPREAD = 1e-8  # and m^2 and rad^2 of these that there always are
STEEPEST = 0.1  # cosine of the angle to a wall's normal from which it may be met
SOFT = 0.01  # m over which walls end
AWRY = 0.02  # rad: headings are never surer than this when it is asked which end of the bumper met
SIDEWAYS = 0.0005  # m that a stage errs sideways,
BUMP_WAY, BUMP_TURN = 0.0005, 0.005  # m and rad that an ordinary bump adds to it: walls are met at all angles
WILD_WAY, WILD_TURN = np.array([0.0, 0.05, 1.0]), np.array([0.0, 0.5, 2.0])  # m and rad by which stages go wrong
TOLD = np.array([0.04, 0.04, 0.1])  # m, m, rad: how exact places are that are told
KICK = np.array([0.03, 0.03, 0.2])  # m, m, rad that a bump adds of which nothing is believed,
SLID, SWUNG = 0.003, 0.04  # m and rad that a slip adds at least,
SLIDES, SWINGS = 0.3, 0.6  # a metre that wheels went on: as a share of it, and rad per m;
MOST_SLID, MOST_SWUNG = 0.05, 0.3  # m and rad at most
ANYHOW, SQUARE = 0.7, 0.003  # rad: how one that ends square to a wall may have stood, and how square it is then
ORDINARY, SLIPPED, FLAT = range(3)  # what a bump may be
KIND, LEFT, RIGHT, TURNED_LEFT, TURNED_RIGHT, IS_BUMP = range(6)  # columns of a run's stages


class Evidence(NamedTuple):
    """One run: `stages` (n, 6) as of the columns, and for their ends poses `told` (n, 3) by a map and `seen` (n, 3).

    What is nan was not told, or not seen. `first` (3,) was seen at the start. The filter begins from `state` (d,) and
    `covariance` (d, d): `OWN` of the cart, then the map's pose in the camera's frame (3) if it `has_frame`. Walls
    `lines` (m, 5) are a point on each, the direction out through it, and from where to where along it; `corners` (c, 2)
    point into the floor. If the walls are `unsure`, what their directions (rad) and places (m) are off follows in the
    state, two numbers a wall.
    """

    stages: np.ndarray
    told: np.ndarray
    seen: np.ndarray
    first: np.ndarray
    state: np.ndarray
    covariance: np.ndarray
    lines: np.ndarray
    corners: np.ndarray
    has_frame: bool
    unsure: bool = False


@njit(cache=True)
def roll(mean, covariance, stage, values, wildness):
    """Move a hypothesis, state (d,) and covariance (d, d), in place by a stage (6,) that went so wrong (0 to 2)."""
    wheelbase, tick, distance_noise, turn_noise, rotation_noise, veer, play = values[:7]
    left = tick * (stage[LEFT] + play * stage[TURNED_LEFT]) - mean[3]
    right = tick * (stage[RIGHT] + play * stage[TURNED_RIGHT]) - mean[4]
    if stage[IS_BUMP] > 0.0:  # wheels go on a little before they stop
        left -= values[14]
        right -= values[14]
    way = 0.5 * (left + right)
    turn = (right - left) / wheelbase + veer * way
    half = 0.5 * turn
    share = 1.0 - half * half / 6.0 if abs(half) < 1e-4 else math.sin(half) / half
    chord = way * share
    cos, sin = math.cos(mean[2] + half), math.sin(mean[2] + half)
    by_turn = np.array([-0.5 * chord * sin, 0.5 * chord * cos, 1.0])
    by_way = np.array([share * cos, share * sin, 0.0])
    by_left = 0.5 * by_way + (0.5 * veer - 1.0 / wheelbase) * by_turn
    by_right = 0.5 * by_way + (0.5 * veer + 1.0 / wheelbase) * by_turn
    mean[0] += chord * cos
    mean[1] += chord * sin
    mean[2] += turn
    mean[3] = mean[4] = 0.0
    across = np.array([-chord * sin, chord * cos, 0.0])  # of the heading before
    for c in range(mean.size):
        heading, of_left, of_right = covariance[2, c], covariance[3, c], covariance[4, c]
        for r in range(3):
            covariance[r, c] += across[r] * heading - by_left[r] * of_left - by_right[r] * of_right
        covariance[3, c] = covariance[4, c] = 0.0
    for r in range(mean.size):
        heading, of_left, of_right = covariance[r, 2], covariance[r, 3], covariance[r, 4]
        for c in range(3):
            covariance[r, c] += across[c] * heading - by_left[c] * of_left - by_right[c] * of_right
        covariance[r, 3] = covariance[r, 4] = 0.0
    noise = Noise(wheelbase, distance_noise, turn_noise, rotation_noise, values[15])
    of_way = way_variance(way, noise) + WILD_WAY[wildness] ** 2
    of_turn = turn_variance(way, turn, noise) + WILD_TURN[wildness] ** 2
    if stage[IS_BUMP] > 0.0:
        of_way += BUMP_WAY**2
        of_turn += BUMP_TURN**2
    ticks = tick * tick / 12.0
    for r in range(3):
        for c in range(3):
            covariance[r, c] += of_way * by_way[r] * by_way[c] + of_turn * by_turn[r] * by_turn[c]
            covariance[r, c] += ticks * (by_left[r] * by_left[c] + by_right[r] * by_right[c])
        covariance[r, 3] += ticks * by_left[r]
        covariance[3, r] += ticks * by_left[r]
        covariance[r, 4] += ticks * by_right[r]
        covariance[4, r] += ticks * by_right[r]
    covariance[3, 3] += ticks
    covariance[4, 4] += ticks
    sideways = SIDEWAYS**2 + WILD_WAY[wildness] ** 2
    covariance[0, 0] += sideways
    covariance[1, 1] += sideways


@njit(cache=True)
def spread_of(covariance, slope):
    """Variance of what hangs on the states by a slope (d,), most of which is 0."""
    variance = 0.0
    for r in range(slope.size):
        if slope[r] != 0.0:
            for c in range(slope.size):
                variance += slope[r] * covariance[r, c] * slope[c]
    return variance


@njit(cache=True)
def meet(mean, covariance, evidence, feature, values, slope):
    """How a hypothesis meets a feature of the map: how far it would be beyond it, cosine, variance and probability.

    Features are each wall met by the bumper's left and by its right end, then corners. Fills `slope` (d,).
    """
    half, ahead = 0.5 * values[7], values[8]
    cos, sin = math.cos(mean[2]), math.sin(mean[2])
    slope[:] = 0.0
    n_walls = evidence.lines.shape[0]
    if feature >= 2 * n_walls:
        dx = evidence.corners[feature - 2 * n_walls, 0] - mean[0]
        dy = evidence.corners[feature - 2 * n_walls, 1] - mean[1]
        across = cos * dy - sin * dx
        off, cosine, likely = ahead - cos * dx - sin * dy, 1.0, gate(abs(across) - half)
        slope[0], slope[1], slope[2] = cos, sin, -across
    else:
        wall, side = feature // 2, 1.0 - 2.0 * (feature % 2)
        x, y, phi, low, high = evidence.lines[wall]
        own = OWN + 2 * wall
        if evidence.unsure:
            phi += mean[own]
        normal_x, normal_y = math.cos(phi), math.sin(phi)
        cosine = normal_x * cos + normal_y * sin
        if cosine < STEEPEST:
            return 0.0, cosine, 1.0, 0.0
        end_x, end_y = ahead * cos - side * half * sin, ahead * sin + side * half * cos
        dx, dy = mean[0] + end_x - x, mean[1] + end_y - y
        off = normal_x * dx + normal_y * dy
        place = normal_x * dy - normal_y * dx
        if evidence.unsure:
            off -= mean[own + 1]
            slope[own], slope[own + 1] = place, -1.0
        slope[0], slope[1], slope[2] = normal_x, normal_y, -normal_x * end_y + normal_y * end_x
        askew = normal_y * cos - normal_x * sin
        likely = gate(low - place) * gate(place - high)
        likely *= 0.5 * math.erfc(-side * askew / math.sqrt(2.0 * (covariance[2, 2] + AWRY**2)))
    return off, cosine, values[9] ** 2 + max(spread_of(covariance, slope), 0.0), likely


@njit(cache=True, inline="always")
def gate(gap):
    """Probability of a contact `gap` m past a wall's end: 1 well before it, 0 well behind."""
    return 1.0 / (1.0 + math.exp(min(max(gap / SOFT, -50.0), 50.0)))


@njit(cache=True)
def learn_of(mean, covariance, slope, off, variance):
    """Take into a hypothesis, in place, that it is `off` by nothing but chance of a variance (Kalman)."""
    pulled = np.zeros(mean.size)
    for c in range(mean.size):
        if slope[c] != 0.0:
            for r in range(mean.size):
                pulled[r] += covariance[r, c] * slope[c]
    for r in range(mean.size):
        mean[r] -= pulled[r] / variance * off
        for c in range(mean.size):
            covariance[r, c] -= pulled[r] * pulled[c] / variance


@njit(cache=True)
def alike(mean, other, spread):
    """Whether a pose is within `NEAR` of another's spread (3, 3), so that nothing is lost if both go on as one."""
    off = mean[:3] - other[:3]
    off[2] = wrapped(off[2])
    return off @ np.linalg.solve(spread + LEAST_SPREAD * np.eye(3), off) < NEAR**2


@njit(cache=True)
def settle(mean, covariance, evidence, feature, kind, values, slope):
    """Take into a hypothesis that its bump of a kind was at a feature; one that slipped is put back to it first."""
    off, cosine, variance, _ = meet(mean, covariance, evidence, feature, values, slope)
    if kind != ORDINARY:
        went_on = max(off / cosine, 0.0)
        mean[0] -= off / cosine * math.cos(mean[2])
        mean[1] -= off / cosine * math.sin(mean[2])
        for axis in range(2):
            covariance[axis, axis] += min(SLID + SLIDES * went_on, MOST_SLID) ** 2
        covariance[2, 2] += (ANYHOW if kind == FLAT else min(SWUNG + SWINGS * went_on, MOST_SWUNG)) ** 2
        if kind == FLAT:
            square(mean, covariance, evidence, feature // 2, slope)
        off, _, variance, _ = meet(mean, covariance, evidence, feature, values, slope)
    learn_of(mean, covariance, slope, off, variance)


@njit(cache=True)
def square(mean, covariance, evidence, wall, slope):
    """Take into a hypothesis, in place, that the cart stands square to a wall."""
    own = OWN + 2 * wall
    off = mean[2] - evidence.lines[wall, 2]
    slope[:] = 0.0
    slope[2] = 1.0
    if evidence.unsure:
        off -= mean[own]
        slope[own] = -1.0
    off = wrapped(off)
    learn_of(mean, covariance, slope, off, max(spread_of(covariance, slope), 0.0) + SQUARE**2)


@njit(cache=True)
def slip_density(off, sigma, size):
    """Density (1/m) of a way too far by `off` m, sigma m unsure, if such are exponential with a mean of `size` (m).

    An exponentially modified Gaussian (Grushka, Analytical Chemistry 44, 1972).
    """
    ratio = sigma / size
    x = (ratio - off / sigma) / math.sqrt(2.0)
    if x > 20.0:  # far too near: what follows would be nothing times infinity
        return math.exp(-0.5 * (off / sigma) ** 2) / (size * x * math.sqrt(4.0 * math.pi))
    return 0.5 / size * math.exp(0.5 * ratio * ratio - off / size) * math.erfc(x)


@njit(cache=True)
def begin_at(mean, covariance, told):
    """Begin anew at a pose (3,) that was told; without one, where it is, with much doubt."""
    spread = TOLD if not math.isnan(told[0]) else KICK
    if not math.isnan(told[0]):
        covariance[:3] = 0.0
        covariance[:, :3] = 0.0
        mean[:3] = told
    for axis in range(3):
        covariance[axis, axis] += spread[axis] ** 2


@njit(cache=True)
def look(mean, covariance, seen, values, has_frame):
    """Take into a hypothesis, in place, the pose (3,) that a camera saw; its log density."""
    d = mean.size
    slopes = np.zeros((3, d))
    frame = mean[FRAME : FRAME + 3] if has_frame else np.zeros(3)
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    slopes[0, 0], slopes[0, 1], slopes[1, 0], slopes[1, 1], slopes[2, 2] = cos, -sin, sin, cos, 1.0
    x, y = cos * mean[0] - sin * mean[1], sin * mean[0] + cos * mean[1]
    if has_frame:
        slopes[0, FRAME] = slopes[1, FRAME + 1] = slopes[2, FRAME + 2] = 1.0
        slopes[0, FRAME + 2], slopes[1, FRAME + 2] = -y, x
    off = np.array([x + frame[0], y + frame[1], mean[2] + frame[2]]) - seen
    off[2] = wrapped(off[2])
    before, log_density = mean.copy(), 0.0
    for axis in range(3):  # one after the other is the same as all at once
        for c in range(d):
            off[axis] += slopes[axis, c] * (mean[c] - before[c])
        variance = max(spread_of(covariance, slopes[axis]), 0.0) + values[13 if axis == 2 else 12] ** 2
        log_density -= 0.5 * off[axis] * off[axis] / variance + 0.5 * math.log(2.0 * math.pi * variance)
        learn_of(mean, covariance, slopes[axis], off[axis], variance)
    return log_density
