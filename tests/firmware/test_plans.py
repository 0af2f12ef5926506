"""Plans read or refused, the driver that follows them, and routes through real and made-up floors."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from firmware.virtual import Plan, PlanError, World, corridor_plan, load_plan, load_world, route, tour
from firmware.virtual.plans import Driver
from firmware.virtual.routes import CLEARANCE
from tests.firmware.virtual_wire import room
from tests.naive import caster as naive

DATA = Path(os.environ.get("CRUNCH_DATA", Path(__file__).parents[2] / "data")) / "maps"


def follow(plan, seconds=600.0, step=0.02):
    """Poses (n, 3) of a point that obeys the driver exactly, and the time it took."""
    driver = Driver(plan)
    x, y, heading = plan.start
    poses, time = [], 0.0
    while not driver.finished and time < seconds:
        speed, turn = driver.step(x, y, heading, step)
        heading += turn * step
        x, y = x + speed * math.cos(heading) * step, y + speed * math.sin(heading) * step
        poses.append((x, y, heading))
        time += step
    return np.array(poses), time


def off_the_line(plan, poses):
    walls = np.hstack([plan.points[:-1], plan.points[1:]])
    walls = walls[np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > 0.0]
    return max(naive.clearance(walls, x, y) for x, y, _ in poses[::20])


def test_the_driver_keeps_to_the_line_at_its_speed():
    plan = Plan.through(np.array([[0, 0], [4, 0], [4, 3], [0, 3]]), 0.3)
    poses, time = follow(plan)
    assert off_the_line(plan, poses) < 0.12
    assert poses[-1][:2] == pytest.approx([0.0, 3.0], abs=0.07)
    assert time == pytest.approx(plan.length / 0.3, rel=0.1)


def test_the_driver_turns_back_on_its_own_way():
    plan = Plan.through(np.array([[0, 0], [3, 0], [0, 0.0]]), 0.3)
    poses, _ = follow(plan)
    assert poses[:, 0].max() > 2.9
    assert poses[-1][:2] == pytest.approx([0.0, 0.0], abs=0.08)


def test_pauses_are_kept_and_laps_unrolled(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text("laps = 2\nclosed = true\nwaypoints = [[0, 0], {at = [1, 0], pause = 2.5, speed = 0.2}, [1, 1]]\n")
    plan = load_plan(path)
    assert len(plan.points) == 7
    assert plan.length == pytest.approx(2 * (2 + math.sqrt(2)))
    poses, time = follow(plan)
    still = np.hypot(*np.diff(poses[:, :2], axis=0).T) == 0.0
    assert 0.02 * still.sum() > 5.0
    assert time > 5.0 + plan.length / 0.3


@pytest.mark.parametrize("name", ["demo", "corridor50"])
def test_built_in_plans_stay_clear_of_their_worlds_walls(name):
    plan = load_plan(name)
    assert plan.world == name
    poses, _ = follow(plan, 2000.0)
    assert load_world(name).clearances(poses[:, :2], 5.0).min() > 0.2
    assert poses[-1][:2] == pytest.approx(plan.points[-1], abs=0.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("waypoints = [[0, 0]]", "waypoints: needs at least two"),
        ("waypoints = [[0, 0], [1]]", r"waypoints\[1\]: needs a list of 2 numbers"),
        ("waypoints = [[0, 0], {at = [1, 1], sped = 1}]", r"waypoints\[1\]: needs \[x, y\] or"),
        ("laps = 0\nwaypoints = [[0, 0], [1, 1]]", "laps: needs a whole number from 1"),
        ("speed = -1\nwaypoints = [[0, 0], [1, 1]]", "speed: needs a number above 0"),
        ("sped = 1\nwaypoints = [[0, 0], [1, 1]]", "sped: unknown key"),
    ],
)
def test_bad_plans_name_file_place_and_remedy(tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(PlanError, match=r"bad\.toml: " + message):
        load_plan(path)


def test_missing_plans_are_told_what_there_is():
    with pytest.raises(PlanError, match="built-in: corridor50, demo"):
        load_plan("nowhere")


def test_corridor_plans_wander_but_keep_off_the_walls():
    plan = corridor_plan(3, laps=2.2)
    assert plan.length == pytest.approx(107.0, rel=0.03)
    steps = np.hypot(*np.diff(plan.points, axis=0).T)
    assert steps.max() < 0.2
    lower = plan.points[(plan.points[:, 1] < 1.0) & (plan.points[:, 0] > 2) & (plan.points[:, 0] < 14)]
    assert 0.05 < np.std(lower[:, 1]) < 0.2
    assert np.abs(lower[:, 1]).max() <= 0.31


def test_a_reversed_plan_comes_back_the_other_way():
    plan = corridor_plan(3, laps=2.0, reverse=True)
    half = len(plan.points) // 2
    back = plan.points[half:][::-1]
    assert np.hypot(*(back - plan.points[:half]).T).max() < 0.7
    assert np.hypot(*np.diff(plan.points, axis=0).T).max() < 0.7


def two_rooms() -> World:
    """Two rooms of 4 x 4 m beside each other, a door of 1 m between them at the far end."""
    walls = [[0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0], [4, 0, 4, 2.8], [4, 3.8, 4, 4]]
    return World(np.array(walls, float), (1.0, 1.0, 0.0))


def test_routes_find_the_door():
    plan = route(two_rooms(), [(1.0, 1.0), (7.0, 1.0)])
    assert plan.points[0] == pytest.approx([1.0, 1.0], abs=0.08)
    assert plan.points[-1] == pytest.approx([7.0, 1.0], abs=0.08)
    door = plan.points[np.argmin(np.abs(plan.points[:, 0] - 4.0))]
    assert 3.0 < door[1] < 3.6
    assert two_rooms().clearances(plan.points, 5.0).min() > CLEARANCE - 0.06


def test_places_that_cannot_be_reached_are_named():
    world = World(np.vstack([room(4.0, 4.0).segments, room(40.0, 40.0).segments]))
    with pytest.raises(PlanError, match=r"\(15, 0\) cannot be reached"):
        route(world, [(0.0, 0.0), (15.0, 0.0)])
    with pytest.raises(PlanError, match="at least two"):
        route(world, [(0.0, 0.0)])
    with pytest.raises(PlanError, match="nowhere to drive"):
        route(room(0.3, 0.3), [(0.0, 0.0), (0.1, 0.0)])


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no maps in {DATA}; set CRUNCH_DATA")
@pytest.mark.parametrize("name", ["freiburg.map", "longwood.map"])
def test_tours_of_real_floors_come_back_and_keep_clear(name):
    world = load_world(DATA / name)
    plan = tour(world, 250.0, seed=1)
    assert 250.0 <= plan.length < 320.0
    assert world.clearances(plan.points, 5.0).min() > 0.2
    np.testing.assert_array_equal(plan.points, tour(world, 250.0, seed=1).points)
    assert len(tour(world, 250.0, seed=2).points) != len(plan.points)
    cells = {tuple(cell) for cell in np.rint(plan.points / 0.5).astype(int).tolist()}
    assert len(cells) * 0.5 < 0.75 * plan.length  # most of it is driven more than once
