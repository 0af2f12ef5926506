"""Restarts: while no path leads, a whole log is filtered again by islands of other seeds.

Where the way is hard to find few islands find it, and where none did, wrong paths explain the walls about equally: the
lead tells that, and more islands are the remedy. A robot that still drives cannot have them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from server.messages import Keyframe
from server.robots.crunch import CrunchParams, make_estimator
from slam.hypotheses import Verdict, likeliest, verdict
from slam.islands import seed_of
from slam.refined_filter import RefinedFilter

FIRST = 1 << 16  # number of the first restart's seed; islands have smaller ones


def decided(
    path_filter: RefinedFilter,
    keyframes: Sequence[Keyframe],
    params: CrunchParams,
    seed: int,
    threads: int,
    told: Callable[[float], None] = lambda share: None,
) -> tuple[RefinedFilter, Verdict]:
    """The refined estimator of the likeliest path: this one's, or one of at most `params.restarts`.

    `told` hears which share of the log each restart has filtered.
    """
    best, known = path_filter, path_filter.hypotheses
    found = verdict(known)
    while found.is_open and found.restarts < params.restarts:
        other = make_estimator(params, seed_of(seed, FIRST + found.restarts), threads)
        for done, keyframe in enumerate(keyframes):
            told(done / len(keyframes))
            other.extend(keyframe.pose, keyframe.walls, keyframe.travelled)
        other.refine()
        if likeliest(other.hypotheses).score > likeliest(known).score:
            best = other
        known = [*known, *other.hypotheses]
        found = verdict(known, found.restarts + 1)
    return best, found
