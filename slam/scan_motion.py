"""How a laser moved between two scans: by an odometry of any quality, and by the scans.

Uses its siblings `scan_matching`, `scan_agreement` and `correlative_search`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.correlative_search import SearchParams, search
from slam.laser_scan import Scan
from slam.params import Params
from slam.scan_agreement import AgreementParams, agreement
from slam.scan_matching import Match, ScanMatchingParams, match_scans

LOOSE = 0.1  # of the odometry's information, once it was searched around
LEAST = np.array([0.01, 0.01, 0.005])  # m, m, rad: standard deviations of an odometry that did not move


class OdometryNoise(Params):
    """Standard deviations of the odometry between two scans."""

    distance: float = Field(default=0.1, ge=0.0)  # m per root metre
    turn: float = Field(default=0.1, ge=0.0)  # rad per root metre
    rotation: float = Field(default=0.2, ge=0.0)  # rad per rad turned

    def information(self, motion: np.ndarray) -> np.ndarray:
        """(3, 3) on a motion (3,)."""
        root, turn = math.sqrt(math.hypot(motion[0], motion[1])), abs(float(motion[2]))
        distance, heading = self.distance * root, math.hypot(self.turn * root, self.rotation * turn)
        return np.diag(np.hypot([distance, distance, heading], LEAST) ** -2.0)


class ScanMotionParams(Params):
    """How motions are told by two scans."""

    odometry: OdometryNoise = OdometryNoise()
    matching: ScanMatchingParams = ScanMatchingParams()
    trust: float = Field(default=0.02, gt=0.0, le=1.0)  # in a match's information, for its ends err together
    agreement: AgreementParams = AgreementParams()
    search: SearchParams = SearchParams()
    slack: tuple[float, float, float] = (0.1, 0.1, 0.05)  # m, m, rad that a match may be off however sure it is


class Motion(NamedTuple):
    """A motion (3,) and the information (3, 3) on it."""

    pose: np.ndarray
    information: np.ndarray


def motion_between(
    before: Scan, scan: Scan, told: np.ndarray, params: ScanMotionParams, prior: np.ndarray | None = None
) -> Motion:
    """The motion from where one scan was taken to the next, which the odometry has `told` (3,); its, where walls lack.

    `prior` (3, 3) is the information on what was told, that of an odometry unless it is given. Where the scans cannot
    both be true as aligned from there, the likeliest of all poses around is the start; where its walls are too rough to
    be aligned, it is the answer.
    """
    prior = params.odometry.information(told) if prior is None else prior
    match = match_scans(scan, before, told, prior, params.matching)
    known = agreement(scan, before, match.pose, params.agreement)[0]
    if known >= params.agreement.share:
        return motion_of(match, params) if match.share >= params.matching.enough else Motion(match.pose, prior)
    start = search(scan, before, told, np.diag(prior) ** -0.5, params.search)
    again = match_scans(scan, before, start, LOOSE * prior, params.matching)
    if agreement(scan, before, again.pose, params.agreement)[0] <= known:
        again = match
    elif again.share < params.matching.enough:
        lattice = np.array([params.search.resolution, params.search.resolution, params.search.turn])
        return Motion(start, np.diag(lattice**-2.0))
    return motion_of(again, params) if again.share >= params.matching.enough else Motion(np.array(told, float), prior)


def motion_of(match: Match, params: ScanMotionParams) -> Motion:
    """What an alignment tells of a motion."""
    slack = np.diag(np.square(params.slack))
    return Motion(match.pose, np.linalg.inv(np.linalg.inv(params.trust * match.information) + slack))


def in_world(information: np.ndarray, headings: np.ndarray) -> np.ndarray:
    """The information (3, 3) on a motion as that (n, 3, 3) on where it ends, begun with `headings` (n,)."""
    turns = np.zeros((len(headings), 3, 3))
    cos, sin = np.cos(headings), np.sin(headings)
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1], turns[:, 2, 2] = cos, -sin, sin, cos, 1.0
    return turns @ information @ turns.transpose(0, 2, 1)
