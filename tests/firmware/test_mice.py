"""Virtual mice count what their place goes by, in packets as Linux has them, and markings fool them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.mice import AHEAD, COUNTS_PER_METRE, PLACES, Floor, MousePlace, VirtualMouse, packet
from server.mouse_line import Decoder

CLEAN = Floor()


def counted(mouse: VirtualMouse, poses: np.ndarray) -> np.ndarray:
    """What it tells (2,) in all along poses (n, 3), a millisecond apart."""
    decoder = Decoder()
    found = [decoder.feed(mouse.advance(ms, pose)) for ms, pose in enumerate(poses)]
    assert not any(each.skipped or each.unsound for each in found)
    return np.array([[each.x, each.y] for each in found]).sum(axis=0)


def eased(last: float, n: int) -> np.ndarray:
    """From 0 to a value in n milliseconds, with a rest before and behind."""
    return np.concatenate([np.zeros(20), np.linspace(0.0, last, n), np.full(20, last)])


def straight(metres: float, heading: float = 0.0, n: int = 2000) -> np.ndarray:
    way = eased(metres, n)
    return np.column_stack([way * math.cos(heading), way * math.sin(heading), np.full(len(way), heading)])


@pytest.mark.parametrize(("x", "y"), [(0, 0), (127, -127), (-1, 1), (-127, 127)])
def test_a_packet_has_its_signs_and_the_bit_that_is_always_set(x, y):
    first, right, ahead = packet(x, y)
    assert first & 0xC8 == 0x08
    assert (bool(first & 0x10), bool(first & 0x20)) == (x < 0, y < 0)
    assert (right - 256 * (x < 0), ahead - 256 * (y < 0)) == (x, y)


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_one_whose_cable_leads_ahead_counts_ahead(heading):
    counts = np.array(
        [counted(VirtualMouse(MousePlace(0.1, 0.05, AHEAD), CLEAN, seed), straight(0.4, heading)) for seed in range(30)]
    )
    assert np.median(counts, axis=0) == pytest.approx([0.0, 0.4 * COUNTS_PER_METRE], abs=0.004 * 0.4 * COUNTS_PER_METRE)


def test_a_turn_on_the_spot_moves_it_sideways_by_its_arm():
    turn = eased(1.5, 2000)
    poses = np.column_stack([np.zeros_like(turn), np.zeros_like(turn), turn])
    counts = np.array([counted(VirtualMouse(MousePlace(0.1, 0.0, 0.0), CLEAN, seed), poses) for seed in range(30)])
    assert np.median(counts, axis=0) == pytest.approx(
        [0.0, 0.15 * COUNTS_PER_METRE], abs=0.004 * 0.15 * COUNTS_PER_METRE
    )


def test_what_does_not_fit_into_a_packet_comes_with_the_next():
    """At 1 m/s there are 315 counts in a hundredth of a second, and 127 fit."""
    fast = np.concatenate([straight(0.1, n=100), np.tile([0.1, 0.0, 0.0], (200, 1))])
    counts = counted(VirtualMouse(MousePlace(0.0, 0.0, 0.0), CLEAN, 3), fast)
    assert counts[0] == pytest.approx(0.1 * COUNTS_PER_METRE, rel=0.03)


def test_one_that_stands_or_is_unplugged_says_nothing():
    mouse = VirtualMouse(PLACES[0], CLEAN)
    assert b"".join(mouse.advance(ms, np.zeros(3)) for ms in range(100)) == b""
    mouse.is_plugged = False
    assert b"".join(mouse.advance(ms, pose) for ms, pose in enumerate(straight(0.1))) == b""


class Striped(Floor):
    """One marking from end to end."""

    def __init__(self, direction: float):
        super().__init__()
        self.direction = direction

    def marking(self, x: float, y: float) -> float:
        return self.direction


@pytest.mark.parametrize(("direction", "share"), [(0.0, 1.0), (0.25 * math.pi, 0.5), (0.5 * math.pi, 0.0)])
def test_over_a_marking_it_counts_only_what_leads_along_the_line(direction, share):
    counts = counted(VirtualMouse(MousePlace(0.0, 0.0, 0.0), Striped(direction), 1), straight(0.2))
    assert counts[0] == pytest.approx(share * 0.2 * COUNTS_PER_METRE, abs=0.03 * 0.2 * COUNTS_PER_METRE)


def test_markings_are_where_the_seed_has_them_and_as_dense_as_told():
    rng = np.random.default_rng(0)
    places = rng.uniform(-5.0, 5.0, (4000, 2))
    floor, again, other = Floor(0.4, 1), Floor(0.4, 1), Floor(0.4, 2)
    marked = [floor.marking(x, y) is not None for x, y in places]
    assert marked == [again.marking(x, y) is not None for x, y in places]
    assert marked != [other.marking(x, y) is not None for x, y in places]
    assert np.mean(marked) == pytest.approx(0.4 * 0.16 * 0.03 / 0.2**2, rel=0.3)  # but for those that overlap
    assert not any(Floor(0.0, 1).marking(x, y) for x, y in places)
