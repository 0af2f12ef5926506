"""Errors of trajectories and maps: formulas worked by hand, twins, and what must not change them."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from slam import evaluate
from slam import pose as se2
from slam.evaluate import Relations, absolute_error, alignment, map_agreement, relations_error, relative_error, revisits
from slam.grid import Grid
from tests.naive import evaluate as naive

DATA = Path(os.environ.get("CRUNCH_DATA", Path(__file__).parents[2] / "data"))
UNITS = [{}, {"step": 7, "by": "rows"}, {"step": 0.5, "by": "metres"}]


def wander(n, seed):
    """A path (n, 3) of steps near 0.1 m."""
    rng = np.random.default_rng(seed)
    steps = np.column_stack([rng.uniform(0.05, 0.15, n), rng.normal(0.0, 0.01, n), rng.normal(0.0, 0.1, n)])
    poses = [np.zeros(3)]
    for step in steps[1:]:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def disturb(poses, seed, size=0.1):
    """Poses with independent errors."""
    return poses + np.random.default_rng(seed).normal(0.0, size, poses.shape)


def laps(n_laps, radius=5.0, n=200):
    """Laps (n_laps * n, 3) of a circle."""
    angles = np.arange(n_laps * n) * 2.0 * math.pi / n
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), se2.wrap(angles + math.pi / 2.0)])


def signed_area(corners):
    """Twice the area of a triangle (3, 2), positive if its corners run counter-clockwise."""
    (x0, y0), (x1, y1), (x2, y2) = corners
    return (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)


def test_spread_of_known_errors():
    spread = evaluate.Spread.of(np.array([3.0, 4.0]))
    assert (spread.n, spread.mean, spread.median, spread.std, spread.max) == (2, 3.5, 3.5, 0.5, 4.0)
    assert spread.rmse == pytest.approx(math.sqrt(12.5))
    assert spread.p90 == pytest.approx(3.9)


def test_spread_of_nothing_is_none_in_json():
    spread = evaluate.Spread.of(np.empty(0)).to_dict()
    assert spread.pop("n") == 0
    assert set(spread.values()) == {None}


@pytest.mark.parametrize("seed", range(10))
def test_alignment_agrees_with_umeyama(seed):
    rng = np.random.default_rng(seed)
    points, references = rng.normal(size=(2, 30, 2))
    rotation, translation = naive.alignment(points, references)
    found = alignment(points, references)
    np.testing.assert_allclose(se2.transform(found, points), points @ rotation.T + translation, atol=1e-9)


def test_alignment_never_mirrors():
    points = np.random.default_rng(1).normal(size=(30, 2))
    moved = se2.transform(alignment(points, points * [1.0, -1.0]), points)
    np.testing.assert_allclose(np.hypot(*np.diff(moved, axis=0).T), np.hypot(*np.diff(points, axis=0).T))
    assert signed_area(moved[:3]) == pytest.approx(signed_area(points[:3]))


def test_one_pose_aligns_and_none_raises():
    np.testing.assert_allclose(alignment(np.array([[1.0, 2.0]]), np.array([[5.0, 5.0]])), [4.0, 3.0, 0.0])
    with pytest.raises(ValueError, match="no poses"):
        alignment(np.empty((0, 2)), np.empty((0, 2)))


def test_absolute_error_agrees_with_one_pose_at_a_time():
    reference = wander(100, 1)
    poses = se2.compose(np.array([3.0, -2.0, 1.0]), disturb(reference, 2))
    errors = naive.absolute_errors(poses, reference)
    found = absolute_error(poses, reference)
    assert found.translation.rmse == pytest.approx(math.sqrt(np.mean(np.square(errors))))
    assert found.translation.median == pytest.approx(np.median(errors))
    assert found.translation.max == pytest.approx(max(errors))
    assert found.translation.n == 100


def test_a_rigidly_moved_trajectory_has_no_error_once_aligned():
    reference, move = wander(60, 3), np.array([10.0, -4.0, 2.5])
    moved = se2.compose(move, reference)
    assert absolute_error(moved, reference).translation.max == pytest.approx(0.0, abs=1e-12)
    assert absolute_error(moved, reference).rotation.max == pytest.approx(0.0, abs=1e-12)
    assert absolute_error(moved, reference, is_aligned=False).translation.max > 1.0
    for unit in UNITS:
        assert relative_error(moved, reference, **unit).translation.max == pytest.approx(0.0, abs=1e-12)


def test_alignment_is_the_best_rigid_motion():
    reference = wander(50, 4)
    poses = disturb(reference, 5, 0.5)
    best = absolute_error(poses, reference).translation.rmse
    for move in np.random.default_rng(6).normal(0.0, 0.05, (50, 3)):
        moved = se2.compose(se2.compose(alignment(poses[:, :2], reference[:, :2]), move), poses)
        assert absolute_error(moved, reference, is_aligned=False).translation.rmse >= best


def test_unaligned_error_of_a_constant_offset():
    reference = wander(20, 7)
    found = absolute_error(reference + [0.3, 0.4, 0.1], reference, is_aligned=False)
    assert found.translation.rmse == pytest.approx(0.5)
    assert found.translation.std == pytest.approx(0.0, abs=1e-12)
    assert found.rotation.mean == pytest.approx(0.1)


@pytest.mark.parametrize("step", [1, 7, 40])
def test_relative_error_by_rows_agrees_with_one_step_at_a_time(step):
    reference = wander(200, 8)
    poses = disturb(reference, 9)
    translations, rotations = zip(*naive.relative_errors_by_rows(poses, reference, step), strict=True)
    found = relative_error(poses, reference, step, "rows")
    assert found.translation.n == len(translations) == 199 // step
    assert found.translation.mean == pytest.approx(np.mean(translations))
    assert found.rotation.mean == pytest.approx(np.mean(rotations))


@pytest.mark.parametrize("step", [0.2, 1.0, 5.0])
def test_relative_error_by_metres_agrees_with_one_step_at_a_time(step):
    reference = wander(200, 10)
    poses = disturb(reference, 11)
    translations, rotations = zip(*naive.relative_errors_by_metres(poses, reference, step), strict=True)
    found = relative_error(poses, reference, step)
    assert found.translation.n == len(translations)
    assert found.translation.mean == pytest.approx(np.mean(translations))
    assert found.rotation.mean == pytest.approx(np.mean(rotations))


def test_relative_error_of_a_wrong_scale():
    reference = np.column_stack([np.arange(101) * 0.1, np.zeros((101, 2))])
    found = relative_error(reference * [1.02, 1.0, 1.0], reference, 1.0)
    assert found.translation.mean == pytest.approx(0.02)
    assert found.translation.n == 10
    assert relative_error(reference * [1.02, 1.0, 1.0], reference, 1.0, all_pairs=True).translation.n == 91


def test_relative_error_of_too_short_a_path_has_no_sample():
    assert relative_error(wander(5, 12), wander(5, 12), 100.0).translation.n == 0
    assert relative_error(np.empty((0, 3)), np.empty((0, 3)), 1, "rows").translation.n == 0
    assert relative_error(np.empty((0, 3)), np.empty((0, 3)), 1.0).to_dict()["translation_m"]["mean"] is None


@pytest.mark.parametrize(("step", "by"), [(0, "rows"), (1.5, "rows"), (-1.0, "metres"), (math.nan, "metres")])
def test_steps_without_meaning_raise(step, by):
    with pytest.raises(ValueError, match="step"):
        relative_error(wander(5, 1), wander(5, 1), step, by)


def test_relations_error_agrees_with_one_relation_at_a_time():
    rng = np.random.default_rng(13)
    times, poses = np.cumsum(rng.uniform(0.1, 1.0, 80)), wander(80, 14)
    ends = rng.uniform(times[0] - 1.0, times[-1] + 1.0, (2, 60))
    motions = rng.normal(size=(60, 3))
    translations, rotations = zip(*naive.relations_errors(times, poses, zip(*ends, motions, strict=True)), strict=True)
    found = relations_error(times + 5.0, poses, Relations(ends[0], ends[1], motions), offset=-5.0)
    assert (found.translation.n, found.n_offered) == (len(translations), 60)
    assert found.translation.mean == pytest.approx(np.mean(translations))
    assert found.translation.std == pytest.approx(np.std(translations))
    assert found.rotation.mean == pytest.approx(np.mean(rotations))
    assert found.rotation.std == pytest.approx(np.std(rotations))


def test_true_relations_have_no_error():
    times, poses = np.arange(50.0), wander(50, 15)
    first, second = np.arange(0, 40), np.arange(10, 50)
    relations = Relations(times[first], times[second], se2.between(poses[first], poses[second]))
    assert relations_error(times, poses, relations).translation.max == pytest.approx(0.0, abs=1e-12)
    assert relations_error(times[::-1], poses[::-1], relations).rotation.max == pytest.approx(0.0, abs=1e-12)


def test_revisits_agree_with_a_search_row_by_row():
    reference = disturb(laps(3, n=80), 16, 0.05)
    later, earlier = evaluate.revisit_pairs(reference, 0.4, 20.0, spacing=1e-3)
    assert list(zip(later.tolist(), earlier.tolist(), strict=True)) == naive.revisits(reference, 0.4, 20.0)


def test_a_true_path_is_closed_and_a_drifting_one_is_not():
    reference = laps(2)
    drifted = reference + np.linspace(0.0, 2.0, len(reference))[:, None] * [1.0, 0.0, 0.0]
    assert revisits(reference, reference).is_closed
    assert revisits(reference, reference).errors.translation.n > 100
    assert not revisits(drifted, reference).is_closed
    assert revisits(drifted, reference).errors.translation.median == pytest.approx(1.0, rel=0.05)


def test_each_of_the_three_bounds_can_leave_a_loop_open():
    reference = laps(2)
    late = np.arange(len(reference)) >= 200
    far, turned, partly = reference.copy(), reference.copy(), reference.copy()
    far[late, 0] += 0.36
    turned[late, 2] += math.radians(5.5)
    partly[late & (np.arange(len(reference)) % 7 == 0), 0] += 1.1
    for poses in (far, turned, partly):
        assert not revisits(poses, reference).is_closed
    far[late, 0] -= 0.05
    assert revisits(far, reference).is_closed


def test_a_path_without_a_revisit_is_not_closed():
    found = revisits(wander(100, 17), np.column_stack([np.arange(100.0), np.zeros((100, 2))]))
    assert not found.is_closed
    assert found.to_dict()["n"] == 0


def test_standing_still_is_no_revisit():
    reference = np.repeat(laps(1), 3, axis=0)
    assert revisits(reference, reference, min_path=2.0).errors.translation.n < 10


def wall_grid():
    """A grid with a wall of one cell along x = 1.025."""
    cells = np.full((40, 60), -1.0, np.float32)
    cells[:, 20] = 2.0
    return Grid(cells, 0.05, 0.0, -1.0)


def test_points_on_the_wall_agree_and_points_off_it_do_not():
    along = np.linspace(-0.9, 0.9, 50)
    for offset, share in ((0.0, 1.0), (0.14, 1.0), (-0.14, 1.0), (0.25, 0.0), (-0.25, 0.0)):
        points = np.column_stack([np.full(50, 1.025 + offset), along])
        assert map_agreement(points, wall_grid()).share == share


def test_points_outside_of_the_grid_count_their_distance():
    points = np.array([[1.025, -1.1], [1.025, 1.1], [1.025, -1.3], [1e6, 0.0], [-1e6, 0.0]])
    found = map_agreement(points, wall_grid())
    assert (found.n, found.share) == (5, 0.4)


def test_agreement_of_no_points_is_unknown():
    assert map_agreement(np.empty((0, 2)), wall_grid()).to_dict()["share"] is None


def corridor_visits(shift):
    """Two drives along a straight wall 1 m to the left, the second `shift` m nearer to it by mistake."""
    there = [(0.5 * i, 0.0, 0.0) for i in range(40)]
    again = [(0.5 * i, shift, 0.0) for i in range(40)]
    back = [(20.0 + 0.5 * i, 5.0, 0.0) for i in range(40)]  # elsewhere in between
    wall = np.column_stack([np.linspace(1.0, -1.0, 21), np.full(21, 1.0)])  # counter-clockwise: from ahead to behind
    return np.array(there + back + again), [[wall]] * 40 + [[]] * 40 + [[wall]] * 40


@pytest.mark.parametrize("shift", [0.0, 0.12, 0.6])
def test_walls_seen_twice_spread_by_how_far_the_path_is_off(shift):
    path, curves = corridor_visits(shift)
    spread = evaluate.wall_spread(path, curves)
    assert spread.n == 40 * 21
    assert spread.median == pytest.approx(shift, abs=1e-9)


def test_many_visits_do_not_make_walls_seem_nearer():
    """Visits that are off in turn: of six pairs of four visits, four lie apart; the nearest of all would hide that."""
    (path, curves), (off, _) = corridor_visits(0.0), corridor_visits(0.12)
    visits = [path[:80], off[80:], path[40:80], path[80:], path[40:80], off[80:]]
    seen = [*curves, *curves[40:], *curves[40:]]
    spread = evaluate.wall_spread(np.concatenate(visits), seen)
    assert spread.n == 6 * 40 * 21
    assert spread.median == pytest.approx(0.12, abs=1e-9)


def test_the_other_side_of_a_wall_is_another_wall():
    path, curves = corridor_visits(0.0)
    path[80:, 1] = 2.1  # beyond the wall, and seeing it from there
    curves[80:] = [[np.column_stack([np.linspace(-1.0, 1.0, 21), np.full(21, -1.0)])]] * 40
    assert evaluate.wall_spread(path, curves).n == 0


def test_walls_seen_once_have_no_spread():
    path, curves = corridor_visits(0.0)
    assert evaluate.wall_spread(path[:60], curves[:60]).n == 0
    assert evaluate.wall_spread(path[:0], []).n == 0


def test_wall_spread_agrees_with_one_pair_of_points_at_a_time():
    rng = np.random.default_rng(3)
    path = laps(2, radius=4.0, n=50) + rng.normal(0.0, 0.05, (100, 3))
    angles = np.linspace(0.0, 2.0, 12)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    curves = [[(0.8 + rng.uniform(0.0, 0.4)) * ring, ring[:1]] for _ in path]
    expected = naive.wall_spread(path, curves, 1.0, 20.0)
    assert len(expected) > 100
    assert vars(evaluate.wall_spread(path, curves)) == pytest.approx(vars(evaluate.Spread.of(np.array(expected))))


def test_results_are_json():
    reference = laps(2)
    results = [
        absolute_error(reference, reference),
        relative_error(reference, reference),
        revisits(reference, reference),
        map_agreement(reference[:, :2], wall_grid()),
    ]
    for result in results:
        json.dumps(result.to_dict(), allow_nan=False)


@pytest.mark.skipif(not (DATA / "intel").is_dir(), reason="needs CRUNCH_DATA/intel (Radish's Intel Research Lab)")
def test_the_reference_of_intel_beats_its_odometry_on_the_hand_verified_relations():
    table = np.loadtxt(DATA / "intel" / "intel.relations")
    relations = Relations(table[:, 0], table[:, 1], table[:, [2, 3, 7]])
    tum = np.loadtxt(DATA / "intel" / "reference.tum")
    reference = np.column_stack([tum[:, 1:3], 2.0 * np.arctan2(tum[:, 6], tum[:, 7])])
    lines = map(str.split, (DATA / "intel" / "intel.log").read_text().splitlines())
    odometry = np.array([[float(words[i]) for i in (7, 1, 2, 3)] for words in lines if words[:1] == ["ODOM"]])
    by_reference = relations_error(tum[:, 0], reference, relations)
    by_odometry = relations_error(odometry[:, 0], odometry[:, 1:], relations)
    assert by_reference.translation.n == by_odometry.translation.n == 2984
    assert by_reference.translation.mean < 0.15  # 910 scans, straight lines between them
    assert by_odometry.translation.mean > 7.0
