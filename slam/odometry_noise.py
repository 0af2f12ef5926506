"""How badly a robot's odometry errs, learned from where its paths meet themselves: maximum likelihood with intervals.

A drive's path is taken from a path filter. Where it comes back to a place, the walls measure a relative pose
(`slam.loop_measurements`); what odometry says about it is off by the errors of all steps between. To first order those
add up linearly, so that the measurements are jointly Gaussian and the errors' variances are variance components of
them: steps that no loop spans weigh nothing, and no path that leans towards its own prior is taken for the truth. The
measurements' own scale is a component too, so that it does not matter how much the filter tempers its affinity.

    drives = [linearise(chain, path, measure_loops(path, seen)) for chain, path, seen in ...]
    learned = learn(drives, present)
    learned.values, learned.intervals  # of `LEARNED`

Sizes are those of `slam.motion.MotionParams`: two kinds of turn error, one of distance, and the drives' turn biases. A
scale bias shows nowhere: where a path comes back to the same place, it does so in a map of any size.
Uses its siblings `loop_measurements`, `motion`, `odometry_chain` and `variance_components`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from slam.loop_measurements import Loops
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.pose import between, wrap
from slam.variance_components import NOTHING, Block, Estimate, interval, maximise

LEARNED = ("turn_noise", "distance_noise", "rotation_noise", "turn_bias")  # fields of MotionParams
TURN_BIAS = LEARNED.index("turn_bias")
MEASUREMENT = len(LEARNED)  # the component of the measurements' own errors
LEAST = 15  # measurements below which nothing is learned
EXCESS = 2.0  # of intervals: over simulated drives, the truth is that much less likely than chi square allows
SYSTEMATIC = 0.1  # share by which estimates from many simulated drives together are off; more drives do not mend it
OUTLIER = 4.0  # standard deviations of a measurement's error beyond which its pair is left out


class Learned(NamedTuple):
    """Estimate (4,), 0 if absent, and 95 % interval (4, 2) of each of `LEARNED`; measurements' errors over the told.

    `biases` (d, 2): each drive's turn bias, with its standard deviation behind it. `n_rows` (d,) and `n_left_out` count
    measurements. `gain` is in log likelihood over the present sizes, `unlike` (d,) what noise of its
    own would gain each drive.
    """

    values: np.ndarray
    intervals: np.ndarray
    measurement: float
    biases: np.ndarray
    n_rows: np.ndarray
    n_left_out: int
    gain: float
    unlike: np.ndarray


class NothingRevealed(ValueError):
    """The drives come back to too few places for their odometry's errors to show."""


def corrections_of(chain: Chain, path: np.ndarray) -> np.ndarray:
    """(3, v): turns (rad), lengths and sideways slips (m) that the path (v, 3) adds to odometry's motions.

    They act as in `slam.motion.moved_pose`, half of a turn before the way; columns 0 are 0. A particle's path never
    slips, a refined one does (`slam.odometry_chain`).
    """
    found = np.zeros_like(chain.motions)
    found[1:] = between(path[:-1], path[1:])
    turns = wrap(found[:, 2] - chain.motions[:, 2])
    ways = directions(chain) + 0.5 * turns
    along = found[:, 0] * np.cos(ways) + found[:, 1] * np.sin(ways)
    aside = found[:, 1] * np.cos(ways) - found[:, 0] * np.sin(ways)
    return np.stack([turns, along - np.hypot(chain.motions[:, 0], chain.motions[:, 1]), aside])


def directions(chain: Chain) -> np.ndarray:
    """Direction (v,) of each motion in the older vertex's frame."""
    return np.arctan2(chain.motions[:, 1], chain.motions[:, 0])


def jacobian(chain: Chain, path: np.ndarray, loops: Loops) -> np.ndarray:
    """(3, k, v): what a turn, a lengthening and a slip of each step do to the measured places.

    Half of a turn acts before the step and half after it: as if the robot turned in its middle.
    """
    middles = 0.5 * (path[:-1, :2] + path[1:, :2])
    headings = path[:-1, 2] + directions(chain)[1:] + 0.5 * corrections_of(chain, path)[0, 1:]
    ahead = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    rows = np.zeros((3, len(loops.first), len(path)))
    for row, (a, b) in enumerate(zip(loops.first, loops.second, strict=True)):
        cos, sin = math.cos(path[a, 2]), math.sin(path[a, 2])
        direction = loops.directions[row] @ np.array([[cos, sin], [-sin, cos]])  # in the world's axes
        to_the_right = np.array([direction[1], -direction[0]])
        levers = path[b, :2] - middles[a:b]
        rows[:, row, a + 1 : b + 1] = levers @ to_the_right, ahead[a:b] @ direction, ahead[a:b] @ to_the_right
    return rows


class Linearised(NamedTuple):
    """A drive's measurements: the block of their components, and which pair of vertices each (k,) is about.

    `effects` (k,) are those of a unit of turn bias.
    """

    block: Block
    pairs: np.ndarray
    effects: np.ndarray

    def without(self, is_out: np.ndarray) -> Linearised:
        """Without the measurements for which `is_out` (k,) says so."""
        kept = np.flatnonzero(~is_out)
        block = Block(self.block.residuals[kept], self.block.kernels[:, kept[:, None], kept])
        return Linearised(block, self.pairs[kept], self.effects[kept])


def linearise(chain: Chain, path: np.ndarray, loops: Loops) -> Linearised:
    """Residuals of odometry alone at the measured places, to first order about the path (v, 3)."""
    rows = jacobian(chain, path, loops)
    turns, lengths, _ = rows
    effects = turns @ chain.travelled
    kernels = [
        (turns * chain.travelled) @ turns.T,
        (lengths * chain.travelled) @ lengths.T,
        (turns * chain.motions[:, 2] ** 2) @ turns.T,
        np.outer(effects, effects),
        np.diag(loops.variances),
    ]
    residuals = loops.offsets + np.einsum("ckv,cv->k", rows, corrections_of(chain, path))
    return Linearised(Block(residuals, np.array(kernels)), loops.pairs, effects)


def bias_of(drive: Linearised, sizes: np.ndarray) -> tuple[float, float]:
    """Turn bias of this drive alone, with its standard deviation."""
    inverse = np.linalg.inv(np.tensordot(sizes**2, drive.block.kernels, 1))
    information = max(1e-12, float(drive.effects @ inverse @ drive.effects))
    bias = float(drive.effects @ inverse @ drive.block.residuals) / information
    return bias, math.sqrt(max(0.0, 1.0 / information - sizes[TURN_BIAS] ** 2))


def outliers(drive: Linearised, sizes: np.ndarray) -> np.ndarray:
    """Which rows (k,) belong to a pair one of whose measurements errs by more than `OUTLIER` of its deviations."""
    inverse = np.linalg.inv(np.tensordot(sizes**2, drive.block.kernels, 1))
    errors = (inverse @ drive.block.residuals) / np.sqrt(np.diag(inverse))
    return np.isin(drive.pairs, drive.pairs[np.abs(errors) > OUTLIER])


class Fit(NamedTuple):
    """Drives without their outliers, and the sizes of greatest likelihood: those of `LEARNED`, then `MEASUREMENT`."""

    drives: list[Linearised]
    best: Estimate

    @property
    def blocks(self) -> list[Block]:
        """One for each drive."""
        return [drive.block for drive in self.drives]

    def fall(self, values: Sequence[float] | np.ndarray, which: Sequence[int]) -> float:
        """How much less likely the drives are if the components `which` of `LEARNED` are `values`, and not the best."""
        at = self.best.log_sizes.copy()
        at[which] = logarithms(values)
        return self.best.value - maximise(self.blocks, at, which).value


def logarithms(sizes: Sequence[float] | np.ndarray) -> np.ndarray:
    """Of sizes, none of which is so small that the search could not leave it."""
    return np.log(np.maximum(sizes, 1e-3))


def fit(drives: Sequence[Linearised], present: MotionParams) -> Fit:
    """The sizes under which drives of one robot are likeliest; `present` is where the search starts.

    NothingRevealed where they come back to too little.
    """
    n = sum(drive.pairs.size for drive in drives)
    if n < LEAST:
        raise NothingRevealed(f"{n} measurements where paths come back, {LEAST} are needed")
    start = np.append(logarithms(sizes_of(present)), math.log(0.5))
    first = maximise([drive.block for drive in drives], start).log_sizes
    kept = [drive.without(outliers(drive, np.exp(first))) for drive in drives]
    return Fit(kept, maximise([drive.block for drive in kept], first))


def sizes_of(motion: MotionParams) -> list[float]:
    """The components of `LEARNED`, as the parameters have them."""
    return [getattr(motion, name) for name in LEARNED]


def learn(
    drives: Sequence[Linearised], present: MotionParams, progress: Callable[[float], None] | None = None
) -> Learned:
    """Learn the sizes from drives of one robot, with intervals; NothingRevealed where they come back to too little.

    `progress` takes the share that is done.
    """
    found = fit(drives, present)
    sizes = np.exp(found.best.log_sizes)
    intervals = []
    for which in range(MEASUREMENT):
        intervals.append(widened(sizes[which], interval(found.blocks, found.best, which, EXCESS)))
        if progress:
            progress((which + 1) / MEASUREMENT)
    n_rows = np.array([drive.pairs.size for drive in found.drives])
    return Learned(
        values=np.where(found.best.log_sizes > NOTHING, sizes, 0.0)[:MEASUREMENT],
        intervals=np.array(intervals),
        measurement=float(sizes[MEASUREMENT]),
        biases=np.array([bias_of(drive, sizes) for drive in found.drives]),
        n_rows=n_rows,
        n_left_out=sum(drive.pairs.size for drive in drives) - int(n_rows.sum()),
        gain=found.fall(sizes_of(present), range(MEASUREMENT)),
        unlike=np.array([gain_of_its_own(drive.block, found.best) for drive in found.drives]),
    )


def widened(value: float, ends: tuple[float, float]) -> list[float]:
    """An interval's ends, farther off by what more drives do not mend: `SYSTEMATIC`. None and infinite stay."""
    low, high = ends
    if low > 0.0:
        low = value * math.exp(-math.hypot(math.log(value / low), SYSTEMATIC))
    if high < math.inf:
        high = value * math.exp(math.hypot(math.log(high / value), SYSTEMATIC))
    return [low, high]


def gain_of_its_own(block: Block, common: Estimate) -> float:
    """Log likelihood that a drive gains when it may have noise of its own; chi square of three degrees, halved.

    The measurements' own errors may be its own in either case, and one drive says little about the biases' spread.
    """
    if block.residuals.size < LEAST:
        return 0.0
    shared = maximise([block], common.log_sizes, range(MEASUREMENT))
    return maximise([block], shared.log_sizes, [TURN_BIAS]).value - shared.value
