"""A laser in a building of straight walls, for tests of what maps with one."""

import itertools

import numpy as np

from slam.laser_scan import ScanParams, rays_of, scan_of, walls_of
from slam.pose import between, compose

BEARINGS = np.radians(np.arange(-90.0, 90.0, 1.0))
MAX_RANGE = 20.0
RAYS = rays_of(BEARINGS)
SCAN = ScanParams()
JUMP = 0.15


def box(x, y, width, height):
    """Walls (4, 4) of a rectangle."""
    corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    return np.column_stack([corners, np.roll(corners, -1, axis=0)])


def ring():
    """Walls of a corridor of 2 m around a block, with recesses that tell places apart."""
    alcoves = [box(3.0, -0.6, 1.0, 0.6), box(12.0, 2.5, 0.7, 1.2), box(4.5, 9.0, 1.6, 0.5), box(-0.5, 6.0, 0.5, 1.0)]
    return np.concatenate([box(0.0, 0.0, 12.0, 9.0), box(2.0, 2.0, 8.0, 5.0), *alcoves, box(6.0, 0.0, 0.3, 0.4)])


def ranges_of(pose, walls, rng=None, bearings=BEARINGS, noise=0.01):
    """What a laser at `pose` (3,) measures of walls (m, 4); inf where none is within its reach."""
    ways = np.stack([np.cos(pose[2] + bearings), np.sin(pose[2] + bearings)], axis=1)
    start, along = walls[:, :2] - pose[:2], walls[:, 2:] - walls[:, :2]
    cross = ways[:, None, 0] * along[:, 1] - ways[:, None, 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        share = (start[:, 0] * ways[:, None, 1] - start[:, 1] * ways[:, None, 0]) / cross
    met = (reach > 0.0) & (share >= 0.0) & (share <= 1.0)
    ranges = np.where(met, reach, np.inf).min(axis=1)
    if rng is not None:
        ranges = ranges + noise * rng.standard_normal(ranges.shape)
    return np.where(ranges < MAX_RANGE, ranges, np.inf)


def seen_at(pose, walls, seed=0, noise=0.01):
    """The vertex's walls that a laser at `pose` (3,) sees of walls (m, 4)."""
    return walls_of(ranges_of(pose, walls, np.random.default_rng(seed), noise=noise), RAYS, SCAN)


def scan_at(pose, walls, seed=0, noise=0.01):
    """The scan of it."""
    return scan_of(seen_at(pose, walls, seed, noise), JUMP)


def blind():
    """The scan of a laser that sees nothing."""
    return scan_of(walls_of(np.full(len(BEARINGS), np.inf), RAYS, SCAN), JUMP)


def around(laps=1.0, step=0.2):
    """Poses (n, 3) of a drive around the block of `ring`."""
    corners = np.array([[1.0, 1.0], [11.0, 1.0], [11.0, 8.0], [1.0, 8.0], [1.0, 1.0]])
    poses = []
    for _ in range(int(np.ceil(laps))):
        for (x, y), (u, v) in itertools.pairwise(corners):
            length, heading = np.hypot(u - x, v - y), np.arctan2(v - y, u - x)
            ways = np.arange(0.6, length - 0.6, step) / length
            poses += [[x + way * (u - x), y + way * (v - y), heading] for way in ways]
            end = np.array([u, v]) - 0.6 * np.array([np.cos(heading), np.sin(heading)])
            for turn in np.linspace(0.0, np.pi / 2, 8)[1:-1]:  # a quarter of a circle of 0.6 m
                centre = end + 0.6 * np.array([-np.sin(heading), np.cos(heading)])
                on = centre + 0.6 * np.array([np.sin(heading + turn), -np.cos(heading + turn)])
                poses.append([*on, heading + turn])
    n = round(len(poses) * laps / np.ceil(laps))
    return np.array(poses[:n])


def odometry_of(poses, rng, turn_noise=0.05, distance_noise=0.05, bias=0.03):
    """A bad odometry of poses (n, 3): noise per root metre, and a bias of `bias` rad/m."""
    odometry = [poses[0]]
    for before, after in itertools.pairwise(poses):
        motion = between(before, after)
        way = np.hypot(motion[0], motion[1])
        motion = motion * [1.0 + distance_noise / np.sqrt(way) * rng.standard_normal(), 1.0, 1.0]
        motion[2] += turn_noise * np.sqrt(way) * rng.standard_normal() + bias * way
        odometry.append(compose(odometry[-1], motion))
    return np.array(odometry)
