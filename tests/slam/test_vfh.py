"""The vector field histogram: its density is a twin's, turns with the robot, and steers where there is room."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from slam.grid import Grid
from slam.vfh import Vfh, VfhParams
from tests.naive import vfh as naive

HOME = np.zeros(3)
SECTOR = 2.0 * math.pi / 72


def local_map(is_wall, n=80, resolution=0.025, log_odds=2.5):
    """Grid around the origin whose cells are walls where is_wall(x, y), else free."""
    centres = (np.arange(n) + 0.5 - n / 2) * resolution
    x, y = np.meshgrid(centres, centres)
    cells = np.where(is_wall(x, y), log_odds, -2.0).astype(np.float32)
    return Grid(cells, resolution, -0.5 * n * resolution, -0.5 * n * resolution)


def noise_map(seed, n=24, resolution=0.1, share=0.05):
    """Grid of random log odds, few of them positive."""
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((n, n)) < share, rng.uniform(0.0, 3.0, (n, n)), rng.uniform(-3.0, 0.0, (n, n)))
    return Grid(cells.astype(np.float32), resolution, -0.5 * n * resolution, -0.5 * n * resolution)


def wall_ahead(distance):
    return local_map(lambda x, y: (x > distance) & (x < distance + 0.06))


def corridor(width):
    return local_map(lambda x, y: (np.abs(y) > width / 2) & (np.abs(y) < width / 2 + 0.06))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("smoothing", [0, 1, 5])
def test_histogram_agrees_with_cell_by_cell(seed, smoothing):
    params = VfhParams(smoothing=smoothing, sectors=36)
    rng = np.random.default_rng(seed)
    grid, pose = noise_map(seed), rng.uniform(-1.0, 1.0, 3)
    expected = naive.histogram(grid, pose, params)
    np.testing.assert_allclose(Vfh(params).histogram(grid, pose), expected, rtol=1e-5, atol=1e-9)
    near = naive.histogram(grid, pose, params, limit=0.5)
    np.testing.assert_allclose(Vfh(params).histogram(grid, pose, limit=0.5), near, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("sectors_turned", [1, 7, 36, -20])
def test_turning_the_robot_turns_the_histogram(sectors_turned):
    vfh, grid = Vfh(VfhParams()), noise_map(5, 80, 0.025)
    before = vfh.histogram(grid, np.array([0.013, -0.007, 0.2001]))
    after = vfh.histogram(grid, np.array([0.013, -0.007, 0.2001 + sectors_turned * SECTOR]))
    np.testing.assert_allclose(after, np.roll(before, -sectors_turned), atol=1e-12)


def test_turning_the_world_turns_the_histogram():
    vfh, grid = Vfh(VfhParams()), noise_map(6, 80, 0.025)
    turned = grid._replace(cells=np.ascontiguousarray(np.rot90(grid.cells, -1)))  # rows are y: this turns ccw
    before = vfh.histogram(grid, np.array([0.0, 0.0, 0.3]))
    np.testing.assert_allclose(vfh.histogram(turned, np.array([0.0, 0.0, 0.3 + math.pi / 2])), before, atol=1e-12)
    np.testing.assert_allclose(vfh.histogram(turned, np.array([0.0, 0.0, 0.3])), np.roll(before, 18), atol=1e-12)


def test_moving_robot_and_world_together_changes_nothing():
    vfh, grid = Vfh(VfhParams()), noise_map(7, 80, 0.025)
    moved = grid._replace(x=grid.x + 32.0, y=grid.y - 64.0)
    before = vfh.histogram(grid, np.array([0.1, -0.2, 1.0]))
    np.testing.assert_allclose(vfh.histogram(moved, np.array([32.1, -64.2, 1.0])), before, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(arrays.arrays(np.float32, (12, 12), elements=st.floats(-3, 3, width=32)), st.integers(0, 143), st.floats(0, 3))
def test_density_rises_with_certainty(cells, index, more):
    vfh = Vfh(VfhParams())
    surer = cells.copy()
    surer.flat[index] += np.float32(more)
    before = vfh.histogram(Grid(cells, 0.1, -0.6, -0.6), HOME)
    assert np.all(vfh.histogram(Grid(surer, 0.1, -0.6, -0.6), HOME) >= before - 1e-12)


def test_density_falls_with_distance_and_ends_at_the_reach():
    vfh = Vfh(VfhParams())
    ahead = [vfh.histogram(wall_ahead(distance), HOME)[0] for distance in (0.3, 0.5, 0.7, 0.9)]
    assert np.all(np.diff(ahead) < 0.0)
    assert not vfh.histogram(local_map(lambda x, y: np.hypot(x, y) > 1.0, n=120), HOME).any()


def test_density_does_not_depend_on_the_size_of_cells():
    densities = []
    for resolution in (0.0125, 0.025):
        grid = local_map(lambda x, y: (x > 0.4) & (x < 0.5), round(2.0 / resolution), resolution)
        densities.append(Vfh(VfhParams()).histogram(grid, HOME))
    np.testing.assert_allclose(densities[0][:9], densities[1][:9], rtol=0.15)


def test_an_empty_map_is_open_all_round():
    vfh = Vfh(VfhParams())
    densities = vfh.histogram(local_map(lambda x, y: x > 99.0), HOME)
    assert not densities.any()
    assert vfh.valleys(densities) == [(-math.pi, math.pi)]
    for goal in (0.0, 0.5, -3.0):
        steering = vfh.steer(densities, goal)
        assert steering.bearing == pytest.approx(goal)
    assert vfh.steer(densities, 0.0).speed == VfhParams().max_speed


def test_an_unknown_map_is_open():
    densities = Vfh(VfhParams()).histogram(Grid(np.zeros((80, 80), np.float32), 0.025, -1.0, -1.0), HOME)
    assert not densities.any()


@pytest.mark.parametrize("distance", [0.25, 0.4, 0.6])
def test_a_wall_ahead_is_steered_round(distance):
    vfh = Vfh(VfhParams())
    steering = vfh.steer(vfh.histogram(wall_ahead(distance), HOME), 0.0)
    assert steering.bearing is not None
    assert abs(steering.bearing) > math.radians(60.0)
    assert steering.speed < 0.05


def test_a_closed_ring_leaves_no_way():
    vfh = Vfh(VfhParams())
    densities = vfh.histogram(local_map(lambda x, y: np.abs(np.hypot(x, y) - 0.35) < 0.04), HOME)
    assert vfh.valleys(densities) == []
    assert vfh.steer(densities, 0.0) == (None, 0.0, None)


@pytest.mark.parametrize("width", [0.6, 1.0, 1.5])
def test_a_corridor_is_driven_along_its_middle(width):
    vfh = Vfh(VfhParams())
    densities = vfh.histogram(corridor(width), HOME)
    assert len(vfh.valleys(densities)) == 2
    steering = vfh.steer(densities, 0.3)
    assert steering.bearing is not None
    assert abs(steering.bearing) < 0.31
    assert vfh.steer(densities, 0.0).bearing == pytest.approx(0.0, abs=SECTOR)
    assert vfh.steer(densities, math.pi).bearing == pytest.approx(math.pi, abs=SECTOR) or width == 1.5


@pytest.mark.parametrize(("width", "is_open"), [(0.3, False), (0.36, False), (0.5, True), (0.6, True)])
def test_a_door_is_open_if_robot_and_clearance_fit(width, is_open):
    params = VfhParams()
    assert (width > 2.0 * params.half_width) == is_open
    vfh = Vfh(params)
    densities = vfh.histogram(local_map(lambda x, y: (np.abs(x - 0.4) < 0.03) & (np.abs(y) > width / 2)), HOME)
    assert (densities[0] < params.threshold) == is_open


def test_a_thin_pole_is_not_overlooked():
    vfh = Vfh(VfhParams())
    densities = vfh.histogram(local_map(lambda x, y: np.hypot(x - 0.4, y) < 0.03), HOME)
    assert densities[0] > vfh.params.threshold


@settings(max_examples=200, deadline=None)
@given(arrays.arrays(bool, 24))
def test_valleys_are_the_arcs_below_the_threshold(is_open):
    params = VfhParams(sectors=24)
    densities = np.where(is_open, 0.0, 1.0)
    expected = naive.valleys(densities, params.threshold)
    found = Vfh(params).valleys(densities)
    assert len(found) == len(expected)
    for (start, end), arc in zip(found, expected, strict=True):
        assert end - start == pytest.approx(len(arc) * 2.0 * math.pi / 24)
        assert -math.pi <= start <= math.pi
        middle = 2.0 * math.pi / 24 * (arc[0] + (len(arc) - 1) / 2)
        if len(arc) < 24:
            assert math.remainder((start + end) / 2 - middle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def in_valley(valley, bearing):
    start, end = valley
    return (bearing - start + 1e-9) % (2.0 * math.pi) <= end - start + 2e-9


@settings(max_examples=200, deadline=None)
@given(arrays.arrays(bool, 72), st.floats(-4.0, 4.0), st.none() | st.floats(-3.0, 3.0))
def test_steering_stays_in_a_valley_and_the_nearest_one(is_open, goal, last_bearing):
    vfh = Vfh(VfhParams())
    densities = np.where(is_open, 0.0, 1.0)
    steering = vfh.steer(densities, goal, last_bearing)
    valleys = vfh.valleys(densities)
    if steering.bearing is None or steering.valley is None:
        assert not valleys
        return
    assert -math.pi < steering.bearing <= math.pi
    assert steering.valley in valleys
    assert in_valley(steering.valley, steering.bearing)
    assert 0.0 <= steering.speed <= vfh.params.max_speed
    holding = [valley for valley in valleys if in_valley(valley, goal)]
    if holding:
        assert steering.valley in holding
    elif last_bearing is None:
        gaps = [min((start - goal) % (2 * math.pi), (goal - end) % (2 * math.pi)) for start, end in valleys]
        chosen = gaps[valleys.index(steering.valley)]
        assert chosen == pytest.approx(min(gaps), abs=1e-9)


def open_between(first, last):
    """Densities with one valley, from sector first to last."""
    densities = np.ones(72)
    densities[np.arange(first, last + 1) % 72] = 0.0
    return densities


def test_a_narrow_valley_is_entered_in_its_middle():
    vfh = Vfh(VfhParams(wide_valley_deg=60.0))
    for goal in (0.4, 0.2, 0.6, -1.0):
        assert vfh.steer(open_between(3, 9), goal).bearing == pytest.approx(6 * SECTOR)


def test_a_wide_valley_is_entered_off_its_sides_and_at_the_goal_between():
    vfh = Vfh(VfhParams(wide_valley_deg=60.0))
    densities = open_between(-18, 17)  # edges at -92.5 and 87.5 degrees
    for goal, bearing in ((0.0, 0.0), (40.0, 40.0), (80.0, 57.5), (100.0, 57.5), (-91.0, -62.5), (-150.0, -62.5)):
        found = vfh.steer(densities, math.radians(goal)).bearing
        assert found is not None
        assert math.degrees(found) == pytest.approx(bearing)


def test_of_two_equal_ways_the_one_begun_is_kept():
    vfh = Vfh(VfhParams())
    densities = np.zeros(72)
    densities[:6] = densities[-5:] = 1.0
    for begun in (1.2, -1.2):
        bearing = vfh.steer(densities, 0.0, begun).bearing
        assert bearing is not None
        assert bearing * begun > 0.0


def test_speed_falls_with_obstacles_ahead_and_with_the_turn():
    vfh = Vfh(VfhParams())
    densities = np.zeros(72)
    speeds = [vfh.steer(densities + ahead, 0.0).speed for ahead in (0.0, 0.002, 0.005, 0.009)]
    assert np.all(np.diff(speeds) < 0.0)
    turns = [vfh.steer(densities, bearing).speed for bearing in (0.0, 0.4, 0.8, 1.6, 3.0)]
    assert np.all(np.diff(turns[:4]) < 0.0)
    assert turns[3:] == [0.0, 0.0]


def drive(is_wall, heading, goal):
    """Drive a disc by the true map; the nearest that it came to a wall (m), and whether it arrived in two minutes."""
    vfh, resolution, step = Vfh(VfhParams()), 0.025, 0.08
    grid = Grid(np.where(is_wall, 2.5, -2.0).astype(np.float32), resolution, 0.0, 0.0)
    walls = (np.argwhere(is_wall)[:, ::-1] + 0.5) * resolution
    x, y, last_bearing, nearest = 0.5, 0.5, None, math.inf
    for _ in range(1500):
        distance = math.hypot(goal[0] - x, goal[1] - y)
        if distance < 0.2:
            return nearest, True
        densities = vfh.histogram(grid, np.array([x, y, heading]), distance)
        bearing, speed, _ = vfh.steer(densities, math.atan2(goal[1] - y, goal[0] - x) - heading, last_bearing)
        assert bearing is not None
        turn = step * min(max(2.0 * bearing, -1.5), 1.5)
        heading, last_bearing = heading + turn, bearing - turn
        x, y = x + speed * step * math.cos(heading), y + speed * step * math.sin(heading)
        nearest = min(nearest, np.hypot(*(walls - (x, y)).T).min())
    return nearest, False


@pytest.mark.parametrize("seed", range(6))
def test_a_disc_gets_through_a_room_of_pillars_untouched(seed):
    rng = np.random.default_rng(seed)
    centres = (np.arange(200) + 0.5) * 0.025
    x, y = np.meshgrid(centres, centres)
    is_wall = (np.minimum(x, y) < 0.05) | (np.maximum(x, y) > 4.95)
    for _ in range(10):
        pillar = rng.uniform(0.8, 4.2, 2)
        is_wall |= np.hypot(x - pillar[0], y - pillar[1]) < rng.uniform(0.03, 0.15)
    nearest, has_arrived = drive(is_wall, rng.uniform(-3.0, 3.0), (4.5, 4.5))
    assert has_arrived
    assert nearest > VfhParams().robot_radius + 0.05


@pytest.mark.parametrize(("key", "value"), [("sectors", 3), ("threshold", 0.0), ("treshold", 1.0), ("clearance", -0.1)])
def test_a_wrong_key_or_value_is_named(key, value):
    with pytest.raises(ValueError, match=key):
        VfhParams(**{key: value})


def test_the_thesis_sums_every_cell_along_a_direction():
    """Certainty squared, falling linearly from the centre, summed radially (thesis, 2.2); a cell in its own sector."""
    grid = noise_map(3)
    params = VfhParams(radial_sum=True, robot_radius=0.0, clearance=0.0, smoothing=0, reach=1.0)
    expected = np.zeros(72)
    for (row, column), value in np.ndenumerate(grid.cells):
        x, y = (column + 0.5) * 0.1 + grid.x, (row + 0.5) * 0.1 + grid.y
        distance = math.hypot(x, y)
        if value > 0.0 and 0.05 <= distance < 1.0:
            certainty = 2.0 / (1.0 + math.exp(-float(value))) - 1.0
            expected[round(math.atan2(y, x) / SECTOR) % 72] += 0.1 * certainty**2 * (1.0 - distance)
    assert np.count_nonzero(expected) > 5
    np.testing.assert_allclose(Vfh(params).histogram(grid, HOME), expected, atol=1e-6)
