"""Whether a map from bumps may be wrong, told from the run alone.

A right map explains each bump by walls that others felt, as well as the noise lets it. A wrong one needs slips, strays,
more walls and drives through them: what it costs, in nats a bump, is its misfit. A logistic curve makes of it the
probability that walls are off by 5 cm or more in the mean. It knows nothing of ways to be wrong that cost nothing, as
that of a room that looks alike from two sides.
"""

from __future__ import annotations

import math

# The curve, by maximum likelihood from 40 maps of 100 bumps in the rooms polygon:300 to polygon:339, 20 of them wrong
EVEN = 0.6  # nats a bump at which a map is as likely wrong as right
STEEPNESS = 3.0  # in log odds a nat
SURE = 1.0 / 3.0  # of the probability, below which a map is called sure: a wrong one told costs twice a needless doubt
FEWEST = 10  # bumps from which anything is sure


def doubt(cost: float, n_bumps: int) -> float:
    """Probability that a refined map of so many bumps is wrong, given its cost in nats; 1 where bumps are too few."""
    if n_bumps < FEWEST:
        return 1.0
    exponent = STEEPNESS * (cost / n_bumps - EVEN)
    return 1.0 / (1.0 + math.exp(-min(max(exponent, -700.0), 700.0)))
