"""Every benchmark, in the order in which `crunch bench --list` tells them. A new one gets a line here."""

from __future__ import annotations

from bench import (
    ablation,
    accepts,
    avr,
    basin,
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
    laser,
    maze,
    maze_turns,
    odometry,
    parity,
    radio,
    real,
    ride,
    rivals,
    safety,
    scale,
    sonar8,
    speed,
    worlds,
)
from bench.benchmark import Bench

FIRMWARE: tuple[Bench, ...] = (
    *ride.BENCHES,
    safety.BENCH,
    radio.BENCH,
    avr.BENCH,
    accepts.BENCH,
    fuzz.BENCH,
    builds.BENCH,
    parity.BENCH,
)
SETS = {"firmware": FIRMWARE}  # several by one name

CATALOGUE: tuple[Bench, ...] = (
    cycle.BENCH,
    real.BENCH,
    beams.BENCH,
    floor.BENCH,
    worlds.BENCH,
    crazyflie.BENCH,
    sonar8.BENCH,
    *laser.BENCHES,
    rivals.BENCH,
    basin.BENCH,
    maze.BENCH,
    maze_turns.BENCH,
    claims.BENCH,
    ablation.BENCH,
    calibration.BENCH,
    odometry.BENCH,
    scale.BENCH,
    kernels.BENCH,
    speed.BENCH,
    *FIRMWARE,
    *dashboard.BENCHES,
)
