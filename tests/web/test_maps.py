"""Maps in the browser: saved, looked at, downloaded, turned, labelled, compared, deleted and taken back."""

import json
import math
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Position

from server.formats.g2o import read_g2o
from server.formats.ros_map import OCCUPIED, read_ros_map
from server.formats.tum import read_tum
from tests.served import PATIENCE, Served, demo, wait_until
from tests.web.conftest import HOLD_BACK, Open, Watched
from tests.web.test_page import PHONE, dismiss

FORMATS = ("png", "pgm", "yaml", "json", "g2o", "tum", "csv", "zip")


@pytest.fixture(scope="module")
def mapped(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A robot that has driven by itself for a while and stands now."""
    assert browser.is_connected()
    with demo(tmp_path_factory.mktemp("mapped"), "--autopilot", "--speed", "8", "--name", "Tuesday") as served:
        wait_until(lambda: served.status()["map"]["vertices"] >= 30)
        ask(served, "POST", "commands", {"type": "stop"})
        ask(served, "POST", "commands", {"type": "resume"})
        wait_until(lambda: ask(served, "GET", "status")["filter"]["waiting"] == 0)
        yield served


def ask(served: Served, method: str, address: str, body: Any = None) -> Any:
    """A request of REST."""
    data = None if body is None else json.dumps(body).encode()
    headers = {"Content-Type": "application/json", "X-Crunch-Client": "test"}
    request = urllib.request.Request(f"{served.address}api/v1/{address}", data, headers, method=method)
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        return json.loads(answer.read() or "null")


def open_maps(page: Watched) -> Watched:
    """The library at its maps."""
    dismiss(page)
    page.page.click("#library-open")
    page.page.click("#maps-tab")
    return page


def open_map(page: Watched, name: str) -> None:
    """A saved map, drawn."""
    page.page.locator(".map-cards").get_by_role("button", name=name, exact=True).click()
    page.wait("document.querySelector('.map-sheet .stage').dataset.empty === undefined")
    wait_until(lambda: inked(page) > 0.005)


def inked(page: Watched) -> float:
    """Share of the opened map's canvas that is drawn on."""
    return page.value("""(() => {
        const canvas = document.querySelector(".map-sheet canvas");
        const context = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
        context.drawImage(canvas, 0, 0);
        const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
        let drawn = 0;
        for (let i = 3; i < data.length; i += 4) drawn += data[i] > 60;
        return drawn / (data.length / 4);
    })()""")


def saved(served: Served, name: str) -> int:
    """The number of a map saved by REST."""
    return ask(served, "POST", "maps", {"name": name})["id"]


def test_a_map_is_saved_and_each_format_downloaded_and_read(mapped: Served, visit: Open, tmp_path: Path):
    page = open_maps(visit(mapped))
    page.page.get_by_label("Name for the map").fill("Ground floor")
    page.page.get_by_role("button", name="Save the present map").click()
    page.page.locator(".toast", has_text="Saved as").wait_for()
    page.wait("document.querySelector('.map-cards img')?.naturalWidth === 480")
    open_map(page, "Ground floor")
    files: dict[str, Path] = {}
    for name in FORMATS:
        with page.page.expect_download() as download:
            page.page.locator(".map-files").get_by_role("link", name=name.upper(), exact=True).click()
        files[name] = tmp_path / download.value.suggested_filename
        download.value.save_as(files[name])
    assert {file.name for file in files.values()} == {f"ground-floor.{name}" for name in FORMATS}
    document = json.loads(files["json"].read_text())
    path = np.array(document["path"])
    assert len(path) >= 30
    with Image.open(files["png"]) as picture:
        assert min(picture.size) > 400
    assert OCCUPIED in read_ros_map(files["yaml"]).cells
    np.testing.assert_allclose(read_g2o(files["g2o"]).vertices, path, atol=1e-3)
    np.testing.assert_allclose(read_tum(files["tum"])[1], path, atol=1e-3)
    assert len(files["csv"].read_text().splitlines()) == len(path) + 1
    with zipfile.ZipFile(files["zip"]) as archive:
        assert archive.testzip() is None


def test_the_button_on_the_live_map_saves_too(mapped: Served, visit: Open):
    before = len(ask(mapped, "GET", "maps"))
    page = dismiss(visit(mapped))
    page.page.click("#map-save")
    page.page.locator(".toast", has_text="Saved as “Tuesday”").wait_for()
    assert len(ask(mapped, "GET", "maps")) == before + 1


def test_a_frame_is_straightened_turned_moved_and_all_of_it_taken_back(mapped: Served, visit: Open):
    number = saved(mapped, "Crooked")
    ask(mapped, "PATCH", f"maps/{number}", {"frame": {"x": 0.5, "y": -0.25, "theta": 0.3}})

    def frame() -> dict[str, float]:
        return ask(mapped, "GET", f"maps/{number}")["frame"]

    page = open_maps(visit(mapped))
    open_map(page, "Crooked")
    page.page.get_by_role("button", name="Straighten").click()
    wait_until(lambda: abs(ask(mapped, "GET", f"maps/{number}")["skew_rad"]) < 0.01)
    page.page.locator(".toast", has_text="Straightened").get_by_role("button", name="Undo").click()
    wait_until(lambda: frame()["theta"] == pytest.approx(0.3))
    page.page.get_by_label("Turned by").fill("45")
    page.page.get_by_label("Turned by").blur()
    wait_until(lambda: frame()["theta"] == pytest.approx(-math.pi / 4.0, abs=1e-3))

    # What is named where the origin is then put comes to lie at zero.
    stage = page.page.locator(".map-sheet canvas")
    assert page.value("""(() => {
        document.body.classList.add("stale");
        return ["#map", ".map-sheet canvas"].map((one) => getComputedStyle(document.querySelector(one)).filter);
    })()""") == ["grayscale(1) opacity(0.5)", "none"], "only what is live grows old"
    box = stage.bounding_box()
    assert box is not None
    place: Position = {"x": box["width"] * 0.4, "y": box["height"] * 0.6}
    page.page.get_by_role("button", name="Name a place").click()
    stage.click(position=place)
    page.page.locator(".map-side").get_by_label("Name of this place").fill("Lamp")
    page.page.get_by_role("button", name="Save name").click()
    page.page.locator(".map-labels", has_text="Lamp").wait_for()
    page.page.get_by_role("button", name="Set origin").click()
    stage.click(position=place)
    wait_until(lambda: frame()["x"] != pytest.approx(0.5))
    (lamp,) = ask(mapped, "GET", f"maps/{number}")["labels"]
    assert (lamp["x"], lamp["y"]) == pytest.approx((0.0, 0.0), abs=0.01)
    page.page.get_by_role("button", name="As it was made").click()
    wait_until(lambda: frame() == {"x": 0.0, "y": 0.0, "theta": 0.0})


def test_keys_alone_name_a_place_and_never_drive(mapped: Served, visit: Open):
    number = saved(mapped, "By keys")
    before = mapped.status()["driver"]["viewer"]
    page = open_maps(visit(mapped))
    open_map(page, "By keys")
    page.page.get_by_role("button", name="Name a place").press("Enter")
    for key in ("ArrowLeft", "ArrowUp", "+", "Enter"):
        page.page.keyboard.press(key)
    page.page.keyboard.type("Sad wad")  # letters that drive elsewhere
    page.page.keyboard.press("Enter")
    page.page.locator(".map-labels", has_text="Sad wad").wait_for()
    assert [place["text"] for place in ask(mapped, "GET", f"maps/{number}")["labels"]] == ["Sad wad"]
    page.page.get_by_role("button", name="Remove Sad wad").click()
    page.page.locator(".toast", has_text="removed").get_by_role("button", name="Undo").click()
    page.page.locator(".map-labels", has_text="Sad wad").wait_for()
    assert mapped.status()["driver"]["viewer"] == before, "no key has driven"


def test_changes_are_kept_although_they_come_at_once(mapped: Served, visit: Open):
    number = saved(mapped, "Before")
    page = open_maps(visit(mapped))
    open_map(page, "Before")
    page.page.get_by_label("Name of the map").fill("After")
    page.page.get_by_label("Note", exact=True).fill("doors shut")
    page.page.get_by_role("button", name="Quarter turn").click()
    page.page.get_by_role("button", name="Quarter turn").click()
    wait_until(lambda: abs(ask(mapped, "GET", f"maps/{number}")["frame"]["theta"]) == pytest.approx(math.pi, abs=1e-3))
    kept = ask(mapped, "GET", f"maps/{number}")
    assert (kept["name"], kept["note"]) == ("After", "doors shut")


def test_two_maps_are_laid_over_each_other(mapped: Served, visit: Open):
    saved(mapped, "Monday")
    other = saved(mapped, "Turned")
    ask(mapped, "PATCH", f"maps/{other}", {"frame": {"x": 2.0, "y": 1.0, "theta": 1.0}})
    page = open_maps(visit(mapped))
    open_map(page, "Monday")
    page.page.get_by_label("Compare with another map").select_option(label="Turned")
    page.page.locator(".map-side", has_text="Within 15 cm, 100 % of this map's walls are in the other").wait_for()
    assert page.page.locator(".map-sheet .legend").inner_text().split() == ["Monday", "Turned"]
    page.page.get_by_label("find how they lie").uncheck()
    page.page.locator(".map-side", has_text="Within 15 cm").and_(
        page.page.locator(":not(:has-text('100 %'))")
    ).wait_for()
    address = page.page.get_by_role("link", name="Picture of both").get_attribute("href")
    with urllib.request.urlopen(mapped.address + str(address).lstrip("/"), timeout=PATIENCE) as answer:
        assert answer.read().startswith(b"\x89PNG")


def test_a_deletion_is_taken_back_at_once_or_later(mapped: Served, visit: Open):
    number = saved(mapped, "Precious")
    page = open_maps(visit(mapped, **PHONE))
    cards = page.page.locator(".map-cards")
    for way_back in ("Undo", "Take back"):
        cards.get_by_role("button", name="Delete Precious").click()
        toast = page.page.locator(".toast", has_text="“Precious” deleted")
        toast.wait_for()
        assert ask(mapped, "GET", f"maps/{number}")["is_deleted"]
        assert cards.get_by_text("Precious").count() == 0
        if way_back == "Undo":
            toast.get_by_role("button", name="Undo").click()
        else:
            page.page.get_by_role("button", name="Deleted maps").click()
            cards.locator("li", has_text="Precious").get_by_role("button", name="Take back").click()
            wait_until(lambda: not ask(mapped, "GET", f"maps/{number}")["is_deleted"])
            page.page.get_by_role("button", name="Deleted maps").click()
        cards.get_by_role("button", name="Delete Precious").wait_for()
    assert page.value("document.documentElement.scrollWidth <= innerWidth")


def test_a_list_that_comes_late_is_not_shown(mapped: Served, visit: Open):
    ask(mapped, "DELETE", f"maps/{saved(mapped, 'Unwanted')}")
    saved(mapped, "Wanted")
    page = open_maps(visit(mapped))
    cards = page.page.locator(".map-cards")
    cards.get_by_text("Wanted", exact=True).wait_for()
    page.value(HOLD_BACK)
    page.page.get_by_role("button", name="Deleted maps").click()
    page.wait("letGo")
    page.page.get_by_role("button", name="Deleted maps").click()
    page.wait("answered")
    page.take_up()
    page.value("letGo()")
    page.take_up()
    cards.get_by_text("Wanted", exact=True).wait_for()
    assert cards.get_by_text("Unwanted").count() == 0


def test_a_name_that_is_saved_late_takes_no_other_place_away(mapped: Served, visit: Open):
    page = dismiss(visit(mapped))
    page.page.click("#map-fit")
    page.page.click("#map", position={"x": 200, "y": 200})
    page.page.get_by_role("button", name="Name it").click()
    page.page.locator("#goal-card").get_by_label("Name of this place").fill("Desk")
    page.value(HOLD_BACK)
    page.page.locator("#goal-card").get_by_role("button", name="Save name").click()
    page.wait("letGo")
    page.page.click("#map", position={"x": 120, "y": 90})
    page.value("letGo()")
    page.take_up()
    assert page.page.is_visible("#goal-card")
    for place in ask(mapped, "GET", "labels"):
        ask(mapped, "DELETE", f"labels/{place['id']}")


def test_a_place_of_the_live_map_is_named_seen_by_all_and_its_name_taken_away(mapped: Served, visit: Open):
    page, other = dismiss(visit(mapped)), dismiss(visit(mapped))
    page.page.click("#map-fit")
    page.page.click("#map", position={"x": 300, "y": 250})
    page.page.get_by_role("button", name="Name it").click()
    page.page.locator("#goal-card").get_by_label("Name of this place").fill("Sofa")
    page.page.locator("#goal-card").get_by_role("button", name="Save name").click()
    for each in (page, other):
        each.wait("crunch.map.frames.labels?.header.labels.some(({ text }) => text === 'Sofa')")
    page.page.wait_for_selector("#goal-card", state="hidden")
    assert [place["text"] for place in ask(mapped, "GET", "labels")] == ["Sofa"]
    kept = ask(mapped, "POST", "maps", {"name": "With sofa"})
    assert [place["text"] for place in kept["labels"]] == ["Sofa"]
    page.page.click("#map", position={"x": 303, "y": 248})
    page.page.get_by_role("button", name="Remove “Sofa”").click()
    other.wait("crunch.map.frames.labels.header.labels.length === 0")
    page.page.locator(".toast", has_text="removed").get_by_role("button", name="Undo").click()
    other.wait("crunch.map.frames.labels.header.labels.length === 1")


def test_a_server_that_is_killed_and_started_again_has_every_map(browser: Browser, tmp_path: Path):
    assert browser.is_connected()
    with demo(tmp_path, "--autopilot", "--speed", "8") as served:
        wait_until(lambda: served.status()["map"]["vertices"] >= 3)
        number = saved(served, "Kept")
        ended = ask(served, "POST", "sessions/current/end")
        served.process.kill()
        served.process.wait()
    with demo(tmp_path) as served:
        kept = ask(served, "GET", f"maps/{number}")
        assert kept["name"] == "Kept"
        with urllib.request.urlopen(f"{served.address}api/v1/maps/{number}/map.json", timeout=PATIENCE) as answer:
            assert len(json.load(answer)["path"]) == kept["vertices"]
        by_itself = ask(served, "GET", f"maps/{ended['map']}")
        assert by_itself["vertices"] == ended["vertices"]
        assert by_itself["recording"] == ended["recording"]
