"""What the paper learned about driving and bumpers, on the virtual cart: wheels that are kept alike, narrow and wide.

A cart that gives both motors the same power drives arcs. Keeping both counters at the same count instead makes it wave,
and a wave is longer than its counts tell. The first metre in an open hall tells how far the arc of both counts is off
at its end, when wheelbase and tick are known exactly. The same cart is then looked for in the cut rectangle, and makes
a map of a random room, which tells what a metre's error is worth. A seed is another cart.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bench import bump_localization
from bench.benchmark import Bench, Column, Record, each, figures, runs, share
from bench.bump_mapping import FIRST_ROOM, GOOD, ROOMS, Driven, errors_of
from firmware.virtual.bumper_cart import CartBuild, VirtualCart, run_cart
from firmware.virtual.cart_board import HostCart
from firmware.virtual.polygons import polygon
from firmware.virtual.worlds import World
from slam.bump_mapper import BumpMapper, BumpMapperParams
from slam.cart_odometry import CartParams, Stage, arc, bumps_of
from slam.pose import wrap

HALL = World(np.array([[-9, -9, 9, -9], [9, -9, 9, 9], [9, 9, -9, 9], [-9, 9, -9, -9]], float))  # m
METRE = 1.0
STEP_MS = 50  # between the places of a track
BUMPS = 100
PARTICLES = 2000
USUAL = CartParams().bumper_width


class Case(NamedTuple):
    """How the wheels are driven, and how wide the bumper is (m)."""

    is_matched: bool = False
    is_coarse: bool = False
    width: float = USUAL


ARCS, FINE, COARSE = "same power (arcs)", "matched, fine powers", "matched, eight powers"
MANNERS = {ARCS: Case(), FINE: Case(True), COARSE: Case(True, True)}
WIDTHS = (0.04, 0.1, 0.14, 0.2)
CASES = MANNERS | {f"bumper {1e3 * width:.0f} mm": Case(width=width) for width in WIDTHS}


def track(case: Case, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """True places (n, 3) of a cart that drives its first metre from the origin, and the pose that its counts tell."""
    cart = VirtualCart(HALL, (0.0, 0.0, 0.0), seed, CartBuild(bumper_width=case.width))
    board = cart.board
    assert isinstance(board, HostCart)
    board.order(1, (2 * seed + 1) & 0xFFFF, int(case.is_matched) | 2 * int(case.is_coarse))
    poses = [cart.pose]
    while math.hypot(*cart.pose[:2]) < METRE:
        board.next_stage(STEP_MS)
        poses.append(cart.pose)
    left, right = board.robot.loop.program.counted
    return np.array(poses), arc(left, right, CartParams(wheelbase=cart.build.wheelbase))


def run(case: Case, seed: int) -> Record:
    """One cart."""
    poses, told = track(case, seed)
    way = float(np.sum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    straight = math.hypot(*poses[-1, :2])
    return {
        "seed": seed,
        "place": 100.0 * math.hypot(*(told[:2] - poses[-1, :2])) / straight,
        "heading": math.degrees(abs(float(wrap(told[2] - poses[-1, 2])))),
        "longer": 100.0 * (way / straight - 1.0),
        "track": np.round(poses[:, :2], 4).tolist(),
        **localized(case, seed),
        **mapped(case, seed),
    }


def localized(case: Case, seed: int) -> Record:
    """Whether, and after how many bumps, it was found in the cut rectangle."""
    build = bump_localization.Case("ours", width=case.width, is_matched=case.is_matched, is_coarse=case.is_coarse)
    found = bump_localization.run(build, seed)
    return {key: found[key] for key in ("hits", "is_right", "is_wrong")}


def mapped(case: Case, seed: int) -> Record:
    """How far off its map of a random room is."""
    room = polygon(FIRST_ROOM + seed % ROOMS)
    build = CartBuild(bumper_width=case.width)
    logged, truth = run_cart(
        room, FIRST_ROOM + seed, BUMPS, build=build, is_matched=case.is_matched, is_coarse=case.is_coarse
    )
    stages = [Stage(*stage) for stage in logged]
    mapper = BumpMapper(CartParams(bumper_width=case.width), BumpMapperParams(n_particles=PARTICLES), seed)
    mapper.extend(stages)
    error, covered = errors_of(mapper.refine(), Driven(stages, truth, bumps_of(stages)), room.segments)
    return {"error": error, "covered": covered, "good": error < GOOD}


BENCH = Bench(
    name="bump-lessons",
    about="the paper's lessons: both wheels kept alike against arcs, narrow against wide bumpers",
    rows=each(run, CASES),
    columns=(
        Column("carts", runs),
        Column("a metre's end off: median / p90 (% of the way)", figures("place", 1, 0.5, 0.9)),
        Column("its heading: median / p90 (degrees)", figures("heading", 1, 0.5, 0.9)),
        Column("longer than straight: median / p90 (%)", figures("longer", 1, 0.5, 0.9)),
        Column("localized, and right", share("is_right")),
        Column("hits until then: median / p90", figures("hits", 0, 0.5, 0.9)),
        Column("localized, but wrong", share("is_wrong")),
        Column("map off: median / p90 (m)", figures("error", 3, 0.5, 0.9)),
        Column("below 5 cm (95 %)", share("good")),
        Column("covered: median / least", figures("covered", 2, 0.5, 0.0)),
    ),
    seeds=60,
    minutes=25,
    heading="the wheels; the bumper",
)
