"""Where two rotation counters and a bumper say that a cart went: exact arcs, stage by stage, as the robot logged them.

A cart drives until it bumps, backs up, turns and drives off again; each stage is logged as the ticks of both wheels
(Dye, Mapping with only a bumper, part 2). The robot's pose is the middle of its axle. What the counters do not know,
slip and what a wall does to the heading, is for `slam.bump_localizer`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.pose import compose

DRIVE, BACK, TURN = 0, 1, 2  # kinds of stages
LEFT, MIDDLE, RIGHT = 1, 2, 4  # bits of the bumper's switches
INCH = 0.0254  # m


class Stage(NamedTuple):
    """One stage of drive, back up, turn: ticks of both wheels, negative backwards, and the switches closed at its end.

    A drive that ends with no switch closed (0) timed out. A cart with one switch has `MIDDLE` for any contact.
    """

    kind: int
    left: int
    right: int
    bumper: int = 0


class Noise(NamedTuple):
    """Of `CartParams`, what its errors grow by."""

    wheelbase: float
    distance_noise: float
    turn_noise: float
    rotation_noise: float
    slip_length: float


class CartParams(NamedTuple):
    """A cart's build in m, and the standard deviations of its odometry's errors.

    Errors that grow do so with the root of the way, as sums of independent ones do, once it is longer than tyres slip
    alike (`grown`); ticks add their own quantization.
    A share of the bumps ends with large errors besides. Tick and bumper are the paper's, whose wheelbase "was difficult
    to determine" and whose bumper covers the robot's profile; sizes of errors are those of the virtual cart.
    """

    wheelbase: float = 0.064
    tick: float = 0.0675 * INCH  # m of a wheel's way
    bumper_width: float = 3.0 * INCH
    bumper_ahead: float = 0.09  # from the middle of the axle to the bumper's middle
    distance_noise: float = 0.003  # m per root metre
    turn_noise: float = 0.045  # rad per root metre
    rotation_noise: float = 0.03  # rad per root rad turned
    slip_length: float = 0.045  # m of a wheel's way over which it slips alike
    wheelbase_doubt: float = 0.02  # share of the wheelbase that it may be wrong by
    slip_share: float = 0.2  # of bumps that the wheels go on after
    slip_distance: float = 0.06  # m that they go on then, in the mean, at a wall they meet square; along a wall more
    slip_turn: float = 0.1  # rad that this may turn the cart
    flatten_distance: float = 0.15  # m of going on that make the cart stand square to the wall, in the mean
    switches: int = 1  # of the bumper: one for all of it, or three for its thirds
    veer: float = 0.0  # rad/m that it turns when its counters say straight on, as one wheel is larger than the other


@njit(cache=True)
def grown(way, length):
    """A way (m, not negative) as a variance grows along it by errors that are alike over a `length` (m).

    The variance of a first-order process's integral, as a share of what it grows by per metre in the end: way less
    length for long ways, way^2 / (2 length) for short ones (Gelb, Applied Optimal Estimation, 1974, section 2.2).
    """
    if length <= 0.0:
        return way
    share = way / length
    if share < 1e-4:  # what the two terms below differ by is lost in their digits
        return 0.5 * share * way
    return way + length * math.expm1(-share)


@njit(cache=True)
def turn_variance(way, turn, cart):
    """Variance (rad^2) of the heading after a stage of a way (m) and a turn (rad), without ticks and slips.

    `cart` is a `CartParams`, or else has the fields of `Noise`. On the spot a wheel goes half a wheelbase per rad.
    """
    half = 0.5 * cart.wheelbase
    rotated = grown(half * abs(turn), cart.slip_length) / half
    return cart.turn_noise**2 * grown(abs(way), cart.slip_length) + cart.rotation_noise**2 * rotated


@njit(cache=True)
def way_variance(way, cart):
    """Variance (m^2) of a stage's way (m), likewise."""
    return cart.distance_noise**2 * grown(abs(way), cart.slip_length)


def arc(left: np.ndarray | int, right: np.ndarray | int, params: CartParams) -> np.ndarray:
    """Pose changes (..., 3) of stages of `left` and `right` ticks (...,), in the frame of each one's beginning.

    The chord of a circle's arc, which holds forwards, backwards, straight on (an arc of infinite radius) and on the
    spot. The angle is the whole turn, not wrapped. ValueError where wheelbase or tick are not positive.
    """
    if not (params.wheelbase > 0.0 and params.tick > 0.0):
        raise ValueError(f"wheelbase {params.wheelbase} m and tick {params.tick} m must both be positive")
    left, right = np.asarray(left, float), np.asarray(right, float)
    way = 0.5 * params.tick * (left + right)
    turn = params.tick * (right - left) / params.wheelbase + params.veer * way
    chord = way * np.sinc(turn / (2.0 * np.pi))  # sin(turn / 2) / (turn / 2), 1 where there is no turn
    return np.stack([chord * np.cos(0.5 * turn), chord * np.sin(0.5 * turn), turn], axis=-1)


def arcs(stages: Sequence[Stage], params: CartParams) -> np.ndarray:
    """Pose changes (n, 3) of a run's stages."""
    ticks = np.array([(stage.left, stage.right) for stage in stages], float).reshape(-1, 2)
    return arc(ticks[:, 0], ticks[:, 1], params)


def raw_path(
    stages: Sequence[Stage], params: CartParams, start: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """Poses (n + 1, 3) at the start and after each stage: movements added end to end, with all their errors."""
    poses = [np.asarray(start, float)]
    for change in arcs(stages, params):
        poses.append(compose(poses[-1], change))
    return np.array(poses)


def bumps_of(stages: Sequence[Stage]) -> np.ndarray:
    """Rows (m,) of the stages that ended at a wall."""
    return np.array([row for row, stage in enumerate(stages) if stage.kind == DRIVE and stage.bumper], np.int64)


def bumper_points(poses: np.ndarray, params: CartParams) -> np.ndarray:
    """The bumper's left, middle and right points (..., 3, 2) of carts at poses (..., 3)."""
    poses = np.asarray(poses, float)
    across = 0.5 * params.bumper_width * np.array([1.0, 0.0, -1.0])
    cos, sin = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x = poses[..., 0, None] + params.bumper_ahead * cos - across * sin
    y = poses[..., 1, None] + params.bumper_ahead * sin + across * cos
    return np.stack([x, y], axis=-1)
