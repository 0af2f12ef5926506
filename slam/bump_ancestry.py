"""Where particles were at each bump, and whose children they are: what is known of a path in the light of all of it.

A level is a bump. Of earlier ones only those are kept that some particle of now descends from, soon one a bump (as in
`path_tree`, which knows neither particles that begin anew nor filters that are joined). Uses its sibling
`pose_clusters`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slam.pose_clusters import clusters

NOBODY = -1  # the parent of a particle that began anew


class Level(NamedTuple):
    """Poses (n, 3) after a bump, and the rows (n,) of their parents in the level before."""

    poses: np.ndarray
    parents: np.ndarray


class Ancestry:
    """Levels of a filter's particles, the oldest first."""

    def __init__(self) -> None:
        self.levels: list[Level] = []

    def add(self, poses: np.ndarray, parents: np.ndarray) -> None:
        """A bump more: poses (n, 3), and their parents' rows (n,) among those of the bump before, or `NOBODY`."""
        self.levels.append(Level(poses.copy(), parents if self.levels else np.full(len(poses), NOBODY)))
        self.forget()

    def join(self, other: Ancestry) -> None:
        """Stand the particles of a filter that took up the last bumps, as this one did, behind those of this one."""
        first = len(self.levels) - len(other.levels)
        n_before = 0
        for row, level in enumerate(other.levels, first):
            mine = self.levels[row]
            parents = np.where(level.parents == NOBODY, NOBODY, level.parents + n_before)
            n_before = len(mine.poses)
            self.levels[row] = Level(np.concatenate([mine.poses, level.poses]), np.concatenate([mine.parents, parents]))

    def choose(self, rows: np.ndarray) -> None:
        """Particles of now become those of these rows (m,), some of them several times."""
        now = self.levels[-1]
        self.levels[-1] = Level(now.poses[rows], now.parents[rows])
        self.forget()

    def forget(self) -> None:
        """Let go of those whom nobody descends from any more."""
        for row in range(len(self.levels) - 1, 0, -1):
            after, before = self.levels[row], self.levels[row - 1]
            needed, parents = np.unique(after.parents, return_inverse=True)
            n_orphans = int(np.sum(needed == NOBODY))
            if len(needed) - n_orphans == len(before.poses):
                return
            needed = needed[n_orphans:]
            self.levels[row] = Level(after.poses, parents - n_orphans if n_orphans else parents)
            self.levels[row - 1] = Level(before.poses[needed], before.parents[needed])

    def path(self, weights: np.ndarray, size: float, turn: float) -> np.ndarray:
        """Poses (levels, 3) at each bump of the particles that weigh `weights` (n,) now; nan before they began.

        Where they had several places then, the mean of the heaviest cluster's ancestors (`pose_clusters.clusters`).
        """
        path = np.full((len(self.levels), 3), np.nan)
        rows = np.flatnonzero(weights > 0.0)
        shares = weights[rows]
        for number in range(len(self.levels) - 1, -1, -1):
            level = self.levels[number]
            heavy = np.bincount(rows, shares, len(level.poses))
            found = clusters(level.poses, heavy / heavy.sum(), size, turn)
            path[number] = found[0].pose if found else level.poses[np.argmax(heavy)]
            rows = level.parents[rows]
            shares, rows = shares[rows != NOBODY], rows[rows != NOBODY]
            if not len(rows):
                break
        return path
