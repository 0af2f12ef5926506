"""Motors without encoders: how fast a power drives them, by trials, and where that leads (Maze Runner, eq. 1 and 2).

power = A exp(B speed): below the power A the wheel stands, and the faster it turns the more each further cm/s takes. A
line through the logarithms of the powers finds A and B. Speeds are a wheel's rim's in m/s, powers shares of the whole,
either with its sign.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.params import Params

Pair = tuple[float, float]  # of the left and of the right


class MotorParams(Params):
    """Two motors and the wheels that they drive. The default is the paper's curve for both."""

    standing: Pair = (0.090149, 0.090149)  # A of each: the power at which it begins to turn,
    growth: Pair = (6.44209, 6.44209)  # and B, s/m
    track: float = Field(default=0.20, gt=0.0)  # m between the wheels
    nominal_volts: float = Field(
        default=11.4, gt=0.0
    )  # of the battery when the curve was taken: a power counts as much
    lag: float = Field(default=0.1, ge=0.0)  # s in which a wheel follows two thirds of a change


class MotorCurve(NamedTuple):
    """`standing` (A) is the power at which it begins to turn, `growth` (B, s/m) how fast the power grows with speed."""

    standing: float
    growth: float

    @property
    def fastest(self) -> float:
        """The speed at full power."""
        return math.log(1.0 / self.standing) / self.growth

    def command(self, speed: np.ndarray | float) -> np.ndarray:
        """The power for a speed; 0 for none, and full power for one that is out of reach."""
        speed = np.asarray(speed, float)
        power = self.standing * np.exp(self.growth * np.minimum(np.abs(speed), self.fastest))
        return np.where(speed == 0.0, 0.0, np.copysign(power, speed))

    def speed(self, command: np.ndarray | float) -> np.ndarray:
        """The speed that a power makes; 0 within the dead band up to `standing`."""
        command = np.asarray(command, float)
        power = np.clip(np.abs(command), self.standing, 1.0)
        return np.copysign(np.log(power / self.standing) / self.growth, command)


class MotorFit(NamedTuple):
    """The curve of n trials, the standard deviation of its two parameters (log A, B), and what it leaves.

    `residuals` (n,) are powers told less those of the curve, as shares of these.
    """

    curve: MotorCurve
    log_standing_sigma: float
    growth_sigma: float
    residuals: np.ndarray


def fit_curve(powers: np.ndarray, distances: np.ndarray, times: np.ndarray) -> MotorFit:
    """The curve of trials in which powers (n,) in (0, 1] drove a wheel over distances (n,) in m in times (n,) in s.

    ValueError for what is out of these bounds, for trials of one speed, and where more power was not faster.
    """
    powers, distances, times = (np.asarray(values, float) for values in (powers, distances, times))
    if not (np.all(powers > 0.0) and np.all(powers <= 1.0)):
        raise ValueError("powers must be above 0 and at most 1")
    if not (np.all(distances > 0.0) and np.all(times > 0.0) and np.all(np.isfinite(distances + times))):
        raise ValueError("distances and times must be above 0: leave out trials in which the wheel stood")
    speeds = distances / times
    if len(speeds) < 2 or float(np.ptp(speeds)) < 1e-9:
        raise ValueError("a curve needs trials of at least two speeds")
    design = np.column_stack([np.ones_like(speeds), speeds])
    (intercept, growth), *_ = np.linalg.lstsq(design, np.log(powers), rcond=None)
    if growth <= 0.0:
        raise ValueError("more power was not faster in these trials: look for swapped columns")
    off = np.log(powers) - design @ [intercept, growth]
    spare = len(speeds) - 2
    variance = float(off @ off) / spare if spare > 0 else math.nan
    sigmas = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    curve = MotorCurve(math.exp(intercept), float(growth))
    return MotorFit(curve, float(sigmas[0]), float(sigmas[1]), np.expm1(off))


class MotorOdometry:
    """Dead reckoning by what the motors are told: the pose (3,) that the powers lead to."""

    def __init__(self, params: MotorParams):
        self.params = params
        self.curves = [MotorCurve(*both) for both in zip(params.standing, params.growth, strict=True)]
        self.pose = np.zeros(3)
        self.speeds = np.zeros(2)  # m/s of the wheels' rims
        self.t: float | None = None
        self.wanted = np.zeros(2)

    def step(self, t: float, powers: Pair, volts: float) -> float:
        """Take up powers (shares of 1) at a time (s); the metres that the robot has gone since the last, signed.

        What was told before counts until then. `volts` are the battery's; 0 where it does not tell.
        """
        params = self.params
        seconds = 0.0 if self.t is None else max(0.0, t - self.t)
        follows = 1.0 - math.exp(-seconds / params.lag) if params.lag > 0.0 else 1.0
        before = self.speeds
        self.speeds = before + follows * (self.wanted - before)
        catching_up = (params.lag * follows if params.lag > 0.0 else 0.0) * (self.wanted - before)
        left, right = self.wanted * seconds - catching_up  # of an exponential's way
        turn, way = (right - left) / params.track, 0.5 * (left + right)
        middle = self.pose[2] + 0.5 * turn
        heading = math.remainder(self.pose[2] + turn, 2.0 * math.pi)
        self.pose = np.array([self.pose[0] + way * math.cos(middle), self.pose[1] + way * math.sin(middle), heading])
        share = volts / params.nominal_volts if volts > 0.0 else 1.0
        self.wanted = np.array(
            [float(curve.speed(share * power)) for curve, power in zip(self.curves, powers, strict=True)]
        )
        self.t = t
        return float(way)
