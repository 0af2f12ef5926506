"""One map of several carts' recordings of an area, none of which knew where it began.

Maps of the few carts that explain their own bumps best are laid on each other; the largest set whose frames agree, also
around loops of three (Mangelson et al., 2018, pairwise consistency), is the core, and wrong maps are outvoted. Every
other cart is then found on the core's map by its run alone, so that its own map, which may be wrong, does not matter.
At last all runs are refined as one, and what they felt besides becomes walls. Uses its siblings `bump_finding`,
`bump_frames`, `bump_fleet`, `bump_mapper`, `bump_refinement`, `bump_swarm`, `bump_walls`, `cart_odometry` and `pose`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from slam.bump_bundle import STRAY_SHARE
from slam.bump_finding import BumpFindingParams, Recording, found_on
from slam.bump_fleet import Member, Track, descend_together, felt_extents, places_felt
from slam.bump_frames import BumpFrameParams, agreed, frame_of
from slam.bump_mapper import BumpMap, BumpMapperParams
from slam.bump_refinement import BumpRefinementParams, Refined, alike, kept, tell
from slam.bump_swarm import COLUMNS, HITS, PHI, X, Y, innovation
from slam.bump_walls import LEAST_BUMPS, points_on, walls_of
from slam.params import Params
from slam.pose import compose, inverse, transform

LEAST_BENT = 5  # contacts of each of two walls that were taken for one


class BumpMergingParams(Params):
    """How many carts vote, how the others are found on the map, and what becomes a wall."""

    core: int = Field(default=7, ge=1, le=12)  # maps at most that are laid on each other
    worse: float = Field(default=2.0, gt=0.0)  # nats a bump that it may cost there beyond what the core's carts do
    least_felt: float = Field(default=0.01, ge=0.0, le=1.0)  # of all bumps that make a wall
    reach: float = Field(default=0.1, gt=0.0)  # m by which a wall goes on beyond where it was felt, on average
    bent: float = Field(default=0.05, ge=0.0)  # nats a bump that two walls for one must save, besides a wall's cost
    least_spread: float = Field(default=0.5, ge=0.0, le=1.0)  # of the carts that so many bumps would come from
    steps: int = Field(default=15, ge=1)  # of each descent
    rounds: int = Field(default=4, ge=1)  # of telling again which wall was met
    finding: BumpFindingParams = Field(default_factory=BumpFindingParams)
    frames: BumpFrameParams = Field(default_factory=BumpFrameParams)
    refinement: BumpRefinementParams = Field(default_factory=BumpRefinementParams)


class Shape(NamedTuple):
    """A map's lines (m, 10) and points (n, 2) on its walls."""

    lines: np.ndarray
    contacts: np.ndarray


class MergedMap(NamedTuple):
    """Walls as curves in the frame of cart `reference`, and what each cart is told of.

    `nodes` of cart c (2 t, 3) are its poses before and after each of its drives, (0, 3) if it is among `left_out`. On
    the map that those of `core` made, `shares` (carts,) of its bumps were on walls, and `excess` (carts,) is how many
    nats a bump its run cost more than theirs. `second` is how well the map fits itself another way round, of 1.
    """

    reference: int
    core: list[int]
    left_out: list[int]
    shares: np.ndarray
    excess: np.ndarray
    second: float
    walls: list[np.ndarray]
    lines: np.ndarray
    nodes: list[np.ndarray]
    biases: np.ndarray


class Place(NamedTuple):
    """A cart on a map: its track, the share of its bumps that are on walls, and the cost in nats per bump."""

    track: Track
    share: float
    cost: float


class Fleet(NamedTuple):
    """Carts whose tracks share lines (m, 10)."""

    members: list[Member]
    tracks: list[Track]
    lines: np.ndarray
    cost: float = math.inf


def merge(recordings: Sequence[Recording], mapper: BumpMapperParams | None = None,
          params: BumpMergingParams | None = None) -> MergedMap:  # fmt: skip
    """One map of recordings; ValueError where there are none, or none with a bump at a wall.

    What comes out does not depend on the recordings' order, but for their numbers.
    """
    params, mapper = params or BumpMergingParams(), mapper or BumpMapperParams()
    carts = [cart for cart, each in enumerate(recordings) if np.any(each.area.felt >= 0)]
    if not carts:
        raise ValueError(f"nothing to merge: {len(recordings)} recordings, none of which felt a wall twice")
    carts.sort(key=lambda cart: (recordings[cart].cost, [tuple(stage) for stage in recordings[cart].stages]))
    members = {
        cart: Member.of(recordings[cart].stages, mapper.model(recordings[cart].cart), mapper.spreads) for cart in carts
    }
    core, frames = agreed([recordings[cart].area for cart in carts[: params.core]], params.frames)
    first = [carts[row] for row in core]
    fleet = core_map([recordings[cart] for cart in first], [members[cart] for cart in first], frames, params)
    found = {
        cart: fitted(track, members[cart], fleet.lines, params) for cart, track in zip(first, fleet.tracks, strict=True)
    }
    usual = float(np.median([place.cost for place in found.values()]))
    spare = [np.zeros((0, COLUMNS))]
    for cart in carts:
        if cart not in found:
            track, new = found_on(fleet.lines, recordings[cart], mapper, params.finding)
            found[cart] = fitted(track, members[cart], fleet.lines, params)
            spare.append(new)
    least = params.finding.least_told
    taken = [
        cart for cart in carts
        if cart in first or (found[cart].share >= least and found[cart].cost - usual <= params.worse)
    ]  # fmt: skip
    fleet = Fleet([members[cart] for cart in taken], [found[cart].track for cart in taken], fleet.lines)
    fleet = refined(fleet, np.concatenate(spare), params)
    shares, excess = np.zeros(len(recordings)), np.full(len(recordings), np.inf)
    for cart, place in found.items():
        shares[cart], excess[cart] = place.share, place.cost - usual
    return concluded(fleet, taken, MergedMap(
        first[0], first, [cart for cart in range(len(recordings)) if cart not in taken], shares, excess, 0.0, [],
        fleet.lines, [np.zeros((0, 3))] * len(recordings), np.zeros((len(recordings), 2)),
    ), params)  # fmt: skip


def core_map(
    recordings: Sequence[Recording], members: list[Member], frames: Sequence[np.ndarray], params: BumpMergingParams
) -> Fleet:
    """The map of carts whose own maps lie at `frames` (3,) in the first one's."""
    lines, tracks = recordings[0].area.lines, []
    for recording, member, pose in zip(recordings, members, frames, strict=True):
        area = recording.area
        nodes = compose(pose, area.nodes)
        felt = area.felt
        if tracks:
            felt, lines = told_of(area, nodes[1::2], member, lines, pose)
        tracks.append(Track(nodes, felt.copy(), area.biases))
    return refined(Fleet(members, tracks, lines), np.zeros((0, COLUMNS)), params)


def told_of(
    area: BumpMap, bumped: np.ndarray, member: Member, lines: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which of `lines` (n, 10) the bumps of a map at a pose felt, -1 for none; and the lines, with its own new.

    A wall of the map is the line that most of its bumps would be told of, and if that is not half of them a new one.
    """
    near = np.full(len(bumped), -1)
    tell(bumped, member.bumpers, lines, member.model._replace(contact=3.0 * member.model.contact), near)
    told = np.full(len(bumped), -1)
    for j in range(len(area.lines)):
        own = area.felt == j
        votes = np.bincount(near[own & (near >= 0)], minlength=1)
        if 2 * votes.max() >= np.sum(own) > 0:
            told[own] = int(np.argmax(votes))
        elif np.sum(own) > 1:
            told[own] = len(lines)
            lines = np.vstack([lines, moved_line(area.lines[j], pose)])
    return told, lines


def moved_line(line: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """A line (10,) of another frame."""
    moved = line.copy()
    moved[[X, Y]] = transform(pose, line[[X, Y]])
    moved[PHI] = line[PHI] + pose[2]
    return moved


def fitted(track: Track, member: Member, lines: np.ndarray, params: BumpMergingParams) -> Place:
    """A track laid on walls (m, 10) that stay where they are, with its bumps told of them again."""
    is_bump = member.bumpers > 0
    cost = math.inf
    for _ in range(2):
        felt = told_again(Fleet([member], [track], lines), params).tracks
        (track,), _, cost = descend_together([member], felt, lines, params.steps, is_fixed=True)
    strays = track.felt[is_bump] < 0
    cost -= math.log(STRAY_SHARE) * float(np.sum(strays))
    return Place(track, 1.0 - float(np.mean(strays)), cost / len(strays))


def refined(fleet: Fleet, spare: np.ndarray, params: BumpMergingParams) -> Fleet:
    """Walls are told again, found among `spare` ones (k, 10) for bumps that have none, and joined, while that helps."""
    fleet = settled(fleet, params)
    tried: set[tuple[float, float]] = set()
    for _ in range(params.rounds):
        trial = settled(grown(told_again(fleet, params), spare, params), params)
        trial = joined(min(trial, fleet, key=lambda each: each.cost), params, tried)
        trial = parted(trial, params)
        if not trial.cost < fleet.cost - 0.1:
            break
        fleet = trial
    return pruned(fleet, params)


def settled(fleet: Fleet, params: BumpMergingParams) -> Fleet:
    """After one descent; the cost has that of walls and strays in it."""
    felt = np.concatenate([track.felt for track in fleet.tracks])
    lines, felt = kept(fleet.lines, felt)
    bounds = np.cumsum([len(track.felt) for track in fleet.tracks])[:-1]
    tracks = [track._replace(felt=own) for track, own in zip(fleet.tracks, np.split(felt, bounds), strict=True)]
    tracks, lines, cost = descend_together(fleet.members, tracks, lines, params.steps)
    lines = felt_extents(lines, fleet.members, tracks)
    strays = sum(
        int(np.sum((track.felt < 0) & (member.bumpers > 0)))
        for track, member in zip(tracks, fleet.members, strict=True)
    )
    cost += params.refinement.wall_cost * len(lines) - math.log(STRAY_SHARE) * strays
    return Fleet(fleet.members, tracks, lines, cost)


def told_again(fleet: Fleet, params: BumpMergingParams) -> Fleet:
    """Each bump told of the wall that it met most likely."""
    tracks = []
    for member, track in zip(fleet.members, fleet.tracks, strict=True):
        felt = track.felt.copy()
        tell(track.nodes[1::2], member.bumpers, fleet.lines, member.model._replace(reach=params.reach), felt)
        tracks.append(track._replace(felt=felt))
    return fleet._replace(tracks=tracks)


def grown(fleet: Fleet, spare: np.ndarray, params: BumpMergingParams) -> Fleet:
    """With walls for bumps that have none: of `spare` ones that which most of these met, again and again."""
    n_bumps = sum(int(np.sum(member.bumpers > 0)) for member in fleet.members)
    lines, tracks = fleet.lines, fleet.tracks
    while len(spare):
        met = []
        for line in spare:
            own = []
            for member, track in zip(fleet.members, tracks, strict=True):
                felt = np.full(len(track.felt), -1)
                tell(track.nodes[1::2], np.where(track.felt < 0, member.bumpers, 0), line[None], member.model, felt)
                own.append(felt >= 0)
            met.append(own)
        counts = [sum(int(np.sum(own)) for own in each) for each in met]
        best = int(np.argmax(counts))
        if counts[best] < max(LEAST_BUMPS, params.least_felt * n_bumps):
            break
        tracks = [
            track._replace(felt=np.where(own, len(lines), track.felt))
            for track, own in zip(tracks, met[best], strict=True)
        ]
        lines, spare = np.vstack([lines, spare[best]]), np.delete(spare, best, axis=0)
    return fleet._replace(tracks=tracks, lines=lines)


def joined(fleet: Fleet, params: BumpMergingParams, tried: set[tuple[float, float]]) -> Fleet:
    """With pairs of walls made one where that costs less than two; no pair is tried twice."""
    model = fleet.members[0].model
    while True:
        nodes = np.concatenate([track.nodes for track in fleet.tracks])
        felt = np.concatenate([track.felt for track in fleet.tracks])
        state = Refined(nodes, felt, fleet.lines, np.zeros(2), fleet.cost)
        pairs = [pair for pair in alike(state, model, params.refinement) if pair[3] not in tried]
        if not pairs:
            return fleet
        _, i, j, name = min(pairs, key=lambda pair: pair[0])
        tried.add(name)
        tracks = [track._replace(felt=np.where(track.felt == j, i, track.felt)) for track in fleet.tracks]
        trial = settled(fleet._replace(tracks=tracks), params)
        if trial.cost < fleet.cost:
            fleet = trial


def parted(fleet: Fleet, params: BumpMergingParams) -> Fleet:
    """With walls made two that bend where they were taken for straight, if that saves enough."""
    for j, (places, beyond) in enumerate(zip(*places_felt(fleet.lines, fleet.members, fleet.tracks), strict=True)):
        at = bend(places, beyond)
        if at is None:
            continue
        tracks = []
        for member, track in zip(fleet.members, fleet.tracks, strict=True):
            felt = track.felt.copy()
            for row in np.flatnonzero(felt == j):
                if innovation(fleet.lines[j], track.nodes[2 * row + 1], member.model)[3] > at:
                    felt[row] = len(fleet.lines)
            tracks.append(track._replace(felt=felt))
        trial = settled(fleet._replace(tracks=tracks, lines=np.vstack([fleet.lines, fleet.lines[j]])), params)
        if trial.cost < fleet.cost - params.bent * len(places):
            return parted(trial, params)
    return fleet


def pruned(fleet: Fleet, params: BumpMergingParams) -> Fleet:
    """Without walls that few bumps or few carts felt; their bumps are told of others, or strays.

    Bumps of a wall come from many carts, those of one that lost its way for a while from one: of n carts, h bumps that
    fall on any of them alike come from n (1 - (1 - 1 / n)^h).
    """
    n = len(fleet.members)
    n_bumps = sum(int(np.sum(member.bumpers > 0)) for member in fleet.members)
    carts = np.array([[np.any(track.felt == j) for j in range(len(fleet.lines))] for track in fleet.tracks])
    hits = fleet.lines[:, HITS]
    expected = n * (1.0 - (1.0 - 1.0 / n) ** hits)
    is_wall = (hits >= max(LEAST_BUMPS, params.least_felt * n_bumps)) & (
        np.sum(carts, axis=0) >= params.least_spread * expected
    )
    if np.all(is_wall) or not np.any(is_wall):
        return fleet
    return settled(told_again(fleet._replace(lines=fleet.lines[is_wall]), params), params)


def bend(places: np.ndarray, beyond: np.ndarray) -> float | None:
    """Where along a wall two straight ones fit contacts best that are so far beyond it (k,); None for few of them."""
    if len(places) < 4 * LEAST_BENT:
        return None
    order = np.argsort(places, kind="stable")
    places, beyond = places[order], beyond[order]

    def left(rows: slice) -> float:
        table = np.column_stack([np.ones(len(places[rows])), places[rows]])
        return float(np.sum((beyond[rows] - table @ np.linalg.lstsq(table, beyond[rows], rcond=None)[0]) ** 2))

    splits = np.unique(np.linspace(LEAST_BENT, len(places) - LEAST_BENT, 20).astype(int))
    best = min(splits, key=lambda split: left(slice(0, split)) + left(slice(split, None)))
    return float(0.5 * (places[best - 1] + places[best]))


def concluded(fleet: Fleet, taken: list[int], known: MergedMap, params: BumpMergingParams) -> MergedMap:
    """What is `known` of the carts, with the map of those `taken`, in the frame of the first one."""
    back = inverse(fleet.tracks[0].nodes[0])
    lines = np.array([moved_line(line, back) for line in fleet.lines]).reshape(-1, COLUMNS)
    walls = walls_of(lines)
    itself = Shape(lines, points_on(walls, 0.03))
    nodes, biases = list(known.nodes), known.biases.copy()
    for cart, track in zip(taken, fleet.tracks, strict=True):
        nodes[cart], biases[cart] = compose(back, track.nodes), track.biases
    second = frame_of(itself, itself, params.frames).second
    return known._replace(second=second, walls=walls, lines=lines, nodes=nodes, biases=biases)
