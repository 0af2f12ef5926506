"""How well the robot stands, drives, and takes a blow: in closed loop, with parts that differ from robot to robot.

Mass and centre of gravity vary by +-20 %, the gyro's zero by +-0.2 V and its drift by 0.1 deg/s in a minute, the
accelerometer's zero by +-20 mg, which is what a builder's hand leaves of it, or by +-0.1 g before it is calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from bench.benchmark import Bench, Column, Record, Row, each, failed, middle, runs, share, tails, values_of
from bench.boards import Rider, hall
from firmware.virtual.variation import Variation

STAND_SECONDS = 600
SAMPLE_SECONDS = 0.1
MAX_WANDER = 0.10  # m
MAX_HEADING = 1.0  # deg per minute
SPEED, WAY = 0.3, 20.0  # m/s, m
TURN, TURN_SECONDS = 1.0, 6.0  # rad/s
RAMP_SECONDS = 3.0  # after which a wish is to be kept
MAX_ERROR = 5.0  # %
BLOW = 0.5  # N s at the centre of mass, over 50 ms
HARDEST = 4.0  # N s
HALVINGS = 6
RECOVERY_SECONDS = 6.0
AWAY_SECONDS, AWAY_LEAST, AWAY_MOST = 6.0, 0.75, 1.15  # of the way wanted: it stands up first, and learned no lean
UPRIGHT = 0.1  # rad
CALIBRATED = 0.02  # g


class Case(NamedTuple):
    """Whether the boards are the real ones, and by how much the accelerometer's zero varies (g)."""

    is_real: bool
    level: float


CASES = {
    "real boards": Case(True, CALIBRATED),
    "the same C on this machine": Case(False, CALIBRATED),
    "the same, accelerometer not calibrated": Case(False, 0.1),
}


def rider_of(case: Case, seed: int, length: float = 12.0, x: float = 0.0) -> Rider:
    """A robot of the seed's own kind that has just been let go."""
    rider = Rider(hall(length), (x, 0.0, 0.0), seed, Variation.drawn(seed, case.level), case.is_real)
    if not rider.arm():
        raise RuntimeError(f"the robot of seed {seed} does not arm")
    return rider


def stand(case: Case, seed: int) -> Record:
    """Ten minutes: the greatest distance (cm) from where it was let go, and the heading's drift (deg per minute)."""
    rider = rider_of(case, seed)
    place, heading, farthest, steepest = rider.position, rider.body.heading, 0.0, 0.0
    for _ in range(round(STAND_SECONDS / SAMPLE_SECONDS)):
        rider.wait(SAMPLE_SECONDS)
        farthest = max(farthest, rider.distance(place))
        steepest = max(steepest, abs(rider.body.tilt))
    drift = abs(math.degrees(rider.body.heading - heading)) / (STAND_SECONDS / 60.0)
    is_kept = rider.is_balancing and farthest < MAX_WANDER and drift < MAX_HEADING
    return {
        "seed": seed, "stands": rider.is_balancing, "is_kept": is_kept, "wander": 100.0 * farthest, "drift": drift,
        "lean": math.degrees(steepest), "end": 100.0 * rider.distance(place),
    }  # fmt: skip


def drive(case: Case, seed: int) -> Record:
    """20 m at 0.3 m/s after ten seconds of standing, then a turn on the spot: errors (%) of speed and turn rate."""
    rider = rider_of(case, seed, 60.0, -25.0)
    rider.wait(10.0)
    rider.tell(SPEED)
    rider.wait(RAMP_SECONDS)
    place, seconds = rider.position, WAY / SPEED
    rider.wait(seconds)
    speed_error = 100.0 * abs(rider.distance(place) / WAY - 1.0)
    rider.tell(0.0)
    rider.wait(RAMP_SECONDS)
    rider.tell(0.0, TURN)
    rider.wait(RAMP_SECONDS)
    heading = rider.body.heading
    rider.wait(TURN_SECONDS)
    turn_error = 100.0 * abs((rider.body.heading - heading) / (TURN * TURN_SECONDS) - 1.0)
    is_kept = rider.is_balancing and max(speed_error, turn_error) < MAX_ERROR
    return {
        "seed": seed, "stands": rider.is_balancing, "is_kept": is_kept, "speed": speed_error, "turn": turn_error,
    }  # fmt: skip


def recovers(case: Case, seed: int, newton_seconds: float) -> bool:
    """Whether it stands upright again after a blow."""
    rider = rider_of(case, seed)
    rider.wait(2.0)
    rider.push(newton_seconds)
    rider.wait(RECOVERY_SECONDS)
    return rider.is_balancing and abs(rider.body.tilt) < UPRIGHT


def push(case: Case, seed: int) -> Record:
    """The blow that is asked for, from behind and from before, and the largest one from behind that it stands (N s)."""
    is_kept = recovers(case, seed, BLOW) and recovers(case, seed, -BLOW)
    largest, smallest = (BLOW, HARDEST) if is_kept else (0.0, BLOW)
    for _ in range(HALVINGS):
        middle_blow = 0.5 * (largest + smallest)
        if recovers(case, seed, middle_blow):
            largest = middle_blow
        else:
            smallest = middle_blow
    return {"seed": seed, "is_kept": is_kept, "largest": largest}


def wall(case: Case, seed: int) -> Record:
    """Drives against a wall for 15 s, stands there for as long, then back: the greatest lean (deg), and whether it came
    away, as it was told to, or had stopped."""
    rider = rider_of(case, seed, 4.0, 1.0)
    rider.tell(SPEED)
    steepest = 0.0
    for _ in range(150):
        rider.wait(SAMPLE_SECONDS)
        steepest = max(steepest, abs(rider.body.tilt))
    told, stands = ", ".join(rider.told), rider.is_balancing
    rider.tell(0.0)
    rider.wait(15.0)
    place = rider.position
    rider.tell(-SPEED)
    rider.wait(AWAY_SECONDS)
    has_stopped = rider.told[0] == "fault"  # and not fallen
    way = rider.distance(place) / (SPEED * AWAY_SECONDS)
    is_kept = has_stopped or AWAY_LEAST < way < AWAY_MOST
    return {"seed": seed, "stands": stands, "is_kept": is_kept, "lean": math.degrees(steepest), "told": told}


def verdict(rows: list[Row]) -> Iterator[str]:
    """No robot may fall, nor one that is calibrated miss what is asked of it."""
    for row in rows:
        if not all(values_of(row, "stands")):
            yield f"{row.name}: fallen are the seeds {failed('stands')(row)}"
        if CASES[row.name].level <= CALIBRATED and not all(values_of(row, "is_kept")):
            yield f"{row.name}: not as it should be with the seeds {failed('is_kept')(row)}"


COMMON = (Column("runs", runs), Column("as it should be (95 %)", share("is_kept")), Column("not so", failed("is_kept")))
STANDS = Column("stands at the end", share("stands"))
HEADING = "boards"

BENCHES = (
    Bench(
        name="stand",
        about="the robot stands for ten minutes: within 10 cm, and 1 degree of heading per minute",
        rows=each(stand, CASES),
        columns=(
            *COMMON,
            STANDS,
            Column("farthest from its place: median / p90 / worst (cm)", tails("wander", 1)),
            Column("heading (deg/min)", tails("drift", 2)),
            Column("greatest lean (deg)", tails("lean", 1)),
            Column("off its place at the end (cm)", tails("end", 1)),
        ),
        seeds=20,
        minutes=25,
        heading=HEADING,
        verdict=verdict,
    ),
    Bench(
        name="ride",
        about="the robot drives 20 m and turns on command: errors of speed and turn rate below 5 %",
        rows=each(drive, CASES),
        columns=(
            *COMMON,
            STANDS,
            Column("speed's error: median / p90 / worst (%)", tails("speed", 1)),
            Column("turn rate's error (%)", tails("turn", 1)),
        ),
        seeds=20,
        minutes=5,
        heading=HEADING,
        verdict=verdict,
    ),
    Bench(
        name="push",
        about="a blow of 0.5 N s at the centre of mass over 50 ms, and the largest that the robot stands",
        rows=each(push, CASES),
        columns=(
            *COMMON,
            Column("largest: median (N s)", middle("largest", 2)),
            Column("least of all (N s)", lambda row: f"{min(record['largest'] for record in row.records):.2f}"),
        ),
        seeds=20,
        minutes=6,
        heading=HEADING,
        verdict=verdict,
    ),
    Bench(
        name="wall",
        about="the robot is driven against a wall, left there, then driven back: it climbs nothing, and comes away",
        rows=each(wall, CASES),
        columns=(
            *COMMON,
            STANDS,
            Column("greatest lean: median / p90 / worst (deg)", tails("lean", 1)),
            Column("told at the wall", lambda row: "; ".join(sorted({record["told"] for record in row.records}))),
        ),
        seeds=20,
        minutes=3,
        heading=HEADING,
        verdict=verdict,
    ),
)
