"""Partners of a scan's ends by trying all of the other's."""

import numpy as np


def partner(points, normals, x, y, nx, ny, gate, like):
    """The nearest point within the gate whose normal is like (nx, ny), or -1."""
    apart = np.hypot(points[:, 0] - x, points[:, 1] - y)
    apart[normals @ [nx, ny] <= like] = np.inf
    nearest = int(np.argmin(apart)) if len(apart) else -1
    return nearest if nearest >= 0 and apart[nearest] < gate else -1
