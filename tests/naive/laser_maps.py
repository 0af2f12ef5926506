"""A scan drawn into one particle's map beam by beam."""

import math

import numpy as np


def first_cleared(k, spacing, resolution):
    """From where on the k-th beam clears: where it is half a cell off the next that clears as well.

    Beam 0 and every 64th clear all; of the others every 32nd, 16th, ... down to every second one less and less.
    """
    if k % 64 == 0:
        return 0.0
    fellows = max(step for step in (1, 2, 4, 8, 16, 32) if k % step == 0)
    return 0.5 * resolution / (spacing * fellows)


def draw_scan(twin, scan, pose, clears):
    """Draw a scan that was taken at a pose (3,) into a `tests.naive.tree_map.NaiveMap`."""
    turn = np.array([[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]])
    if clears:
        for k, end in enumerate(scan.swept):
            twin.clear(pose[:2], pose[:2] + turn @ end, first_cleared(k, scan.spacing, twin.resolution))
    for end, normal in zip(scan.points, scan.normals, strict=True):
        twin.hit(pose[:2] + turn @ end, turn @ normal)
