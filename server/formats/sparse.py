"""A laser made sparse: reduced to Crunch's few directions, or thinned to so many beams as the literature does it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from server.formats.laser import SENSOR, LaserLog
from server.messages import Message, Odometry, Ranges
from slam.pose import compose
from slam.rangefinder import RingParams

SPACING = 45.0  # degrees between Crunch's directions
CONE = 22.5  # degrees to either side that a sonar hears
SONAR_MAX_RANGE = 3.0  # m
INFRARED_MAX_RANGE = 0.8  # m
BEAM_MAX_RANGE = 5.0  # m; the reach to which the literature cuts thinned lasers
DENSE = 2.0  # scans per half metre, the spacing of vertices, from which a few directions show where walls are


class Reduction(NamedTuple):
    """What of a laser a robot may see: Crunch's senses where `beams` is None, else so many evenly spread beams."""

    beams: int | None = None
    max_range: float | None = None


class Sensor(NamedTuple):
    """A ring and, for each of its bearings, the beams (first, one past the last) whose least range it reports."""

    name: str
    ring: RingParams
    windows: list[tuple[int, int]]


def sensors_of(bearings: np.ndarray, reduction: Reduction) -> list[Sensor]:
    """The rings that a laser of these bearings (n,) can stand for, in the order in which a scan reports them."""
    if reduction.beams is None:
        return [infrared(bearings), sonar(bearings)]
    return [thinned(bearings, reduction.beams, reduction.max_range or BEAM_MAX_RANGE)]


def scans_per_half_metre(log: LaserLog) -> float:
    """How densely a drive was scanned on average; inf for one that never moved on."""
    length = float(np.hypot(*np.diff(log.odometry[:, :2], axis=0).T).sum()) if len(log.odometry) > 1 else 0.0
    return 0.5 * len(log.scans) / length if length > 0.5 else math.inf


def directions(bearings: np.ndarray) -> np.ndarray:
    """Multiples of 45 degrees, ascending, that the laser sees to within one beam, and within the sonar's cone."""
    degrees = np.degrees(bearings)
    step = min(abs(degrees[1] - degrees[0]), CONE) + 1e-6  # of few beams, some lie beyond every cone
    multiples = SPACING * np.arange(-4, 4)
    return multiples[[np.min(np.abs(degrees - multiple)) <= step for multiple in multiples]]


def infrared(bearings: np.ndarray) -> Sensor:
    """The one beam nearest to each direction, as far as a GP2D12 sees."""
    nearest = [int(np.argmin(np.abs(bearings - np.radians(degrees)))) for degrees in directions(bearings)]
    ring = RingParams(
        model="infrared",
        bearings_deg=tuple(round(float(np.degrees(bearings[beam])), 6) for beam in nearest),
        min_range=0.0,
        max_range=INFRARED_MAX_RANGE,
    )
    return Sensor("infrared", ring, [(beam, beam + 1) for beam in nearest])


def sonar(bearings: np.ndarray) -> Sensor:
    """The nearest return within each direction's cone, as far as the laser sees it."""
    degrees = np.degrees(bearings)
    centres = directions(bearings)
    inside = [np.flatnonzero(np.abs(degrees - centre) <= CONE + 1e-6) for centre in centres]
    ring = RingParams(
        model="sonar",
        bearings_deg=tuple(float(centre) for centre in centres),
        half_angle_deg=CONE,
        min_range=0.0,
        max_range=SONAR_MAX_RANGE,
    )
    return Sensor("sonar", ring, [(int(beams[0]), int(beams[-1]) + 1) for beams in inside])


def thinned(bearings: np.ndarray, beams: int, max_range: float) -> Sensor:
    """`beams` of the laser's beams, evenly spread from the first to the last."""
    chosen = np.unique(np.round(np.linspace(0, bearings.size - 1, beams)).astype(int))
    ring = RingParams(
        model="beam",
        bearings_deg=tuple(round(float(np.degrees(bearings[beam])), 6) for beam in chosen),
        min_range=0.0,
        max_range=max_range,
    )
    return Sensor(SENSOR, ring, [(int(beam), int(beam) + 1) for beam in chosen])


def reduce_scans(scans: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Ranges (m, bearings) of scans (m, beams): inf from the ring's reach on, nan where no beam measured anything."""
    # fmin passes over nan unless there is nothing else
    ranges = np.stack([np.fmin.reduce(scans[:, first:last], axis=1) for first, last in sensor.windows], axis=1)
    ranges[ranges >= sensor.ring.max_range] = np.inf
    return ranges


def messages(log: LaserLog, sensors: list[Sensor]) -> Iterator[Message]:
    """Odometry and sparse ranges in file order; odometry tells how the laser moved, wherever it sits."""
    odometry = compose(log.odometry, log.mount)
    reduced = [(sensor.name, reduce_scans(log.scans, sensor)) for sensor in sensors]
    row = scan = 0
    for is_scan in log.is_scan:
        if is_scan:
            t = float(log.scan_times[scan])
            yield from (Ranges(t, name, ranges[scan]) for name, ranges in reduced)
            scan += 1
        else:
            yield Odometry(float(log.odometry_times[row]), *(float(part) for part in odometry[row]))
            row += 1
