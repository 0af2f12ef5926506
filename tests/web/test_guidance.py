"""The way to a goal and the places worth seeing again, as a person meets them on the page."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.served import Served, demo, wait_until
from tests.web.conftest import LISTEN, UNHURRIED, Open, Watched
from tests.web.test_page import at_rest, dismiss

GOAL = [-0.5, -2.6]  # m
ROUTE = "crunch.map.frames.route"
PLACES = """[{x: 1.0, y: 0.5, gain_m: 0.4, drive_m: 6.2, text: "Drive 6 m to here."}]"""
SHOW = """(suggestions) => {
  const { connection } = crunch;
  const frame = {topic: "suggestions", header: {topic: "suggestions", suggestions}, arrays: {}};
  connection.announce = connection.truly ??= connection.announce.bind(connection);
  connection.announce("frame", frame);
  connection.announce("suggestions", frame);
  connection.announce = (name, detail) => name !== "suggestions" && connection.truly(name, detail);
}"""  # as if the server had said so; what it says itself meanwhile is not heard

NEVER_SEEN = """(() => {
  const { connection } = crunch;
  const announce = connection.announce.bind(connection);
  connection.announce = (name, detail) => {
    if (name === "pose") detail.header.goal = null;
    announce(name, detail);
  };
})()"""  # no picture shows a goal, as when it is given up before the next one is taken
OLD_NEWS = """(() => {
  const { driver, connection } = crunch;
  const tell = (name, header) => connection.announce(name, { header, arrays: {} });
  const goal = (place) => tell("pose", { ...crunch.pose, goal: place });
  driver.goTo([1, 0]);
  const first = driver.goal;
  goal([1, 0]);
  driver.goTo([2, 0]);
  goal(null);
  tell("notice", { kind: "ended", word: "hold", id: first, reason: "" });
  tell("notice", { kind: "refused", word: "hold", id: first, reason: "the picture is too old to drive by" });
  const lasted = driver.hasGoal;
  tell("notice", { kind: "ended", word: "hold", id: driver.goal, reason: "" });
  return [lasted, driver.hasGoal];
})()"""  # whether a goal outlives what comes late of the one before it, and then its own end
HIDE = """(() => {
  Object.defineProperty(document, "hidden", { value: true, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
})()"""


@pytest.fixture(scope="module")
def served(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """With a long lease, and old pictures to drive by: a busy machine is not to look like a driver who has let go."""
    assert browser.is_connected()
    flags = ("--world", "demo", "--plan", "demo", "--set", "control.lease=30", "--set", "control.stale=30")
    with demo(tmp_path_factory.mktemp("guidance"), *flags, *UNHURRIED) as served:
        yield served


def look(served: Served, visit: Open) -> Watched:
    """A page that may send the robot somewhere."""
    at_rest(served)
    page = visit(served)
    page.wait(f"{ROUTE} && crunch.pose && !crunch.driver.isLocked")
    return page


def far_place(served: Served) -> list[float]:
    """One of two places, so far that the robot is on its way for a while."""
    return [0.0, 0.0] if math.dist(served.status()["robot"]["pose"][:2], GOAL) < 1.0 else GOAL


def test_a_goal_in_another_room_is_reached_by_a_planned_way_that_is_shown(served: Served, visit: Open):
    """Through the door of the room below the start."""
    page = look(served, visit)
    assert page.page.is_hidden("#route-state")
    page.page.evaluate("place => crunch.driver.goTo(place)", GOAL)
    page.wait(f"{ROUTE}.header.state === 'driving' && {ROUTE}.arrays.route.shape[0] > 1")
    page.page.wait_for_selector("#route-state:has-text('m to go')")
    wait_until(lambda: served.status()["driver"]["goal"] is None)
    status = served.status()
    assert math.dist(status["robot"]["pose"][:2], GOAL) < 0.5, status["stops"]
    page.page.wait_for_selector("#route-state", state="hidden")


def test_a_goal_goes_on_while_the_page_is_visible_and_ends_when_it_is_hidden(served: Served, visit: Open):
    page = look(served, visit)
    page.page.evaluate("place => crunch.driver.goTo(place)", far_place(served))
    page.wait("crunch.pose.goal")
    page.value(LISTEN)
    page.value("dispatchEvent(new Event('blur'))")
    page.wait("said.filter((type) => type === 'hold').length > 3")
    assert set(page.value("said")) <= {"hold", "ack", "ping"}, "nothing was held, so nothing is let go"
    page.value(HIDE)
    assert page.value("said").count("cancel") == 1
    wait_until(lambda: served.status()["driver"]["goal"] is None)
    page.value("said.length = delete document.hidden && 0")
    page.page.wait_for_timeout(300)
    assert "hold" not in page.value("said"), "seen again, it does not begin to drive by itself"


def test_a_click_proposes_a_goal_and_the_button_drives_there(served: Served, visit: Open):
    page = dismiss(look(served, visit))
    page.page.locator("#limit").fill("0.1")  # it is not to arrive before it is called back
    page.value("crunch.map.zoom(0.5)")  # so that both places are in sight

    def is_proposed() -> bool:  # the page may have moved under the click
        left, top = page.value(f"crunch.map.toScreen({far_place(served)})")
        box = page.page.locator("#map").bounding_box() or {"x": 0.0, "y": 0.0}
        page.page.mouse.click(box["x"] + left, box["y"] + top)
        return page.page.is_visible("#goal-card")

    wait_until(is_proposed)
    assert served.status()["driver"]["goal"] is None, "a click alone moves nothing"
    page.page.click("#goal-go")
    wait_until(lambda: served.status()["driver"]["goal"])
    page.wait("!document.getElementById('cancel').hidden")
    page.page.click("#cancel")
    wait_until(lambda: served.status()["driver"]["goal"] is None)


def test_a_place_without_a_way_says_why(served: Served, visit: Open):
    page = look(served, visit)
    page.page.evaluate("crunch.driver.goTo([500, 0])")
    page.page.wait_for_selector("#route-state:has-text('more than 200 m away')")
    wait_until(lambda: served.status()["driver"]["goal"] is None)
    page.wait("!crunch.driver.hasGoal")


def test_a_goal_that_no_picture_has_shown_ends_all_the_same(served: Served, visit: Open):
    page = look(served, visit)
    page.value(NEVER_SEEN)
    assert page.value("(crunch.driver.goTo([500, 0]), crunch.driver.hasGoal)")
    page.wait("!crunch.driver.hasGoal")
    wait_until(lambda: served.status()["driver"]["goal"] is None)


def test_a_goal_outlives_what_comes_late_of_the_one_before(served: Served, visit: Open):
    page = look(served, visit)
    assert page.value(OLD_NEWS) == [True, False]
    page.value("crunch.driver.cancelGoal()")
    wait_until(lambda: served.status()["driver"]["goal"] is None)


def test_a_suggestion_unfolds_and_proposes_a_goal(served: Served, visit: Open):
    page = visit(served)
    page.page.evaluate(f"({SHOW})([])")
    assert page.page.is_hidden("#suggestions")
    page.page.evaluate(f"({SHOW})({PLACES})")
    page.page.click("#suggestions > button")
    assert page.page.get_attribute("#suggestions > button", "aria-expanded") == "true"
    page.page.click("#suggestions li button")
    assert page.page.is_visible("#goal-card")
    assert page.value("crunch.map.candidate") == [1.0, 0.5]
    page.page.evaluate(f"({SHOW})([])")
    assert page.page.is_hidden("#suggestions")
