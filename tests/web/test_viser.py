"""The view in three dimensions in a real browser: it draws the robot, and a click in it proposes and moves nothing."""

import io
import json
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page
from websockets.sync.client import connect

from server.stream import decode
from tests.served import Served, wait_until
from tests.web.conftest import FLAGS, find_browser

WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # without a graphics card; slow to begin
SLOW = 120_000  # ms


@pytest.fixture(scope="module")
def webgl(browser: Browser) -> Iterator[Browser]:
    """A browser that draws in three dimensions with the processor; `browser` has skipped where there is none."""
    webgl = browser.browser_type.launch(executable_path=find_browser(), headless=True, args=[*FLAGS, *WEBGL])
    yield webgl
    webgl.close()


@pytest.fixture(scope="module")
def view(webgl: Browser, served: Served) -> Iterator[Page]:
    """The view behind the robot; one for all tests, since it takes long to begin."""
    page = webgl.new_page(viewport={"width": 800, "height": 600})
    page.goto(served.address + "viser/")
    page.wait_for_selector("text=Path tree", timeout=SLOW)
    yield page
    page.close()


def share_of(page: Page, is_wanted) -> float:
    """Share of the picture's pixels (n, 3) that are wanted."""
    picture = Image.open(io.BytesIO(page.screenshot(timeout=SLOW))).convert("RGB")
    return float(np.mean(is_wanted(np.asarray(picture, int).reshape(-1, 3))))


def is_yellow(pixels: np.ndarray) -> np.ndarray:
    """The decks of the robot, in light and shade."""
    red, green, blue = pixels.T
    return (red > 120) & (green > 100) & (blue < 0.85 * red) & (red - green < 60)


def test_the_robot_is_seen(view: Page):
    wait_until(lambda: share_of(view, is_yellow) > 0.0005)


def test_a_click_is_proposed_to_all_viewers_and_moves_nothing(view: Page, served: Served):
    with connect(served.address.replace("http", "ws", 1) + "api/v1/stream") as viewer:

        def proposal() -> dict | None:
            view.mouse.click(200, 450)
            for _ in range(40):
                sequence, header, _ = decode(viewer.recv(decode=False))
                viewer.send(json.dumps({"type": "ack", "seq": sequence}))
                if header.get("kind") == "proposal":
                    return header
            return None

        place = wait_until(proposal)
    view.get_by_text("Objective proposed").first.wait_for(timeout=SLOW)
    x, y, _ = served.status()["robot"]["pose"]
    assert np.hypot(place["x"] - x, place["y"] - y) < 10.0, "in front of the camera, which stands behind the robot"
    assert served.status()["driver"]["goal"] is None
    assert served.status()["driver"]["viewer"] is None


def test_turning_the_view_proposes_nothing(view: Page):
    proposed = view.get_by_text("Objective proposed")

    def is_clickable() -> bool:
        view.mouse.click(200, 450)
        return proposed.count() > 0

    wait_until(is_clickable)
    wait_until(lambda: proposed.count() == 0)  # they go by themselves
    view.mouse.move(200, 400)
    view.mouse.down()
    view.mouse.move(320, 430, steps=6)
    view.mouse.up()
    view.wait_for_timeout(1500)
    assert proposed.count() == 0
