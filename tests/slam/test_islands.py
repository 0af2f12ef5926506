"""Islands are path filters that share what was seen and nothing else; the one whose refined path is best is told."""

from __future__ import annotations

import numpy as np
import pytest

from slam import comparison, islands
from slam.comparison import ComparisonParams
from slam.islands import AS_TOLD, FREE, WARY, Islands, sizes_of
from slam.motion import MotionParams
from slam.path_filter import PathFilter, PathFilterParams
from slam.refined_filter import RefinedFilter
from slam.refinement import RefinementParams
from slam.wall_direction import DirectionParams
from tests.slam.drives import REACH, laps

MOTION = MotionParams(turn_noise=0.04, distance_noise=0.04)
TOLD = {"chance": 0.1, "turn_bias": 0.03, "gain": 0.4}  # what beliefs are about


@pytest.fixture(autouse=True)
def small_islands(monkeypatch):
    """Islands of 60 particles, so that a test has several."""
    monkeypatch.setattr(islands, "SMALLEST", 60)


def params_of(particles, n_islands=4):
    return PathFilterParams(
        particles=particles, islands=n_islands, reach=REACH, motion=MOTION, comparison=ComparisonParams(gap=6)
    )


def drive_on(estimator, drive):
    for pose, walls, travelled in zip(drive.odometry, drive.walls, drive.travelled, strict=True):
        estimator.extend(pose, walls, travelled)
    return estimator


@pytest.mark.parametrize(("particles", "n_islands", "expected"), [
    (59, 4, [59]), (120, 4, [60, 60]), (242, 4, [60, 60, 61, 61]), (1000, 3, [333, 333, 334]), (500, 1, [500]),
])  # fmt: skip
def test_particles_fill_as_many_islands_as_they_can(particles, n_islands, expected):
    found = Islands(params_of(particles, n_islands))
    assert [island.n_particles for island in found.filters] == expected
    assert found.n_particles == particles


def test_one_island_is_one_filter():
    drive = laps(1.3, noise=1.0, seed=1)
    alone, one = drive_on(PathFilter(params_of(200), 5), drive), drive_on(Islands(params_of(200, 1), 5), drive)
    for field, expected in zip(one.estimate(), alone.estimate(), strict=True):
        np.testing.assert_array_equal(field, expected)


def test_each_island_is_the_filter_of_its_seed_and_they_differ():
    drive = laps(1.3, noise=1.0, seed=2)
    found = drive_on(Islands(params_of(240), 5), drive)
    paths = found.candidates()
    biases, gain = (MOTION.turn_bias, MOTION.turn_bias / 3.0), DirectionParams().gain
    as_told, wary, free = (0.0, biases[0], gain), (0.6, biases[1], 2.0 * gain), (0.6, biases[1], 0.0)
    for island, (believed, path) in enumerate(zip((as_told, free, wary, free), paths, strict=True)):
        alone = PathFilter(believing(params_of(60), *believed), islands.seed_of(5, island))
        np.testing.assert_array_equal(drive_on(alone, drive).estimate().path, path)
    assert len({path.tobytes() for path in paths}) == 4


def believing(params, chance, turn_bias, gain):
    """The parameters with these three in place of their own."""
    return params.model_copy(update={
        "comparison": params.comparison.model_copy(update={"chance": chance}),
        "motion": params.motion.model_copy(update={"turn_bias": turn_bias}),
        "direction": params.direction.model_copy(update={"gain": gain}),
    })  # fmt: skip


@pytest.mark.parametrize(("belief", "chance", "turn_bias", "gain"), [
    (AS_TOLD, 0.1, 0.03, 0.4), (WARY, 0.6, 0.01, 0.8), (FREE, 0.6, 0.01, 0.0),
])  # fmt: skip
def test_a_belief_changes_chance_turn_bias_and_directions_and_nothing_else(belief, chance, turn_bias, gain):
    found = belief.of(believing(params_of(500), **TOLD))
    assert found.comparison.chance == chance
    assert found.motion.turn_bias == pytest.approx(turn_bias)
    assert found.direction.gain == pytest.approx(gain)
    assert believing(found, **TOLD) == believing(params_of(500), **TOLD)


@pytest.mark.parametrize("belief", [AS_TOLD, WARY, FREE])
def test_a_belief_takes_no_less_chance_off_than_the_parameters_say(belief):
    assert belief.of(believing(params_of(500), **TOLD | {"chance": 0.7})).comparison.chance == 0.7


def test_half_of_the_islands_are_free_one_in_four_is_wary_and_the_first_is_as_told():
    found = Islands(believing(params_of(360, 6), **TOLD))
    assert [island.params.comparison.chance for island in found.filters] == [0.1, 0.6, 0.6, 0.6, 0.1, 0.6]
    gains = [island.params.direction.gain for island in found.filters]
    assert gains == pytest.approx([0.4, 0.0, 0.8, 0.0, 0.4, 0.0])
    assert found.observations.rule.chance == 0.6, "paths are told apart by the wary measure"


@pytest.mark.parametrize("changes", [{"beliefs": "one"}, {"islands": 1}])
def test_islands_of_one_belief_are_as_told(changes):
    params = believing(params_of(240), **TOLD).model_copy(update=changes)
    found = Islands(params)
    for island in found.filters:
        assert island.params == params.model_copy(update={"particles": 240 // len(found.filters)})
    assert found.observations.rule.chance == 0.1


def test_only_free_islands_go_the_same_way_whatever_directions_walls_have(monkeypatch):
    drive = laps(1.3, noise=1.0, seed=2)
    straight = drive_on(Islands(params_of(240), 5), drive)
    monkeypatch.setattr(comparison, "wall_direction", lambda walls: 1j)
    turned = drive_on(Islands(params_of(240), 5), drive)
    same = [
        island.particles.log_weights.tobytes() == other.particles.log_weights.tobytes()
        and island.best_path().tobytes() == other.best_path().tobytes()
        for island, other in zip(straight.filters, turned.filters, strict=True)
    ]
    assert same == [False, True, False, True]


def test_threads_change_nothing():
    drive = laps(1.3, noise=1.0, seed=3)
    told = [drive_on(Islands(params_of(240), 7, threads), drive).candidates() for threads in (1, 2, 3, 9)]
    assert len({b"".join(path.tobytes() for path in paths) for paths in told}) == 1


def test_resizing_keeps_islands_that_are_large_enough():
    drive = laps(1.1, noise=1.0, seed=4)
    found = drive_on(Islands(params_of(240)), drive)
    for size in (400, 600, 420):
        found.resize(size)
        assert len(found.filters) == 4
        assert found.n_particles == size
        assert found.estimate().n_particles == size


def test_islands_that_would_be_too_small_are_given_up_but_not_the_believed_one():
    drive = laps(1.1, noise=1.0, seed=4)
    found = drive_on(Islands(params_of(240)), drive)
    found.believe(2)
    told = found.filter
    for size, n_islands in ((islands.FEWEST * 3, 3), (islands.FEWEST * 2, 2), (30, 1), (1, 1), (900, 1)):
        found.resize(size)
        assert len(found.filters) == n_islands
        assert found.n_particles == size
        assert found.filter is told
    drive_on(found, drive)
    with pytest.raises(ValueError, match="one at least"):
        told.resize(0)


def lost_and_found(seed):
    """Islands so small that some lose the loop, driven."""
    drive = laps(2.2, noise=3.0, turn_bias=0.06, seed=seed)
    estimator = RefinedFilter(Islands(params_of(20), 1), MOTION, RefinementParams(gap=6))
    return drive_on(estimator, drive)


@pytest.mark.parametrize("seed", range(6))
def test_the_island_of_the_best_refined_path_is_told(monkeypatch, seed):
    monkeypatch.setattr(islands, "SMALLEST", 5)
    estimator = lost_and_found(seed)
    estimator.refine()
    refinement = estimator.refinement()
    filters = estimator.path_filter
    assert isinstance(filters, Islands)
    refined = [refinement.refine(path).path for path in filters.candidates()]
    scores = [estimator.score(refinement, path) for path in refined]
    assert filters.believed == int(np.argmax(scores))
    best = refined[int(np.argmax(scores))]
    told = refinement.run(best, 1, is_square=refinement.squareness(best) > 0.0).path
    np.testing.assert_allclose(estimator.estimate().path, told, atol=1e-9)


def test_islands_that_agreed_would_prove_nothing_above(monkeypatch):
    monkeypatch.setattr(islands, "SMALLEST", 5)
    winners = set()
    for seed in range(6):
        estimator = lost_and_found(seed)
        estimator.refine()
        assert isinstance(estimator.path_filter, Islands)
        winners.add(estimator.path_filter.believed)
    assert len(winners) > 1


def test_quick_refinements_come_to_believe_a_better_island_in_turn(monkeypatch):
    monkeypatch.setattr(islands, "SMALLEST", 5)
    changed = 0
    for seed in range(6):
        estimator, whole = lost_and_found(seed), lost_and_found(seed)
        whole.refine()
        filters, others = estimator.path_filter, whole.path_filter
        assert isinstance(filters, Islands)
        assert isinstance(others, Islands)
        wrong = (others.believed + 1) % len(filters.filters)
        filters.believe(wrong)
        for _ in range(2):
            estimator.refine(is_quick=True)
        changed += filters.believed != wrong
    assert changed >= 4


def test_without_rounds_the_island_whose_own_path_scores_best_is_told(monkeypatch):
    monkeypatch.setattr(islands, "SMALLEST", 5)
    drive = laps(2.2, noise=3.0, turn_bias=0.06, seed=1)
    estimator = drive_on(RefinedFilter(Islands(params_of(20), 1), MOTION, RefinementParams(gap=6, rounds=0)), drive)
    estimator.refine()
    filters, refinement = estimator.path_filter, estimator.refinement()
    assert isinstance(filters, Islands)
    scores = [estimator.score(refinement, path) for path in filters.candidates()]
    assert filters.believed == int(np.argmax(scores))
    assert estimator.estimate().path.tobytes() == filters.estimate().path.tobytes()


def test_without_rounds_one_island_leaves_nothing_to_do():
    drive = laps(1.1, noise=1.0, seed=4)
    idle = RefinedFilter(Islands(params_of(60)), MOTION, RefinementParams(gap=6, rounds=0))
    choosing = RefinedFilter(Islands(params_of(240)), MOTION, RefinementParams(gap=6, rounds=0))
    assert not drive_on(idle, drive).is_rough
    drive_on(choosing, drive).resize(1)  # one island is left, and it has seen every vertex
    assert choosing.is_rough
    drive_on(choosing, drive).refine()
    assert choosing.estimate().path.tobytes() == choosing.path_filter.estimate().path.tobytes()


def test_before_the_first_vertex_there_is_nothing_to_tell():
    found = Islands(params_of(240))
    for ask in (found.estimate, found.candidates, lambda: found.uncertainty(4)):
        with pytest.raises(RuntimeError, match="no vertex"):
            ask()
    assert sizes_of(3, 4) == [1, 1, 1, 1]
