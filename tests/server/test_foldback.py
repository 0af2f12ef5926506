"""Which infra-red readings a near echo casts doubt on."""

from __future__ import annotations

import numpy as np
import pytest

from server.robots.foldback import TieBreaker
from slam.rangefinder import crunch_sensors

EVEN, ODD = np.arange(8) % 2 == 0, np.arange(8) % 2 == 1
LOOK = np.full(8, 0.2)


def half(fired, echo):
    """A sweep of the sonars that fired."""
    return np.where(fired, echo, np.nan)


def test_only_beams_with_a_near_echo_are_doubted_whichever_half_fired_last():
    breaker = TieBreaker(crunch_sensors())
    np.testing.assert_array_equal(breaker.believed("infrared", LOOK), LOOK)
    breaker.believed("sonar", half(EVEN, [0.05, 9, 0.6, 9, np.inf, 9, 0.6, 9]))
    breaker.believed("sonar", half(ODD, 0.6))
    np.testing.assert_array_equal(np.isnan(breaker.believed("infrared", LOOK)), np.arange(8) == 0)
    breaker.believed("sonar", half(EVEN, 0.6))
    assert np.isnan(breaker.believed("infrared", LOOK)[0]), "one lost ping breaks no tie"
    breaker.believed("sonar", half(EVEN, 0.6))
    np.testing.assert_array_equal(breaker.believed("infrared", LOOK), LOOK)


@pytest.mark.parametrize(("echo", "is_doubted"), [(0.03, True), (0.12, True), (0.14, False), (np.inf, False)])
def test_an_echo_within_15_cm_of_the_infrared_is_near(echo, is_doubted):
    breaker = TieBreaker(crunch_sensors())
    breaker.believed("sonar", np.full(8, echo))
    assert np.isnan(breaker.believed("infrared", LOOK)).all() == is_doubted


def test_an_echo_that_rounds_below_the_nearest_range_still_counts():
    breaker = TieBreaker(crunch_sensors())
    given = np.array([0.0299, 0.01, np.nan, np.inf, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(breaker.believed("sonar", given), [0.03, *given[1:]])


@pytest.mark.parametrize("change", [{"model": "beam"}, {"min_range": 0.0}, {"bearings_deg": (0.0, 90.0)}])
def test_rings_that_do_not_fold_or_look_elsewhere_are_left_alone(change):
    sensors = crunch_sensors()
    sensors["infrared"] = sensors["infrared"].model_copy(update=change)
    breaker = TieBreaker(sensors)
    breaker.believed("sonar", np.full(8, 0.05))
    np.testing.assert_array_equal(breaker.believed("infrared", LOOK), LOOK)
