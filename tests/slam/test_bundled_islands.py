"""Of the islands' paths, those that differ are bundled, and the one that comes out best is told."""

from __future__ import annotations

import numpy as np
import pytest

from slam import islands
from slam.bundled_islands import APART, MOST, best_bundled, hypotheses, is_near
from slam.comparison import ComparisonParams
from slam.islands import Islands
from slam.motion import MotionParams
from slam.path_filter import PathFilterParams
from slam.refined_filter import RefinedFilter
from slam.refinement import Refined, RefinementParams
from slam.walls import Walls
from tests.slam.drives import REACH, laps

NOTHING = Walls(np.full(16, np.inf), np.zeros(16))


@pytest.fixture(autouse=True)
def small_islands(monkeypatch):
    """Islands of 60 particles, so that a test has several."""
    monkeypatch.setattr(islands, "SMALLEST", 60)


def driven(n_islands: int, is_blind: bool = False, noise: float = 0.04) -> RefinedFilter:
    """A filter on as many islands that went round twice, without seeing anything if it is blind."""
    motion = MotionParams(turn_noise=noise, distance_noise=noise)
    near = ComparisonParams(gap=6)
    params = PathFilterParams(particles=60 * n_islands, islands=n_islands, reach=REACH, motion=motion, comparison=near)
    path_filter = RefinedFilter(Islands(params, 5), motion, RefinementParams())
    drive = laps(1.5, noise=1.0, seed=1)
    for pose, walls, travelled in zip(drive.odometry, drive.walls, drive.travelled, strict=True):
        path_filter.extend(pose, NOTHING if is_blind else walls, travelled)
    return path_filter


def by_end(place: np.ndarray):
    """In place of a bundle: a path costs as much as its end is off a place (2,)."""
    return lambda path: Refined(path, np.zeros(3), float(np.hypot(*(path[-1, :2] - place))), np.empty((0, 2), int))


def test_islands_that_differ_are_told_apart_likeliest_first():
    path_filter = driven(8, is_blind=True, noise=0.3)
    refinement = path_filter.refinement()
    found = hypotheses(path_filter)
    assert 2 <= len(found) <= MOST
    scores = [path_filter.score(refinement, path) for _, path in found]
    assert scores == sorted(scores, reverse=True)
    for place, (_, path) in enumerate(found):
        assert not any(is_near(path, other) for _, other in found[:place]), f"{APART} m apart at least"


def test_islands_that_agree_are_bundled_once():
    assert len(hypotheses(driven(3))) == 1
    assert len(hypotheses(driven(1))) == 1


def test_the_best_bundled_path_is_told_and_its_island_believed():
    path_filter = driven(8, is_blind=True, noise=0.3)
    for island, path in hypotheses(path_filter):
        best = best_bundled(path_filter, by_end(path[-1, :2]))
        np.testing.assert_array_equal(best.path, path)
        assert isinstance(path_filter.path_filter, Islands)
        assert path_filter.path_filter.believed == island
