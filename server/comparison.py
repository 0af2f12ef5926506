"""Two surveys of one building compared: how they lie to each other, what of their walls they share, and a picture.

Uses its siblings `map_picture`, `maps` and `survey`.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import BaseModel, Field

from server.map_picture import draw_pair
from server.maps import FloorMap
from server.survey import Survey, floor_of
from slam.map_alignment import NO_MOTION, TOLERANCE, agreement, align, moved, walls_of
from slam.pose import compose, transform


class Comparison(BaseModel):
    """How a second map lies in the first one's frame, and how far they agree."""

    x: float = Field(examples=[3.12], description="m, where the second map's origin lies in the first one's frame")
    y: float = Field(examples=[-0.4])
    theta: float = Field(examples=[1.571], description="rad, how far the second map is turned")
    first_share: float | None = Field(
        examples=[0.91],
        description="of the first map's walls, that the second has within the tolerance; null without walls",
    )
    second_share: float | None = Field(examples=[0.95], description="the same of the second map's walls")
    median_distance_m: float | None = Field(examples=[0.03], description="between walls that agree; null if none do")
    tolerance_m: float = Field(default=TOLERANCE, examples=[0.15])

    def pose(self) -> np.ndarray:
        """Of the second map's frame in the first's, as (3,)."""
        return np.array([self.x, self.y, self.theta])


def compare(first: Survey, second: Survey, is_aligned: bool = True, guess: np.ndarray = NO_MOTION) -> Comparison:
    """Two surveys, each in its own frame, the second's near `guess` (3,) in the first's unless the walls say otherwise.

    Without alignment the frames are taken to be the same.
    """
    ours, theirs = (walls_of(floor_of(survey, has_grid=False).walls) for survey in (first, second))
    pose = align(ours, theirs, guess) if is_aligned else NO_MOTION
    found = agreement(ours, moved(theirs, pose))
    x, y, theta = (round(float(part), 5) for part in pose)
    return Comparison(
        x=x,
        y=y,
        theta=theta,
        first_share=known(found.first),
        second_share=known(found.second),
        median_distance_m=known(found.median),
    )


def known(figure: float) -> float | None:
    """A figure to four digits, or None for one that nothing decides."""
    return round(figure, 4) if math.isfinite(figure) else None


def comparison_png(first: Survey, second: Survey, found: Comparison, names: tuple[str, str]) -> bytes:
    """Both maps in the first one's frame, as they were found to lie."""
    pose = found.pose()
    other = floor_of(second, has_grid=False)
    laid = FloorMap(compose(pose, other.path), [transform(pose, curve) for curve in other.walls], other.settled)
    shares = [100.0 * (share or 0.0) for share in (found.first_share, found.second_share)]
    centimetres = 100.0 * found.tolerance_m
    words = f"shared within {centimetres:.0f} cm: {shares[0]:.0f} % of the first, {shares[1]:.0f} % of the second"
    return draw_pair(floor_of(first, has_grid=False), laid, names, words)
