"""What a cart's own runs say about it: wheelbase, tick, how badly its odometry errs, its bumper; what is likely.

Evidence are a known map, whose walls each bump must be at; the path that a camera above saw, in a frame of its own;
or both. Without either the tick alone tells lengths, so that it must be known, and walls that are felt again tell the
rest: they are mapped first, and where they are is found with all else. What is called noise is that of ordinary stages:
large errors have components of their own, and what errs always the same way, a cart that veers and gears that have
play, is told apart. Uses its siblings `bump_localizer` and `bump_mapper`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from slam.area import Area, is_inside
from slam.bump_localizer import BumpLocalizer, BumpLocalizerParams
from slam.bump_mapper import BumpMapper, BumpMapperParams
from slam.bump_swarm import BEYOND, HIGH, HITS, LOW, PHI, X, Y
from slam.bump_walls import LEAST_BUMPS
from slam.cart_hypothesis import NAMES, OWN, TOLD, Evidence
from slam.cart_likelihood import run_costs
from slam.cart_odometry import DRIVE, CartParams, Stage, bumps_of
from slam.pose import transform, wrap
from slam.posterior import Learned, Unknown, fitted

ODOMETRY = ("wheelbase", "tick", "distance_noise", "turn_noise", "rotation_noise", "veer", "play", "overrun")
BUMPER = ("bumper_width", "bumper_ahead", "tolerance", "slip_share", "slip_distance")
CAMERA = ("camera_place", "camera_turn")
FIRST_GUESS = {"veer": 0.0, "overrun": 0.002, "play": 0.3, "tolerance": 0.003, "slip_share": 0.15,
               "slip_distance": 0.06, "camera_place": 0.002, "camera_turn": 0.01}  # fmt: skip
DOUBT = {
    "wheelbase": 0.1,
    "tick": 0.05,
    "bumper_width": 0.3,
    "bumper_ahead": 0.05,
    "veer": 0.05,
    "play": 0.5,
    "overrun": 0.002,
}
# of a parameter's logarithm beforehand, one sigma, of the last three (rad/m, ticks, m) of the parameter itself,
VAGUE = 1.0  # and of those not named here: a factor of 2.7 either way
NO_CORNERS = np.zeros((0, 2))
LEAST_STAGES = 20  # below which nothing is learned,
BLOCK = 15  # stages, five bumps, over which errors of the model hang together
LEAST_PLACED = 20  # bumps with a sure place, likewise,
LEAST_ALONE = 50  # and of runs without a map or a camera
CARRIED = 0.001  # probability before each bump that it was put elsewhere
OFTEN = 0.8  # of the bumps of a cart whose bumper sticks
LOOSE = 0.03  # share of the wheelbase that it may be wrong by while bumps are placed
UNSURE = np.array([0.02, 0.02, 0.02])  # m, m, rad that a camera's frame may be off its first guess
FAR = 10.0  # m: how much nothing is known of a pose
UNFELT = 0.05  # m by which a wall that was mapped may go on beyond where it was felt
OFF_WALL = np.array([0.1, 0.1])  # rad, m that one may be off beforehand: so much that what was mapped hardly counts


def learn_from_camera(runs: Sequence[Sequence[Stage]], paths: Sequence[np.ndarray], guess: CartParams) -> Learned:
    """What runs say whose poses (n + 1, 3), at the start and after each of n stages, a camera saw; nan where not.

    ValueError where there are too few stages, or a path is not of its run's length.
    """
    check(runs, paths)
    found = [seen_alone(stages, path) for stages, path in zip(runs, paths, strict=True)]
    return learned(found, guess, ODOMETRY + CAMERA, ODOMETRY)


def learn_from_map(
    runs: Sequence[Sequence[Stage]],
    area: Area,
    guess: CartParams,
    seed: int = 0,
    paths: Sequence[np.ndarray] | None = None,
) -> Learned:
    """What runs on a known map say; each begins anywhere on it. A camera's `paths` may help, each in its own frame.

    ValueError where too few bumps are localized, or a path is not of its run's length.
    """
    if paths is not None:
        check(runs, paths)
    places = [located(stages, area, guess, seed) for stages in runs]
    if sum(int(np.sum(np.isfinite(told[:, 0]))) for told in places) < LEAST_PLACED:
        raise ValueError("too few bumps have a sure place on the map; log longer runs, or check the map")
    seen = paths if paths is not None else [np.full((len(stages) + 1, 3), math.nan) for stages in runs]
    found = [on_map(stages, told, path, area) for stages, told, path in zip(runs, places, seen, strict=True)]
    names = ODOMETRY + BUMPER
    return learned(found, guess, names + CAMERA if paths is not None else names, (*ODOMETRY, *BUMPER[:3]))


def learn_alone(
    runs: Sequence[Sequence[Stage]], guess: CartParams, seed: int = 0, params: BumpMapperParams | None = None
) -> Learned:
    """What runs tell of their ratios to the tick, which stays as guessed, with no map but that of their own bumps.

    ValueError where there are too few bumps, or a run's map is doubtful.
    """
    if sum(len(bumps_of(stages)) for stages in runs) < LEAST_ALONE:
        raise ValueError(f"without a map or a camera it takes {LEAST_ALONE} bumps; log longer runs, or give the map")
    found = [on_own_map(stages, guess, params or BumpMapperParams(), seed) for stages in runs if len(bumps_of(stages))]
    names = [name for name in ODOMETRY + BUMPER if name != "tick"]
    return learned(found, guess, names, (*(name for name in ODOMETRY if name != "tick"), "bumper_width"))


def check(runs: Sequence[Sequence[Stage]], paths: Sequence[np.ndarray]) -> None:
    """ValueError where paths are not the runs', or too short."""
    for stages, path in zip(runs, paths, strict=True):
        if len(path) != len(stages) + 1:
            raise ValueError(f"a path of {len(path)} poses for {len(stages)} stages; it needs one more than those")
    n_seen = sum(int(np.sum(np.isfinite(path[1:, 0]))) for path in paths)
    if n_seen < LEAST_STAGES:
        raise ValueError(f"{n_seen} stages that a camera saw tell nothing: {LEAST_STAGES} are needed at least")


def learned(found: Sequence[Evidence], guess: CartParams, names: Sequence[str], wanted: Sequence[str]) -> Learned:
    """What is likely of the parameters by the evidence of several runs."""
    first = FIRST_GUESS | {name: getattr(guess, name) for name in NAMES if name in CartParams._fields}
    unknowns = [
        Unknown(name, first[name], DOUBT.get(name, VAGUE), name not in ("veer", "play", "overrun")) for name in names
    ]
    values = np.array([first[name] for name in NAMES])
    rows = np.array([NAMES.index(name) for name in names])

    def costs(some: np.ndarray) -> np.ndarray:
        whole = values.copy()
        whole[rows] = some
        return np.concatenate([run_costs(whole, evidence) for evidence in found])

    return fitted(costs, unknowns, wanted, BLOCK)


def table_of(stages: Sequence[Stage]) -> np.ndarray:
    """Rows (n, 6): kind, ticks of both wheels, which way each turned round at its start (0: it did not), is a bump."""
    ticks = np.array([(stage.left, stage.right) for stage in stages], float).reshape(-1, 2)
    ways = np.sign(ticks)
    before = np.vstack([ways[:1], ways[:-1]])
    kinds = [[stage.kind] for stage in stages]
    bumps = [[stage.kind == DRIVE and stage.bumper > 0] for stage in stages]
    return np.hstack([kinds, ticks, np.where(ways * before < 0.0, ways, 0.0), bumps]).astype(float)


def seen_alone(stages: Sequence[Stage], path: np.ndarray) -> Evidence:
    """Evidence of a camera without a map, whose frame is the world."""
    nothing = np.full((len(stages), 3), math.nan)
    begun = np.flatnonzero(np.isfinite(path[:, 0]))[0]
    table = table_of(stages)[begun:]  # what was before it was seen first tells nothing
    return Evidence(
        table, nothing[begun:], np.ascontiguousarray(path[begun + 1 :], float), path[begun].astype(float),
        np.concatenate([path[begun], np.zeros(OWN - 3)]),
        np.diag([FAR**2, FAR**2, FAR**2, 0.0, 0.0]), np.zeros((0, 5)), NO_CORNERS, False,
    )  # fmt: skip


def on_map(stages: Sequence[Stage], told: np.ndarray, path: np.ndarray, area: Area) -> Evidence:
    """Evidence of a map, and of what a camera saw if it saw anything; it begins where the first bump is told."""
    lines, corners = lines_of(area)
    begun = np.flatnonzero(np.isfinite(told[:, 0]))
    first = int(begun[0]) if len(begun) else len(told)
    rest = slice(first + 1, None)
    pose = told[first] if len(begun) else np.zeros(3)
    state, spread = np.concatenate([pose, np.zeros(OWN - 3)]), np.concatenate([TOLD**2, np.zeros(OWN - 3)])
    seen = np.ascontiguousarray(path[1:], float)
    has_frame = bool(np.any(np.isfinite(seen[rest, 0]))) and len(begun) > 0
    if has_frame:
        state, spread = np.concatenate([state, frame_of(told, seen)]), np.concatenate([spread, UNSURE**2])
    return Evidence(
        table_of(stages)[rest], np.ascontiguousarray(told[rest]), seen[rest], np.full(3, math.nan),
        state, np.diag(spread), lines, corners, has_frame,
    )  # fmt: skip


def on_own_map(stages: Sequence[Stage], guess: CartParams, params: BumpMapperParams, seed: int) -> Evidence:
    """Evidence of walls that are known only from this run's own bumps; ValueError where their map is doubtful."""
    mapper = BumpMapper(guess, params, seed)
    mapper.extend(stages)
    found = mapper.refine()
    if not found.is_sure:
        raise ValueError(
            "the map of these bumps is doubtful, so that walls felt again tell nothing; log a longer run, or give a map"
        )
    felt = found.lines[found.lines[:, HITS] >= LEAST_BUMPS]
    outward = np.column_stack([np.cos(felt[:, PHI]), np.sin(felt[:, PHI])])
    places = felt[:, [X, Y]] + felt[:, BEYOND, None] * outward
    lines = np.column_stack([places, felt[:, PHI], felt[:, LOW] - UNFELT, felt[:, HIGH] + UNFELT])
    drives = [row for row, stage in enumerate(stages) if stage.kind == DRIVE]
    told = np.full((len(stages), 3), math.nan)
    told[drives] = np.where(found.is_bump[:, None], found.path, math.nan)
    first = bumps_of(stages)[0]
    rest, nothing = slice(first + 1, None), np.full((len(stages), 3), math.nan)
    state = np.concatenate([told[first], np.zeros(OWN - 3 + 2 * len(lines))])
    spread = np.concatenate([np.zeros(OWN), np.tile(OFF_WALL**2, len(lines))])  # it begins where the frame is
    return Evidence(
        table_of(stages)[rest], np.ascontiguousarray(told[rest]), nothing[rest], np.full(3, math.nan),
        state, np.diag(spread), np.ascontiguousarray(lines), NO_CORNERS, False, True,
    )  # fmt: skip


def frame_of(told: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The map's pose (3,) in a camera's frame, by poses (n, 3) known in both; medians, since some are wrong."""
    both = np.isfinite(told[:, 0]) & np.isfinite(seen[:, 0])
    if not np.any(both):
        return np.zeros(3)
    turns = seen[both, 2] - told[both, 2]
    middle = math.atan2(np.median(np.sin(turns)), np.median(np.cos(turns)))
    turn = middle + float(np.median(wrap(turns - middle)))
    turned = transform(np.array([0.0, 0.0, turn]), told[both, :2])
    return np.array([*np.median(seen[both, :2] - turned, axis=0), turn])


def lines_of(area: Area) -> tuple[np.ndarray, np.ndarray]:
    """An area's walls (m, 5) as of `Evidence`, and its corners (c, 2) that point into the floor."""
    lines = np.empty((len(area.walls), 5))
    for wall, (x1, y1, x2, y2) in enumerate(area.walls):
        x, y, length = 0.5 * (x1 + x2), 0.5 * (y1 + y2), math.hypot(x2 - x1, y2 - y1)
        phi = math.atan2(x1 - x2, y2 - y1)
        if is_inside(area.walls, x + 1e-6 * math.cos(phi), y + 1e-6 * math.sin(phi)):
            phi += math.pi
        lines[wall] = x, y, phi, -0.5 * length, 0.5 * length
    corners = []
    for line, wall in zip(lines, area.walls, strict=True):
        for other in area.walls:  # the next wall goes on out through this one
            if np.array_equal(wall[2:], other[:2]):
                ahead = other[2:] - other[:2]
                if math.cos(line[2]) * ahead[0] + math.sin(line[2]) * ahead[1] > 1e-9:
                    corners.append(wall[2:])
    return lines, np.array(corners).reshape(-1, 2)


def located(stages: Sequence[Stage], area: Area, guess: CartParams, seed: int) -> np.ndarray:
    """Poses (n, 3) after stages: those of bumps with a sure place, else nan.

    A cart whose wheels mostly go on after bumps is another cart to the localizer: the likelier one places the bumps.
    """
    found = []
    for slip_share in (guess.slip_share, OFTEN):
        cart = guess._replace(wheelbase_doubt=LOOSE, slip_share=slip_share)
        localizer = BumpLocalizer(area, cart, BumpLocalizerParams(kidnapping=CARRIED), seed)
        found.append((placed(localizer, stages), localizer.evidence))
    return max(found, key=lambda pair: pair[1])[0]


def placed(localizer: BumpLocalizer, stages: Sequence[Stage]) -> np.ndarray:
    """The poses of `located` by one localizer, as the whole run tells them; all nan if it never found the cart."""
    told, was_sure = np.full((len(stages), 3), math.nan), False
    for stage in stages:
        localizer.step(stage)
        if stage.kind == DRIVE and stage.bumper > 0 and not was_sure and (estimate := localizer.estimate()) is not None:
            was_sure = estimate.is_localized
    if was_sure:
        told[bumps_of(stages)] = localizer.path()
    return told
