"""A corrected pose for one odometry row at a time."""

from __future__ import annotations

import math

import numpy as np

from tests.naive import pose as se2


def followed(odometry, row, vertex_row, vertex_pose):
    """Pose of a row by odometry from one vertex."""
    return se2.compose(vertex_pose, se2.between(odometry[vertex_row], odometry[row]))


def correct(odometry, vertex_rows, path):
    """From the vertex before and the vertex after, by the share of the way between them."""
    way = [0.0]
    for row in range(1, len(odometry)):
        way.append(way[-1] + math.dist(odometry[row][:2], odometry[row - 1][:2]))
    poses = []
    for row in range(len(odometry)):
        before = [v for v in range(len(vertex_rows)) if vertex_rows[v] <= row]
        if not before or len(before) == len(vertex_rows):
            v = before[-1] if before else 0
            poses.append(followed(odometry, row, vertex_rows[v], path[v]))
            continue
        v = before[-1]
        a = followed(odometry, row, vertex_rows[v], path[v])
        b = followed(odometry, row, vertex_rows[v + 1], path[v + 1])
        span = way[vertex_rows[v + 1]] - way[vertex_rows[v]]
        share = (way[row] - way[vertex_rows[v]]) / span if span > 0.0 else 0.0
        turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
        poses.append(np.array([*(a[:2] + share * (b[:2] - a[:2])), a[2] + share * turn]))
    return np.array(poses)
