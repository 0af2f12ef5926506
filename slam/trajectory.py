"""From corrected vertices to a corrected pose for every odometry reading."""

from __future__ import annotations

import numpy as np

from slam.pose import compose, inverse, wrap


def correct(odometry: np.ndarray, vertex_rows: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Poses (n, 3) in the world for `odometry` (n, 3), given that row `vertex_rows[v]` truly is at `path[v]`.

    Between two vertices the odometry is followed forwards from the one and backwards from the other, and the two are
    mixed by the share of the way already driven, so that the trajectory has no jumps. Rows before the first and after
    the last vertex move rigidly with it. Raises ValueError if rows and path differ in number or there is none.
    """
    rows = np.asarray(vertex_rows, int)
    if rows.size == 0 or rows.size != len(path):
        raise ValueError(
            f"{rows.size} vertex rows for {len(path)} poses; as many as poses, and one at least, are needed"
        )
    n = len(odometry)
    before = np.clip(np.searchsorted(rows, np.arange(n), side="right") - 1, 0, rows.size - 1)
    after = np.minimum(before + 1, rows.size - 1)
    corrections = compose(path, inverse(odometry[rows]))
    forwards = compose(corrections[before], odometry)
    backwards = compose(corrections[after], odometry)
    steps = np.hypot(*np.diff(odometry[:, :2], axis=0, prepend=odometry[:1, :2]).T)
    driven = np.cumsum(steps)
    span = driven[rows[after]] - driven[rows[before]]
    share = np.where(span > 0.0, (driven - driven[rows[before]]) / np.where(span > 0.0, span, 1.0), 0.0).clip(0.0, 1.0)
    poses = forwards.copy()
    poses[:, :2] += share[:, None] * (backwards[:, :2] - forwards[:, :2])
    poses[:, 2] = wrap(forwards[:, 2] + share * wrap(backwards[:, 2] - forwards[:, 2]))
    return poses
