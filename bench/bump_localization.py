"""Where is a cart with a bumper? The paper's sample, on the virtual cart: its own rule against particles with weights.

The room is a rectangle with a corner cut off, the start random, a seed another cart, way and filter. *Localized*: at
least 95 % of the weight lies within 0.15 m and 45 degrees (a cart's own size, an eighth of a turn) of the pose that is
told; *right*: so does the truth. Both rules are told the same of the cart, and are asked the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Record, Row, each, figures, runs, share
from firmware.virtual.bumper_cart import CartBuild, random_start, run_cart
from firmware.virtual.polygons import closed_outlines
from firmware.virtual.worlds import load_world
from slam.area import Area, area_of
from slam.bump_localizer import BumpLocalizer, BumpLocalizerParams
from slam.bump_survivors import Survival, Survivors
from slam.cart_odometry import DRIVE, CartParams, Stage
from slam.pose import wrap
from slam.pose_clusters import Cluster, within

PARAMS = BumpLocalizerParams()
RULES = ("paper", "ours")
NUMBERS = (100, 300, 700, 2000, 5000)
HITS = 25  # within which a cart is to be localized
CHECKED = (10, 30, 100)  # hits after which the error is told
TWO = 0.05  # share of the weight from which a place is told as possible
SENSITIVE = {
    "wheelbase": (0.9, 0.95, 0.98, 1.02, 1.05, 1.1),
    "turn_noise": (0.25, 0.5, 2.0, 4.0),
    "rotation_noise": (0.25, 0.5, 2.0, 4.0),
    "distance_noise": (0.25, 0.5, 2.0, 4.0),
    "bumper_width": (0.5, 0.75, 1.25, 1.5),
    "band": (0.25, 0.5, 2.0, 4.0),
}  # what each rule is told, as a multiple of what it is told otherwise
EARLY = 10  # bumps of a path whose beginning is told


class Case(NamedTuple):
    """A rule in a room; what is told of the cart is the usual, `changed` by a factor; the rest is how it is built."""

    rule: str
    particles: int = PARAMS.particles
    hits: int = HITS
    room: str = "cut-rectangle"
    is_carried: bool = False
    changed: str = ""
    factor: float = 1.0
    width: float = CartParams().bumper_width
    switches: int = 1
    is_matched: bool = False
    is_coarse: bool = False


def localizer_of(case: Case, area: Area, seed: int) -> BumpLocalizer | Survivors:
    """The rule, with what it is told."""
    cart, survival = CartParams(bumper_width=case.width, switches=case.switches), Survival(particles=case.particles)
    tolerance = PARAMS.tolerance
    if case.changed == "band":
        survival = survival._replace(tolerance=case.factor * survival.tolerance)
        tolerance *= case.factor
    elif case.changed:
        cart = cart._replace(**{case.changed: case.factor * getattr(cart, case.changed)})
    if case.rule == "paper":
        return Survivors(area, cart, survival, seed)
    return BumpLocalizer(
        area, cart, PARAMS.model_copy(update={"particles": case.particles, "tolerance": tolerance}), seed
    )


def told(localizer: BumpLocalizer | Survivors) -> list[Cluster]:
    """Its clusters, the heaviest first; none where it is lost."""
    if isinstance(localizer, Survivors):
        return localizer.clusters()
    estimate = localizer.estimate()
    return estimate.clusters if estimate else []


def is_near(cluster: Cluster, true: np.ndarray) -> bool:
    """Whether the truth (3,) is what a cluster means."""
    return bool(within(true[None], cluster.pose, PARAMS.size, PARAMS.turn)[0])


def run(case: Case, seed: int) -> Record:
    """One cart's way."""
    world, build = load_world(case.room), CartBuild(bumper_width=case.width, switches=case.switches)
    area = area_of(closed_outlines(world.segments, world.name))
    stages, driven = run_cart(world, seed, case.hits, None, build, case.is_matched, case.is_coarse)
    poses = driven[1:]
    carried = case.hits if case.is_carried else 0
    if carried:
        more, then = run_cart(world, seed, case.hits, random_start(world, seed + 1_000_000, build), build)
        stages, poses = stages + more, np.concatenate([poses, then[1:]])
    localizer = localizer_of(case, area, seed)
    record: Record = {"seed": seed, "first": None, "is_right": False, "claims": 0, "wrong_claims": 0}
    hits, then, truth = 0, [], []
    for stage, true in zip(stages, poses, strict=True):
        localizer.step(Stage(*stage))
        if stage.kind == DRIVE:
            hits += 1
            found = told(localizer)
            note(record, found, true, hits, carried)
            record["particles"] = len(localizer.poses)
            if stage.bumper:
                then.append(found[0].pose if found else np.full(3, np.nan))
                truth.append(true)
    if isinstance(localizer, BumpLocalizer) and not carried:
        begun = localizer.path()
        begun = np.where(np.isfinite(begun), begun, then)[:EARLY]  # what nobody left has seen stays as it was told
        for name, path in (("then", np.array(then[:EARLY])), ("now", begun)):
            record[name] = float(np.nanmedian(np.hypot(*(path - truth[:EARLY])[:, :2].T)))
    found = told(localizer)
    record["is_lost"] = not found
    twin = np.array([1.5 - poses[-1, 0], 1.1 - poses[-1, 1], wrap(poses[-1, 2] + math.pi)])
    record["two"] = all(any(is_near(one, pose) and one.share > TWO for one in found) for pose in (poses[-1], twin))
    return summed(record)


def note(record: Record, found: list[Cluster], true: np.ndarray, hits: int, carried: int) -> None:
    """What is told after a hit, beside the truth (3,); of a cart that is carried, only what comes after counts."""
    after = hits - carried
    if found and after in CHECKED:
        record[f"error_{after}"] = float(np.hypot(*(found[0].pose[:2] - true[:2])))
        record[f"turn_{after}"] = math.degrees(abs(float(wrap(found[0].pose[2] - true[2]))))
    if after <= 0 or not found or found[0].share < PARAMS.sure:
        return
    is_right = is_near(found[0], true)
    record["claims"] += 1
    record["wrong_claims"] += not is_right
    if carried and not is_right:  # that it still believes to be where it was is no answer
        return
    if record["first"] is None:
        record["first"], record["is_right"] = after, is_right


def summed(record: Record) -> Record:
    """The record with what its columns need."""
    record["hits"] = record["first"] if record["is_right"] else None
    record["is_wrong"] = record["first"] is not None and not record["is_right"]
    record["is_never"] = record["first"] is None
    record["wrong_share"] = record["wrong_claims"] / record["claims"] if record["claims"] else None
    return record


def wrong_claims(row: Row) -> str:
    """Of all claims of all runs those that were wrong."""
    claims, wrong = (sum(record[key] for record in row.records) for key in ("claims", "wrong_claims"))
    return f"{100.0 * wrong / claims:.1f} %" if claims else "-"


COLUMNS = (
    Column("carts", runs),
    Column("localized, and right", share("is_right")),
    Column("hits until then: median / p90", figures("hits", 0, 0.5, 0.9)),
    Column("localized, but wrong", share("is_wrong")),
    Column("never localized", share("is_never")),
    Column("no particle left", share("is_lost")),
    Column("of all claims wrong", wrong_claims),
)
ERRORS = tuple(
    column
    for hits in CHECKED
    for column in (
        Column(f"after {hits} hits off by: median / p90 (m)", figures(f"error_{hits}", 3, 0.5, 0.9)),
        Column("degrees", figures(f"turn_{hits}", 0, 0.5, 0.9)),
    )
)
BEGINNING = (
    Column(f"first {EARLY} bumps off as told then: median / p90 (m)", figures("then", 3, 0.5, 0.9)),
    Column("as told after the run", figures("now", 3, 0.5, 0.9)),
)
LOCALIZATION: Mapping[str, Case] = {
    f"{rule}, {number} particles": Case(rule, number) for rule in RULES for number in NUMBERS
} | {f"ours, {number} particles, three switches": Case("ours", number, switches=3) for number in (300, 2000)}
TRACKING: Mapping[str, Case] = (
    {f"{rule}, 100 hits": Case(rule, hits=100) for rule in RULES}
    | {f"{rule}, carried elsewhere": Case(rule, is_carried=True) for rule in RULES}
    | {f"{rule}, symmetric room": Case(rule, room="rectangle") for rule in RULES}
)
SENSITIVITY: Mapping[str, Case] = {f"{rule}": Case(rule) for rule in RULES} | {
    f"{rule}, {name} times {factor:g}": Case(rule, changed=name, factor=factor)
    for name, factors in SENSITIVE.items()
    for factor in factors
    for rule in RULES
}

BENCHES = (
    Bench(
        name="bumps",
        about="where a cart with a bumper is: hits until it is localized, the paper's rule and ours",
        rows=each(run, LOCALIZATION),
        columns=(*COLUMNS, Column("particles at the end", figures("particles", 0, 0.5))),
        seeds=200,
        minutes=25,
        heading="rule",
    ),
    Bench(
        name="bump-tracking",
        about="errors over a hundred bumps, carts that are carried elsewhere, and a room that is symmetric",
        rows=each(run, TRACKING),
        columns=(*COLUMNS, *ERRORS, *BEGINNING, Column("both places of a symmetric room told", share("two"))),
        seeds=100,
        minutes=15,
        heading="rule",
    ),
    Bench(
        name="bump-sensitivity",
        about="what it costs to be wrong about the cart, parameter by parameter",
        rows=each(run, SENSITIVITY),
        columns=COLUMNS,
        seeds=50,
        minutes=40,
        heading="told of the cart",
    ),
)
