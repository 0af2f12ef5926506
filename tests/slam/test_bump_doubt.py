"""A map's doubt: little where the run is explained well, much where it is not, and told with the refined map."""

from __future__ import annotations

import numpy as np
import pytest

from slam.bump_doubt import EVEN, FEWEST, SURE, doubt
from slam.bump_mapper import BumpMapper, BumpMapperParams
from slam.cart_odometry import TURN, CartParams, Stage
from tests.slam.bump_world import AREAS, run


def test_doubt_is_a_probability_that_grows_with_what_a_bump_costs():
    shares = [doubt(cost, 100) for cost in np.linspace(-400.0, 500.0, 40)]
    assert np.all(np.diff(shares) >= 0.0)
    assert shares[0] < 0.01 < 0.99 < shares[-1]
    assert doubt(EVEN * 100, 100) == pytest.approx(0.5)
    assert doubt(-1e9, 100) == pytest.approx(0.0)
    assert doubt(1e9, 100) == pytest.approx(1.0)


def test_few_bumps_are_never_sure():
    assert doubt(-1e3, FEWEST - 1) == 1.0
    assert doubt(-1e3, FEWEST) < SURE


def refined(stages: list[Stage]):
    mapper = BumpMapper(CartParams(), BumpMapperParams(n_particles=1500, n_islands=2), 1)
    mapper.extend(stages)
    assert not mapper.estimate().is_sure, "nobody asked yet"
    return mapper.refine()


def test_a_run_whose_turns_were_swapped_makes_a_doubtful_map_and_the_run_itself_a_sure_one():
    stages, _ = run(AREAS["square"], 2, 60)
    right = refined(stages)
    turns = [row for row, stage in enumerate(stages) if stage.kind == TURN]
    swapped = list(stages)
    for row, other in zip(turns, np.random.default_rng(1).permutation(turns), strict=True):
        swapped[row] = stages[other]
    wrong = refined(swapped)
    assert right.is_sure, right.doubt
    assert not wrong.is_sure, wrong.doubt
    assert wrong.doubt > 0.9
