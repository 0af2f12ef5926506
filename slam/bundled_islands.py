"""Choose among islands by what single echoes say: bundle each hypothesis of the path, tell the one that explains most.

Local maps of half a metre of drive may agree along a wrong path about as well as along the right one, where a corridor
is like the next; bundled, the wrong one's echoes make fewer common walls, and its odometry is bent more. Uses its
siblings `islands`, `refined_filter` and `refinement`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slam.islands import Islands
from slam.refined_filter import RefinedFilter
from slam.refinement import Refined

APART = 1.0  # m by which paths differ somewhere that bundling would not make one
MOST = 4  # paths that are bundled, for each takes as long as the filter


def hypotheses(path_filter: RefinedFilter) -> list[tuple[int, np.ndarray]]:
    """A few islands with their refined paths (n, 3), the likeliest first, none where a likelier one goes.

    One path where there are no islands; RuntimeError before the first vertex.
    """
    islands = path_filter.path_filter
    if not isinstance(islands, Islands) or len(islands.filters) == 1 or path_filter.params.rounds == 0:
        path_filter.refine()
        return [(getattr(islands, "believed", 0), path_filter.estimate(1).path)]
    refinement = path_filter.refinement()
    paths = [refinement.refine(path).path for path in islands.candidates()]
    scores = [path_filter.score(refinement, path) for path in paths]
    chosen: list[tuple[int, np.ndarray]] = []
    for island in np.argsort(scores, kind="stable")[::-1]:
        if not any(is_near(paths[island], other) for _, other in chosen):
            chosen.append((int(island), paths[island]))
    return chosen[:MOST]


def is_near(path: np.ndarray, other: np.ndarray) -> bool:
    """Whether two paths (n, 3) that begin alike never part by more than `APART`."""
    return float(np.max(np.hypot(*(path - other)[:, :2].T))) < APART


def best_bundled(path_filter: RefinedFilter, run: Callable[[np.ndarray], Refined]) -> Refined:
    """The hypothesis that is best once `run` has bundled its path (n, 3); its island is believed from now on."""
    found = [(run(path), island) for island, path in hypotheses(path_filter)]
    best, island = min(found, key=lambda one: one[0].cost)
    if isinstance(path_filter.path_filter, Islands):
        path_filter.path_filter.believe(island)
    return best
