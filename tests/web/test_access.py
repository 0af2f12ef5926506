"""The page for everybody: axe-core finds no serious fault in any state, keys reach everything, it fits its screens."""

import urllib.request
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe

from tests.served import PATIENCE, Served, demo, wait_until
from tests.web.conftest import Open, Watched
from tests.web.test_page import DRIVER, PHONE, at_rest, dismiss

DESK: dict[str, Any] = {"viewport": {"width": 1440, "height": 900}}
TABLET: dict[str, Any] = {"viewport": {"width": 820, "height": 1180}, "has_touch": True, "is_mobile": True}
WALL: dict[str, Any] = {"viewport": {"width": 2560, "height": 1440}}
LOOKS = [
    pytest.param({**DESK, "color_scheme": "light"}, id="desk-light"),
    pytest.param({**PHONE, "color_scheme": "dark"}, id="phone-dark"),
]
SCREENS = [pytest.param(screen, id=name) for name, screen in
           {"phone": PHONE, "tablet": TABLET, "desk": DESK, "wall": WALL}.items()]  # fmt: skip
FOCUS = "document.activeElement"
ANOTHER_STOP = """(() => {
    const [, ...stops] = crunch.status.stops;
    const stop = { t: 1e4, reason: "pressed Stop", by: "somebody else" };
    crunch.connection.announce("status", { header: { ...crunch.status, stops: [stop, ...stops] } });
})()"""
RULES = {"rules": {"target-size": {"enabled": True}}}  # not among axe's defaults


def check(watched: Watched, state: str) -> None:
    """No serious or critical fault in what the page shows now."""
    violations = Axe().run(watched.page, options=RULES).response["violations"]
    faults = [
        (fault["id"], fault["help"], [node["html"][:160] for node in fault["nodes"]])
        for fault in violations
        if fault["impact"] in ("serious", "critical")
    ]
    assert not faults, f"{state}: {faults}"


def shown(watched: Watched, *selectors: str) -> None:
    """Until all of these are in sight."""
    for selector in selectors:
        watched.page.wait_for_selector(selector, state="visible")


def within(watched: Watched, selector: str) -> bool:
    """Whether an element lies wholly on the screen."""
    box = watched.page.locator(selector).bounding_box()
    width, height = watched.value("[innerWidth, innerHeight]")
    return (
        box is not None
        and box["x"] >= 0
        and box["y"] >= 0
        and box["x"] + box["width"] <= width
        and box["y"] + box["height"] <= height
    )


def on_top(watched: Watched, selector: str) -> bool:
    """Whether a finger on an element's middle meets the element, and nothing that lies over it."""
    return watched.value(f"""(() => {{
        const element = document.querySelector("{selector}");
        const box = element.getBoundingClientRect();
        return element.contains(document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2));
    }})()""")


@pytest.mark.parametrize("look", LOOKS)
def test_all_newest_stops_can_be_read_by_keys_too(served: Served, visit: Open, look: dict[str, Any]):
    page = dismiss(visit(served, **look))
    for number in range(20):
        headers = {"Content-Type": "application/json", "X-Crunch-Client": f"watch {number}"}
        request = urllib.request.Request(f"{served.address}api/v1/commands", b'{"type": "stop"}', headers)
        urllib.request.urlopen(request, timeout=PATIENCE).close()
    page.wait("document.querySelectorAll('#health .long dt').length === 20")
    check(page, "twenty stops")
    page.page.focus("#health .long")
    page.page.keyboard.press("End")
    page.wait("document.querySelector('#health .long').scrollTop > 0")
    page.value(ANOTHER_STOP)
    assert page.value("document.activeElement.classList.contains('long') && document.activeElement.scrollTop > 0")
    page.page.click("#resume")
    page.wait(f"{DRIVER}.stopped_by === null")


@pytest.mark.parametrize("look", LOOKS)
def test_first_visit_and_the_panels(served: Served, visit: Open, look: dict[str, Any]):
    page = visit(served, **look)
    page.wait("crunch.status && crunch.pose")
    shown(page, "#hint", "#health dd")
    check(page, "welcome")
    dismiss(page)
    page.page.click("#map-layers-open")
    shown(page, "#map-layers [role=switch]")
    check(page, "layers")
    page.page.click("#histogram-panel .why")
    shown(page, "#histogram-explain")
    check(page, "explanation")
    if page.page.locator("#menu-open").is_visible():
        page.page.click("#menu-open")
        shown(page, "#theme")
        check(page, "menu")


@pytest.mark.parametrize("look", LOOKS)
def test_goal_card_and_stop(served: Served, visit: Open, look: dict[str, Any]):
    at_rest(served)
    page = dismiss(visit(served, **look))
    page.wait("crunch.pose")
    page.page.click("#map", position={"x": 160, "y": 120})
    shown(page, "#goal-card")
    check(page, "goal card")
    page.page.click("#goal-cancel")
    page.page.click("#stop")
    page.wait(f"{DRIVER}.stopped_by !== null")
    shown(page, "#banner", "#resume")
    page.wait("document.querySelector('#health').textContent.includes('pressed Stop')")
    check(page, "stopped")
    page.page.click("#resume")
    page.wait(f"{DRIVER}.stopped_by === null")


@pytest.mark.parametrize("look", LOOKS)
def test_replay(served: Served, visit: Open, look: dict[str, Any]):
    page = visit(served, **look)
    page.page.goto(f"{served.address}?recording={served.recording().stem}")
    shown(page, "#replay-bar")
    page.wait("crunch.status && crunch.pose")
    check(page, "replay")
    wait_until(lambda: on_top(page, "#stop"))


def test_saved_map_and_the_map_that_grew(visit: Open, tmp_path):
    with demo(tmp_path, "--autopilot", "--speed", "8") as served:
        page = dismiss(visit(served, **DESK))
        page.wait("crunch.map.map?.path.length >= 8")
        for scheme in ("light", "dark"):
            page.page.emulate_media(color_scheme=scheme)
            check(page, f"driven, {scheme}")
        page.page.click("#library-open")
        page.page.click("#maps-tab")
        page.page.click("#maps-pane button[type=submit]")
        shown(page, ".map-cards button")
        check(page, "saved map, dark")
        page.page.click(".map-cards button >> nth=0")
        shown(page, ".map-sheet canvas")
        for scheme in ("light", "dark"):
            page.page.emulate_media(color_scheme=scheme)
            check(page, f"map's sheet, {scheme}")
        page.page.close()


@pytest.mark.parametrize("look", LOOKS)
def test_library(served: Served, visit: Open, look: dict[str, Any]):
    page = dismiss(visit(served, **look))
    page.page.click("#library-open")
    shown(page, "#recordings-pane .recordings li")
    check(page, "recordings")
    wait_until(lambda: on_top(page, "#stop"))  # the sheet leaves STOP in reach
    page.page.click("#maps-tab")
    shown(page, "#maps-pane")
    check(page, "maps")
    page.page.click("#library-close")
    assert page.value("document.activeElement.id") == "library-open", "back to where it was opened"


def test_hand_over(served: Served, visit: Open):
    at_rest(served)
    driver, other = dismiss(visit(served)), dismiss(visit(served, color_scheme="dark"))
    driver.hold("s", lambda: other.page.is_visible("#ask"))
    check(other, "watching")
    other.page.click("#ask")
    shown(driver, "#driver-request")
    check(driver, "asked")
    shown(other, "#driver-request")
    check(other, "asking")
    driver.page.keyboard.up("s")


def test_without_a_server(visit: Open, tmp_path):
    with demo(tmp_path) as served:
        page = dismiss(visit(served))
        page.wait("crunch.status && crunch.pose")
    page.page.wait_for_selector('#connection[data-state="bad"]')
    shown(page, "#banner")
    check(page, "offline")
    page.page.close()
    page.complaints[:] = [text for text in page.complaints if "WebSocket connection" not in text]


def test_tab_reaches_every_control(served: Served, visit: Open):
    at_rest(served)
    page = visit(served, **DESK)
    page.wait("crunch.status && document.getElementById('arm').hidden")
    wanted = page.value(
        "[...document.querySelectorAll('a[href], button, input, [tabindex=\"0\"]')]"
        ".filter(e => e.checkVisibility() && e.tabIndex >= 0).length"
    )
    met: set[str] = set()
    for _ in range(2 * wanted):
        page.page.keyboard.press("Tab")
        met.add(page.value(f"{FOCUS}.id || {FOCUS}.outerHTML"))
        assert page.value(f"{FOCUS} === document.body || getComputedStyle({FOCUS}).outlineStyle !== 'none'")
    assert {"library-open", "theme", "stop", "map", "hint-close", "stick", "limit", "shared"} <= met
    assert len(met) >= wanted


def test_map_is_driven_to_by_keys(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    page.wait("crunch.map.pose")
    page.page.focus("#map")
    page.page.keyboard.press("Shift+ArrowRight")
    shown(page, "#map-keys")
    assert page.value("crunch.driver.source") is None, "Shift and an arrow move the map, not the robot"
    assert page.value("crunch.map.isFollowing") is False
    scale = page.value("crunch.map.scale")
    page.page.keyboard.press("+")
    assert page.value("crunch.map.scale") > scale
    page.page.keyboard.press("Enter")
    shown(page, "#goal-card")
    assert page.value("crunch.map.candidate[0] - crunch.map.centre[0]") == 0
    assert page.value("document.activeElement.id") == "goal-go"
    page.page.keyboard.press("Tab")
    page.page.keyboard.press("Enter")
    assert page.page.locator("#goal-card").is_hidden()
    assert page.value("document.activeElement.id") == "map"


def test_space_stops_where_a_switch_has_the_focus_and_enter_switches(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    was = page.value("document.getElementById('shared').checked")
    page.page.click("#shared")
    assert page.value("document.getElementById('shared').checked") is not was
    page.page.keyboard.press("Enter")
    assert page.value("document.getElementById('shared').checked") is was
    page.page.keyboard.press("Space")
    page.wait(f"{DRIVER}.stopped_by === crunch.connection.viewer")
    assert page.value("document.getElementById('shared').checked") is was
    page.page.click("#resume")
    page.wait(f"{DRIVER}.stopped_by === null")


@pytest.mark.parametrize("screen", SCREENS)
def test_newcomer_can_drive_and_stop_without_scrolling(served: Served, visit: Open, screen: dict[str, Any]):
    page = visit(served, **screen)
    page.wait("crunch.status && crunch.pose")
    shown(page, "#hint")
    for selector in ("#stop", "#stick", "#hint-close", "#library-open"):
        wait_until(lambda wanted=selector: within(page, wanted) and on_top(page, wanted))
    assert page.value("document.documentElement.scrollWidth <= innerWidth")
    beyond = page.value("""[...document.querySelectorAll("main button, main a.button")].filter((button) => {
        const [inner, outer] = [button.getBoundingClientRect(), button.closest(".panel").getBoundingClientRect()];
        return button.checkVisibility() && (inner.right > outer.right || inner.left < outer.left);
    }).map((button) => button.outerHTML)""")
    assert beyond == []


def test_welcome_leaves_with_whom_it_has_taught(served: Served, visit: Open):
    at_rest(served)
    page = visit(served)
    shown(page, "#hint")
    page.hold("s", lambda: page.page.is_hidden("#hint"))
    page.page.keyboard.up("s")
    page.page.click("#help")
    shown(page, "#hint")
    wait_until(lambda: not served.status()["driver"]["leased"])


def test_panels_that_a_robot_has_not_leave_their_room(served: Served, visit: Open):
    page = dismiss(visit(served, **DESK))
    page.wait("crunch.status")
    before, after, seen = page.value("""(() => {
        const height = () => document.getElementById("map-panel").offsetHeight;
        const before = height();
        const robot = { ...crunch.status.robot, layers: ["pose", "local"] };
        crunch.connection.announce("status", { header: { ...crunch.status, robot } });
        const seen = [...document.querySelectorAll("main .panel")].filter((panel) => panel.checkVisibility());
        return [before, height(), seen.map((panel) => panel.id)];
    })()""")
    assert seen == ["map-panel", "drive-panel", "local-panel", "health-panel"]
    assert after > before


def test_page_is_light(served: Served, visit: Open):
    page = visit(served)
    sizes = page.value("performance.getEntriesByType('resource').map((one) => one.decodedBodySize)")
    assert len(sizes) < 60
    assert sum(sizes) < 300_000, "bytes"
