"""Measured places: the moments are the twin's, offsets come out as put in, a bare corridor tells nothing along it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import slam.loop_measurements as loops
from slam.loop_measurements import APART, WINDOW, measure, measure_loops, moments, rasters
from slam.pose import compose
from tests.naive import loop_measurements as naive
from tests.naive.walls import cast, rectangle
from tests.slam.drives import N_RAYS, REACH, laps

CORRIDOR = np.array([[-50.0, -0.7, 50.0, -0.7], [-50.0, 0.7, 50.0, 0.7]])
CORNER = np.vstack([rectangle(0.0, 0.0, 1.6, 1.4), rectangle(0.3, 0.6, 0.2, 0.2)])


def seen_from(world, *poses):
    """Rasters of what is seen from poses in a world of line segments."""
    return rasters([cast(np.asarray(pose, float), world, N_RAYS, REACH) for pose in poses], REACH)


def test_moments_are_those_of_the_twin():
    seen = seen_from(CORNER, (0.0, 0.0, 0.1), (0.1, -0.1, -0.2))
    seen = seen._replace(points=seen.points[:24])
    motion = np.array([0.12, -0.09, -0.35])
    means, covariance = moments(seen, 0, 1, motion)
    looks = WINDOW, loops.STEPS, loops.SHARPNESS
    expected = naive.moments(seen.labels[0], seen.labels[1], motion, seen.points, seen.cell, seen.scores, *looks)
    np.testing.assert_allclose(means, expected[0], atol=1e-9)
    np.testing.assert_allclose(covariance, expected[1], atol=1e-9)


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.15, -0.1, 0.0), (-0.1, 0.2, 0.05), (0.05, 0.05, -0.08)])
def test_an_offset_of_the_path_is_measured(offset):
    true = np.array([0.1, -0.1, -0.2])
    seen = seen_from(CORNER, (0.0, 0.0, 0.0), true)
    directions, offsets, strengths = measure(seen, 0, 1, true - offset)
    assert len(strengths) == 2, "a corner fixes both directions"
    found = WINDOW[0] * offsets @ directions
    np.testing.assert_allclose(found, offset[:2], atol=0.04)  # a cell of the rasters


def test_a_bare_corridor_tells_what_is_across_it_and_nothing_along_it():
    seen = seen_from(CORRIDOR, (0.0, 0.0, 0.3), (0.2, 0.1, 0.3))
    directions, offsets, _ = measure(seen, 0, 1, compose(np.array([0.0, 0.0, -0.3]), np.array([0.05, 0.0, 0.3])))
    assert len(directions) == 1
    across = np.array([math.sin(0.3), math.cos(0.3)])  # in the first vertex's frame
    assert abs(directions[0] @ across) > 0.97
    assert WINDOW[0] * offsets[0] * np.sign(directions[0] @ across) == pytest.approx(0.1, abs=0.04)


def test_nothing_seen_is_nothing_measured():
    nothing = np.array([[90.0, 90.0, 91.0, 90.0]])
    directions, offsets, strengths = measure(seen_from(nothing, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)), 0, 1, np.zeros(3))
    assert directions.shape == (0, 2)
    assert offsets.size == strengths.size == 0


def test_kept_pairs_are_apart_and_what_they_say_agrees_with_the_truth():
    drive = laps(2.0, noise=0.0)
    found = measure_loops(drive.truth, rasters(drive.walls, REACH))
    ways = 0.5 * np.unique(found.second)
    assert np.diff(ways).min() >= APART
    assert len(ways) >= 8
    assert np.all(np.abs(found.offsets) < 0.06)
    np.testing.assert_allclose(np.hypot(*found.directions.T), 1.0)
    assert np.unique(found.pairs).size == np.unique(found.second).size
    assert measure_loops(drive.truth[:20], rasters(drive.walls[:20], REACH)).first.size == 0
