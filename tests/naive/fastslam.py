"""The paper's algorithms (4) and (5) and its measurement model: cell by cell, end by end, in the words of the book."""

import math

import numpy as np


def occupancy_grid_mapping(cells, corner, resolution, pose, inverse_model, z_max):
    """The log odds (rows, columns), with what `inverse_model(centre)` adds in a scan's perceptual field; l_0 is 0."""
    mapped = np.array(cells, float)
    for row, column in np.ndindex(mapped.shape):
        centre = corner + resolution * np.array([column + 0.5, row + 0.5])
        if math.dist(centre, pose[:2]) <= z_max:
            mapped[row, column] += inverse_model(centre)
    return mapped


def inverse_sensor_model(centre, pose, bearings, ranges, alpha, beta, l_occ, l_free, z_max, unseen_is_free=False):
    """Log odds that a scan gives a cell, by the nearest of its beams.

    A beam of infinite range met nothing. To the paper that is a range of z_max, so that `unseen_is_free`.
    """
    r = math.hypot(*(centre - pose[:2]))
    phi = math.atan2(*(centre - pose[:2])[::-1]) - pose[2]
    off = np.abs(np.angle(np.exp(1j * (phi - bearings))))
    k = int(np.argmin(off))
    if math.isinf(ranges[k]) and not unseen_is_free:
        return 0.0
    z = min(ranges[k], z_max)
    if r > min(z_max, z + alpha / 2) or off[k] > beta / 2:
        return 0.0
    if z < z_max and abs(r - z) < alpha / 2:
        return l_occ
    return l_free if r <= z else 0.0


def measurement_model(walls, pose, bearings, ranges, sigma, random, z_max, reach):
    """Log likelihood of ends by their distance from the nearest centre of an occupied cell (n, 2), within `reach`."""
    total = 0.0
    for bearing, z in zip(bearings, ranges, strict=True):
        if not z < z_max:
            continue
        end = pose[:2] + z * np.array([math.cos(pose[2] + bearing), math.sin(pose[2] + bearing)])
        near = np.hypot(*(walls - end).T) if len(walls) else np.array([math.inf])
        near = near[near < reach]
        hit = math.exp(-0.5 * (near.min() / sigma) ** 2) if len(near) else 0.0
        total += math.log((1.0 - random) * hit + random)
    return total
