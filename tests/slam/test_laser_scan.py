"""Ends of beams become points with the direction of their walls."""

import numpy as np
import pytest

from slam.laser_scan import ScanParams, line_through, rays_of, scan_normals, scan_of, walls_of
from slam.pose import transform
from tests.naive import laser_scan as naive
from tests.slam.laser_world import BEARINGS, JUMP, RAYS, SCAN, blind, box, ranges_of, ring, scan_at


def of_ranges(ranges, jump=JUMP, params=SCAN):
    return scan_of(walls_of(ranges, RAYS, params), jump)


def test_normals_stand_across_the_walls_and_look_to_the_laser():
    pose = np.array([1.0, 2.0, 0.4])
    scan = scan_at(pose, box(-3.0, -2.0, 8.0, 7.0), noise=0.0)
    assert len(scan.points) == len(BEARINGS)
    world = transform(pose * [0.0, 0.0, 1.0], scan.normals)
    known = np.hypot(*scan.normals.T) > 0.0
    assert known.mean() > 0.9  # but for ends in corners
    along_axes = np.abs(world[known]).max(axis=1)
    assert np.all(along_axes > 0.95)
    assert np.mean(along_axes > 1.0 - 1e-9) > 0.93  # all but those with neighbours around a corner
    assert np.all(np.sum(scan.points * scan.normals, axis=1)[known] < 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_walls_so_near_that_beams_lie_closer_than_they_err_have_their_directions(seed):
    """A laser of a third of a degree, 20 to 30 cm from a corner: its ends are 2 mm apart and off by 1 cm."""
    bearings = np.radians(np.arange(-120.0, 120.0, 1.0 / 3.0))
    pose = np.array([0.25, 0.3, 3.0 + 0.8 * seed])
    ranges = ranges_of(pose, box(0.0, 0.0, 1.0, 1.2), np.random.default_rng(seed), bearings)
    scan = scan_of(walls_of(ranges, rays_of(bearings), SCAN), JUMP)
    along = np.abs(transform(pose * [0.0, 0.0, 1.0], scan.normals)).max(axis=1)
    near = scan.ranges < 0.4
    assert np.mean(along[near] > np.cos(0.35)) > 0.85


@pytest.mark.parametrize("seed", range(6))
def test_lines_are_the_axes_of_their_points(seed):
    rng = np.random.default_rng(seed)
    for _ in range(50):
        points = rng.uniform(-5.0, 5.0, 2) + rng.uniform(0.01, 0.3, 2) * rng.standard_normal((9, 2))
        points = points @ np.linalg.qr(rng.standard_normal((2, 2)))[0]
        first, end = int(rng.integers(0, 4)), int(rng.integers(6, 10))
        x, y, flatness = line_through(points, first, end)
        normal, ratio = naive.line_through(points[first:end])
        assert flatness == pytest.approx(ratio, abs=1e-9)
        assert np.hypot(x, y) == pytest.approx(1.0)
        assert abs(normal @ [x, y]) == pytest.approx(1.0, abs=1e-9 / (1.0 - ratio) ** 2)


def random_ends(rng, n=120):
    """Walls with gaps and noise, of no particular place, as arguments of `scan_normals`."""
    bearings = np.sort(rng.uniform(-np.pi, np.pi, n))
    ranges = 2.0 + np.repeat(rng.uniform(-1.0, 2.0, n // 4), 4) + rng.choice([0.003, 0.1]) * rng.standard_normal(n)
    ways = np.column_stack([np.cos(bearings), np.sin(bearings)])
    return ranges[:, None] * ways, ways, ranges, rng.uniform(0.001, 0.06), rng.uniform(0.05, 0.4)


@pytest.mark.parametrize("seed", range(8))
def test_normals_are_those_of_the_eigenvectors(seed):
    rng = np.random.default_rng(seed)
    scan = scan_at(rng.uniform([0.5, 0.5, -3.0], [11.0, 1.5, 3.0]), ring(), seed)
    ways = scan.points / scan.ranges[:, None]
    n_known = 0
    near = (0.1 * scan.points, ways, 0.1 * scan.ranges, scan.spacing, JUMP)  # whose neighbours are more than three
    for ends in ((scan.points, ways, scan.ranges, scan.spacing, JUMP), near, *(random_ends(rng) for _ in range(4))):
        found = scan_normals(*ends)
        assert found == pytest.approx(naive.scan_normals(*ends), abs=1e-7)
        n_known += np.count_nonzero(np.any(found, axis=1))
    assert 200 < n_known < 0.9 * (2 * len(scan.points) + 4 * 120)


def test_ends_are_where_they_were_measured_and_told_both_ways():
    pose = np.array([0.5, -0.3, 1.1])
    ranges = ranges_of(pose, box(-4.0, -4.0, 8.0, 8.0))
    scan = of_ranges(ranges)
    assert np.abs(transform(pose, scan.points)).max(axis=1) == pytest.approx(4.0, abs=1e-9)
    assert scan.ranges == pytest.approx(ranges, abs=1e-12)
    assert scan.bearings == pytest.approx(BEARINGS, abs=1e-12)
    assert scan.spacing == pytest.approx(np.radians(1.0))


def test_what_is_no_echo_is_left_out_and_what_was_passed_is_swept():
    ranges = np.full(len(BEARINGS), 3.0)
    ranges[:6] = [np.nan, np.inf, 0.0, -1.0, 20.0, 25.0]
    scan = of_ranges(ranges)
    assert len(scan.points) == len(BEARINGS) - 6
    assert np.hypot(*scan.swept.T) == pytest.approx([8.0, 8.0] + [3.0] * (len(BEARINGS) - 6))
    assert len(of_ranges(ranges, params=ScanParams(max_range=2.0)).points) == 0
    nothing = blind()
    assert nothing.points.shape == nothing.normals.shape == nothing.swept.shape == (0, 2)


def test_lonely_ends_and_scattered_ones_tell_of_no_direction():
    rng = np.random.default_rng(3)
    far_apart = np.where(np.arange(len(BEARINGS)) % 2, 2.0, 4.0)
    assert not np.any(of_ranges(far_apart).normals)
    bush = 2.0 + 0.1 * rng.uniform(-1.0, 1.0, len(BEARINGS))
    assert np.mean(np.any(of_ranges(bush, 0.3).normals, axis=1)) < 0.6


@pytest.mark.parametrize(
    ("bearings_deg", "n_rays", "offset_deg"),
    [
        (np.arange(-90.0, 90.0), 360, 0.0),
        (np.arange(-90.0, 90.5, 0.5), 720, 0.0),
        (np.arange(-90.0, 90.0) + 0.4, 360, 0.4),
        ((np.arange(682) - 341) * 360.0 / 1024.0, 1024, 0.0),
        (np.linspace(-135.0, 135.0, 1081), 1440, 0.0),
        (np.arange(-180.0, 180.0), 360, 0.0),
        (np.array([-90.0, -45.0, 0.0, 45.0, 60.0]), 24, 0.0),  # with rays between that no beam looks along
    ],
)
def test_beams_are_rays_of_a_full_circle(bearings_deg, n_rays, offset_deg):
    bearings = np.radians(bearings_deg)
    rays = rays_of(bearings)
    assert rays.n == n_rays
    assert np.degrees(rays.offset) == pytest.approx(offset_deg, abs=1e-6)
    assert len(np.unique(rays.rows)) == len(bearings)
    off = np.angle(np.exp(1j * (2.0 * np.pi * rays.rows / rays.n + rays.offset - bearings)))
    assert np.abs(off).max() < np.radians(0.03)
    ranges = np.linspace(1.0, 4.0, len(bearings))
    scan = scan_of(walls_of(ranges, rays, SCAN), JUMP)
    assert sorted(scan.ranges) == pytest.approx(sorted(ranges))
    assert scan.spacing == pytest.approx(np.median(np.diff(bearings)), rel=0.01)


@pytest.mark.parametrize("bearings", [[], [0.1], [0.0, np.nan], [0.0, 0.0, 1.0], [0.0, 0.001, 2.2]])
def test_bearings_of_no_circle_are_refused(bearings):
    with pytest.raises(ValueError, match="bearing"):
        rays_of(np.array(bearings))
