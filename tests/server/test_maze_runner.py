"""Maze Runner maps a laser's log as Crunch maps its own: the same outputs, the same bytes, and a path that is right."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from server.config import ConfigError, check_robot
from server.formats import FormatError
from server.formats.carmen import format_flaser, format_odom, write_carmen
from server.formats.tum import read_tum
from server.messages import Keyframe, Odometry, Ranges
from server.replay import Options, open_log, replay, run_log
from server.robots.maze_runner import MazeRunner, MazeRunnerParams
from slam.evaluate import absolute_error
from slam.laser_scan import LaserParams
from slam.pose import compose
from tests.server.test_formats_crazyflie import flight, write_bag
from tests.slam.laser_world import BEARINGS, around, odometry_of, ranges_of, ring

FEW = MazeRunnerParams().filter.model_copy(update={"particles": 8})
OUTPUTS = {"trajectory.tum", "map.pgm", "map.yaml", "map.png", "map.json", "path.g2o", "profile.csv", "report.json"}


def write_ring_log(path: Path, laps: float = 1.3, seed: int = 0) -> np.ndarray:
    """A CARMEN log of a drive around a block with a bad odometry; returns the true poses (n, 3)."""
    truth, rng = around(laps), np.random.default_rng(seed)
    odometry = odometry_of(truth, rng)
    rows = []
    for k, (true, told) in enumerate(zip(truth, odometry, strict=True)):
        rows.append(format_odom(0.5 * k, told))
        rows.append(format_flaser(0.5 * k, ranges_of(true, ring(), rng), told))
    write_carmen(path, rows)
    return truth


@pytest.fixture(scope="module")
def ring_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("ring") / "ring.log"
    return path, write_ring_log(path)


def run(path: Path, out: Path, **options):
    flags = {"maze_runner": {"filter": {"particles": 8}}}
    return replay(path, out, Options(robot="maze_runner", flags=flags, **options))


def test_a_laser_log_becomes_a_map_and_a_path_that_is_right(ring_log, tmp_path):
    path, truth = ring_log
    report = run(path, tmp_path / "out")
    assert {file.name for file in (tmp_path / "out").iterdir()} == OUTPUTS
    times, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    assert len(times) == len(truth)
    assert absolute_error(poses, truth).translation.rmse < 0.06
    assert (report.robot, report.kind, report.particles) == ("maze_runner", "carmen", 8)
    assert report.uncertainty.source == "refinement"
    assert json.loads((tmp_path / "out" / "map.json").read_text())["robot"] == "maze_runner"


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(ring_log, tmp_path):
    path, _ = ring_log
    for name, options in (("a", {"threads": 1}), ("b", {"threads": 2}), ("c", {"threads": 1, "seed": 1})):
        run(path, tmp_path / name, **options)
    same = OUTPUTS - {"report.json", "map.png"}  # which tell how long it took
    files = {name: {file: (tmp_path / name / file).read_bytes() for file in same} for name in "abc"}
    for file in same:
        assert files["a"][file] == files["b"][file], file
    assert files["a"]["profile.csv"] != files["c"]["profile.csv"]  # the path itself may be refined to the same


def test_a_laser_that_sits_ahead_and_askew_tells_of_the_robot(tmp_path):
    """The same drive seen by a laser off the middle: the trajectory is the robot's, not the laser's."""
    mount = np.array([0.2, 0.05, 0.3])
    truth = around(0.8)
    log = open_log(write_mounted(tmp_path / "mounted.log", truth, mount), None, None, "maze_runner")
    assert log.mount == pytest.approx(mount, abs=1e-5)
    result = run_log(log, MazeRunnerParams(filter=FEW))
    assert absolute_error(result.trajectory, truth).translation.rmse < 0.05
    assert absolute_error(compose(result.trajectory, mount), truth).translation.max > 0.1


def write_mounted(path: Path, truth: np.ndarray, mount: np.ndarray) -> Path:
    rows = []
    for k, pose in enumerate(truth):
        laser = compose(pose, mount)
        ranges = ranges_of(laser, ring(), np.random.default_rng(k))
        beams = " ".join(f"{reading:.3f}" for reading in np.nan_to_num(ranges, posinf=81.0))
        rows.append(format_odom(0.5 * k, pose))
        poses = " ".join(f"{part:.6f}" for part in [*laser, *pose])
        rows.append(
            f"ROBOTLASER1 0 {-math.pi / 2} {math.pi} {math.pi / 180} 80.0 0.01 0 {len(BEARINGS)} {beams} 0 {poses} "
            f"0 0 0 0 0 {0.5 * k:.6f} crunch {0.5 * k:.6f}\n"
        )
    write_carmen(path, rows)
    return path


def test_every_half_metre_or_half_a_radian_is_a_vertex_with_the_whole_scan():
    robot = MazeRunner(MazeRunnerParams(laser=laser_of_180()))
    found: list[Keyframe] = []
    for k, pose in enumerate(around(0.4)):
        robot.step(Odometry(0.5 * k, *(float(part) for part in pose)))
        seen = ranges_of(pose, ring(), np.random.default_rng(k))
        found += [effect for effect in robot.step(Ranges(0.5 * k, "laser", seen)) if isinstance(effect, Keyframe)]
    assert [keyframe.index for keyframe in found] == list(range(len(found)))
    steps = np.diff([keyframe.pose for keyframe in found], axis=0)
    apart = np.hypot(steps[:, 0], steps[:, 1])
    turned = np.abs(np.angle(np.exp(1j * steps[:, 2])))
    assert np.all((apart >= 0.45) | (turned >= 0.4))
    assert np.all((apart < 0.75) & (turned < 0.75))
    assert all(np.sum(np.isfinite(keyframe.walls.distances)) > 150 for keyframe in found)
    assert sum(keyframe.travelled for keyframe in found[1:]) == pytest.approx(float(np.sum(apart)), rel=0.1)


def laser_of_180() -> LaserParams:
    return LaserParams(beams=180, first_deg=-90.0, step_deg=1.0, max_range=20.0)


def test_scans_before_any_odometry_and_of_other_sensors_are_passed_over():
    robot = MazeRunner(MazeRunnerParams(laser=laser_of_180()))
    seen = ranges_of(around(0.1)[0], ring())
    assert robot.step(Ranges(0.0, "laser", seen)) == []
    robot.step(Odometry(0.0, 0.0, 0.0, 0.0))
    assert robot.step(Ranges(0.0, "sonar", np.ones(8))) == []
    assert len(robot.step(Ranges(0.1, "laser", seen))) == 1


def test_logs_that_it_cannot_map_and_what_it_cannot_do_are_told(tmp_path):
    with pytest.raises(FormatError, match="holds no ranges"):
        run(Path(__file__).parents[1] / "replay" / "lap.rlog", tmp_path / "out")
    with pytest.raises(FormatError, match="has no laser's scans, which maze_runner maps with; leave out --robot"):
        run(write_bag(tmp_path / "flight.bag", flight([1.0, 2.0, 3.0, 0.5])), tmp_path / "out")
    (tmp_path / "measurement.txt").write_text("0 " + " ".join(["500"] * 8) + "\n")
    (tmp_path / "poses.txt").write_text("0 0 0 0\n")
    for path in (tmp_path, tmp_path / "poses.txt"):
        with pytest.raises(FormatError, match="has no laser's scans"):
            run(path, tmp_path / "out")
    with pytest.raises(ConfigError, match="`maze_runner` has no such thing; robots that can be simulated: crunch"):
        check_robot("maze_runner", ("crunch",), "robots that can be simulated")


def test_who_stands_still_makes_no_way_whatever_scans_err_by():
    laser = LaserParams(beams=180, first_deg=-90.0, step_deg=1.0, max_range=20.0)
    robot, rng = MazeRunner(MazeRunnerParams(laser=laser)), np.random.default_rng(3)
    trembled, before = 0.0, None
    for tick in range(600):
        t = 0.1 * tick
        robot.step(Odometry(t, 0.0, 0.0, 0.0))
        robot.step(Ranges(t, "laser", ranges_of(np.array([3.0, 1.0, 0.0]), ring(), rng)))
        here = robot.follower.pose
        trembled += 0.0 if before is None else math.dist(here[:2], before[:2])
        before = here
    assert trembled > 0.05
    assert robot.distance == 0.0
    assert len(robot.vertices) == 1
