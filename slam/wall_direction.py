"""What the directions of walls say about a particle's heading: the density of those that it saw before, learned.

Every particle keeps how often walls stood in which direction of its own frame, modulo 90 degrees, as the first few
harmonics of that distribution. A wall is as likely as it stands where walls stood. A building with two wall directions
gives one peak, slanted wings one each. Where walls turn steadily, as in a round hall, the density is flat along the
true path, but a path bent until they stand alike gains: such buildings are for islands that believe in no directions
(`slam.islands`). Strong directions count more than faint ones. Uses its sibling `walls`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.params import Params
from slam.walls import Walls

HARMONICS = 5  # of four angles: directions 12 degrees apart are told apart
BLUR = math.radians(16.0)  # of four angles: how far a wall's direction errs, in the kernel density


class DirectionParams(Params):
    """How far the directions of walls are believed."""

    gain: float = Field(default=0.5, ge=0.0)  # of the log density, for neighbours see the same walls; 0 switches it off
    memory: float = Field(default=0.98, ge=0.0, le=1.0)  # of the directions seen, per vertex
    prior: float = Field(default=2.0, gt=0.0)  # vertices' worth of belief that walls stand anyhow
    outliers: float = Field(default=0.15, gt=0.0, le=1.0)  # share of vertices whose walls obey nothing seen before


def wall_direction(walls: Walls, step: int = 3, enough: float = 0.6, jump: float = 0.15) -> complex:
    """Dominant wall direction modulo 90 degrees as R exp(4 i a), |R| from 0 (none, or too little wall) to 1.

    Chords over `step` rays vote with their length; `enough` (m) of wall counts in full.
    """
    n = walls.distances.size
    angles = 2.0 * np.pi * np.arange(n) / n
    inside = np.where(np.isfinite(walls.distances), walls.distances, np.nan)
    points = inside * np.exp(1j * angles)
    chords = np.roll(points, -step) - points
    steady = np.abs(np.roll(inside, -step) - inside) < jump
    for between in range(1, step):
        steady &= np.isfinite(np.roll(inside, -between))
    chords = chords[steady]
    lengths = np.abs(chords)
    total = float(np.sum(lengths))
    if chords.size < 3 or total == 0.0:
        return 0j
    votes = np.sum(lengths * np.exp(4j * np.angle(chords))) / total
    return complex(votes * min(1.0, total / step / enough))


def fresh_directions(n: int) -> np.ndarray:
    """(n, 10) of particles that have seen nothing: real and imaginary parts of the harmonics."""
    return np.zeros((n, 2 * HARMONICS), np.float32)


def kernel_of_blur() -> np.ndarray:
    """(5,) what a wrapped normal distribution's harmonics are weighed by, twice, for both signs."""
    return 2.0 * np.exp(-0.5 * (np.arange(1, HARMONICS + 1) * BLUR) ** 2)


KERNEL = kernel_of_blur()


@njit(cache=True, nogil=True)
def align(poses, particles, seen, known, gain, memory, prior, outliers, low, high):
    """Weigh particles low..high, at `poses` (n, 3), by how likely the walls' direction `seen` is to them; learn it.

    `seen` is cos and sin of 4 angles, times its strength; `known` the strengths that the particles have learned from.
    """
    strength = math.hypot(seen[0], seen[1])
    if strength == 0.0:
        return
    unit_x, unit_y = seen[0] / strength, seen[1] / strength
    for p in range(low, high):
        theta = 4.0 * poses[p, 2]
        cos, sin = math.cos(theta), math.sin(theta)
        x, y = cos * unit_x - sin * unit_y, sin * unit_x + cos * unit_y
        learned, power_x, power_y, density = particles.directions[p], 1.0, 0.0, 0.0
        for m in range(HARMONICS):
            power_x, power_y = power_x * x - power_y * y, power_x * y + power_y * x
            density += KERNEL[m] * (learned[2 * m] * power_x + learned[2 * m + 1] * power_y)
            learned[2 * m] = memory * learned[2 * m] + strength * power_x
            learned[2 * m + 1] = memory * learned[2 * m + 1] + strength * power_y
        likely = max(0.0, 1.0 + density / (known + prior))
        gained = gain * strength * math.log((1.0 - outliers) * likely + outliers)
        particles.log_weights[p] += gained
        particles.affinities[p] += gained
