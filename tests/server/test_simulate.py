"""Simulated recordings: the same seed makes the same bytes, truth lies beside them, semi-real ones follow their log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firmware.virtual import load_world
from server.config import load
from server.errors import UserError
from server.formats.tum import read_tum, write_tum
from server.messages import CartStage, Ranges, Wheels
from server.recorded import open_log
from server.replay import run_log
from server.robots.crunch import CrunchParams
from server.simulate import Semireal, Simulation, simulate_drive, simulate_semireal, world_and_plan
from slam.cart_odometry import CartParams, arc
from slam.evaluate import absolute_error
from slam.timeline import associate
from tests.server.logs import write_room_log


def drive(out: Path, seed: int = 1, **more) -> Path:
    simulate_drive(Simulation("crunch", "demo", "demo", seed, out, duration=8.0, **more), load())
    return out


def test_the_same_seed_makes_the_same_bytes_and_another_does_not(tmp_path):
    names = {"a": 1, "b": 1, "c": 2}
    recordings = {name: drive(tmp_path / f"{name}.rlog", seed).read_bytes() for name, seed in names.items()}
    assert recordings["a"] == recordings["b"]
    assert recordings["a"] != recordings["c"]
    truths = [(tmp_path / f"{name}.rlog.truth.tum").read_bytes() for name in ("a", "b")]
    assert truths[0] == truths[1]


def test_truth_has_a_pose_per_odometry_reading_at_its_time(tmp_path):
    log = open_log(drive(tmp_path / "a.rlog"))
    times = np.array([message.t for message in log.messages() if isinstance(message, Wheels)])
    true_times, _ = read_tum(tmp_path / "a.rlog.truth.tum")
    assert abs(len(times) - len(true_times)) <= 1
    assert abs(len(times) - 8.0 * 50) <= 5
    matches = associate(times, true_times, 0.0, 0.02)
    assert len(matches.rows) >= len(true_times) - 2


def test_sensors_speak_at_their_rates(tmp_path):
    log = open_log(drive(tmp_path / "a.rlog"))
    counts = {"sonar": 0, "infrared": 0}
    for message in log.messages():
        if isinstance(message, Ranges):
            counts[message.sensor] += 1
    assert counts["infrared"] == pytest.approx(8.0 * 25, abs=5)
    assert counts["sonar"] == pytest.approx(8.0 * 12.5 * 2, abs=8)  # two half sweeps each


def test_a_recording_in_the_way_is_replaced_and_nothing_else_is_left(tmp_path):
    out = tmp_path / "a.rlog"
    out.write_text("old")
    drive(out)
    assert open_log(out).kind == "rlog"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.rlog", "a.rlog.truth.tum"]


def test_settings_that_were_given_go_into_the_header(tmp_path):
    settings = load(assignments=["crunch.filter.particles=123"])
    simulate_drive(Simulation("crunch", "demo", "demo", 1, tmp_path / "a.rlog", duration=1.0), settings)
    assert open_log(tmp_path / "a.rlog").configuration == {"crunch": {"filter": {"particles": 123}}}


@pytest.fixture
def semireal(tmp_path) -> Path:
    """A semi-real recording of the rectangle in the room."""
    times, truth = write_room_log(tmp_path / "room.log", scan_every=2, turn_bias=0.02)
    write_tum(tmp_path / "reference.tum", times[4:-4:2], truth[4:-4:2])
    arguments = Semireal("crunch", tmp_path / "room.log", tmp_path / "reference.tum", 3, tmp_path / "semi.rlog")
    simulate_semireal(arguments, load())
    return tmp_path / "semi.rlog"


def test_semireal_takes_odometry_from_the_log_and_truth_from_the_reference(semireal):
    true_times, true_poses = read_tum(Path(f"{semireal}.truth.tum"))
    reference_times, reference = read_tum(semireal.parent / "reference.tum")
    span = reference_times[-1] - reference_times[0]
    assert true_times[-1] - true_times[0] == pytest.approx(span, abs=0.1), "clipped to the reference"
    matches = associate(reference_times - reference_times[0], true_times, 0.0, 0.011)
    errors = absolute_error(true_poses[matches.reference_rows], reference[matches.rows], is_aligned=False)
    assert errors.translation.max < 0.03
    result = run_log(open_log(semireal), CrunchParams(), seed=1)
    rows = associate(result.drive.times, true_times, 0.0, 0.02)
    odometry = absolute_error(result.drive.odometry[rows.rows], true_poses[rows.reference_rows])
    assert odometry.translation.rmse > 0.1, "the log's own drift is in it"


def test_semireal_sees_the_walls_of_the_log(semireal):
    reach = [
        float(np.nanmin(message.ranges)) for message in open_log(semireal).messages()
        if isinstance(message, Ranges) and message.sensor == "sonar"
    ]  # fmt: skip
    assert np.median(reach) == pytest.approx(1.0 - 0.07, abs=0.1)  # the drive keeps 1 m from the walls


@pytest.mark.parametrize(
    ("world", "plan", "told"),
    [("nowhere", "demo", "nowhere"), ("demo", "nowhere", "nowhere"), ("missing.toml", "demo", "missing.toml")],
)
def test_unknown_worlds_and_plans_are_told(tmp_path, world, plan, told):
    with pytest.raises(UserError, match=told):
        simulate_drive(Simulation("crunch", world, plan, 1, tmp_path / "a.rlog", duration=1.0), load())


def test_a_plan_brings_its_world_and_a_world_its_plan_or_a_tour():
    def chosen(world: str | None, plan: str | None) -> tuple[str, str]:
        place, route = world_and_plan(world, plan, 1)
        return place.name, route.name

    assert chosen(None, None) == chosen("demo", None) == chosen(None, "demo") == chosen("demo", "demo")
    assert chosen("corridor50", None) == chosen(None, "corridor50")
    _, plan = world_and_plan("demo", "tour:30", 1)
    assert 25.0 < plan.length < 60.0


@pytest.mark.parametrize("plan", ["tour:far", "tour:0", "tour:nan"])
def test_a_tour_of_no_length_is_told(tmp_path, plan):
    with pytest.raises(UserError, match=f"--plan {plan}: "):
        simulate_drive(Simulation("crunch", "demo", plan, 1, tmp_path / "a.rlog"), load())


def test_a_reference_of_another_clock_is_told(tmp_path):
    times, truth = write_room_log(tmp_path / "room.log", laps=1)
    write_tum(tmp_path / "reference.tum", times + 1e6, truth)
    arguments = Semireal("crunch", tmp_path / "room.log", tmp_path / "reference.tum", 1, tmp_path / "a.rlog")
    with pytest.raises(UserError, match="both must share a clock"):
        simulate_semireal(arguments, load())


def test_an_unwritable_place_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        drive(tmp_path / "file" / "a.rlog")


def bump(out: Path, seed: int = 1, assignments: tuple[str, ...] = (), **more) -> Path:
    settings = load(assignments=assignments)
    simulate_drive(Simulation("bumper_cart", None, "bump", seed, out, **{"duration": 60.0, **more}), settings)
    return out


def stages_in(path: Path) -> list[CartStage]:
    return [message for message in open_log(path).messages() if isinstance(message, CartStage)]


def test_a_cart_s_recording_holds_its_stages_and_the_truth_beside_them(tmp_path):
    told = stages_in(bump(tmp_path / "a.rlog"))
    assert [each.number for each in told] == list(range(len(told)))
    assert [each.stage.kind for each in told] == [i % 3 for i in range(len(told))]
    assert len(told) > 15
    times, poses = read_tum(tmp_path / "a.rlog.truth.tum")
    assert times[-1] == pytest.approx(61.0, abs=0.05)
    at_bumps = [np.searchsorted(times, each.t) - 1 for each in told if each.stage.kind == 0]
    away = load_world("cut-rectangle").clearances(np.ascontiguousarray(poses[at_bumps, :2]), 2.0)
    assert away.max() < 0.11, "the middle of the axle is as far from a wall as the bumper is from it, or nearer"
    params = CartParams()
    ends = [np.searchsorted(times, each.t) - 1 for each in told]
    for stage, before, after in zip(told[1:], ends[:-1], ends[1:], strict=True):
        seen = arc(stage.stage.left, stage.stage.right, params)
        assert np.hypot(*seen[:2]) == pytest.approx(np.hypot(*(poses[after] - poses[before])[:2]), abs=0.2)


def test_a_cart_s_recording_is_the_same_for_the_same_seed_only(tmp_path):
    bytes_of = {
        name: bump(tmp_path / f"{name}.rlog", seed).read_bytes() for name, seed in (("a", 1), ("b", 1), ("c", 2))
    }
    assert bytes_of["a"] == bytes_of["b"]
    assert bytes_of["a"] != bytes_of["c"]


def test_a_cart_stands_after_the_bumps_that_its_settings_tell(tmp_path):
    out = bump(tmp_path / "a.rlog", assignments=("bumper_cart.run.bumps=3",), duration=None)
    assert len(stages_in(out)) == 7
    three = bump(tmp_path / "b.rlog", 5, ("bumper_cart.build.switches=3",))
    assert {each.stage.bumper for each in stages_in(three) if each.stage.kind == 0} - {2}


def test_a_cart_knows_no_other_plan_and_no_world_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match="--plan tour: bumper_cart drives by none but bump"):
        simulate_drive(Simulation("bumper_cart", None, "tour", 1, tmp_path / "a.rlog"), load())
    with pytest.raises(UserError, match="no built-in world of that name"):
        simulate_drive(Simulation("bumper_cart", "nowhere", None, 1, tmp_path / "a.rlog"), load())
