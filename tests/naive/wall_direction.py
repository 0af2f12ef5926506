"""A wall direction chord by chord; the density of many by a sum over every one seen, not over their harmonics."""

from __future__ import annotations

import math

import numpy as np

HARMONICS, BLUR = 5, math.radians(16.0)


def density(angle, seen, prior):
    """How likely `angle` is, relative to any: kernels about the (angle, strength) `seen`, and `prior` of no opinion."""
    known = sum(strength for _, strength in seen)
    return (prior + sum(strength * kernel(angle - before) for before, strength in seen)) / (prior + known)


def kernel(angle):
    """A wrapped normal distribution relative to the uniform one, of its first harmonics."""
    return 1.0 + sum(2.0 * math.exp(-0.5 * (m * BLUR) ** 2) * math.cos(m * angle) for m in range(1, HARMONICS + 1))


def wall_direction(walls, step, enough, jump):
    """Chords over `step` rays, each voting with its length for its direction modulo a right angle."""
    n = walls.distances.size
    votes, total, chords = 0j, 0.0, 0
    for ray in range(n):
        inner = [walls.distances[(ray + k) % n] for k in range(step + 1)]
        if not all(math.isfinite(distance) for distance in inner) or abs(inner[-1] - inner[0]) >= jump:
            continue
        start = inner[0] * np.exp(2j * math.pi * ray / n)
        chord = inner[-1] * np.exp(2j * math.pi * (ray + step) / n) - start
        votes += abs(chord) * np.exp(4j * math.atan2(chord.imag, chord.real))
        total += abs(chord)
        chords += 1
    return 0j if chords < 3 else votes / total * min(1.0, total / step / enough)
