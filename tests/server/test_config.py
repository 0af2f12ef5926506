"""Settings: the strongest place wins, a wrong one is named with its place, and config.toml shows the defaults."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from server.config import PRESETS, Config, ConfigError, check_robot, load, merge, revised, working_file
from server.robots.crunch import Crunch, CrunchParams
from slam.path_filter import PathFilterParams

ROOT = Path(__file__).resolve().parents[2]
PARTICLES = "CRUNCH_CRUNCH__FILTER__PARTICLES"


def particles(value: int) -> dict:
    return {"crunch": {"filter": {"particles": value}}}


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def without_none(values: dict) -> dict:
    return {
        key: without_none(value) if isinstance(value, dict) else list(value) if isinstance(value, tuple) else value
        for key, value in values.items()
        if value is not None
    }


def test_config_toml_shows_every_default():
    shown = tomllib.loads((ROOT / "config.toml").read_text())
    assert shown == without_none(Config().model_dump()), "run `make config`"
    assert load(file=ROOT / "config.toml") == Config()


def test_strong_places_win_over_weak_ones(tmp_path, monkeypatch):
    file = write(tmp_path / "c.toml", "[crunch.filter]\nparticles = 30\nthreshold = 0.3\n")
    assert load().crunch.filter.particles == PathFilterParams().particles
    assert load(header=particles(40)).crunch.filter.particles == 40
    assert load(file=file, header=particles(40)).crunch.filter.particles == 30
    monkeypatch.setenv(PARTICLES, "20")
    assert load(file=file, header=particles(40)).crunch.filter.particles == 20
    assert load(particles(10), file, particles(40)).crunch.filter.particles == 10
    settings = load(particles(10), file, particles(40), ["crunch.filter.particles=5"])
    assert settings.crunch.filter.particles == 5
    assert settings.crunch.filter.threshold == 0.3, "what the stronger places leave open comes from the weaker"
    assert settings.crunch.track == 0.19


def test_a_preset_stands_where_it_is_named(tmp_path):
    thesis = load({"preset": "thesis"})
    assert thesis.crunch.local_map.reach == 1.0
    assert thesis.crunch.filter.comparison.affinity.states == 2
    assert thesis.crunch.filter.motion.turn_bias == 0.0
    assert thesis.crunch.filter.direction.gain == 0.0
    file = write(tmp_path / "c.toml", 'preset = "thesis"\n[crunch.local_map]\nreach = 1.5\n')
    assert load(file=file).crunch.local_map.reach == 1.5, "keys of the same place win over it"
    assert load({"preset": "thesis"}, file).crunch.local_map.reach == 1.0, "a stronger place's preset wins over keys"
    undone = load({"preset": "default"}, file)
    assert undone.crunch == load().crunch, "the default preset takes back what a weaker place's preset set"
    assert load({"preset": "default"}, None, load({"preset": "thesis"}).model_dump()).crunch == load().crunch


def test_the_thesis_preset_is_the_thesis():
    """By section: 2.1 first point and resampling, 2.2 plain sum, 2.3 at once, 2.5 two states, 2.7 two errors."""
    thesis = load({"preset": "thesis"}).crunch
    affinity, motion = thesis.filter.comparison.affinity, thesis.filter.motion
    assert (thesis.local_map.reach, thesis.local_map.resample) == (1.0, True)
    assert thesis.walls.thickness < 0.5 * thesis.local_map.finest_cell
    assert (thesis.vfh.radial_sum, thesis.vfh.half_width) == (True, 0.0)
    assert (thesis.vertex_spacing, thesis.hindsight) == (0.5, 0)
    assert (affinity.kind, affinity.states, affinity.gain) == ("points", 2, 0.3)
    assert affinity.both_free == affinity.both_wall == -affinity.differ == 1.0
    assert (motion.rotation_noise, motion.turn_bias, motion.scale_bias, motion.jitter) == (0.0, 0.0, 0.0, 0.0)
    assert motion.turn_noise > 0.0 < motion.distance_noise
    assert thesis.filter.direction.gain == 0.0


@pytest.mark.parametrize("name", PRESETS)
def test_presets_name_only_settings_that_exist(name):
    assert Config(**merge(Config().model_dump(), PRESETS[name]))


def test_one_key_of_a_sensor_leaves_the_others(tmp_path):
    file = write(tmp_path / "c.toml", "[crunch.sensors.sonar]\nmax_range = 4.0\n")
    sonar = load(file=file).crunch.sensors["sonar"]
    assert (sonar.max_range, sonar.offset, len(sonar.bearings_deg)) == (4.0, 0.07, 8)


def test_a_header_of_another_version_is_read_as_far_as_it_is_known():
    header = {"crunch": {"filter": {"particles": 40, "flux": 1}, "wings": 2}, "old": True, "web": {"port": None}}
    settings = load(header=header)
    assert settings.crunch.filter.particles == 40
    assert settings.web.port == 8000


def test_settings_survive_the_way_through_a_header():
    settings = load(assignments=["crunch.filter.particles=77", "crunch.local_map.reach=1.5"])
    assert load(header=settings.model_dump(mode="json")) == settings


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[crunch.filter]\nthreshold = 0.9\npartcles = 5\n", "c.toml:3: `crunch.filter.partcles` is no setting"),
        ("[crunch.filter]\npartcles = 5\n", "no setting; did you mean `crunch.filter.particles`?"),
        ("[crunch]\nfilter.partcles = 5\n", "c.toml:2: `crunch.filter.partcles`"),
        ("[crunh]\n", "c.toml:1: `crunh` is no setting; did you mean `crunch`?"),
        ("[crunch.sensors.sonar]\nmax_rnge = 1.0\n", "c.toml:2: `crunch.sensors.sonar.max_rnge`"),
        ("volume = 1\n", "c.toml:1: `volume` is no setting; known here: preset, crunch, maze_runner, bumper_cart"),
        ("[crunch.filter]\n\nparticles = 0\n", "c.toml:3: crunch.filter.particles = 0 cannot be used; input"),
        ("[web]\nport = 'x'\n", "c.toml:2: web.port = 'x' cannot be used"),
        ("[crunch.sensors.bat]\nmax_range = 1.0\n", "c.toml:1: crunch.sensors.bat.model"),
        ("crunch = 4\n", "c.toml:1: crunch = 4 cannot be used"),
        ("preset = 'thesiss'\n", "c.toml:1: preset `thesiss` is unknown; choose default or thesis"),
        ("[crunch\n", "c.toml:1: is no TOML"),
        ("\xff", "is no TOML"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_one_line_with_its_place(tmp_path, text, told):
    with pytest.raises(ConfigError) as error:
        load(file=write(tmp_path / "c.toml", text))
    assert told in str(error.value)
    assert str(error.value).startswith(str(tmp_path))
    assert "\n" not in str(error.value)


def test_a_missing_file_and_a_directory_are_told(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        load(file=tmp_path / "none.toml")
    with pytest.raises(ConfigError, match="is a directory"):
        load(file=tmp_path)
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="is no text"):
        load(file=tmp_path / "b.toml")


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("CRUNCH_CRUNCH__FILTER__PARTCLES", "5", "environment: `crunch.filter.partcles` is no setting"),
        ("CRUNCH_CRUMCH__FILTER__PARTICLES", "5", "environment: `CRUNCH_CRUMCH__FILTER__PARTICLES` is no setting"),
        (PARTICLES, "many", "environment: crunch.filter.particles = 'many' cannot be used"),
    ],
)
def test_a_wrong_variable_is_named(monkeypatch, name, value, told):
    monkeypatch.setenv(name, value)
    with pytest.raises(ConfigError) as error:
        load()
    assert told in str(error.value)


def test_variables_that_are_no_settings_are_left_alone(monkeypatch):
    monkeypatch.setenv("CRUNCH_DATA", "/somewhere")
    assert load() == Config()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("crunch.filter.particles", "has no `=`"),
        ("crunch.filter.partcles=5", "--set: `crunch.filter.partcles` is no setting"),
        ("crunch.filter.particles=-1", "--set: crunch.filter.particles = -1"),
    ],
)
def test_a_wrong_assignment_is_told(text, told):
    with pytest.raises(ConfigError, match=told):
        load(assignments=[text])


def test_assignments_take_toml_or_plain_text():
    settings = load(assignments=["web.host=localhost", "web.port=9", "crunch.local_map.resample=true"])
    assert (settings.web.host, settings.web.port, settings.crunch.local_map.resample) == ("localhost", 9, True)


def test_an_unknown_robot_is_told_with_the_known_ones():
    with pytest.raises(ConfigError, match="robot `krunch` is unknown; known: crunch"):
        check_robot("krunch")


def test_the_working_directory_counts_only_where_it_has_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert working_file() is None
    write(tmp_path / "config.toml", "")
    assert working_file() == Path("config.toml")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("crunch.filter.particles", 2_000_001),
        ("crunch.filter.comparison.neighbours", 101),
        ("crunch.filter.comparison.affinity.n_points", 10_001),
        ("crunch.filter.comparison.affinity.label_cell", 0.01),
        ("crunch.local_map.cells_per_reach", 501),
        ("crunch.local_map.finest_cell", 0.001),
        ("crunch.local_map.reach", 21.0),
        ("crunch.hindsight", 11),
        ("crunch.vertex_spacing", 2.1),
        ("crunch.vertex_spacing", 1e-6),
        ("crunch.perturbations", 10_001),
        ("crunch.walls.n_rays", 3601),
        ("crunch.walls.smoothing", 1e6),
        ("crunch.vfh.sectors", 721),
        ("crunch.vfh.smoothing", 101),
        ("crunch.vfh.reach", 21.0),
        ("crunch.sensors.sonar.bearings_deg", [0.0] * 4097),
        ("crunch.sensors", {str(n): {"model": "beam", "bearings_deg": [0.0]} for n in range(15)}),
        ("estimator.shown", 10**6),
        ("estimator.batch", 10**6),
        ("estimator.bound", 10**6),
    ],
)
def test_a_session_cannot_ask_for_more_than_the_server_can_hold(key, value):
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        revised(Config(), {key: value})


def test_the_largest_local_map_is_of_bounded_size():
    widest = {"reach": 5.0, "finest_cell": 0.01, "cells_per_reach": 500}
    robot = Crunch(CrunchParams.model_validate({"local_map": widest, "hindsight": 10, "vertex_spacing": 2.0}))
    assert robot.local_map.cells.nbytes < 128e6
