"""A maze that is explored in simulation is recorded, mapped, replayed, and tells how badly its motors err."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from server.config import Config, load
from server.errors import UserError
from server.formats.tum import read_tum
from server.laser_calibration import calibrate
from server.messages import Ranges
from server.recorded import open_log
from server.recording import Kind, Reader
from server.replay import Options, replay, run_log
from server.robots.kinds import LASER
from server.robots.maze_runner import MazeRunnerParams
from server.simulate import Simulation, simulate_drive
from slam.evaluate import absolute_error
from slam.timeline import associate
from tests.server.rendered import rendered

SETTINGS = Config()
PARAMS = SETTINGS.maze_runner


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("maze") / "a.rlog"
    told = simulate_drive(Simulation("maze_runner", "maze:small:1", None, 1, out), load())
    assert "0 walls touched" in told
    assert "not closed" not in told
    return out


def test_a_simulated_maze_is_recorded_with_both_its_lines_and_the_same_seed_makes_the_same_bytes(recording, tmp_path):
    reader = Reader(recording)
    assert reader.header.robot == "maze_runner"
    kinds = {(record.kind, record.link_id) for record in reader}
    assert {(Kind.RX, "link0"), (Kind.RX, LASER), (Kind.TX, "link0"), (Kind.TX, LASER), (Kind.MARK, "")} == kinds
    simulate_drive(Simulation("maze_runner", "maze:small:1", "explore", 1, tmp_path / "b.rlog"), load())
    again = [record[1:] for record in Reader(tmp_path / "b.rlog")]
    assert again == [record[1:] for record in reader]


@pytest.mark.parametrize("seed", range(4))
def test_its_recording_is_mapped_to_the_centimetre(recording, seed):
    """One cell is like another: a loop that puts it a cell farther on is none, as the odometry cannot be so wrong."""
    log = open_log(recording)
    assert sum(isinstance(message, Ranges) for message in log.messages()) > 200
    result = run_log(log, MazeRunnerParams(), seed)
    times, truth = read_tum(recording.with_name("a.rlog.truth.tum"))
    matches = associate(result.drive.times, times)
    error = absolute_error(result.trajectory[matches.rows], truth[matches.reference_rows])
    assert error.translation.rmse < 0.02
    assert error.rotation.rmse < np.radians(1.0)


def test_a_sweep_is_laid_where_it_was_taken(recording):
    """What the delay is may be tried out on a recording; half a tenth of a second too little shows in the headings."""
    times, truth = read_tum(recording.with_name("a.rlog.truth.tum"))
    off = []
    for delay in (PARAMS.laser_delay, 0.0):
        result = run_log(open_log(recording), PARAMS.model_copy(update={"laser_delay": delay}))
        matches = associate(result.drive.times, times)
        error = absolute_error(result.trajectory[matches.rows], truth[matches.reference_rows])
        off.append(error.rotation.rmse)
    assert off[0] < 0.6 * off[1]


def test_its_recording_is_replayed_and_shown_again(recording, tmp_path):
    report = replay(recording, tmp_path / "map", Options("maze_runner"))
    assert report.vertices > 15
    last, cache = rendered(recording, tmp_path / "cache")
    assert last.complete
    assert {"pose", "local", "path", "histogram", "particles"} <= {topic for topic, _ in cache.between(0.0, 60.0)}


@pytest.mark.parametrize(
    ("world", "plan", "remedy"),
    [
        ("maze:huge:1", None, "write maze:medium:3"),
        ("maze:small:x", None, "write maze:medium:3"),
        ("maze:small:1:2", None, "write maze:medium:3"),
        ("maze:1x4:2", None, "two of each"),
        ("maze:small:1", "demo", "explore, frontiers, wall"),
    ],
)
def test_what_cannot_be_simulated_is_told_with_the_remedy(tmp_path, world, plan, remedy):
    simulation = Simulation("maze_runner", world, plan, 1, tmp_path / "a.rlog")
    with pytest.raises(UserError, match=remedy):
        simulate_drive(simulation, load())
    assert not list(tmp_path.iterdir())


def test_its_recording_tells_how_badly_its_motors_err(recording, tmp_path):
    found = calibrate([recording], Options("maze_runner"))
    assert {row.name for row in found.rows} == {"distance", "turn", "rotation"}
    assert found.gain > 5.0, "the virtual motors err otherwise than the default thinks"
    path = tmp_path / "robot.toml"
    path.write_text(found.toml())
    noise = load(file=path).maze_runner.odometry.motion.odometry
    assert noise.distance == next(row.recommended for row in found.rows if row.name == "distance")
    with pytest.raises(UserError, match="named twice"):
        calibrate([recording, recording], Options("maze_runner"))
