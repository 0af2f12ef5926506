"""The paper's inverse sensor model and its measurement model, cell by cell and end by end, in the words of the book."""

import math

import numpy as np


def inverse_sensor_model(centre, pose, bearings, ranges, alpha, beta, l_occ, l_free, z_max):
    """Log odds that a scan gives a cell, by the nearest of its beams."""
    r = math.hypot(*(centre - pose[:2]))
    phi = math.atan2(*(centre - pose[:2])[::-1]) - pose[2]
    off = np.abs(np.angle(np.exp(1j * (phi - bearings))))
    k = int(np.argmin(off))
    if not math.isfinite(ranges[k]) or r > min(z_max, ranges[k] + alpha / 2) or off[k] > beta / 2:
        return 0.0
    if ranges[k] < z_max and abs(r - ranges[k]) < alpha / 2:
        return l_occ
    return l_free if r <= ranges[k] else 0.0


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
