"""Density of wall directions by a sum over every direction seen, not over the harmonics of them all."""

from __future__ import annotations

import math

HARMONICS, BLUR = 5, math.radians(16.0)


def density(angle, seen, prior):
    """How likely `angle` is, relative to any: kernels about the (angle, strength) `seen`, and `prior` of no opinion."""
    known = sum(strength for _, strength in seen)
    return (prior + sum(strength * kernel(angle - before) for before, strength in seen)) / (prior + known)


def kernel(angle):
    """A wrapped normal distribution relative to the uniform one, of its first harmonics."""
    return 1.0 + sum(2.0 * math.exp(-0.5 * (m * BLUR) ** 2) * math.cos(m * angle) for m in range(1, HARMONICS + 1))
