"""Random mazes are whole, rearranged by every seed, and seen by a laser that speaks SCIP 2.0."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.virtual.mazes import BOARD, CELL, SIZES, maze, neighbours, passages
from firmware.virtual.urg import FIRST, LAST, PERIOD_MS, REACH, VirtualUrg
from firmware.virtual.worlds import World
from server.scip import Answer, Decoder, Sweep, laser_of, start
from slam.laser_scan import LaserParams

SQUARE = World(np.array([[-1, -1, 1, -1], [1, -1, 1, 1], [1, 1, -1, 1], [-1, 1, -1, -1]], float))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(5))
def test_every_cell_of_a_maze_can_be_reached(size, seed):
    columns, rows = SIZES[size]
    open_pairs = passages(columns, rows, np.random.default_rng(seed))
    reached, edge = {(0, 0)}, [(0, 0)]
    while edge:
        cell = edge.pop()
        for other in neighbours(cell, columns, rows):
            if other not in reached and frozenset((cell, other)) in open_pairs:
                reached.add(other)
                edge.append(other)
    assert len(reached) == columns * rows
    assert len(open_pairs) > columns * rows - 1, "there are loops"


def test_ways_between_cells_are_open_in_the_world_and_others_are_closed():
    columns, rows = SIZES["medium"]
    for seed in range(3):
        world = maze("medium", seed)
        open_pairs = passages(columns, rows, np.random.default_rng(seed))
        for x in range(columns):
            for y in range(rows):
                for u, v in neighbours((x, y), columns, rows):
                    way = float(world.cast(CELL * x, CELL * y, math.atan2(v - y, u - x)))
                    if frozenset(((x, y), (u, v))) in open_pairs:
                        assert way > CELL
                    else:
                        assert way == pytest.approx(0.5 * (CELL - BOARD))


def test_seeds_and_sizes_make_other_mazes_and_the_same_ones_again():
    assert np.array_equal(maze("large", 3).segments, maze("large", 3).segments)
    assert not np.array_equal(maze("large", 3).segments, maze("large", 4).segments)
    assert maze((4, 9), 0).bounds == pytest.approx((-0.306, -0.306, 3.5 * CELL + 0.006, 8.5 * CELL + 0.006))


@pytest.mark.parametrize("size", ["huge", (1, 5)])
def test_mazes_that_are_none_are_refused(size):
    with pytest.raises(ValueError, match="maze of"):
        maze(size, 0)


def heard(urg: VirtualUrg, ms: int) -> list[Sweep | Answer]:
    decoder = Decoder()
    found = list(decoder.feed(urg.advance(ms)))
    assert not decoder.rejected
    return found


def test_a_laser_tells_of_itself_and_of_what_it_sees():
    urg = VirtualUrg(SQUARE, lambda t: np.array([0.2, -0.1, 0.5]))
    urg.write(b"PP\r" + start(FIRST, LAST))
    particulars, begun, *sweeps = heard(urg, 1000)
    assert isinstance(particulars, Answer)
    assert laser_of(particulars) == LaserParams(), "the default laser is this one"
    assert isinstance(begun, Answer)
    assert begun.status == "00"
    assert [sweep.time_ms for sweep in sweeps if isinstance(sweep, Sweep)] == list(range(0, 1000, PERIOD_MS))
    ranges = np.array([sweep.ranges for sweep in sweeps if isinstance(sweep, Sweep)])
    true = SQUARE.cast(0.2, -0.1, 0.5 + LaserParams().bearings)
    off = ranges - true
    assert np.abs(np.nanmean(off, axis=0)).max() < 0.01
    assert 0.001 < np.nanstd(off) < 0.01
    assert 0.0 < np.isnan(ranges).mean() < 0.05


def test_a_turning_robot_bends_what_it_sees():
    """At 3 rad/s the last beams are measured 0.2 rad later than the first: walls are not where they are."""
    rate = 3.0
    urg = VirtualUrg(SQUARE, lambda t: np.array([0.0, 0.0, rate * t]))
    urg.write(start(FIRST, LAST))
    sweep = heard(urg, 300)[-1]
    assert isinstance(sweep, Sweep)
    bearings, end = LaserParams().bearings, 0.3
    steps = np.arange(FIRST, LAST + 1)
    still = SQUARE.cast(0.0, 0.0, rate * end + bearings)
    moving = SQUARE.cast(0.0, 0.0, rate * (end - 0.1 * (1.0 - steps / 1024)) + bearings)
    assert np.nanmedian(np.abs(sweep.ranges - moving)) < 0.01
    assert np.nanquantile(np.abs(sweep.ranges - still), 0.9) > 0.1


def test_beyond_its_reach_it_sees_nothing():
    far = World(np.array([[REACH + 0.3, -50.0, REACH + 0.3, 50.0]]))
    urg = VirtualUrg(far, lambda t: np.zeros(3))
    urg.write(start(FIRST, LAST))
    sweep = heard(urg, 200)[-1]
    assert isinstance(sweep, Sweep)
    assert np.all(np.isnan(sweep.ranges))


@pytest.mark.parametrize(
    ("request_", "status"),
    [(b"MD0044\n", "0C"), (b"MD0900012001000\n", "05"), (b"MD0044200001000\n", "04"), (b"XX\n", "0E"), (b"QT\n", "00")],
)
def test_requests_are_answered_with_their_status(request_, status):
    urg = VirtualUrg(SQUARE, lambda t: np.zeros(3))
    urg.write(request_[:3])
    urg.write(request_[3:])
    [answer] = heard(urg, 300)
    assert isinstance(answer, Answer)
    assert answer.status == status


def test_so_many_sweeps_as_asked_for_and_none_after_it_is_switched_off():
    urg = VirtualUrg(SQUARE, lambda t: np.zeros(3))
    urg.write(b"MD0044072503003\n")
    _, *sweeps = heard(urg, 1000)
    assert [len(sweep.ranges) for sweep in sweeps if isinstance(sweep, Sweep)] == [228] * 3
    urg.write(start(FIRST, LAST))
    assert len(heard(urg, 250)) == 3
    urg.write(b"QT\n")
    assert len(heard(urg, 500)) == 1
