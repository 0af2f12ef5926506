"""`crunch calibrate cart`: logs of one bumper cart on a known map in, its build and its noise out, with intervals.

Each recording is folded into its stages (its siblings `recorded` and `replay`, for logs and options); what they say of
the cart is for `slam.cart_calibration`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from server import config
from server.errors import UserError
from server.recorded import open_log
from server.replay import Options
from server.robots.bumper_cart import BumperCart, area_named
from slam.cart_calibration import Learned, learn_from_map
from slam.cart_odometry import CartParams, Stage, bumps_of

NAME = "bumper_cart"
BUILT = ("wheelbase", "tick", "bumper_width", "bumper_ahead")  # that the settings have
UNITS = {
    "wheelbase": "m", "tick": "m", "bumper_width": "m", "bumper_ahead": "m", "tolerance": "m", "play": "ticks",
    "distance_noise": "m per root metre", "turn_noise": "rad per root metre", "rotation_noise": "rad per rad",
}  # fmt: skip


class CartCalibration(NamedTuple):
    """What was learned, from so many bumps, and what the reader should know of the logs."""

    learned: Learned
    present: CartParams
    bumps: int
    warnings: list[str]

    def rows(self) -> list[tuple[str, ...]]:
        """A table: parameter, estimate, interval, present value, unit."""
        rows: list[tuple[str, ...]] = [("parameter", "estimate", "90 % interval", "present", "unit")]
        for name, value, (low, high) in zip(*self.learned[:3], strict=True):
            present = getattr(self.present, name, None)
            told = f"{present:.4g}" if present is not None else "-"
            rows.append((name, f"{value:.4g}", f"{low:.4g} to {high:.4g}", told, UNITS[name]))
        return rows

    def toml(self) -> str:
        """A configuration file with the build; how it errs stands beside it."""
        lines = [f"# Learned by `crunch calibrate cart` from {self.bumps} bumps.", f"[{NAME}.build]"]
        lines += [f"{name} = {self.learned.value(name):.5g}  # {UNITS[name]}" for name in BUILT]
        return "\n".join(lines) + "\n"


def calibrate(paths: Sequence[Path], world: str, options: Options) -> CartCalibration:
    """Learn from logs of one cart on one map; UserError where they cannot be read, or tell nothing."""
    area = area_named(world)
    runs: list[list[Stage]] = []
    warnings: list[str] = []
    present = CartParams()
    for path in paths:
        log = open_log(path, None, None, NAME)
        params = config.load(options.flags, options.file, log.configuration, options.assignments).bumper_cart
        present = params.build.params
        robot = BumperCart(params)
        for message in log.messages(robot.calibration):
            robot.step(message)
        robot.finish()
        runs.append(robot.stages)
        warnings += log.warnings
        if robot.truant:
            warnings.append(f"{path}: {robot.truant} stages were lost; poses on both sides of them are not compared")
    try:
        learned = learn_from_map(runs, area, present, seed=options.seed)
    except ValueError as error:
        raise UserError(f"{', '.join(map(str, paths))}: nothing is learned: {error}") from None
    return CartCalibration(learned, present, sum(len(bumps_of(stages)) for stages in runs), warnings)
