"""The roofline's arithmetic; what the machine can do is measured, not tested."""

from __future__ import annotations

import numpy as np
import pytest

from bench.roofline import Ceilings, Work, call, copy, look_up, multiply_and_add


def test_the_longest_part_is_the_bound():
    ceilings = Ceilings(bytes=1e9, lookups=1e8, flops=1e10, calls=1e7)
    assert Work(bytes=1e6, lookups=1e6, flops=1e6).seconds(ceilings) == (pytest.approx(1e-2), "lookups")
    assert Work(bytes=1e8, calls=1e5).seconds(ceilings) == (pytest.approx(0.1), "bytes")


def test_what_is_measured_does_what_it_says():
    rng = np.random.default_rng(1)
    source, target = rng.normal(size=100), np.zeros(100)
    copy(source, target)
    np.testing.assert_array_equal(source, target)
    table, places = rng.integers(-1, 2, 64).astype(np.int8), rng.integers(0, 64, 50).astype(np.uint32)
    assert look_up(table, places, 3) == 3 * table[places].sum()
    values = rng.uniform(0.5, 2.0, 10)
    assert call(values, 1) == pytest.approx(np.sum(np.log(values) + np.exp(values) + np.sin(values) + np.cos(values)))
    expected = values.copy()
    for _ in range(15):
        expected = expected * 0.999 + 0.001
    multiply_and_add(values, 1)
    np.testing.assert_allclose(values, expected)
