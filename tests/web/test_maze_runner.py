"""Maze Runner in a real browser: its panels, a drive by keys, exploring by a button, and its recording played again."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from server.recorded import open_log
from server.recording import Kind, Reader
from tests.served import Served, demo, wait_until
from tests.web.conftest import UNHURRIED, Open, Watched

SPEED = "4"


@pytest.fixture(scope="module")
def runner(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A virtual Maze Runner in a small maze."""
    assert browser.is_connected()
    folder = tmp_path_factory.mktemp("maze")
    flags = ("--robot", "maze_runner", "--world", "maze:small:1", "--speed", SPEED, "--particles", "30")
    with demo(folder, *flags, *UNHURRIED) as served:
        yield served


def opened(visit: Open, served: Served) -> Watched:
    watched = visit(served)
    watched.page.click("#hint-close")
    return watched


def test_its_panels_show_a_laser_and_leave_out_what_it_has_not(visit: Open, runner: Served):
    watched = opened(visit, runner)
    watched.wait("document.getElementById('local-figures').textContent.startsWith('laser')")
    page = watched.page
    assert page.inner_text("#health-figures") == "Maze Runner, virtual"
    assert page.is_hidden("#chip-tilt")
    watched.wait("crunch.status?.robot.powers && document.getElementById('health').textContent.includes('Power')")
    shown = page.eval_on_selector_all("#health dt", "rows => rows.map((row) => row.textContent)")
    assert "Power" in shown
    assert not {"Tilt", "Charger", "Current", "Motors"} & set(shown)
    legend = page.eval_on_selector_all("#local-panel [data-sensor]", "all => all.filter((one) => !one.hidden).length")
    assert legend == 1
    assert page.inner_text("#autopilot") == "Explore"
    assert not watched.value("isNaN(parseFloat(document.querySelector('#chip-battery b').textContent))")


def test_keys_drive_it(visit: Open, runner: Served):
    watched = opened(visit, runner)
    watched.hold("a", lambda: runner.status()["robot"]["pose"][2] > 1.2)  # a wall is ahead, within 0.1 m
    watched.page.keyboard.up("a")
    wait_until(lambda: runner.status()["robot"]["powers"] == [0.0, 0.0])
    before = runner.status()["robot"]["distance_m"]
    watched.hold("w", lambda: runner.status()["robot"]["distance_m"] > before + 0.1)
    watched.page.keyboard.up("w")
    wait_until(lambda: runner.status()["robot"]["powers"] == [0.0, 0.0])


def test_the_button_lets_it_explore_until_its_map_is_closed(visit: Open, runner: Served):
    watched = opened(visit, runner)
    watched.page.click("#autopilot")
    watched.wait("document.getElementById('drive-state').textContent === 'looks around'")
    watched.wait("document.getElementById('drive-state').textContent === 'explores'")
    assert watched.page.is_hidden("#cancel"), "the goal is the explorer's"
    wait_until(lambda: runner.status()["driver"]["exploring"] == "done")
    watched.wait("crunch.status.driver.autopilot === false")
    assert runner.status()["map"]["vertices"] > 15
    assert runner.status()["link"]["names"] == ["virtual:maze:small:1", "virtual:laser"]
    wait_until(lambda: runner.status()["robot"]["powers"] == [0.0, 0.0])


def test_its_recording_has_both_lines_and_is_played_again(visit: Open, runner: Served):
    recording = runner.recording()
    links = {record.link_id for record in Reader(recording) if record.kind == Kind.RX}
    assert links == {"link0", "laser"}
    assert open_log(recording).robot == "maze_runner"
    watched = visit(runner, f"?recording={recording.stem}")
    watched.wait("crunch.status?.map.vertices > 5")
    assert watched.page.inner_text("#health-figures").startswith("Maze Runner")
