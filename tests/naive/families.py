"""Families of particles, found by comparing whole paths one by one."""

import numpy as np

from slam.pose import wrap


def look_back(paths, lags):
    """Poses (n, lags, 3) of paths (n, v, 3) so many vertices before their last; the first for what lies before it."""
    return np.array([[path[max(0, len(path) - 1 - lag)] for lag in lags] for path in paths], np.float32)


def is_like(history, head, near, turn, before):
    """Whether two histories (lags, 3) are alike, the newest by `near` and `turn`, others `before` times as loosely."""
    wide = np.array([1.0, *[before] * (len(head) - 1)])
    off = history.astype(float) - head
    return bool(np.all(np.hypot(off[:, 0], off[:, 1]) <= wide * near) and np.all(abs(wrap(off[:, 2])) <= wide * turn))


def join(histories, near, turn, before):
    """The family of each history, and the heads."""
    families, heads = [], []
    for p, history in enumerate(histories):
        likes = [k for k, head in enumerate(heads) if is_like(history, histories[head], near, turn, before)]
        if not likes:
            heads.append(p)
        families.append(likes[0] if likes else len(heads) - 1)
    return families, heads
