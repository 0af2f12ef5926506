"""Random numbers that are functions of a key, so that neither threads nor restarts change them.

A key is (seed, vertex, particle, stream). Every word of it selects one output of a SplitMix64 generator, and that
output seeds the generator of the next word (Steele, Lea and Flood, Fast splittable pseudorandom number generators,
OOPSLA 2014): a tree of generators in which any number is reached directly, in any order, by any thread.

Streams keep apart what one particle draws at one vertex; whoever draws names its streams. Words are
integers from 0 to 2^63 - 1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio, odd: SplitMix64's step
FIRST_MULTIPLIER = np.uint64(0xBF58476D1CE4E5B9)
SECOND_MULTIPLIER = np.uint64(0x94D049BB133111EB)
ONE, SHIFT_11, SHIFT_12 = np.uint64(1), np.uint64(11), np.uint64(12)
SHIFT_27, SHIFT_30, SHIFT_31 = np.uint64(27), np.uint64(30), np.uint64(31)


@njit(cache=True)
def nth_output(state, n):
    """Output n (from 0) of the SplitMix64 generator that starts at `state`, a uint64."""
    mixed = state + GOLDEN * (np.uint64(n) + ONE)
    mixed = (mixed ^ (mixed >> SHIFT_30)) * FIRST_MULTIPLIER
    mixed = (mixed ^ (mixed >> SHIFT_27)) * SECOND_MULTIPLIER
    return mixed ^ (mixed >> SHIFT_31)


@njit(cache=True)
def vertex_key(seed, vertex):
    """The first two words of a key, for those who draw for many particles."""
    return nth_output(np.uint64(seed), vertex)


@njit(cache=True)
def bits(seed, vertex, particle, stream):
    """64 random bits of the key, as a uint64."""
    return nth_output(nth_output(vertex_key(seed, vertex), particle), stream)


@njit(cache=True)
def uniform(seed, vertex, particle, stream):
    """Uniform number in [0, 1), a multiple of 2^-53."""
    return uniform_of(vertex_key(seed, vertex), particle, stream)


@njit(cache=True)
def gaussian(seed, vertex, particle, stream):
    """Standard normal number; never beyond 8.21, where 2^-53 of the distribution is left on either side."""
    return gaussian_of(vertex_key(seed, vertex), particle, stream)


@njit(cache=True)
def gaussian_of(key, particle, stream):
    """The same from a vertex's key."""
    # Midpoints of 2^52 intervals: exact in a double, symmetric about 1/2, and never 0 or 1.
    drawn = nth_output(nth_output(key, particle), stream) >> SHIFT_12
    return normal_quantile((np.float64(drawn) + 0.5) * 2.0**-52)


@njit(cache=True)
def uniform_of(key, particle, stream):
    """Uniform number in [0, 1) from a vertex's key."""
    return np.float64(nth_output(nth_output(key, particle), stream) >> SHIFT_11) * 2.0**-53


@njit(cache=True)
def normal_quantile(p):
    """Value below which a standard normal number lies with probability p in (0, 1); relative error near 1e-16.

    Wichura, Algorithm AS 241 (PPND16), Applied Statistics 37, 1988. It costs one division for 85% of all p, where a
    pair of Box-Muller numbers costs a logarithm, a root, a sine and a cosine.
    """
    q = p - 0.5
    if abs(q) <= 0.425:
        return q * central_ratio(0.180625 - q * q)
    r = math.sqrt(-math.log(p if q < 0.0 else 1.0 - p))
    magnitude = tail_ratio(r - 1.6) if r <= 5.0 else far_tail_ratio(r - 5.0)
    return -magnitude if q < 0.0 else magnitude


@njit(cache=True)
def central_ratio(r):
    """AS 241's a and b: 0.075 <= p <= 0.925."""
    above = 2.5090809287301226727e3
    above = above * r + 3.3430575583588128105e4
    above = above * r + 6.7265770927008700853e4
    above = above * r + 4.5921953931549871457e4
    above = above * r + 1.3731693765509461125e4
    above = above * r + 1.9715909503065514427e3
    above = above * r + 1.3314166789178437745e2
    above = above * r + 3.3871328727963666080e0
    below = 5.2264952788528545610e3
    below = below * r + 2.8729085735721942674e4
    below = below * r + 3.9307895800092710610e4
    below = below * r + 2.1213794301586595867e4
    below = below * r + 5.3941960214247511077e3
    below = below * r + 6.8718700749205790830e2
    below = below * r + 4.2313330701600911252e1
    return above / (below * r + 1.0)


@njit(cache=True)
def tail_ratio(r):
    """AS 241's c and d: the smaller side holds more than e^-25."""
    above = 7.74545014278341407640e-4
    above = above * r + 2.27238449892691845833e-2
    above = above * r + 2.41780725177450611770e-1
    above = above * r + 1.27045825245236838258e0
    above = above * r + 3.64784832476320460504e0
    above = above * r + 5.76949722146069140550e0
    above = above * r + 4.63033784615654529590e0
    above = above * r + 1.42343711074968357734e0
    below = 1.05075007164441684324e-9
    below = below * r + 5.47593808499534494600e-4
    below = below * r + 1.51986665636164571966e-2
    below = below * r + 1.48103976427480074590e-1
    below = below * r + 6.89767334985100004550e-1
    below = below * r + 1.67638483018380384940e0
    below = below * r + 2.05319162663775882187e0
    return above / (below * r + 1.0)


@njit(cache=True)
def far_tail_ratio(r):
    """AS 241's e and f: the smaller side holds less than e^-25."""
    above = 2.01033439929228813265e-7
    above = above * r + 2.71155556874348757815e-5
    above = above * r + 1.24266094738807843860e-3
    above = above * r + 2.65321895265761230930e-2
    above = above * r + 2.96560571828504891230e-1
    above = above * r + 1.78482653991729133580e0
    above = above * r + 5.46378491116411436990e0
    above = above * r + 6.65790464350110377720e0
    below = 2.04426310338993978564e-15
    below = below * r + 1.42151175831644588870e-7
    below = below * r + 1.84631831751005468180e-5
    below = below * r + 7.86869131145613259100e-4
    below = below * r + 1.48753612908506148525e-2
    below = below * r + 1.36929880922735805310e-1
    below = below * r + 5.99832206555887937690e-1
    return above / (below * r + 1.0)
