"""A cart's movements added end to end, as they are drawn: along the arcs of its stages, with its bumper at each bump.

Nothing is corrected here; how far this goes astray is what an estimator is for.
"""

from __future__ import annotations

import numpy as np

from slam.cart_odometry import DRIVE, CartParams, Stage, arc, bumper_points
from slam.pose import compose
from slam.thinning import needed

ARC_POINTS = 8  # into which a stage's arc is divided,
HAIR = 0.002  # and m by which a line through them may be off


class Track:
    """Grows stage by stage; `drawn` tells it anew only when it has grown."""

    def __init__(self, cart: CartParams):
        self.cart = cart
        self.ways: list[np.ndarray] = []  # of each stage, (k, 3)
        self.bumps: list[np.ndarray] = []  # poses (3,)
        self.told = 0, np.zeros((0, 2)), np.zeros((0, 3, 2))  # after so many stages

    def add(self, stage: Stage, before: np.ndarray, after: np.ndarray) -> None:
        """A stage led from one pose (3,) to another."""
        shares = np.arange(ARC_POINTS) / ARC_POINTS
        way = compose(before, arc(shares * stage.left, shares * stage.right, self.cart))
        self.ways.append(np.vstack([way, after]))
        if stage.kind == DRIVE and stage.bumper:
            self.bumps.append(after)

    def drawn(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (n, 2) of the way, and the bumper's left, middle and right points (m, 3, 2) at each bump."""
        if len(self.ways) != self.told[0]:
            places = np.ascontiguousarray(np.concatenate(self.ways)[:, :2])
            bumpers = bumper_points(np.array(self.bumps).reshape(-1, 3), self.cart)
            self.told = len(self.ways), places[needed(places, HAIR)], bumpers
        return self.told[1:]
