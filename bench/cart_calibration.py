"""What a cart's own runs tell of it: wheelbase, tick and noise by maximum likelihood, and whether the intervals hold.

A seed is another cart and run of a hundred bumps, in the paper's room or one of random walls. The camera errs by 2 mm
and 0.01 rad. What is true of a noise is measured: on carts of other seeds, whose motion is known, what a stage's
odometry errs by beside what the cart's own build explains and beyond what a slip is. So is the share by which tyres
that scrub make a wheelbase seem longer or shorter to whoever counts turns; errors of the wheelbase are told against the
one that was built, its interval must hold the one that turns.
"""

from __future__ import annotations

import functools
import math
import time
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from bench.benchmark import Bench, Column, Record, Row, each, figures, middle, runs, share
from firmware.virtual.bumper_cart import CartBuild, VirtualCart, run_cart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam.area import area_of
from slam.cart_calibration import learn_from_camera, learn_from_map
from slam.cart_odometry import BACK, DRIVE, TURN, CartParams, Stage
from slam.pose import between, wrap

ROOMS = ("cut-rectangle", "polygon:101", "polygon:103", "polygon:104", "polygon:106")
FIRST = 7000  # seeds from here; those from `OTHERS` tell what is true
OTHERS, N_OTHERS = 50_000, 30
CAMERA = np.array([0.002, 0.002, 0.01])  # m, m, rad
SLIPPED = 4.0  # sigmas beyond which a stage's error is a slip's
NOISES = ("distance_noise", "turn_noise", "rotation_noise")
BUILT = ("tick", "bumper_width", "bumper_ahead")


class Case(NamedTuple):
    """What there is beside the log."""

    has_map: bool
    has_camera: bool
    bumps: int = 100


CASES = {
    "a camera": Case(False, True),
    "a map": Case(True, False),
    "both": Case(True, True),
}


class Truth(NamedTuple):
    """What is true of all carts: noises, and the share by which a wheelbase seems larger than it was built."""

    distance_noise: float
    turn_noise: float
    rotation_noise: float
    seems: float


class Errors(NamedTuple):
    """What odometry erred by in stages (n,): `off` of the motion, its way in m, its turn in rad."""

    off: np.ndarray
    way: np.ndarray
    turn: np.ndarray


@functools.cache
def truth() -> Truth:
    """Measured on carts of other seeds."""
    turns, drives, ways, seems = [], [], [], []
    for seed in range(OTHERS, OTHERS + N_OTHERS):
        world = load_world(ROOMS[seed % len(ROOMS)])
        stages, poses = run_cart(world, seed, 100)
        wheelbase, tick = VirtualCart(world, seed=seed).build.wheelbase, CartBuild().tick
        table, moved = np.array(stages, float), between(poses[:-1], poses[1:])
        way, turn = 0.5 * tick * (table[:, 1] + table[:, 2]), tick * (table[:, 2] - table[:, 1]) / wheelbase
        off = wrap(moved[:, 2] - turn)
        of = {kind: table[:, 0] == kind for kind in (DRIVE, BACK, TURN)}
        kept = of[TURN] & (np.abs(off) < SLIPPED * 0.04)
        fit = np.polyfit(np.abs(turn[kept]), off[kept] * np.sign(turn[kept]), 1)  # play, and what scrubs
        seems.append(-fit[0])
        turns.append(
            Errors(off[kept] - np.polyval(fit, np.abs(turn[kept])) * np.sign(turn[kept]), way[kept], turn[kept])
        )
        kept = of[DRIVE] & (np.abs(off) < SLIPPED * 0.06)
        veer = np.sum(off[kept] * way[kept]) / np.sum(way[kept] ** 2)
        drives.append(Errors(off[kept] - veer * way[kept], way[kept], turn[kept]))
        whole = turn + off
        went = np.hypot(moved[:, 0], moved[:, 1]) / np.sinc(whole / (2.0 * math.pi))
        kept = of[DRIVE] & (np.abs(way - went - 0.002) < 0.01)
        fit = np.polyfit(way[kept], (way - went)[kept], 1)  # the tick's own share, and what wheels go on at a bump
        ways.append(Errors((way - went)[kept] - np.polyval(fit, way[kept]), way[kept], turn[kept]))
    tick, wheelbase = CartBuild().tick, CartBuild().wheelbase
    ticks_of_way, ticks_of_turn = tick**2 / 12.0, tick**2 / (3.0 * wheelbase**2)
    of_turn, of_rotation = noises(turns + drives, ticks_of_turn)
    (of_way,) = noises(ways, ticks_of_way, is_way=True)
    return Truth(of_way, of_turn, of_rotation, float(np.mean(seems)))


def noises(errors: list[Errors], ticks: float, is_way: bool = False) -> np.ndarray:
    """Noise per root metre, and per rad (the latter not of ways), by maximum likelihood without what slipped."""
    off, way, turn = (np.concatenate(parts) for parts in zip(*errors, strict=True))

    def variances(logs: np.ndarray) -> np.ndarray:
        found = math.exp(2.0 * logs[0]) * np.abs(way) + ticks
        return found if is_way else found + math.exp(2.0 * logs[1]) * turn**2

    kept, logs = np.ones(len(off), bool), np.log([0.003] if is_way else [0.05, 0.02])
    for _ in range(5):

        def cost(logs: np.ndarray, kept: np.ndarray = kept) -> float:
            spread = variances(logs)[kept]
            return 0.5 * float(np.sum(off[kept] ** 2 / spread + np.log(spread)))

        logs = minimize(cost, logs, method="Nelder-Mead").x
        kept = np.abs(off) < SLIPPED * np.sqrt(variances(logs))
    return np.exp(logs)


def run(case: Case, seed: int) -> Record:
    """One cart."""
    room = ROOMS[seed % len(ROOMS)]
    world = load_world(room)
    logged, poses = run_cart(world, FIRST + seed, case.bumps)
    stages, built = [Stage(*stage) for stage in logged], VirtualCart(world, seed=FIRST + seed).build
    seen = poses + np.random.default_rng([seed, 0xCA3]).standard_normal(poses.shape) * CAMERA
    record: Record = {"seed": seed, "room": room}
    began = time.process_time()
    try:
        if case.has_map:
            area = area_of(closed_outlines(world.segments, world.name))
            found = learn_from_map([stages], area, CartParams(), seed, [seen] if case.has_camera else None)
        else:
            found = learn_from_camera([stages], [seen], CartParams())
    except ValueError as error:
        return record | {"is_refused": True, "why": str(error)}
    record |= {"is_refused": False, "minutes": (time.process_time() - began) / 60.0}
    true = {name: getattr(truth(), name) for name in NOISES} | {name: getattr(built, name) for name in BUILT}
    true["wheelbase"] = built.wheelbase * (1.0 + truth().seems)
    for name, value in true.items():
        if name in found.names:
            low, high = found.interval(name)
            against = built.wheelbase if name == "wheelbase" else value
            record[name] = float(100.0 * (found.value(name) / against - 1.0))
            record[f"{name}_off"] = abs(record[name])
            record[f"{name}_held"] = bool(low < value < high)
    return record


def held(row: Row) -> str:
    """How many of all intervals of wheelbase and noises hold the truth."""
    each_run = [
        np.mean([record[f"{name}_held"] for name in ("wheelbase", *NOISES)])
        for record in row.records
        if not record["is_refused"]
    ]
    if not each_run:
        return "-"
    error = 1.96 * float(np.std(each_run)) / math.sqrt(len(each_run))
    mean = float(np.mean(each_run))
    return f"{100 * mean:.0f} % ({100 * (mean - error):.0f} to {100 * min(1.0, mean + error):.0f})"


BENCH = Bench(
    name="bump-calibration",
    about="wheelbase, tick and noise of a cart learned from 100 bumps, and how often the 90 % intervals hold",
    rows=each(run, CASES),
    columns=(
        Column("carts", runs),
        Column("refused", share("is_refused")),
        Column("wheelbase off: median / p90 (%)", figures("wheelbase_off", 2, 0.5, 0.9)),
        Column("held (95 %)", share("wheelbase_held")),
        Column("tick off: median / p90 (%)", figures("tick_off", 2, 0.5, 0.9)),
        Column("distance noise off: median / p90 (%)", figures("distance_noise_off", 0, 0.5, 0.9)),
        Column("turn noise (%)", figures("turn_noise_off", 0, 0.5, 0.9)),
        Column("rotation noise (%)", figures("rotation_noise_off", 0, 0.5, 0.9)),
        Column("bumper's width (%)", figures("bumper_width_off", 0, 0.5, 0.9)),
        Column("of wheelbase's and noises' 90 % intervals hold (95 %)", held),
        Column("processor minutes", middle("minutes", 2)),
    ),
    seeds=20,
    minutes=8,
    heading="beside the log",
)
