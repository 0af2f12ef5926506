"""Wall directions are a density that particles learn: it is what a plain sum gives, and a round hall fools it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam.particles import equal_particles
from slam.wall_direction import align, wall_direction
from slam.walls import Walls
from tests.naive import wall_direction as naive
from tests.naive.walls import cast, random_walls, rectangle

GAIN, MEMORY, PRIOR, OUTLIERS = 1.0, 0.98, 2.0, 0.15
N_RAYS = 120


class Watcher:
    """Particles at headings (n,) that look at one wall direction after the other."""

    def __init__(self, headings, memory=MEMORY):
        self.poses = np.zeros((len(headings), 3), np.float32)
        self.poses[:, 2] = headings
        self.particles = equal_particles(np.zeros(len(headings)), np.zeros(len(headings)))
        self.memory, self.known = memory, 0.0

    def see(self, angle, strength=1.0):
        """What each gains by walls at four times `angle` rad of its own frame."""
        before = self.particles.log_weights.copy()
        seen = strength * math.cos(4.0 * angle), strength * math.sin(4.0 * angle)
        align(self.poses, self.particles, seen, self.known, GAIN, self.memory, PRIOR, OUTLIERS, 0, len(self.poses))
        self.known = self.memory * self.known + strength
        return self.particles.log_weights - before


@pytest.mark.parametrize("memory", [1.0, 0.9])
def test_it_agrees_with_a_sum_over_all_that_was_seen(memory):
    rng = np.random.default_rng(1)
    headings = rng.uniform(-math.pi, math.pi, 5)
    watcher, seen = Watcher(headings, memory), [[] for _ in headings]
    for _ in range(60):
        angle, strength = rng.uniform(-math.pi, math.pi), rng.uniform(0.1, 1.0)
        found = watcher.see(angle, strength)
        for p, heading in enumerate(headings):
            world = 4.0 * (angle + heading)
            likely = max(0.0, naive.density(world, seen[p], PRIOR))
            expected = strength * math.log((1.0 - OUTLIERS) * likely + OUTLIERS)
            assert found[p] == pytest.approx(expected, abs=2e-4)
            seen[p] = [(before, memory * weight) for before, weight in seen[p]] + [(world, strength)]


def test_a_density_of_all_directions_is_one_in_the_mean():
    rng = np.random.default_rng(2)
    seen = [(rng.uniform(0.0, 7.0), rng.uniform(0.1, 1.0)) for _ in range(9)]
    angles = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
    assert np.mean([naive.density(angle, seen, PRIOR) for angle in angles]) == pytest.approx(1.0)


def test_where_walls_stand_anyhow_there_is_little_to_gain_along_the_true_path():
    rng = np.random.default_rng(3)
    watcher = Watcher(np.zeros(1))
    gained = [watcher.see(rng.uniform(-math.pi, math.pi))[0] for _ in range(400)]
    assert abs(np.mean(gained[50:])) < 0.2
    assert max(gained[200:]) < 1.0


def test_a_path_bent_until_round_walls_stand_alike_gains():
    """Why some islands do without: what a round hall's walls tell is in favour of the wrong path."""
    true, bent = Watcher(np.zeros(1)), Watcher(np.zeros(1))
    gains = np.zeros(2)
    for step in range(60):
        angle = math.radians(5.0) * step
        bent.poses[0, 2] = -angle
        gains += true.see(angle)[0], bent.see(angle)[0]
    assert gains[0] < 5.0
    assert gains[1] > 20.0


def test_two_families_of_walls_are_two_peaks():
    rng = np.random.default_rng(4)
    watcher = Watcher(np.radians([0.0, 12.0]))
    straight, slanted = 0.0, math.radians(35.0)
    for _ in range(80):
        watcher.see((straight, slanted)[rng.integers(2)] + math.radians(2.0) * rng.normal())
    watcher.poses[1, 2] = np.radians(0.0)  # has learned everything 12 degrees away from what it sees now
    for angle in (straight, slanted, straight + 0.5 * math.pi):
        right, turned = watcher.see(angle)
        assert right > 0.8
        assert turned < right - 1.0
    assert watcher.see(0.5 * slanted)[0] < 0.0, "no walls stood between the two"


def test_faint_directions_count_little_and_none_say_nothing():
    watcher = Watcher(np.zeros(2))
    for _ in range(30):
        watcher.see(0.0)
    strong = watcher.see(0.0, 1.0)[0]
    assert 0.0 < watcher.see(0.0, 0.1)[0] < 0.11 * strong
    learned = watcher.particles.directions.copy()
    assert not watcher.see(0.0, 0.0).any()
    np.testing.assert_array_equal(watcher.particles.directions, learned)


def test_unlikely_walls_cost_no_more_than_the_outliers_share():
    watcher = Watcher(np.zeros(1))
    for _ in range(200):
        watcher.see(0.0)
    assert watcher.see(math.radians(45.0))[0] >= math.log(OUTLIERS) - 1e-9


# The direction of one vertex's walls


@pytest.mark.parametrize("seed", range(10))
def test_wall_direction_agrees_with_chord_by_chord(seed):
    walls = random_walls(seed)
    found = wall_direction(walls, step=3, enough=0.6, jump=0.15)
    assert found == pytest.approx(naive.wall_direction(walls, 3, 0.6, 0.15), abs=1e-12)
    assert abs(found) <= 1.0


@pytest.mark.parametrize("heading", np.linspace(-3.0, 3.0, 9))
def test_wall_direction_is_the_rooms_modulo_a_right_angle(heading):
    found = wall_direction(cast(np.array([0.1, -0.05, heading]), rectangle(0.0, 0.0, 1.4, 1.2), N_RAYS, 2.0))
    assert abs(found) > 0.8
    expected = complex(math.cos(4.0 * heading), -math.sin(4.0 * heading))
    assert found / abs(found) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("rays", [1, 7, 30, 100])
def test_turning_the_vertex_turns_its_wall_direction(rays):
    walls = random_walls(11)
    turned = Walls(np.roll(walls.distances, rays), np.roll(walls.free, rays))
    expected = wall_direction(walls) * np.exp(8j * math.pi * rays / N_RAYS)
    assert wall_direction(turned) == pytest.approx(complex(expected), abs=1e-9)


def test_what_has_no_direction_says_so():
    assert wall_direction(Walls(np.full(N_RAYS, math.inf), np.zeros(N_RAYS))) == 0.0
    assert wall_direction(Walls(np.zeros(N_RAYS), np.zeros(N_RAYS))) == 0.0, "walls without any length"
    assert abs(wall_direction(Walls(np.full(N_RAYS, 0.8), np.zeros(N_RAYS)))) < 1e-9
    scrap = np.full(N_RAYS, math.inf)
    scrap[:8] = 0.5
    assert 0.0 < abs(wall_direction(Walls(scrap, np.zeros(N_RAYS)))) < 0.4
