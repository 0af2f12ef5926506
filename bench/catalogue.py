"""Every benchmark, in the order in which `crunch bench --list` tells them. A new one gets a line here."""

from __future__ import annotations

from bench import (
    ablation,
    accepts,
    avr,
    beams,
    builds,
    calibration,
    claims,
    crazyflie,
    cycle,
    dashboard,
    floor,
    fuzz,
    kernels,
    odometry,
    radio,
    real,
    ride,
    safety,
    scale,
    sonar8,
    speed,
    worlds,
)
from bench.benchmark import Bench

CATALOGUE: tuple[Bench, ...] = (
    cycle.BENCH,
    real.BENCH,
    beams.BENCH,
    floor.BENCH,
    worlds.BENCH,
    crazyflie.BENCH,
    sonar8.BENCH,
    claims.BENCH,
    ablation.BENCH,
    calibration.BENCH,
    odometry.BENCH,
    scale.BENCH,
    radio.BENCH,
    accepts.BENCH,
    fuzz.BENCH,
    kernels.BENCH,
    speed.BENCH,
    safety.BENCH,
    avr.BENCH,
    *ride.BENCHES,
    builds.BENCH,
    *dashboard.BENCHES,
)
