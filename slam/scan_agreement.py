"""Whether two laser scans, laid over each other, can both be true: neither may see through the other's walls.

An alignment whose walls lie upon each other may still be wrong, for corners and corridors are alike; then, as a rule,
one scan ends where the other looked through.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import Field

from slam.laser_scan import Scan
from slam.params import Params
from slam.pose import inverse
from slam.scan_matching import turned

BESIDE = 2.5  # times that beams part, within which a beam looks the way of a point


class AgreementParams(Params):
    """What is agreement, and how much of it is enough."""

    near: float = Field(default=0.15, gt=0.0)  # m between an end and the other scan's wall that agree,
    far: float = Field(default=0.3, gt=0.0)  # and m before it from which on one sees through the other's wall
    share: float = Field(default=0.85, gt=0.0, le=1.0)  # of agreeing ends, of those that speak, that is enough,
    overlap: float = Field(default=0.3, ge=0.0, le=1.0)  # and of all ends, in either scan


@njit(cache=True)
def compare_views(scan, other, pose, near, far):
    """How many ends of a scan, taken at `pose` (3,) in the other's frame, agree with it, and how many see through it.

    An end farther off than the other's wall is hidden from it, and says nothing.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    beside = BESIDE * other.spacing
    agree, through = 0, 0
    for i in range(scan.points.shape[0]):
        dx, dy = turned(cos, sin, scan.points[i, 0], scan.points[i, 1])
        x, y = dx + pose[0], dy + pose[1]
        reach, bearing = math.hypot(x, y), math.atan2(y, x)
        off, wall = math.inf, math.inf  # of the beam that agrees best, and the nearest wall that way
        j = np.searchsorted(other.bearings, bearing - beside)
        while j < other.bearings.size and other.bearings[j] <= bearing + beside:
            off = min(off, abs(other.ranges[j] - reach))
            wall = min(wall, other.ranges[j])
            j += 1
        if off < near:
            agree += 1
        elif wall < math.inf and reach < wall - far:
            through += 1
    return agree, through


def agreement(scan: Scan, other: Scan, pose: np.ndarray, params: AgreementParams) -> tuple[float, float]:
    """The share of agreeing ends of those that speak, and of all in that scan of which fewer agree.

    `pose` (3,) is that of `scan` in the frame of `other`.
    """
    (agree, through), (agreed, throughs) = views_of(scan, other, pose, params)
    overlap = min(agree / max(1, len(scan.points)), agreed / max(1, len(other.points)))
    return (agree + agreed) / max(1, agree + agreed + through + throughs), overlap


def views_of(
    scan: Scan, other: Scan, pose: np.ndarray, params: AgreementParams
) -> tuple[tuple[int, int], tuple[int, int]]:
    """How many ends of a scan at `pose` (3,) of the other's frame agree, and see through it; and of the other's."""
    there = compare_views(scan, other, np.asarray(pose, float), params.near, params.far)
    return there, compare_views(other, scan, inverse(pose), params.near, params.far)


def do_agree(scan: Scan, other: Scan, pose: np.ndarray, params: AgreementParams) -> bool:
    """Whether two scans see the same walls, and neither through the other's."""
    share, overlap = agreement(scan, other, pose, params)
    return share >= params.share and overlap >= params.overlap
