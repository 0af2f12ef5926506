"""Crunch as a fold: wheels to odometry, vertices with hindsight, steering to goals, and a snapshot that agrees."""

from __future__ import annotations

import math

import numpy as np
import pytest

from server.commands import ArmCommand, DriveCommand, StopCommand
from server.messages import Arm, Balance, Drive, Estimate, Goal, LastWords, Odometry, Power, Ranges, Status, Stop
from server.robots.crunch import Crunch
from server.status import robot_status
from slam.local_map import LocalMapParams
from slam.path_filter import PathFilter
from slam.pose import between, compose
from slam.walls import extract
from tests.naive.walls import rectangle
from tests.server.crunch_body import (
    HALL,
    RATE,
    SENSORS,
    Body,
    estimate_of,
    feed,
    keyframes,
    params_of,
    tour,
)

# Looking


@pytest.mark.parametrize("delay", [0.0, 0.2])
def test_a_late_sweep_is_placed_where_it_was_taken(delay):
    """A wall ahead stands where it is, and not further by the way that the sweep was late."""
    world, speed = np.array([[0.6, -2.0, 0.6, 2.0]]), 0.4
    robot, body = Crunch(params_of()), Body()
    for _ in range(25):
        feed(robot, body.drive(speed, 0.0, 0.02))
        taken = body.pose - [speed * delay, 0.0, 0.0]
        if taken[0] > 0.0:
            robot.step(body.ranges("infrared", world, taken, body.t - delay))
    grid = robot.local_map.grid()
    columns = np.flatnonzero(grid.cells[math.floor(-grid.y / grid.resolution)] > 0.6)
    assert np.mean(grid.x + (columns + 0.5) * grid.resolution) == pytest.approx(0.6, abs=0.03)


def test_sweeps_before_any_odometry_and_of_unknown_sensors_are_left_alone():
    robot, body = Crunch(params_of()), Body()
    assert robot.step(body.ranges("sonar", HALL)) == []
    assert not robot.local_map.cells.any()
    robot.step(body.wheels())
    assert robot.step(Ranges(0.0, "radar", np.ones(3))) == []
    assert not robot.local_map.cells.any()
    assert feed(robot, body.drive(0.3, 0.0, 4.0)) == []  # nothing seen, no vertex
    assert robot.vertices == []


# Vertices


def test_there_is_a_vertex_every_half_metre_of_path():
    robot, body = Crunch(params_of()), Body()
    robot.step(body.wheels())
    effects = tour(robot, body, 4.1)
    vertices = np.array(robot.vertices)
    assert len(vertices) in (8, 9)
    steps = np.hypot(*np.diff(vertices[:, :2], axis=0).T)
    np.testing.assert_allclose(steps, 0.5, atol=0.3 / RATE + 1e-9)
    assert robot.distance == pytest.approx(body.rolled, abs=1e-6)
    frames = keyframes(effects)
    assert [frame.index for frame in frames] == list(range(len(frames)))
    np.testing.assert_allclose([frame.travelled for frame in frames[1:]], steps[: len(frames) - 1], atol=1e-9)
    assert len(keyframes(effects)) == len(effects)


def test_path_counts_back_and_forth_and_turns_on_the_spot_do_not():
    robot, body = Crunch(params_of(hindsight=0)), Body()
    robot.step(body.wheels())
    robot.step(body.ranges("infrared", HALL))
    assert len(keyframes(feed(robot, body.drive(0.0, 0.0, 0.1)))) == 1
    assert feed(robot, body.drive(0.0, 1.5, 10.0)) == []
    assert len(feed(robot, body.drive(0.3, 0.0, 0.9) + body.drive(-0.3, 0.0, 0.9))) == 1


@pytest.mark.parametrize("hindsight", [0, 1, 2, 3])
def test_walls_come_some_vertices_later_and_finish_hands_over_the_rest(hindsight):
    robot, body = Crunch(params_of(hindsight=hindsight)), Body()
    robot.step(body.wheels())
    frames = []
    for _ in range(30):
        frames += keyframes(tour(robot, body, 0.1))
        assert len(frames) == max(0, len(robot.vertices) - hindsight)
    rest = robot.finish()
    assert len(rest) == min(hindsight, len(robot.vertices))
    frames += rest
    assert [frame.index for frame in frames] == list(range(len(robot.vertices)))
    for frame, vertex in zip(frames, robot.vertices, strict=True):
        np.testing.assert_array_equal(frame.pose, vertex)
    assert np.all(np.diff([frame.t for frame in frames]) > 0.0)
    assert robot.finish() == []


def test_hindsight_sees_more_of_the_walls():
    seen = []
    for hindsight in (0, 2):
        robot, body = Crunch(params_of(hindsight=hindsight)), Body()
        robot.step(body.wheels())
        frames = keyframes(tour(robot, body, 3.0))[1:4]
        seen.append(np.mean([np.isfinite(frame.walls.distances).sum() for frame in frames]))
    assert seen[1] > 1.05 * seen[0]


def test_walls_of_a_corridor_are_where_they_are():
    robot, body = Crunch(params_of()), Body()
    robot.step(body.wheels())
    frames = keyframes(tour(robot, body, 3.0))[1:]
    assert len(frames) >= 3
    for frame in frames:
        for ray in (30, 90):  # left and right
            assert frame.walls.distances[ray] == pytest.approx(0.6, abs=0.03)
        assert not np.isfinite(frame.walls.distances[[0, 60]]).any()
        assert frame.walls.free[0] > 0.5


# Foreign logs


def test_logs_that_integrate_their_own_odometry_are_mapped_alike():
    ours, theirs, body = Crunch(params_of()), Crunch(params_of()), Body()
    for robot in (ours, theirs):
        robot.step(body.wheels() if robot is ours else Odometry(0.0, 0.0, 0.0, 0.0))
    found = {id(ours): [], id(theirs): []}
    for _ in range(125):
        wheels = body.drive(0.3, 0.02, 0.08)[-1]
        sweep = body.ranges("infrared", HALL)
        for robot, reading in ((ours, wheels), (theirs, Odometry(body.t, *(float(v) for v in body.pose)))):
            found[id(robot)] += feed(robot, [reading, sweep])
    assert len(found[id(ours)]) == len(found[id(theirs)]) > 2
    for a, b in zip(found[id(ours)], found[id(theirs)], strict=True):
        np.testing.assert_allclose(a.pose, b.pose, atol=1e-6)
        both = np.isfinite(a.walls.distances) & np.isfinite(b.walls.distances)
        assert both.sum() > 0.9 * np.isfinite(a.walls.distances).sum()
        np.testing.assert_allclose(a.walls.distances[both], b.walls.distances[both], atol=0.03)


def test_a_log_that_starts_anywhere_counts_no_way_to_get_there():
    robot = Crunch(params_of())
    robot.step(Odometry(5.0, 100.0, -50.0, 2.0))
    assert robot.distance == 0.0
    robot.step(Odometry(5.1, 100.3, -50.4, 2.0))
    assert robot.distance == pytest.approx(0.5)
    robot.step(Odometry(5.0, 100.3, -50.4, 2.0))  # times may step back
    assert robot.distance == pytest.approx(0.5)
    np.testing.assert_allclose(robot.pose(), [100.3, -50.4, 2.0])


# Commands and goals


def test_commands_become_effects():
    robot = Crunch(params_of())
    assert robot.step(Drive(0.0, 0.2, -0.4)) == [DriveCommand(0.2, -0.4)]
    assert robot.step(Stop(0.0)) == [StopCommand()]
    assert robot.step(Arm(0.0, True)) == [ArmCommand(True)]
    assert robot.step(Arm(0.0, False)) == [ArmCommand(False)]
    assert robot.step(Goal(0.0, (1.0, 2.0))) == []
    assert robot.step(Goal(0.0, None)) == [StopCommand()]


@pytest.mark.parametrize("message", [Drive(0.0, 0.1, 0.0), Stop(0.0), Goal(0.0, None)])
def test_a_person_at_the_stick_ends_the_goal(message):
    robot, body = Crunch(params_of()), Body()
    feed(robot, [body.wheels(), Goal(0.0, (3.0, 0.0))])
    assert robot.step(body.ranges("infrared", HALL))
    robot.step(message)
    assert robot.step(body.ranges("infrared", HALL)) == []
    assert robot.snapshot().goal is None
    assert robot.snapshot().steering is None


def approach(robot, body, world, seconds=40.0):
    """Let the robot's own commands drive the body; all effects."""
    effects, command = [], DriveCommand(0.0, 0.0)
    for _ in range(round(seconds * 12.5)):
        feed(robot, body.drive(command.speed, command.turn, 4.0 / RATE))
        found = [effect for sensor in SENSORS for effect in robot.step(body.ranges(sensor, world))]
        effects += found
        if StopCommand() in found:
            break
        command = next((effect for effect in reversed(found) if isinstance(effect, DriveCommand)), command)
    return effects


@pytest.mark.parametrize("goal", [(3.0, 0.1), (-1.2, 0.0)])
def test_steering_ends_at_the_goal_and_stops_once(goal):
    robot, body = Crunch(params_of()), Body()
    feed(robot, [body.wheels(), Goal(0.0, goal, 0.3)])
    effects = approach(robot, body, HALL)
    assert math.dist(body.pose[:2], goal) < 0.25
    assert [effect for effect in effects if isinstance(effect, StopCommand)] == [StopCommand()]
    commands = [effect for effect in effects if isinstance(effect, DriveCommand)]
    assert all(0.0 <= command.speed <= 0.3 for command in commands)
    assert all(abs(command.turn) <= robot.params.max_turn for command in commands)
    assert tour(robot, body, 0.2)[-1:] != [StopCommand()]


def test_steering_goes_round_what_stands_in_the_way():
    world = np.vstack([rectangle(1.5, 0.0, 5.0, 3.0), rectangle(1.0, 0.05, 0.3, 0.3)])
    robot, body = Crunch(params_of()), Body()
    feed(robot, [body.wheels(), Goal(0.0, (2.2, 0.0), 0.2)])
    nearest = math.inf
    command = DriveCommand(0.0, 0.0)
    for _ in range(500):
        feed(robot, body.drive(command.speed, command.turn, 4.0 / RATE))
        nearest = min(nearest, math.hypot(*np.maximum(np.abs(body.pose[:2] - [1.0, 0.05]) - 0.15, 0.0)))
        found = [effect for sensor in SENSORS for effect in robot.step(body.ranges(sensor, world))]
        if StopCommand() in found:
            break
        command = next(effect for effect in reversed(found) if isinstance(effect, DriveCommand))
    assert math.dist(body.pose[:2], (2.2, 0.0)) < 0.25
    assert nearest > 0.076


def test_goals_are_places_in_the_corrected_world():
    """The estimate says that the robot stands elsewhere: the bearing follows it."""
    robot, body = Crunch(params_of()), Body()
    robot.step(body.wheels())
    tour(robot, body, 1.0)
    path = [compose(np.array([5.0, 5.0, 0.5 * math.pi]), vertex) for vertex in robot.vertices]
    robot.step(estimate_of(robot, path))
    np.testing.assert_allclose(robot.pose(), compose(np.array([5.0, 5.0, 0.5 * math.pi]), robot.odometry), atol=1e-9)
    robot.step(Goal(0.0, (5.0, 5.0 + 1.0 + 1.0)))
    bearing = robot.snapshot().goal_bearing
    assert bearing is not None
    assert abs(bearing) < 0.05


def test_a_late_estimate_is_carried_on_by_odometry():
    robot, body = Crunch(params_of()), Body()
    robot.step(body.wheels())
    tour(robot, body, 2.0, turn=0.05)
    path = [compose(np.array([1.0, -1.0, 0.3]), vertex) for vertex in robot.vertices[:2]]
    robot.step(estimate_of(robot, path))
    expected = compose(path[1], between(robot.vertices[1], robot.odometry))
    np.testing.assert_allclose(robot.pose(), expected, atol=1e-12)


# Snapshot


def test_a_snapshot_agrees_with_the_robot():
    robot, body = Crunch(params_of()), Body(tilt=0.05)
    robot.step(body.wheels())
    effects = tour(robot, body, 2.5)
    path_filter = PathFilter(robot.params.filter_params())
    for frame in keyframes(effects):
        path_filter.extend(frame.pose, frame.walls, frame.travelled)
    answer = path_filter.estimate()
    robot.step(Estimate(body.t, **answer._asdict()))
    robot.step(Goal(body.t, (4.0, 0.0)))
    robot.step(body.ranges("sonar", HALL))
    seen = robot.snapshot()
    assert (seen.t, seen.robot, seen.tilt) == (pytest.approx(body.t), "crunch", pytest.approx(0.05))
    assert seen.distance == pytest.approx(body.rolled, abs=1e-6)
    np.testing.assert_allclose(seen.odometry, body.pose, atol=1e-6)
    np.testing.assert_array_equal(seen.path, answer.path)
    assert len(seen.profile) == len(seen.path) == len(keyframes(effects))
    assert seen.n_particles == 30
    assert seen.goal == (4.0, 0.0)
    assert seen.steering is not None
    n = seen.local_map.shape[0]
    middle = seen.local_origin + 0.5 * n * seen.local_resolution
    assert np.all(np.abs(middle - seen.odometry[:2]) < 0.3)
    for curve in seen.curves:
        assert np.all(np.abs(np.abs(curve[:, 1]) - 0.6) < 0.06)
    for curve in seen.walls:
        assert np.all(np.abs(curve[:, 1]) < 1.2)
    for name, ring in SENSORS.items():
        beams = seen.beams[name]
        np.testing.assert_allclose(beams["bearings"], ring.bearings)
        assert beams["ranges"].shape == beams["bearings"].shape == beams["offsets"].shape
    assert len(seen.densities) == robot.params.vfh.sectors


def test_a_snapshot_stays_as_it_was():
    robot, body = Crunch(params_of()), Body()
    robot.step(body.wheels())
    tour(robot, body, 0.5)
    seen = robot.snapshot()
    before = seen.local_map.copy(), seen.beams["infrared"]["ranges"].copy(), seen.path.copy(), seen.odometry.copy()
    tour(robot, body, 0.06)
    now = seen.local_map, seen.beams["infrared"]["ranges"], seen.path, seen.odometry
    for old, kept in zip(before, now, strict=True):
        np.testing.assert_array_equal(kept, old)


def test_a_robot_that_has_heard_nothing_has_a_snapshot():
    seen = Crunch(params_of()).snapshot()
    assert seen.distance == 0.0
    assert seen.curves == []
    assert seen.walls == []
    assert np.isnan(seen.beams["sonar"]["ranges"]).all()
    assert not seen.local_map.any()
    np.testing.assert_array_equal(seen.pose, np.zeros(3))


def test_the_boards_words_are_kept():
    robot = Crunch(params_of())
    balance = Balance(1.0, 0.1, 0.0, 0.2, 0.3, "armed", "none", 7)
    power = Power(2.0, 12.1, 0.4, 0.0, 0.0, 0.1, 0.2)
    status = Status(3.0, "sensor", 1, "armed", "none", 0, 12.0, 3, 0.001, 0, 5)
    words = LastWords(3.0, "fault", "blocked", 9.5, 11.0)
    assert feed(robot, [balance, power, status, words]) == []
    seen = robot.snapshot()
    assert (seen.balance, seen.power, seen.boards, seen.last_words) == (balance, power, {"sensor": status}, words)
    told = robot_status(seen, is_virtual=True, layers=[])
    assert told.last_words == {"t": 3.0, "state": "fault", "reason": "blocked", "since": 9.5, "uptime": 11.0}


def test_halves_of_a_sonar_sweep_are_shown_together():
    robot, body = Crunch(params_of()), Body()
    robot.step(body.wheels())
    even, odd = np.where(np.arange(8) % 2 == 0, [[1.0], [math.nan]], [[math.nan], [2.0]])
    feed(robot, [Ranges(0.0, "sonar", even), Ranges(0.04, "sonar", odd)])
    np.testing.assert_array_equal(robot.snapshot().beams["sonar"]["ranges"], [1.0, 2.0] * 4)


def test_the_same_messages_give_the_same_effects():
    runs = []
    for _ in range(2):
        robot, body = Crunch(params_of()), Body()
        robot.step(body.wheels())
        frames = keyframes(tour(robot, body, 2.0)) + robot.finish()
        runs.append(b"".join(frame.pose.tobytes() + frame.walls.distances.tobytes() for frame in frames))
    assert runs[0] == runs[1]


def test_the_filter_is_told_the_maps_reach():
    params = params_of(local_map=LocalMapParams(reach=1.7), filter={"particles": 77})
    assert params.filter_params().reach == 1.7
    assert params.filter_params().particles == 77


def test_the_thesis_map_is_resampled_and_still_finds_the_corridor():
    robot, body = Crunch(params_of(hindsight=0, local_map=LocalMapParams(reach=1.0, resample=True))), Body()
    robot.step(body.wheels())
    frames = keyframes(tour(robot, body, 2.0))[1:]
    assert frames
    sides = np.array([frame.walls.distances[[30, 90]] for frame in frames])
    assert np.mean(np.isfinite(sides)) > 0.5
    np.testing.assert_allclose(sides[np.isfinite(sides)], 0.6, atol=0.06)
    assert np.all(np.isfinite(robot.snapshot().local_map))


@pytest.mark.parametrize(("tilt", "is_floor"), [(0.0, False), (0.2, False), (0.45, True)])
def test_the_bodys_lean_is_taken_out_of_the_ranges(tilt, is_floor):
    """A beam that points down is longer than the way to the wall; one that ends on the floor says nothing of walls."""
    robot, wall = Crunch(params_of()), 0.6
    for message in Body(tilt=tilt).drive(0.0, 0.0, 0.5):
        robot.step(message)
    ahead = np.full(8, np.nan)
    start = 0.05 + 0.203 * math.sin(tilt)
    ahead[0] = 0.203 / math.sin(tilt) if is_floor else (wall - start) / math.cos(tilt)
    for _ in range(6):
        robot.step(Ranges(0.5, "infrared", ahead))
    seen = extract(robot.local_map, robot.odometry, robot.params.walls.model_copy(update={"shortest": 1}))
    if is_floor:
        assert not np.isfinite(seen.distances).any()
    else:
        assert seen.distances[0] == pytest.approx(wall, abs=0.02)
