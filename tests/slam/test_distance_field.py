"""The distance field is exact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.distance_field import distance_field
from tests.naive import distance_field as naive


@pytest.mark.parametrize("shape", [(1, 1), (1, 13), (13, 1), (7, 5), (12, 20)])
@pytest.mark.parametrize("share", [0.01, 0.1, 0.6])
def test_agrees_with_trying_every_wall(shape, share):
    is_wall = np.random.default_rng(1).random(shape) < share
    np.testing.assert_allclose(distance_field(is_wall, 0.05), naive.distance_field(is_wall, 0.05), rtol=1e-12)


def test_one_wall_gives_circles():
    is_wall = np.zeros((41, 61), bool)
    is_wall[10, 50] = True
    rows, columns = np.indices(is_wall.shape)
    np.testing.assert_allclose(distance_field(is_wall, 0.1), 0.1 * np.hypot(rows - 10, columns - 50), rtol=1e-12)


def test_without_a_wall_everything_is_infinitely_far():
    assert np.all(distance_field(np.zeros((3, 4), bool), 0.05) == math.inf)
    assert distance_field(np.zeros((0, 4), bool), 0.05).shape == (0, 4)


def test_turned_and_mirrored_maps_have_turned_and_mirrored_fields():
    is_wall = np.random.default_rng(2).random((30, 50)) < 0.03
    field = distance_field(is_wall, 1.0)
    np.testing.assert_allclose(distance_field(is_wall.T, 1.0), field.T, rtol=1e-12)
    np.testing.assert_allclose(distance_field(is_wall[::-1, ::-1], 1.0), field[::-1, ::-1], rtol=1e-12)
