"""The view in three dimensions in a real browser: it draws the robot, and a click in it proposes and moves nothing.

On the page it is a sheet that keeps the driver's ways to stop, and the goal, alive.
"""

import io
import json
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page
from websockets.sync.client import connect

from server.stream import decode
from tests.served import PATIENCE, Served, wait_until
from tests.web.conftest import FLAGS, GOOD, LISTEN, Watched, find_browser
from tests.web.test_page import DRIVER, dismiss

WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # without a graphics card; slow to begin
SLOW = 1000.0 * PATIENCE  # ms
BELOW = """document.getElementById("scene").getBoundingClientRect().top + 1
    >= document.getElementById("banner").getBoundingClientRect().bottom"""  # the sheet begins below the banner


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
    wait_until(lambda: view.get_by_text("Objective proposed").count() or view.mouse.click(200, 450))
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


@pytest.fixture
def desk(webgl: Browser, served: Served) -> Iterator[Watched]:
    """The dashboard in the same browser; it must have complained of nothing in the end."""
    desk = Watched(webgl.new_page(viewport={"width": 1000, "height": 760}), [])
    desk.page.set_default_timeout(SLOW)
    desk.page.on("pageerror", lambda error: desk.complaints.append(str(error)))
    desk.page.goto(served.address)
    desk.page.wait_for_selector(GOOD)
    yield dismiss(desk)
    complaints = list(desk.complaints)
    desk.page.close()
    assert not complaints


def test_the_page_shows_it_in_a_sheet_over_which_one_stops_and_confirms(desk: Watched):
    page = desk.page
    desk.wait("crunch.pose && !crunch.driver.isLocked")
    assert page.locator("iframe").count() == 0, "nothing is loaded before it is asked for"
    page.click("#menu-open")
    page.click("#scene-open")
    inside = page.frame_locator("#scene iframe")
    inside.get_by_text("Path tree").first.wait_for()
    page.keyboard.down("w")
    assert desk.value("crunch.driver.source") is None, "nobody drives under the sheet"
    page.keyboard.up("w")

    def is_proposed() -> bool:
        page.mouse.click(300, 600)
        page.wait_for_timeout(500)
        return page.is_visible("#scene #goal-card")

    wait_until(is_proposed)
    assert desk.value("document.activeElement.tagName") == "IFRAME", "the card takes no focus"
    page.keyboard.press("Space")
    desk.wait(f"{DRIVER}.stopped_by === crunch.connection.viewer")
    page.wait_for_selector("#banner:visible")
    desk.wait(BELOW)  # the banner stays in sight
    desk.wait("document.elementFromPoint(...(({x, y}) => [x + 5, y + 5])"
              "(document.getElementById('stop').getBoundingClientRect())).id === 'stop'")  # fmt: skip
    page.click("#goal-cancel")
    page.click("#stop")
    page.click("#scene-close")
    assert page.locator("iframe").count() == 0, "closed, it costs nothing"
    assert desk.value("document.getElementById('goal-card').closest('#map-panel') !== null")
    page.click("#resume")
    desk.wait(f"{DRIVER}.stopped_by === null")


def test_a_goal_goes_on_under_the_sheet(desk: Watched):
    desk.wait("crunch.pose && !crunch.driver.isLocked")
    desk.page.click("#menu-open")
    desk.page.click("#scene-open")
    desk.page.frame_locator("#scene iframe").get_by_text("Path tree").first.wait_for()
    desk.page.mouse.click(300, 600)  # the frame has the focus, the page has not
    desk.value(LISTEN)
    desk.wait("crunch.driver.isLocked || crunch.driver.hasGoal || crunch.driver.goTo([0, 0]), said.includes('hold')")
    assert "cancel" not in desk.value("said")
    desk.value("crunch.driver.stop()")
    desk.page.click("#library-open")
    assert desk.page.locator("iframe").count() == 0, "one sheet at a time"
    assert desk.value("document.querySelector('main').inert")
    desk.page.click("#library-close")
    assert not desk.value("document.querySelector('main').inert")
    desk.page.click("#resume")
    desk.wait(f"{DRIVER}.stopped_by === null")


def test_a_replay_offers_no_view_of_the_present(desk: Watched, served: Served):
    desk.page.goto(f"{served.address}?recording={served.recording().stem}")
    desk.page.wait_for_selector("#replay-bar")
    assert desk.page.locator("#scene-open").is_hidden()
    assert desk.value("document.getElementById('scene-open').hidden")
