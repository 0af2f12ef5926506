"""What a cart's own runs tell of it: wheelbase, tick and noise, as likely as they are, and whether the intervals hold.

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
from firmware.virtual.bumper_cart import LONGEST_MS, VirtualCart, run_cart
from firmware.virtual.cart_board import HostCart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam.area import area_of
from slam.cart_calibration import learn_alone, learn_from_camera, learn_from_map
from slam.cart_odometry import DRIVE, TURN, CartParams, Stage, grown
from slam.pose import between, wrap

ROOMS = ("cut-rectangle", "polygon:101", "polygon:103", "polygon:104", "polygon:106")
FIRST = 72_000  # seeds from here; those from `OTHERS` tell what is true
OTHERS, N_OTHERS = 50_000, 30
CAMERA = np.array([0.002, 0.002, 0.01])  # m, m, rad
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
    "nothing": Case(False, False),
}


class Truth(NamedTuple):
    """What is true of all carts: noises, and the share by which a wheelbase seems larger than it was built."""

    distance_noise: float
    turn_noise: float
    rotation_noise: float
    seems: float


class Motions(NamedTuple):
    """Of stages (n,) of one cart: kind, whether it ended at a wall, way (m) and turn (rad) that its tyres rolled.

    `way_off` (m) and `turn_off` (rad) are what it went and turned beyond that; `wheelbase` in m is its own.
    """

    kind: np.ndarray
    is_bump: np.ndarray
    way: np.ndarray
    turn: np.ndarray
    way_off: np.ndarray
    turn_off: np.ndarray
    wheelbase: np.ndarray


def motions(seed: int) -> Motions:
    """One cart's, by what only its simulator knows: how far its tyres have rolled, which no counter cuts off."""
    cart = VirtualCart(load_world(ROOMS[seed % len(ROOMS)]), seed=seed)
    board, rows = cart.board, []
    assert isinstance(board, HostCart)
    board.order(100, (2 * seed + 1) & 0xFFFF, 0)
    before, rolled = cart.pose, rims(cart)
    while board.is_running and (stage := board.next_stage(LONGEST_MS)):
        left, right = rims(cart) - rolled
        way, turn = 0.5 * (left + right), (right - left) / cart.build.wheelbase
        moved = between(before, cart.pose)
        turn_off = float(wrap(moved[2] - turn))
        went = np.hypot(moved[0], moved[1]) / np.sinc((turn + turn_off) / (2.0 * math.pi))
        is_bump = stage.kind == DRIVE and stage.bumper > 0
        rows.append((stage.kind, is_bump, way, turn, math.copysign(went, way) - way, turn_off, cart.build.wheelbase))
        before, rolled = cart.pose, rims(cart)
    return Motions(*np.array(rows, float).T)


def rims(cart: VirtualCart) -> np.ndarray:
    """m (2,) of floor that both tyres have rolled."""
    return np.array([wheel.way * wheel.scale for wheel in cart.board.body.wheels])


@functools.cache
def truth() -> Truth:
    """Measured on carts of other seeds, by the likeliest values of the law that `slam.cart_odometry` has.

    What errs always alike is fitted beside it: a turn's share and play, a drive's veer, and what a bump itself takes
    of the way. A share of the stages errs by anything at all.
    """
    found = [motions(seed) for seed in range(OTHERS, OTHERS + N_OTHERS)]
    all_of = Motions(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
    is_turn, is_drive, side = all_of.kind == TURN, all_of.kind == DRIVE, np.sign(all_of.turn)
    rotated = grown_all(0.5 * all_of.wheelbase * np.abs(all_of.turn)) / (0.5 * all_of.wheelbase)
    ways = grown_all(np.abs(all_of.way))
    alike = np.column_stack([is_turn * all_of.turn, is_turn * side, is_drive * all_of.way])
    (of_turn, of_rotation, _), shares = law(
        all_of.turn_off, alike, np.column_stack([ways, rotated, all_of.is_bump]), 0.3
    )
    kept = ~is_turn  # on the spot nothing is left of a way
    alike = np.column_stack([all_of.is_bump, all_of.way])[kept]
    (of_way, _), _ = law(all_of.way_off[kept], alike, np.column_stack([ways, all_of.is_bump])[kept], 0.05)
    return Truth(of_way, of_turn, of_rotation, -shares[0])


def grown_all(ways: np.ndarray) -> np.ndarray:
    """`slam.cart_odometry.grown` of ways (n,)."""
    return np.array([grown(way, CartParams().slip_length) for way in ways])


def law(off: np.ndarray, alike: np.ndarray, grows: np.ndarray, wild: float) -> tuple[np.ndarray, np.ndarray]:
    """Likeliest noises (k,), whose squares multiply what grows (n, k), and shares (m,) of what is `alike` (n, m).

    Errors are normal, or with a share of their own as large as `wild`, one sigma.
    """
    k = grows.shape[1]

    def cost(some: np.ndarray) -> float:
        variances = grows @ np.exp(2.0 * some[:k]) + 1e-9
        rest, share = off - alike @ some[k + 1 :], 1.0 / (1.0 + math.exp(-some[k]))
        usual = (1.0 - share) * np.exp(-0.5 * rest**2 / variances) / np.sqrt(variances)
        return -float(np.sum(np.log(usual + share * np.exp(-0.5 * (rest / wild) ** 2) / wild + 1e-300)))

    first = np.concatenate([np.full(k, math.log(0.02)), [-3.0], np.zeros(alike.shape[1])])
    found = minimize(cost, first, method="Powell", options={"maxiter": 50_000, "xtol": 1e-6, "ftol": 1e-10}).x
    return np.exp(found[:k]), found[k + 1 :]


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
        elif not case.has_camera:
            found = learn_alone([stages], CartParams(), seed)
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
    minutes=60,
    heading="beside the log",
)
