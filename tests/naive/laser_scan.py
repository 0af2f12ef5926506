"""Lines through ends and the walls' directions at them, by eigenvectors of the ends' covariance."""

import numpy as np


def line_through(points):
    """A normal of the line through points (n, 2), and their variance across it, of that along it."""
    variances, axes = np.linalg.eigh(np.cov(points.T, bias=True))
    return axes[:, 0], variances[0] / variances[1]


def one_wall(points, i, reach, stretch):
    """Points around the i-th: three on either side or within `stretch`, while neighbours lie nearer than `reach`."""
    wall = [points[i]]
    for way in (-1, 1):
        last = i
        while 0 <= last + way < len(points):
            if abs(last + way - i) > 3 and np.linalg.norm(points[last] - points[i]) >= stretch:
                break
            if np.linalg.norm(points[last + way] - points[last]) >= reach:
                break
            last += way
            wall.append(points[last])
    return np.array(wall)


def scan_normals(points, ways, ranges, spacing, jump):
    """Normals (n, 2) against the beams; zeros where fewer than three points are one wall, or they are as wide."""
    normals = np.zeros((len(points), 2))
    for i, (way, distance) in enumerate(zip(ways, ranges, strict=True)):
        wall = one_wall(
            points, i, max(jump, 4.0 * spacing * distance), 0.08 if 3.0 * spacing * distance < 0.01 else 0.0
        )
        if len(wall) < 3:
            continue
        normal, flatness = line_through(wall)
        if flatness <= 0.1:
            normals[i] = -normal if normal @ way > 0.0 else normal
    return normals
