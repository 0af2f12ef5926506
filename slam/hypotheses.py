"""Paths that may explain a drive, and by how much the likeliest leads over those that go elsewhere.

A lead is a log likelihood ratio. Where one hypothesis is right it is of tens to hundreds of nats; where none is, wrong
ones explain the walls about as badly as each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slam.evaluate import wrong_meetings

ELSEWHERE = 0.1  # of a path's meetings with itself: more must be of two places by another path that makes another map
DECIDED = 20.0  # nats of a lead that counts: some ten vertices see the same wall, so that they tell as much as one


class Hypothesis(NamedTuple):
    """A path (n, 3) and its score: log likelihood of its motions and walls, up to a constant that all share."""

    score: float
    path: np.ndarray


def is_elsewhere(path: np.ndarray, other: np.ndarray) -> bool:
    """Whether two paths (n, 3) make different maps, in that one comes back to a place where the other does not.

    How far apart they are does not tell: a corridor laid on the next is half a metre root mean square, and an end
    that nothing holds may swing by more on one and the same map.
    """
    return max(wrong_meetings(path, other), wrong_meetings(other, path)) > ELSEWHERE


def likeliest(hypotheses: Sequence[Hypothesis]) -> Hypothesis:
    """That of the highest score; ValueError for none."""
    return max(hypotheses, key=lambda hypothesis: hypothesis.score)


def rivals(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Those that make another map than the likeliest; none of none."""
    if not hypotheses:
        return []
    best = likeliest(hypotheses).path
    return [hypothesis for hypothesis in hypotheses if is_elsewhere(hypothesis.path, best)]


class Verdict(NamedTuple):
    """What is to be thought of a map: its lead, how many of how many hypotheses make it, and restarts for them.

    The lead is by how many nats the map's path is likelier than any that makes another one; infinite if there is none.
    """

    lead: float = math.inf
    agreeing: int = 0
    of: int = 0
    restarts: int = 0

    @property
    def is_open(self) -> bool:
        """Whether another map explains the walls about as well."""
        return self.lead < DECIDED


def verdict(hypotheses: Sequence[Hypothesis], restarts: int = 0) -> Verdict:
    """What is to be thought of the likeliest one's map."""
    others = rivals(hypotheses)
    lead = likeliest(hypotheses).score - likeliest(others).score if others else math.inf
    return Verdict(lead, len(hypotheses) - len(others), len(hypotheses), restarts)
