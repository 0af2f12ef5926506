"""Resampling in fractions and high precision, where nothing rounds."""

from __future__ import annotations

from decimal import Decimal, localcontext
from fractions import Fraction


def normalize(log_weights):
    """Weights of finite log weights, to fifty digits, then rounded once."""
    with localcontext() as context:
        context.prec = 50
        weights = [Decimal(float(value)).exp() for value in log_weights]
        total = sum(weights)
        return [float(weight / total) for weight in weights]


def systematic(weights, offset, n_children):
    """Each pointer (child + offset) / M falls into one weight's share of the unit interval; `weights` are fractions."""
    ancestors = []
    for child in range(n_children):
        pointer = (child + Fraction(offset)) / n_children
        covered = Fraction(0)
        for parent, weight in enumerate(weights):
            if covered <= pointer < covered + weight:
                ancestors.append(parent)
            covered += weight
    return ancestors
