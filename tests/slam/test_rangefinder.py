"""Rings of rangefinders: Crunch's own, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from slam.rangefinder import RingParams, crunch_sensors


def test_crunch_carries_eight_of_each_kind_ccw_from_straight_ahead():
    sensors = crunch_sensors()
    assert set(sensors) == {"sonar", "infrared"}
    for kind, ring in sensors.items():
        assert ring.model == kind
        np.testing.assert_allclose(ring.bearings, np.arange(8) * math.pi / 4.0)


def test_eight_sonar_cones_close_the_circle():
    sonar = crunch_sensors()["sonar"]
    assert 8 * 2.0 * sonar.half_angle == pytest.approx(2.0 * math.pi)


def test_infrared_is_not_trusted_where_it_folds_back():
    infrared = crunch_sensors()["infrared"]
    assert infrared.min_range == 0.10
    assert infrared.max_range == 0.80
    assert infrared.half_angle == 0.0


def test_angles_are_degrees_outside_and_radians_inside():
    ring = RingParams(model="beam", bearings_deg=(-90.0, 0.0, 90.0), half_angle_deg=1.0)
    np.testing.assert_allclose(ring.bearings, [-math.pi / 2.0, 0.0, math.pi / 2.0])
    assert ring.half_angle == pytest.approx(math.radians(1.0))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("model", "radar"),
        ("offset", -0.1),
        ("height", 0.0),
        ("half_angle_deg", 90.0),
        ("min_range", -0.01),
        ("max_range", 0.0),
        ("maximum", 3.0),
    ],
)
def test_a_wrong_key_or_value_is_named(key, value):
    with pytest.raises(ValidationError, match=key):
        RingParams(**({"model": "sonar", "bearings_deg": (0.0,)} | {key: value}))


def test_rings_are_frozen():
    with pytest.raises(ValidationError, match="frozen"):
        crunch_sensors()["sonar"].max_range = 5.0  # pyright: ignore[reportAttributeAccessIssue]
