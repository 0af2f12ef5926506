"""Two scans of the same walls tell the motion between them, and how well."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.laser_scan import scan_of, walls_of
from slam.pose import between, compose, wrap
from slam.scan_matching import ScanMatchingParams, match_scans, partner
from tests.naive import scan_matching as naive
from tests.slam.laser_world import BEARINGS, JUMP, RAYS, SCAN, box, ring, scan_at

PARAMS = ScanMatchingParams()
LOOSE = np.diag([1.0, 1.0, 1.0])
STILL = np.zeros(3)


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.25, 0.25), st.floats(-0.1, 0.1), st.floats(-0.15, 0.15), st.integers(0, 1000))
def test_a_motion_is_found_from_a_guess_that_knows_nothing_of_it(x, y, turn, seed):
    pose, walls = np.array([5.0, 1.0, 0.1]), ring()
    moved = compose(pose, np.array([x, y, turn]))
    match = match_scans(scan_at(moved, walls, seed), scan_at(pose, walls, seed + 1), STILL, LOOSE, PARAMS)
    error = between(between(pose, moved), match.pose)
    assert np.hypot(*error[:2]) < 0.02
    assert abs(error[2]) < 0.005
    assert match.share > 0.6


def test_the_information_is_that_of_the_errors_but_for_what_all_ends_share():
    pose, moved, walls = np.array([1.0, 4.0, 1.2]), np.array([1.05, 4.15, 1.25]), ring()
    matches = [
        match_scans(
            scan_at(moved, walls, 2 * k), scan_at(pose, walls, 2 * k + 1), between(pose, moved), 1e-3 * LOOSE, PARAMS
        )
        for k in range(60)
    ]
    errors = np.array([between(between(pose, moved), match.pose) for match in matches])
    squares = np.array([error @ match.information @ error for error, match in zip(errors, matches, strict=True)])
    assert 0.2 < np.median(squares) / 2.37 < 5.0  # chi square of three degrees of freedom


def test_along_a_bare_corridor_the_guess_is_kept_and_told_to_be_unknown():
    walls = np.array([[-50.0, -1.0, 50.0, -1.0], [50.0, 1.0, -50.0, 1.0]])
    pose, guess = np.array([0.0, 0.1, 0.05]), np.array([0.3, 0.0, 0.0])
    moved = compose(pose, np.array([0.2, 0.0, 0.02]))
    match = match_scans(scan_at(moved, walls), scan_at(pose, walls, 1), guess, LOOSE, PARAMS)
    world = wrap(match.pose[2] - 0.02)
    assert abs(world) < 0.005
    assert match.pose[0] == pytest.approx(0.3, abs=0.05)
    axes = np.linalg.eigvalsh(match.information[:2, :2])
    assert axes[0] < 0.02 * axes[1]


def test_strange_walls_leave_the_guess_alone():
    guess = np.array([0.1, 0.0, 0.0])
    match = match_scans(
        scan_at(np.zeros(3), box(-9, -9, 18, 18)), scan_at(np.zeros(3), box(-1, -1, 2, 2)), guess, LOOSE, PARAMS
    )
    assert match.share < PARAMS.enough
    assert np.array_equal(match.pose, guess)
    assert np.array_equal(match.information, LOOSE)


@pytest.mark.parametrize(("first", "second"), [(0, 5), (5, 0), (0, 0)])
def test_scans_of_nothing_leave_the_guess_alone(first, second):
    def some(n):
        return scan_of(walls_of(np.where(np.arange(len(BEARINGS)) < n, 1.0, np.inf), RAYS, SCAN), JUMP)

    match = match_scans(some(first), some(second), STILL, LOOSE, PARAMS)
    assert (match.share, *match.pose) == (0.0, 0.0, 0.0, 0.0)


def test_partners_are_those_found_by_trying_all():
    rng = np.random.default_rng(4)
    pose = np.array([1.0, 1.0, 0.3])
    scan = scan_at(pose, ring(), 4)
    found = 0
    for _ in range(500):
        x, y = scan.points[rng.integers(len(scan.points))] + 0.4 * rng.standard_normal(2)
        normal = scan.normals[rng.integers(len(scan.normals))]
        gate = rng.uniform(0.05, 1.0)
        told = partner(scan, x, y, normal[0], normal[1], gate, 0.5)
        assert told == naive.partner(scan.points, scan.normals, x, y, normal[0], normal[1], gate, 0.5)
        found += told >= 0
    assert found > 100


def test_the_same_scans_give_the_same_bits():
    walls = ring()
    one, other = (
        match_scans(
            scan_at(np.array([1.1, 4.0, 1.5]), walls), scan_at(np.array([1.0, 4.0, 1.5]), walls), STILL, LOOSE, PARAMS
        )
        for _ in range(2)
    )
    assert one.pose.tobytes() == other.pose.tobytes()
