"""Bumper Cart in a real browser: it runs by itself once it is told to, on a map that is known and where none is."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser

from tests.served import PATIENCE, Served, demo, wait_until
from tests.web.conftest import LISTEN, UNHURRIED, Open, Watched
from tests.web.test_access import LOOKS, check

FLAGS = ("--robot", "bumper_cart", "--world", "rectangle", "--speed", "5", "--seed", "2", *UNHURRIED)
NAMES = "Names of places"
OWN = ["Particles", "Path, by certainty", "Bumper at each bump", "Raw path, end to end", "Map so far"]
PLACES = "String(crunch.map.frames.clusters.arrays.poses.values)"
WORDS = "document.getElementById('whereabouts').textContent"
LOOK = """(() => {
    const map = document.getElementById("map");
    const copy = new OffscreenCanvas(map.width, map.height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(map, 0, 0);
    const { data } = copy.getImageData(0, 0, map.width, map.height);
    return data.reduce((sum, level, k) => (sum * 31 + level * (k % 251)) | 0, 7);
})()"""  # a number that changes with the picture


@pytest.fixture(scope="module")
def known(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A virtual cart somewhere in a rectangle, whose map it is given: it looks alike after half a turn."""
    assert browser.is_connected()
    with demo(tmp_path_factory.mktemp("known"), *FLAGS, "--map", "rectangle") as served:
        yield served


@pytest.fixture(scope="module")
def unknown(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The same, that is given no map."""
    assert browser.is_connected()
    with demo(tmp_path_factory.mktemp("unknown"), *FLAGS) as served:
        yield served


def opened(visit: Open, served: Served, **options: Any) -> Watched:
    watched = visit(served, **options)
    watched.page.click("#hint-close")
    watched.wait("crunch.status?.robot.run && crunch.map.frames.map_so_far")
    return watched


def robot(served: Served) -> dict[str, Any]:
    return served.status()["robot"]


def bumps(served: Served) -> int:
    return robot(served)["run"]["bumps"]


def begin(watched: Watched, served: Served, n: int) -> None:
    """Let it run by the button until it has bumped so often."""
    if robot(served)["state"] != "armed":
        watched.page.click("#arm")
    wait_until(lambda: robot(served)["state"] == "armed" and bumps(served) >= n)


def end(watched: Watched, served: Served) -> None:
    """End the run by the button."""
    watched.page.click("#disarm")
    wait_until(lambda: robot(served)["state"] != "armed")
    watched.wait("!document.getElementById('arm').hidden")


def offered(watched: Watched) -> list[str]:
    """The layers that can be switched."""
    if not watched.page.is_visible("#map-layers"):
        watched.page.click("#map-layers-open")
    return watched.page.get_by_role("switch").all_inner_texts()


def test_before_its_first_bump_it_may_be_anywhere_and_nobody_is_offered_to_drive(visit: Open, known: Served):
    watched = opened(visit, known)
    page = watched.page
    watched.wait(f"{WORDS} === 'It may be anywhere on the map: no bump yet.'")
    assert page.inner_text("#drive-title") == "Run"
    assert page.inner_text("#arm") == "Begin a run"
    for hidden in ("#stick", "#limit", "#drive-keys", "#local-panel", "#histogram-panel", "#profile-panel", "#disarm"):
        assert page.is_hidden(hidden), hidden
    assert page.inner_text("#health-figures") == "Bumper Cart, virtual"
    assert offered(watched) == ["Places where it may be", NAMES, *OWN, "Bump space", "Grid"]
    watched.value(LISTEN)
    page.keyboard.press("w")
    page.locator("#map").click(position={"x": 300, "y": 300})
    page.wait_for_selector("#goal-card:not([hidden])")
    assert page.is_hidden("#goal-go"), "it goes nowhere because somebody clicked"
    assert page.get_by_role("button", name="Name it").is_visible()
    assert not {"drive", "goal"} & set(watched.value("said"))


def test_it_runs_by_a_button_is_seen_in_two_places_and_keys_do_not_disturb_it(visit: Open, known: Served):
    watched = opened(visit, known)
    begin(watched, known, 2)
    watched.wait(f"{WORDS}.startsWith('Not localized: it may be in ')")
    watched.wait("crunch.map.frames.clusters.arrays.shares.values.length >= 2")
    places = watched.value(PLACES)
    assert watched.page.is_hidden("#arm")
    watched.wait("/^runs by itself: (drives|backs up|turns)$/.test(document.getElementById('drive-state').textContent)")
    watched.page.keyboard.press("w")
    before = bumps(known)
    wait_until(lambda: bumps(known) >= before + 2)
    assert robot(known)["state"] == "armed", "a key that is let go ends no run"
    watched.wait(f"{PLACES} !== '{places}'")
    watched.wait("Number(document.querySelector('#run div:nth-child(2) dd').textContent) >= 4")
    assert watched.page.inner_text("#run").split()[:2] == ["Run", "1"]
    told = robot(known)["whereabouts"]
    assert not told["localized"]
    first, second = told["places"][:2]
    assert first["share"] == pytest.approx(second["share"], abs=0.02)
    assert first["x"] + second["x"] == pytest.approx(1.5, abs=0.05), "half a turn about the room's middle apart"
    assert first["y"] + second["y"] == pytest.approx(1.1, abs=0.05)
    end(watched, known)
    assert watched.page.inner_text("#drive-state") == "stands"


def test_each_of_its_layers_is_drawn_and_switched_off(visit: Open, known: Served):
    watched = opened(visit, known)
    begin(watched, known, 2)
    end(watched, known)
    watched.wait("crunch.map.frames.raw_path.arrays.bumpers.shape[0] > 0")
    names = offered(watched)
    watched.page.wait_for_timeout(1000)  # the last frames of the run
    for name in [name for name in names if name != NAMES]:  # there are none
        switch = watched.page.get_by_role("switch", name=name, exact=True)
        watched.take_up()
        before = watched.value(LOOK)
        switch.click()
        watched.wait(f"{LOOK} !== {before}")
        switch.click()
        watched.wait(f"{LOOK} === {before}")
    marks = watched.page.eval_on_selector_all("#map-panel .legend li", "all => all.filter((one) => !one.hidden).length")
    assert marks == 7


def test_a_stop_holds_until_somebody_resumes(visit: Open, known: Served):
    watched = opened(visit, known)
    begin(watched, known, 1)
    watched.page.keyboard.press("Space")
    wait_until(lambda: robot(known)["state"] != "armed")
    watched.wait("document.getElementById('banner').textContent.includes('Press Resume to begin a run again')")
    watched.wait("document.getElementById('arm').hidden")
    watched.page.click("#resume")
    watched.wait("!document.getElementById('arm').hidden")
    assert robot(known)["state"] != "armed"


@pytest.mark.parametrize("look", LOOKS)
def test_its_page_is_for_everybody(visit: Open, known: Served, look: dict[str, Any]):
    watched = visit(known, **look)
    watched.wait("crunch.status?.robot.run && crunch.map.frames.clusters")
    check(watched, "welcome")
    watched.page.click("#hint-close")
    offered(watched)
    check(watched, "its layers")
    assert watched.value("document.documentElement.scrollWidth <= innerWidth")


def test_in_an_area_that_nobody_knows_the_map_grows_from_its_bumps(visit: Open, unknown: Served):
    watched = opened(visit, unknown)
    assert watched.page.is_hidden("#whereabouts")
    assert offered(watched) == [NAMES, *OWN, "Grid"]
    assert not watched.value("crunch.map.frames.map_so_far.header.is_given")
    begin(watched, unknown, 12)
    watched.wait("crunch.map.frames.map_so_far.arrays.lengths.values.length > 0")
    watched.wait("crunch.map.map.path.length >= 12")
    assert watched.page.inner_text("#map-figures").split()[1] == "bumps,"
    end(watched, unknown)
    with urllib.request.urlopen(unknown.address + "api/v1/map.json", timeout=PATIENCE) as answer:
        content = json.load(answer)
    assert (content["robot"], len(content["walls"]) > 0) == ("bumper_cart", True)
    watched.page.click("#map-save")
    watched.page.get_by_text("saved", exact=False).first.wait_for()
    assert watched.value("fetch('/api/v1/maps').then((answer) => answer.json()).then((maps) => maps.length)") == 1


def test_its_recording_is_played_again(visit: Open, known: Served):
    recording = known.recording()
    watched = visit(known, f"?recording={recording.stem}")
    watched.wait("crunch.status?.map.vertices > 1")
    watched.wait("crunch.map.frames.clusters?.arrays.shares.values.length > 1")
    assert watched.page.inner_text("#whereabouts").startswith("Not localized")
