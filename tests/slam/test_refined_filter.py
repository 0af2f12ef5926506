"""A filter whose estimate is refined: better told, not otherwise believed."""

from __future__ import annotations

import numpy as np
import pytest

from slam.comparison import ComparisonParams
from slam.evaluate import absolute_error
from slam.local_search import LocalSearch, LocalSearchParams
from slam.motion import MotionParams
from slam.path_filter import PathFilter, PathFilterParams
from slam.refined_filter import RefinedFilter
from slam.refinement import RefinementParams
from slam.walls import Walls
from tests.slam.drives import REACH, laps

MOTION = MotionParams(turn_noise=0.04, distance_noise=0.04)
PARAMS = PathFilterParams(particles=300, reach=REACH, motion=MOTION, comparison=ComparisonParams(gap=6))


def refined_filter(seed: int = 0, **changes) -> RefinedFilter:
    """A filter of 300 particles, to be refined."""
    return RefinedFilter(PathFilter(PARAMS, seed), MOTION, RefinementParams(gap=6, **changes))


def drive_on(estimator, drive, first: int = 0, last: int | None = None):
    """Feed a drive's vertices."""
    for v in range(first, len(drive.truth) if last is None else last):
        estimator.extend(drive.odometry[v], drive.walls[v], drive.travelled[v])
    return estimator


def test_the_refined_path_is_nearer_to_the_truth():
    errors = []
    for seed in range(3):
        drive = laps(2.2, noise=1.0, turn_bias=0.01, seed=seed)
        estimator = drive_on(refined_filter(seed), drive)
        before = absolute_error(estimator.estimate().path, drive.truth).translation.rmse
        estimator.refine()
        errors.append((before, absolute_error(estimator.estimate().path, drive.truth).translation.rmse))
    before, after = np.median(errors, axis=0)
    assert after < 0.6 * before


def test_what_the_filter_believes_stays_as_it_is():
    drive = laps(1.3, noise=1.0, seed=1)
    plain, estimator = PathFilter(PARAMS, 4), refined_filter(4)
    for v in range(len(drive.truth)):
        plain.extend(drive.odometry[v], drive.walls[v], drive.travelled[v])
        estimator.extend(drive.odometry[v], drive.walls[v], drive.travelled[v])
        estimator.refine()
    assert estimator.path_filter.estimate().path.tobytes() == plain.estimate().path.tobytes()
    assert estimator.n_particles == 300


def test_no_rounds_are_no_refinement():
    drive = laps(1.3, noise=1.0, seed=1)
    plain, estimator = drive_on(PathFilter(PARAMS, 4), drive), drive_on(refined_filter(4, rounds=0), drive)
    assert not estimator.is_rough
    assert not estimator.is_due
    estimator.refine()
    assert estimator.estimate().path.tobytes() == plain.estimate().path.tobytes()
    found, expected = estimator.uncertainty(8), plain.uncertainty(8)
    assert found.source == expected.source == "particles"
    assert found.deviations.tobytes() == expected.deviations.tobytes()


def test_the_refined_path_is_as_certain_as_its_covariances_say():
    drive = laps(2.2, noise=1.0, seed=3)
    estimator = drive_on(refined_filter(1), drive)
    assert estimator.uncertainty(8).source == "particles"
    estimator.refine()
    found = estimator.uncertainty(8)
    assert found.source == "refinement"
    assert estimator.correction is not None
    variances = np.diagonal(estimator.correction.covariances.marginals(), axis1=1, axis2=2)
    np.testing.assert_allclose(found.deviations**2, variances, atol=1e-12)
    np.testing.assert_allclose(found.spread**2, variances[:, 0] + variances[:, 1], atol=1e-12)
    assert np.all(found.deviations > 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_score_never_falls(seed):
    drive = laps(1.6, noise=2.0, turn_bias=0.02, seed=seed)
    estimator = refined_filter(seed)
    for last in range(2, len(drive.truth), 9):
        drive_on(estimator, drive, last - 2 if last == 2 else last - 9, last)
        before = estimator.path_filter.estimate().path.astype(float)
        estimator.refine()
        if estimator.correction is not None:
            refinement = estimator.refinement()
            assert estimator.score(refinement, estimator.correction.after) > estimator.score(refinement, before)


def test_the_same_drive_gives_the_same_bytes_and_threads_change_nothing():
    drive = laps(1.5, noise=1.0, seed=2)

    def found(threads: int) -> tuple[bytes, bytes]:
        path_filter = PathFilter(PARAMS, 1, threads)
        estimator = drive_on(RefinedFilter(path_filter, MOTION, RefinementParams(gap=6)), drive)
        estimator.refine()
        return estimator.estimate().path.tobytes(), estimator.uncertainty(8).spread.tobytes()

    assert found(1) == found(1) == found(2)


def test_new_vertices_hang_on_the_end_of_the_refined_path():
    drive = laps(1.5, noise=1.0, seed=2)
    estimator = drive_on(refined_filter(1), drive, 0, 50)
    estimator.refine()
    before = estimator.estimate().path
    drive_on(estimator, drive, 50, 53)
    after = estimator.estimate()
    assert len(after.path) == 53
    assert np.max(np.hypot(*(after.path[:50] - before)[:, :2].T)) < 0.5  # another particle may be the best now
    assert np.all(np.isfinite(after.path))
    assert estimator.uncertainty(8).deviations.shape == (53, 3)
    steps = np.hypot(*np.diff(after.path[48:, :2], axis=0).T)
    np.testing.assert_allclose(steps, 0.5, atol=0.3)


def test_particles_and_branches_lie_about_the_refined_path():
    drive = laps(2.2, noise=1.0, seed=3)
    estimator = drive_on(refined_filter(1), drive)
    estimator.refine()
    estimate, branches = estimator.estimate(), estimator.uncertainty(16).branches
    assert branches is not None
    assert np.median(np.hypot(*(estimate.particles - estimate.path[-1])[:, :2].T)) < 0.5
    assert np.median(np.hypot(*(branches.poses - estimate.path[branches.depths])[:, :2].T)) < 0.5


def test_it_is_due_seldom_as_the_path_grows():
    drive = laps(2.2, noise=0.5, seed=0)
    estimator = refined_filter()
    times = 0
    for v in range(len(drive.truth)):
        drive_on(estimator, drive, v, v + 1)
        if estimator.is_due:
            estimator.refine()
            times += 1
    assert 20 < times < 0.8 * len(drive.truth)


def test_vertices_that_saw_nothing_are_survived():
    nothing = Walls(np.full(72, np.inf), np.zeros(72))
    unknown = Walls(np.full(72, np.nan), np.full(72, np.nan))
    for walls in (nothing, unknown):
        estimator = refined_filter()
        estimator.refine()
        for v in range(12):
            estimator.extend(np.array([0.5 * v, 0.0, 0.0]), walls, 0.5)
            estimator.refine()
        assert np.all(np.isfinite(estimator.estimate().path))


def test_a_local_search_is_refined_too():
    drive = laps(1.6, noise=0.5, seed=1)
    search = LocalSearch(LocalSearchParams(perturbations=5, reach=REACH, motion=MOTION), 0)
    estimator = drive_on(RefinedFilter(search, MOTION, RefinementParams(gap=6)), drive)
    estimator.prepare()
    assert (estimator.uncertainty(8).source, len(estimator.uncertainty(8).deviations)) == ("none", 0)
    estimator.refine()
    assert np.all(np.isfinite(estimator.estimate().path))
    assert (estimator.uncertainty(8).source, len(estimator.uncertainty(8).deviations)) == (
        "refinement",
        len(drive.truth),
    )
