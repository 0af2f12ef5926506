"""Counter-based random numbers with Python's unbounded integers and its own normal quantile."""

from __future__ import annotations

from statistics import NormalDist

WORD = 2**64


def nth_output(state, n):
    """SplitMix64, stepped n + 1 times."""
    for _ in range(n + 1):
        state = (state + 0x9E3779B97F4A7C15) % WORD
    mixed = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9 % WORD
    mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EB % WORD
    return mixed ^ (mixed >> 31)


def bits(seed, *words):
    """A generator per word, each seeded by the one before."""
    for word in words:
        seed = nth_output(seed, word)
    return seed


def uniform(seed, vertex, particle, stream):
    """The upper 53 bits as a fraction."""
    return (bits(seed, vertex, particle, stream) // 2**11) / 2**53


def gaussian(seed, vertex, particle, stream):
    """Quantile of the middle of the interval that the upper 52 bits name."""
    return NormalDist().inv_cdf((2 * (bits(seed, vertex, particle, stream) // 2**12) + 1) / 2**53)
