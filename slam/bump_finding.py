"""Where a cart's run was on a map of walls that bumps made, by the run alone.

The mapper's own particles look for it, which know the walls from the start and are anywhere at their first bump; so a
cart whose own map is wrong is found as well as any. Uses its siblings `bump_fleet`, `bump_mapper`, `bump_swarm`,
`bump_walls`, `cart_odometry` and `pose`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.bump_fleet import Track
from slam.bump_mapper import BumpMap, BumpMapper, BumpMapperParams
from slam.bump_swarm import COVARIANCE, HITS, PHI, VAR_BEYOND, VAR_PHI
from slam.bump_walls import LEAST_BUMPS, stretches
from slam.cart_odometry import CartParams, Stage, bumps_of, raw_path
from slam.params import Params
from slam.pose import compose, inverse

STEEPEST_START = math.radians(75.0)  # off square that a cart's first bump may have been
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class BumpFindingParams(Params):
    """How hard a cart is looked for, and when it is found."""

    particles: int = Field(default=2000, ge=1, le=200_000)  # that find a cart on the map
    tries: int = Field(default=2, ge=1)  # each with three times as many
    wall_doubt: float = Field(default=0.01, gt=0.0)  # m and rad by which the map's walls may be off
    least_told: float = Field(default=0.7, gt=0.0, le=1.0)  # of a cart's bumps that must be on walls of the map


class Recording(NamedTuple):
    """A cart's run, its build, and what `BumpMapper.refine` made of it."""

    stages: Sequence[Stage]
    cart: CartParams
    area: BumpMap

    @property
    def cost(self) -> float:
        """In nats per bump, by which maps of unlike runs are compared."""
        return self.area.cost / max(1, len(self.area.contacts))


def found_on(
    lines: np.ndarray, recording: Recording, mapper: BumpMapperParams, params: BumpFindingParams
) -> tuple[Track, np.ndarray]:
    """Where a run was on a map of lines (m, 10), and the lines (k, 10) that it felt besides.

    The particle that explains the run best is told. Where it is told wrong, three times as many try again.
    """
    known = lines.copy()
    known[:, [VAR_PHI, VAR_BEYOND]], known[:, COVARIANCE] = params.wall_doubt**2, 0.0
    is_bump = recording.area.is_bump
    track, new = Track(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(2)), lines[:0]
    for n in params.particles * 3 ** np.arange(params.tries):
        changed = {"n_particles": int(n), "n_islands": 1, "n_lines": min(120, len(lines) + mapper.n_lines)}
        swarm = BumpMapper(recording.cart, mapper.model_copy(update=changed))
        swarm.swarm.poses[:] = starts_anywhere(lines, recording, int(n))
        swarm.swarm.lines[:, : len(lines)] = known
        swarm.swarm.n_lines[:] = len(lines)
        swarm.extend(recording.stages)
        state = swarm.state(int(np.argmax(swarm.swarm.scores)))
        track = Track(state.nodes, np.where(state.felt < len(lines), state.felt, -1), state.biases)
        new = state.lines[len(lines) :]
        if np.mean(track.felt[is_bump] >= 0) >= params.least_told:
            break
    return track, new


def starts_anywhere(lines: np.ndarray, recording: Recording, n: int) -> np.ndarray:
    """Poses (n, 3) at a run's start, from which it has its first bump anywhere along lines (m, 10), at any angle.

    Places are even along the walls, angles an additive sequence (Weyl, of the golden ratio).
    """
    lines, cart = lines[lines[:, HITS] >= LEAST_BUMPS], recording.cart
    ends = stretches(lines)
    along = ends[:, 2:] - ends[:, :2]
    reached = np.cumsum(np.hypot(*along.T) + 1e-9)
    at = (np.arange(n) + 0.5) / n * reached[-1]
    row = np.searchsorted(reached, at)
    back = (reached[row] - at) / (np.hypot(*along.T) + 1e-9)[row]
    off = STEEPEST_START * (2.0 * (np.arange(n) * GOLDEN % 1.0) - 1.0)
    # the end of the bumper that is farther out touches
    touching = np.column_stack([
        np.full(n, cart.bumper_ahead), -0.5 * cart.bumper_width * np.where(off < 0.0, -1.0, 1.0), np.zeros(n)
    ])  # fmt: skip
    spots = ends[row, 2:] - back[:, None] * along[row]
    poses = compose(np.column_stack([spots, lines[row, PHI] + off]), inverse(touching))
    first = bumps_of(recording.stages)[0]
    return compose(poses, inverse(raw_path(recording.stages[: first + 1], cart)[-1]))
