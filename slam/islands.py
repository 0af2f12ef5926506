"""Path filters that never mix: every island holds a hypothesis of its own where one filter would have lost all but one.

A filter that closed a loop wrongly has no particle left that closed it rightly, and its weights could not have told:
they are of random paths, each bent by as much noise as it drew. Islands find different ways through the same walls, and
the refined best path of each can be told from the others by affinity and plausibility. What all islands saw is stored
once; each has its own random numbers and one thread at a time.

Islands also differ in what they hold true of building and robot, for no one belief suits all: that walls stand in a few
directions keeps the heading in an office and captures it in a round hall; an odometry that may be badly biased can be
told from a curved corridor only by what comes of it; and that like walls are the same walls closes the loops of a
building of few readings, but too early where all corridors look alike. A path that comes of a wrong belief scores less.
Uses its sibling `path_filter`.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from slam.comparison import Observations
from slam.counter_random import bits
from slam.path_filter import PathEstimate, PathFilter, PathFilterParams, checked_pose
from slam.uncertainty import Uncertainty
from slam.walls import Walls

SMALLEST = 1250  # particles of an island; more of them find a way no oftener than more islands do
FEWEST = 100  # particles of an island that was shed of some
SEED = 32  # stream of random numbers, apart from the filters' and the local search's


class Belief(NamedTuple):
    """What an island holds true: the comparison's `chance`, and shares of what the parameters say of the rest."""

    chance: float  # at least
    turn_bias: float
    direction: float

    def of(self, params: PathFilterParams) -> PathFilterParams:
        """The parameters of an island that holds this true."""
        motion, direction, comparison = params.motion, params.direction, params.comparison
        chance = max(comparison.chance, self.chance)
        return params.model_copy(update={
            "motion": motion.model_copy(update={"turn_bias": self.turn_bias * motion.turn_bias}),
            "direction": direction.model_copy(update={"gain": self.direction * direction.gain}),
            "comparison": comparison.model_copy(update={"chance": chance}),
        })  # fmt: skip


AS_TOLD = Belief(chance=0.0, turn_bias=1.0, direction=1.0)
WARY = Belief(chance=0.6, turn_bias=1.0 / 3.0, direction=2.0)  # of likeness, not of walls; a robot in good order
FREE = Belief(chance=0.6, turn_bias=1.0 / 3.0, direction=0.0)  # wary, and of walls that stand anyhow
BELIEFS = (AS_TOLD, FREE, WARY, FREE)  # in turn; free ones find their way less often, and are more


class Islands:
    """As many islands as the parameters allow and the particles fill; the same face as one path filter."""

    def __init__(self, params: PathFilterParams, seed: int = 0, threads: int = 1):
        n = max(1, min(params.islands, params.particles // SMALLEST))
        inner = max(1, threads // n)
        self.params = params
        self.pool = ThreadPoolExecutor(min(threads, n)) if min(threads, n) > 1 else None
        beliefs = BELIEFS if n > 1 and params.beliefs == "several" else (AS_TOLD,)
        # paths are told apart by a wary measure: likeness makes those look good that merged corridors
        measure = WARY if WARY in beliefs else AS_TOLD
        self.observations = Observations(measure.of(params).comparison, params.reach)
        self.filters = [
            PathFilter(
                beliefs[island % len(beliefs)].of(params.model_copy(update={"particles": size})),
                seed_of(seed, island), inner, self.observations,
            )
            for island, size in enumerate(sizes_of(params.particles, n))
        ]  # fmt: skip
        self.believed = 0  # the island whose path is told

    @property
    def n_particles(self) -> int:
        """How many particles there are now on all islands."""
        return sum(island.n_particles for island in self.filters)

    @property
    def resamplings(self) -> int:
        """How often any island was resampled."""
        return sum(island.resamplings for island in self.filters)

    @property
    def filter(self) -> PathFilter:
        """The believed island's."""
        return self.filters[self.believed]

    def extend(self, pose: np.ndarray, walls: Walls, travelled: float | None = None) -> None:
        """Add a vertex at `pose` (3,) of the odometry frame that saw `walls`, `travelled` m after the last one.

        ValueError for a pose or way that is no number, or a way back in time; nothing is added then.
        """
        pose = checked_pose(self.observations.n_vertices, pose, travelled)
        self.observations.add(walls)
        self.on_all(lambda island: island.extend(pose, walls, travelled))

    def on_all(self, task: Callable[[PathFilter], Any]) -> None:
        """Run a task for each island, on as many threads as there are."""
        list(map(task, self.filters) if self.pool is None else self.pool.map(task, self.filters))

    def resize(self, n_particles: int) -> None:
        """Change the number of particles; islands too small for use are given up for good, the believed one last."""
        n = max(1, min(len(self.filters), n_particles // FEWEST))
        if n < len(self.filters):
            kept = sorted([self.believed, *(i for i in range(len(self.filters)) if i != self.believed)][:n])
            self.believed = kept.index(self.believed)
            self.filters = [self.filters[island] for island in kept]
        for island, size in zip(self.filters, sizes_of(n_particles, n), strict=True):
            island.resize(size)

    def candidates(self) -> list[np.ndarray]:
        """Each island's best path (n, 3); RuntimeError before the first vertex."""
        return [island.best_path() for island in self.filters]

    def believe(self, island: int) -> None:
        """Tell this island's path from now on."""
        self.believed = island

    def uncertainty(self, n_leaves: int) -> Uncertainty:
        """How certain each vertex of the believed island is; RuntimeError before the first one."""
        return self.filter.uncertainty(n_leaves)

    def estimate(self, max_particles: int = 500) -> PathEstimate:
        """What the believed island knows now; RuntimeError before the first vertex."""
        effective = sum(island.effective for island in self.filters)
        now = self.filter.estimate(max_particles)
        return now._replace(n_particles=self.n_particles, effective_particles=effective, resamplings=self.resamplings)


def seed_of(seed: int, island: int) -> int:
    """An island's own seed; the first one's is the filter's, so that one island is one filter."""
    return seed if island == 0 else int(bits(seed, 0, island, SEED)) >> 1


def sizes_of(n_particles: int, n_islands: int) -> list[int]:
    """How many particles each island has; none has fewer than one."""
    return [max(1, (n_particles + island) // n_islands) for island in range(n_islands)]
