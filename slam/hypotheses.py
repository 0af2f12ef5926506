"""Paths that may explain a drive, and by how much the likeliest leads over those that go elsewhere.

A lead is a log likelihood ratio. Where one hypothesis is right it is of tens to hundreds of nats; where none is, wrong
ones explain the walls about as badly as each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slam.evaluate import absolute_error

APART = 0.5  # m, root mean square, by which paths differ that are not of one map; open ends alone may differ by more
DECIDED = 20.0  # nats of a lead that counts: some ten vertices see the same wall, so that they tell as much as one


class Hypothesis(NamedTuple):
    """A path (n, 3) and its score: log likelihood of its motions and walls, up to a constant that all share."""

    score: float
    path: np.ndarray


def is_elsewhere(path: np.ndarray, other: np.ndarray) -> bool:
    """Whether two paths (n, 3) make different maps, wherever these begin."""
    return absolute_error(path, other).translation.rmse > APART


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
