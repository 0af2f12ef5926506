"""The calibration benchmark's ruler: it finds right claims right, and wrong ones wrong by as much as they are."""

from __future__ import annotations

import numpy as np
import pytest

from bench.benchmark import Row
from bench.calibration import BENCH, BINS, NOMINAL, Claim, held, mean, views_of

N = 20_000
COVARIANCE = np.array([[0.09, 0.05], [0.05, 0.04]])


def drawn(scale: float = 1.0) -> tuple[Claim, np.ndarray]:
    """A claim for N places, and true places whose deviations are `scale` times those of the claim."""
    rng = np.random.default_rng(3)
    places = rng.uniform(-5.0, 5.0, (N, 2))
    errors = rng.multivariate_normal(np.zeros(2), scale**2 * COVARIANCE, N)
    return Claim(places, np.broadcast_to(COVARIANCE, (N, 2, 2))), places + errors


def test_a_right_claim_holds_what_it_should():
    record = held(*drawn())
    for part in NOMINAL:
        tolerance = 4.0 * 100.0 * np.sqrt(part * (1.0 - part) / N)
        assert record[f"held_{round(100 * part)}"] == pytest.approx(100.0 * part, abs=tolerance)
    assert record["probabilities"] == pytest.approx(np.full(BINS, 1.0 / BINS), abs=4.0 * np.sqrt(1.0 / BINS / N))
    assert record["certain"] == 0.0


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_wrong_claim_holds_what_the_formula_says(scale):
    """d^2 shrinks or grows with the square of the scale: the share held is 1 - (1 - q)^(1 / scale^2)."""
    record = held(*drawn(scale))
    for part in NOMINAL:
        expected = 1.0 - (1.0 - part) ** (1.0 / scale**2)
        assert record[f"held_{round(100 * part)}"] == pytest.approx(100.0 * expected, abs=1.5)


def test_a_claim_of_no_error_at_all_holds_nothing():
    claim, true_places = drawn()
    record = held(claim._replace(covariances=np.zeros((N, 2, 2))), true_places)
    assert record["held_95"] == 0.0
    assert record["certain"] == 100.0


def test_views_look_from_the_ends_and_from_earlier_visits():
    angles = np.linspace(0.0, 4.0 * np.pi, 200)  # two laps of a circle of 8 m radius
    truth = np.stack([8.0 * np.cos(angles), 8.0 * np.sin(angles), angles + 0.5 * np.pi], axis=1)
    views = views_of(truth)
    viewers, viewed = views["revisits"]
    assert viewers.size >= 90
    assert np.all(viewed - viewers > 90)
    assert np.all(views["from the newest"][0] == 199)
    assert np.array_equal(views["from the first vertex"][1], np.arange(1, 200))


def test_every_column_is_in_the_records():
    record = {"seed": 0, **held(*drawn())}
    assert all(column.text(Row("row", [record, record])) != "-" for column in BENCH.columns)


def test_means_come_with_their_standard_error():
    assert mean("a")(Row("row", [{"a": 10.0}, {"a": 20.0}, {"a": 30.0}])) == "20 ± 6"
