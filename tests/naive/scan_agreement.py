"""Which ends of a scan agree with another, by asking every beam about every end."""

import numpy as np

from slam.pose import transform


def compare_views(scan, other, pose, near, far, beside):
    """How many agree, and how many see through."""
    agree = through = 0
    for x, y in transform(pose, scan.points):
        reach, bearing = np.hypot(x, y), np.arctan2(y, x)
        walls = other.ranges[np.abs(other.bearings - bearing) <= beside]
        if len(walls) and np.min(np.abs(walls - reach)) < near:
            agree += 1
        elif len(walls) and reach < np.min(walls) - far:
            through += 1
    return agree, through
