"""Where to drive so that the uncertain stretch of the path is seen again; thought over in a thread, now and then.

Asks no clock. Uses its sibling `navigator` (which floor there is to drive on).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np

from server.messages import Snapshot
from server.navigator import floor_of
from slam.cost_grid import CostParams
from slam.planning import NoWay, let_out, reach_from
from slam.suggestions import Suggestion, SuggestionParams, suggest

log = logging.getLogger(__name__)

PERIOD = 3.0  # s from one advice to the next


class Adviser:
    """Keeps the newest advice."""

    def __init__(self, params: SuggestionParams, cost: CostParams, executor: Executor | None = None):
        self.params = params
        self.cost = cost
        self.executor = executor or ThreadPoolExecutor(1, "adviser")
        self.begin()

    def begin(self) -> None:
        """Nothing is known yet: another session."""
        self.suggestions: list[Suggestion] = []
        self.work: Future[list[Suggestion]] | None = None
        self.asked = -math.inf
        self.seen = 0, 0.0  # vertices and affinity of the best path when it was asked

    def tick(self, t: float, look: Callable[[], Snapshot]) -> None:
        """To be called often while somebody watches, with a way to look at the robot if need be."""
        if self.work is not None and self.work.done():
            work, self.work = self.work, None
            try:
                self.suggestions = work.result()
            except Exception:
                log.exception("no advice")  # the robot drives without it
        if self.work is not None or t - self.asked < PERIOD:
            return
        self.asked = t
        snapshot = look()
        seen = len(snapshot.path), snapshot.affinity
        if seen != self.seen:
            self.seen = seen
            self.work = self.executor.submit(advise, snapshot, self.params, self.cost)


def advise(snapshot: Snapshot, params: SuggestionParams, cost: CostParams) -> list[Suggestion]:
    """The best places to drive to from where the robot stands, best first."""
    if snapshot.branches is None or snapshot.spread.max(initial=0.0) < params.least_gain:
        return []
    start = snapshot.pose[:2]
    grid = let_out(floor_of(snapshot, start, cost), start)
    try:
        reached = reach_from(grid, start)
    except NoWay:
        return []
    rows, columns = np.array([grid.cell(place) for place in snapshot.path[:, :2]]).T
    return suggest(snapshot.path, snapshot.branches, reached.metres[rows * grid.costs.shape[1] + columns], params)
