"""The map of an unknown area from bumps: far better than dead reckoning, the same for the same seed, as bumps come."""

from __future__ import annotations

import numpy as np
import pytest

from slam.bump_mapper import BumpMap, BumpMapper, BumpMapperParams, segments_of
from slam.bump_walls import distances, map_error, points_on
from slam.cart_odometry import DRIVE, CartParams, Stage, bumper_points, bumps_of
from slam.evaluate import alignment
from slam.pose import transform
from tests.slam.bump_world import AREAS, SmallCart, edges_of, run

SMALL = BumpMapperParams(n_particles=2000, n_islands=2)


def mapped(name: str, seed: int, bumps: int, params: BumpMapperParams = SMALL) -> tuple[BumpMapper, np.ndarray]:
    """A mapper that has taken up a run, and the truth at its bumps."""
    stages, truth = run(AREAS[name], seed, bumps)
    mapper = BumpMapper(CartParams(), params, seed)
    mapper.extend(stages)
    return mapper, truth[bumps_of(stages) + 1]


def errors(found: BumpMap, truth: np.ndarray, name: str) -> tuple[float, float]:
    """Of a map laid on the truth by its path."""
    lay = alignment(found.path[found.is_bump][:, :2], truth[:, :2])
    walls = [transform(lay, wall) for wall in found.walls]
    return map_error(segments_of(walls), points_on(walls), edges_of(AREAS[name]))


def raw_error(mapper: BumpMapper, truth: np.ndarray, name: str) -> float:
    """Of dead reckoning's contacts, laid in the same way."""
    raw = mapper.raw()[bumps_of(mapper.stages) + 1]
    contacts = transform(alignment(raw[:, :2], truth[:, :2]), bumper_points(raw, mapper.cart)[:, 1])
    return float(np.mean(distances(contacts, edges_of(AREAS[name]))))


@pytest.mark.parametrize("name", ["square", "cut rectangle", "pentagon", "triangle"])
def test_maps_are_far_better_than_dead_reckoning(name):
    """Of three carts, the median map errs by less than 3 cm and by less than a third of what dead reckoning does."""
    found = []
    for seed in (1, 2, 3):
        mapper, truth = mapped(name, seed, 90)
        error, covered = errors(mapper.refine(), truth, name)
        found.append((error, covered, error / raw_error(mapper, truth, name)))
    error, covered, share = np.median(found, axis=0)
    assert error < 0.03, found
    assert covered > 0.8, found
    assert share < 1.0 / 3.0, found


def test_the_same_seed_gives_the_same_map_and_another_another():
    (one, _), (two, _) = mapped("square", 4, 25), mapped("square", 4, 25)
    for first, second in ((one.estimate(), two.estimate()), (one.refine(), two.refine())):
        assert first.nodes.tobytes() == second.nodes.tobytes()
        assert [wall.tobytes() for wall in first.walls] == [wall.tobytes() for wall in second.walls]
    other = BumpMapper(CartParams(), SMALL, seed=99)
    other.extend(one.stages)
    assert other.estimate().nodes.tobytes() != one.estimate().nodes.tobytes()


def test_telling_a_map_changes_nothing_in_it():
    stages, _ = run(AREAS["square"], 5, 20)
    asked, silent = (BumpMapper(CartParams(), SMALL, 1) for _ in range(2))
    for row, stage in enumerate(stages):
        assert asked.add(stage) == (stage.kind == DRIVE)
        if row % 15 == 14:
            asked.estimate()
            asked.refine()
        silent.add(stage)
    assert asked.estimate().nodes.tobytes() == silent.estimate().nodes.tobytes()


def test_a_long_run_makes_room():
    stages, _ = run(AREAS["square"], 6, 70)
    mapper = BumpMapper(CartParams(), BumpMapperParams(n_particles=50, n_islands=1), 1)
    mapper.extend(stages)
    found = mapper.estimate()
    assert found.nodes.shape == (140, 3)
    assert len(found.contacts) == 70
    assert mapper.swarm.felt.shape[1] == 128


def test_nothing_is_known_before_the_first_bump():
    mapper = BumpMapper(CartParams(), SMALL, 1)
    for found in (mapper.estimate(), mapper.refine()):
        assert len(found.nodes) == len(found.walls) == len(found.contacts) == 0
    assert not mapper.add(Stage(2, 10, -10))
    assert mapper.add(Stage(DRIVE, 100, 100, 0))
    found = mapper.estimate()
    assert (len(found.path), len(found.contacts), found.walls) == (1, 0, [])
    assert 0.5 * SMALL.n_particles < mapper.effective_particles <= SMALL.n_particles


def test_drives_that_time_out_are_no_bumps_but_free_space():
    stages = [Stage(DRIVE, 300, 300, 0), Stage(DRIVE, 200, 200, 2), Stage(1, -50, -50), Stage(2, 45, -45)]
    mapper = BumpMapper(CartParams(), SMALL, 1)
    mapper.extend(stages * 3)
    found = mapper.refine()
    assert found.is_bump.tolist() == [False, True] * 3
    assert np.all(found.felt[~found.is_bump] < 0)


def test_islands_never_mix():
    mapper, _ = mapped("square", 7, 12, BumpMapperParams(n_particles=40, n_islands=4))
    ancestors = np.arange(40)
    for island in mapper.islands:
        assert island.stop - island.start == 10
        mapper.resample(island, np.full(10, island.start))
        ancestors[island] = island.start
    np.testing.assert_array_equal(mapper.swarm.poses, mapper.swarm.poses[ancestors])
    assert len(np.unique(mapper.swarm.poses[:, 0])) == 4


@pytest.mark.parametrize("share", [1.0, 1.04])
def test_a_wheelbase_that_was_told_wrong_is_found(share):
    stages, _ = run(AREAS["square"], 9, 120)
    told = CartParams()._replace(wheelbase=share * CartParams().wheelbase)
    mapper = BumpMapper(told, SMALL, 1)
    mapper.extend(stages)
    true = told.wheelbase / SmallCart(AREAS["square"], 9).own.wheelbase - 1.0
    assert mapper.refine().biases[0] == pytest.approx(true, abs=0.01)
