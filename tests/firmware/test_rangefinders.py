"""What the simulated sonars and GP2D12 show, against geometry and the datasheet's curve."""

import math
from typing import Any

import numpy as np
import pytest

from firmware.virtual import World
from firmware.virtual.native import native
from tests.firmware.virtual_wire import room

FFI, LIB, _ = native()


class Ring:
    """The C sensors at a place of a world."""

    def __init__(self, world: World, seed: int = 1):
        self.world = world
        self.state: Any = FFI.new("struct rangefinders *")
        LIB.rangefinders_init(self.state, world.caster, seed)
        self.eight: Any = FFI.new("double[8]")

    def sonar(self, x=0.0, y=0.0, heading=0.0, tilt=0.0, fired=0x55):
        LIB.sonar_ping(self.state, FFI.new("struct place *", [x, y, heading, tilt]), fired, self.eight)
        return np.array(list(self.eight))

    def infrared(self, x=0.0, y=0.0, heading=0.0, tilt=0.0):
        LIB.infrared_look(self.state, FFI.new("struct place *", [x, y, heading, tilt]), self.eight)
        return np.array(list(self.eight))

    def pings(self, count, **place):
        return np.array([self.sonar(**place) for _ in range(count)])


@pytest.mark.parametrize("skew", [0.0, 0.15, -0.25])
def test_sonar_of_a_flat_wall_is_the_perpendicular_distance(skew):
    """Echoes come from the wall's normal while it lies within the cone, not from the axis."""
    ring = Ring(World(np.array([[1.5, -9.0, 1.5, 9.0]])))
    heading = skew
    face = 0.07 * math.cos(skew)
    ranges = ring.pings(400, heading=heading)[:, 0]
    echoes = ranges[np.isfinite(ranges)]
    assert len(echoes) > 350
    assert np.median(echoes) == pytest.approx(1.5 - face, rel=0.02)


def test_sonar_noise_is_8_mm_and_point_8_percent():
    ring = Ring(World(np.array([[1.57, -9.0, 1.57, 9.0]])))
    ranges = ring.pings(3000)[:, 0]
    near = ranges[np.abs(ranges - 1.5) < 0.1]
    assert np.std(near) == pytest.approx(0.008 + 0.008 * 1.5, rel=0.1)
    assert np.mean(np.isinf(ranges)) == pytest.approx(0.02, abs=0.012)


def test_sonar_loses_walls_that_mirror_it_away():
    oblique = Ring(World(np.array([[-9.0, -9.0 + 0.3, 9.0, 9.0 + 0.3]])))  # at 45 degrees to sonar 0
    assert np.mean(np.isfinite(oblique.pings(300)[:, 0])) < 0.05


def test_corners_send_the_ping_back():
    corner = Ring(World(np.array([[1.5, 0.0, 0.0, 1.5], [1.5, 0.0, 0.0, -1.5]])))  # both walls at 45 degrees
    ranges = corner.pings(300)[:, 0]
    assert np.mean(np.abs(ranges - 1.43) < 0.1) > 0.65  # the rest comes off the walls at the cone's borders


def test_the_nearest_of_two_walls_wins():
    ring = Ring(World(np.array([[1.0, 0.05, 1.0, 3.0], [2.0, -9.0, 2.0, 9.0]])))
    ranges = ring.pings(200)[:, 0]
    assert np.median(ranges) == pytest.approx(0.93, abs=0.03)


def test_sonars_that_did_not_fire_keep_silent():
    ring = Ring(room(2.0, 2.0))
    for i in range(8):
        ring.eight[i] = -1.0
    ranges = ring.sonar(fired=0b10)
    assert [i for i in range(8) if ranges[i] != -1.0] == [1]


def test_crosstalk_brings_a_neighbours_shorter_echo():
    """Sonar 0 looks into the open; what it hears must have been meant for 2 or 6, which see a wall at 0.43 m."""
    ring = Ring(World(np.array([[-9.0, 0.5, 9.0, 0.5], [-9.0, -0.5, 9.0, -0.5]])))
    ranges = ring.pings(6000)[:, 0]
    mixed = np.mean((ranges > 0.40) & (ranges < 0.66))
    assert 0.008 < mixed < 0.025
    alone = Ring(ring.world)
    quiet = alone.pings(6000, fired=1)[:, 0]
    assert np.mean((quiet > 0.40) & (quiet < 0.66)) < 0.004


def test_ghosts_appear_where_nothing_is():
    ranges = Ring(World(np.empty((0, 4)))).pings(8000)[:, 0]
    assert np.mean(np.isfinite(ranges)) == pytest.approx(0.008, abs=0.003)


def test_no_sonar_reads_less_than_it_can():
    ranges = Ring(room(0.16, 0.16)).pings(200)
    assert np.nanmin(ranges[:, ::2]) >= 0.03


def test_infrared_measures_along_its_beam():
    ring = Ring(room(1.0, 1.4))
    expected = [0.45, math.hypot(0.5, 0.5) - 0.05, 0.65]
    assert ring.infrared()[:3] == pytest.approx(expected, abs=1e-9)


def test_a_lean_lengthens_the_beam_and_finds_the_floor():
    tilt = 0.2
    wall = Ring(World(np.array([[0.5, -9.0, 0.5, 9.0]])))
    forward = 0.05 * math.cos(tilt) + (0.203 - 0.0508) * math.sin(tilt)
    assert wall.infrared(tilt=tilt)[0] == pytest.approx((0.5 - forward) / math.cos(tilt), abs=1e-9)
    floor = Ring(World(np.empty((0, 4))))
    tilt = 0.5
    height = 0.0508 + (0.203 - 0.0508) * math.cos(tilt) - 0.05 * math.sin(tilt)
    distances = floor.infrared(tilt=tilt)
    assert distances[0] == pytest.approx(height / math.sin(tilt), abs=1e-9)
    assert np.all(np.isinf(distances[[2, 4, 6]]))


def test_a_leaning_sonar_still_sees_an_upright_wall_at_its_distance():
    tilt = 0.1
    ring = Ring(World(np.array([[1.5, -9.0, 1.5, 9.0]])))
    forward = 0.07 * math.cos(tilt) + (0.152 - 0.0508) * math.sin(tilt)
    assert np.median(ring.pings(300, tilt=tilt)[:, 0]) == pytest.approx(1.5 - forward, abs=0.01)


def test_a_leaning_sonar_hears_the_floor_once_its_cone_comes_near_the_floors_normal():
    """A smooth floor mirrors the ping away at a driver's leans; a robot that is falling hears it."""
    ring = Ring(World(np.empty((0, 4))))
    driving = ring.pings(400, tilt=0.3)
    assert np.mean(np.isfinite(driving[:, 0])) < 0.02  # ghosts
    tilt = 0.8
    height = 0.0508 + (0.152 - 0.0508) * math.cos(tilt) - 0.07 * math.sin(tilt)
    falling = ring.pings(400, tilt=tilt)
    echoes = falling[np.isfinite(falling[:, 0]), 0]
    assert len(echoes) > 100
    assert np.median(echoes) == pytest.approx(height / math.sin(tilt + math.radians(22.5)), abs=0.01)
    assert np.mean(np.isfinite(falling[:, 4])) < 0.02  # the one behind looks up


@pytest.mark.parametrize("centimetres", [8, 10, 20, 40, 80])
def test_gp2d12_follows_its_curve(centimetres):
    assert LIB.infrared_counts(centimetres / 100) == pytest.approx(6787 / (centimetres + 4) + 3)


def test_gp2d12_folds_back_below_8_cm():
    near = [LIB.infrared_counts(d) for d in np.linspace(0.005, 0.08, 20)]
    assert np.all(np.diff(near) > 0.0)
    read_as = 6787 / (LIB.infrared_counts(0.03) - 3) - 4
    assert 10.0 < read_as < 25.0  # 3 cm looks like a wall far outside the robot


def test_gp2d12_noise_is_in_the_counts_and_far_means_far():
    ring = Ring(World(np.empty((0, 4))))
    for distance, spread in ((0.3, 5.3), (0.8, 5.1)):
        counts = np.array([LIB.infrared_read(ring.state, distance) for _ in range(4000)])
        assert np.median(counts) == pytest.approx(LIB.infrared_counts(distance), abs=1.0)
        assert np.diff(np.quantile(counts, [0.16, 0.84]))[0] / 2 == pytest.approx(spread, rel=0.2)
    far = np.array([LIB.infrared_read(ring.state, math.inf) for _ in range(2000)])
    assert np.mean(6787 / (np.maximum(far, 4.0) - 3) - 4 > 80.0) > 0.99


def test_a_grazing_wall_returns_too_little_light():
    along = Ring(World(np.array([[-5.0, 0.02, 5.0, -0.1]])))
    assert np.isinf(along.infrared(x=-3.0)[0])
