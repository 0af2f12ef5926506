"""The page in a real browser: it shows the robot, drives it, stops it, and lets go of it in every way out."""

import json
import math
import os
import signal
import time
import urllib.request

from playwright.sync_api import Page

from server.control import ControlParams
from tests.served import PATIENCE, Served, demo, wait_until
from tests.web.conftest import GOOD, LISTEN, Open, Watched

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "device_scale_factor": 3}
LAST_WORDS = """(() => {
    const last_words = { t: 3, state: "fault", reason: "blocked", since: 9.5, uptime: 71 };
    const { status } = crunch;
    crunch.connection.announce("status", { header: { ...status, robot: { ...status.robot, last_words } } });
    const name = [...document.querySelectorAll("#health dt")].find((dt) => dt.textContent === "Was reset");
    return name?.nextSibling.textContent;
})()"""
DRIVER = "crunch.status?.driver"
RESTARTS = """(() => {
    const name = [...document.querySelectorAll("#health dt")].find((dt) => dt.textContent === "Restarts");
    return name.nextSibling.textContent;
})()"""
REMEMBER = """(() => {
    const [banner, chip] = ["banner", "chip-filter"].map((id) => document.getElementById(id));
    Object.assign(globalThis, { told: [], lengths: [] });
    const text = (one) => (one.hidden ? "" : one.textContent);
    const tell = () => told.push([text(banner), text(chip.lastElementChild), chip.dataset.level]);
    new MutationObserver(tell).observe(document.body, { subtree: true, childList: true, attributes: true });
    crunch.connection.addEventListener("path", ({ detail }) => lengths.push(detail.arrays.path.shape[0]));
})()"""  # what the page tells of the filter, however briefly, and how long the map has been


def dismiss(watched: Watched) -> Watched:
    """Close the first-run hint."""
    watched.page.click("#hint-close")
    return watched


def at_rest(served: Served) -> None:
    """Nobody drives, no stop holds, and the robot stands: what each test may count on."""
    wait_until(lambda: served.status()["driver"]["viewers"] == 0)
    assert served.status()["driver"]["viewer"] is None
    assert served.status()["driver"]["stopped_by"] is None
    wait_until(lambda: distance_in(served, 0.5) < 0.02)


def distance_in(served: Served, seconds: float) -> float:
    """Metres that the wheels roll within some time."""
    before = served.status()["robot"]["distance_m"]
    time.sleep(seconds)
    return served.status()["robot"]["distance_m"] - before


def centre(page: Page, selector: str) -> tuple[float, float]:
    """The middle of an element."""
    box = page.locator(selector).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0


def painted(watched: Watched, canvas: str) -> float:
    """Share of a canvas's pixels that are not blank, in a copy: Chromium complains of who often reads one."""
    return watched.value(f"""(() => {{
        const canvas = document.getElementById("{canvas}");
        const copy = new OffscreenCanvas(canvas.width, canvas.height);
        const context = copy.getContext("2d", {{ willReadFrequently: true }});
        context.drawImage(canvas, 0, 0);
        const pixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
        let drawn = 0;
        for (let i = 3; i < pixels.length; i += 4) drawn += pixels[i] > 0;
        return drawn / (pixels.length / 4);
    }})()""")


def test_everything_is_shown(served: Served, visit: Open):
    page = dismiss(visit(served))
    page.wait("crunch.status && crunch.pose")
    page.wait("document.querySelector('#chip-battery b').textContent.endsWith(' V')")
    for canvas in ("map", "local", "histogram", "profile"):
        page.wait(f"document.getElementById('{canvas}').width > 100")
        wait_until(lambda canvas=canvas: painted(page, canvas) > 0.01)
    assert page.value("document.querySelectorAll('#health dd').length") > 10
    page.wait("crunch.connection.silence < 1000")
    assert page.value(LAST_WORDS) == "after 1:11, fault (blocked)"


def test_every_control_has_a_name_and_nothing_is_wider_than_the_screen(served: Served, visit: Open):
    for options in ({}, PHONE, {"viewport": {"width": 1000, "height": 700}}):
        page = visit(served, **options)
        page.wait("crunch.status && crunch.pose")
        nameless = page.value(
            "[...document.querySelectorAll('button, a, input, canvas, [role=application]')].filter(e => "
            "e.checkVisibility() && !(e.textContent.trim() || e.ariaLabel || e.labels?.length)).map(e => e.outerHTML)"
        )
        assert nameless == []
        assert page.value("document.documentElement.scrollWidth <= innerWidth")
        box = page.page.locator("#stop").bounding_box()
        assert box is not None
        width, height = page.value("[innerWidth, innerHeight]")
        assert 0 <= box["x"] <= width - box["width"], "STOP is always on the screen"
        assert 0 <= box["y"] <= height - box["height"]
        page.page.evaluate("scrollTo(0, 1e6)")
        scrolled = page.page.locator("#stop").bounding_box()
        assert scrolled is not None
        assert scrolled["y"] == box["y"]


def test_keys_drive_and_letting_go_stops(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    before = served.status()["robot"]["distance_m"]
    page.hold("w", lambda: served.status()["robot"]["distance_m"] > before + 0.4)
    page.hold("w", lambda: served.status()["driver"]["leased"])
    assert page.value("crunch.connection.viewer") == served.status()["driver"]["viewer"]
    page.wait("document.getElementById('drive-state').textContent === 'you drive'")
    page.page.keyboard.up("w")
    wait_until(lambda: not served.status()["driver"]["leased"])
    wait_until(lambda: distance_in(served, 0.5) < 0.02)


def test_arrow_keys_turn(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    before = served.status()["robot"]["pose"][2]
    page.hold("ArrowLeft", lambda: math.sin(served.status()["robot"]["pose"][2] - before) > 0.3)
    page.page.keyboard.up("ArrowLeft")


def test_losing_the_focus_lets_go_although_the_key_is_down(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    page.hold("w", lambda: served.status()["driver"]["leased"])
    page.value("dispatchEvent(new Event('blur'))")
    assert page.value("[crunch.driver.source, ...crunch.driver.wish]") == [None, 0, 0]
    wait_until(lambda: not served.status()["driver"]["leased"])


def test_a_page_that_hangs_stops_the_robot(served: Served, visit: Open):
    """The key is held, but the page's own thread is busy: silence, and the server stops the robot."""
    at_rest(served)
    page = dismiss(visit(served))
    page.hold("w", lambda: served.status()["driver"]["leased"])
    before = served.status()["t"]
    page.value("setTimeout(() => { const end = Date.now() + 3000; while (Date.now() < end); }, 0)")

    def is_stopped() -> bool:
        fallen_silent = (stop for stop in served.status()["stops"] if stop["reason"] == "the driver fell silent")
        return any(stop["t"] > before for stop in fallen_silent)

    wait_until(is_stopped)
    page.page.keyboard.up("w")


def test_closing_the_page_stops_the_robot_and_frees_it(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    page.hold("w", lambda: distance_in(served, 0.3) > 0.03)
    page.page.close()
    wait_until(lambda: served.status()["driver"]["viewer"] is None)
    wait_until(lambda: distance_in(served, 0.5) < 0.02)


def test_space_stops_for_everyone_until_the_driver_resumes(served: Served, visit: Open):
    at_rest(served)
    driver, watcher = dismiss(visit(served)), dismiss(visit(served))
    driver.hold("w", lambda: served.status()["driver"]["leased"])
    watcher.page.keyboard.press("Space")
    wait_until(lambda: served.status()["driver"]["stopped_by"])
    driver.page.wait_for_selector("#banner:visible >> text=Resume")
    driver.hold("w", lambda: driver.page.is_visible("#toasts .toast"))
    wait_until(lambda: distance_in(served, 0.5) < 0.02)
    driver.page.keyboard.up("w")
    driver.page.click("#resume")
    wait_until(lambda: served.status()["driver"]["stopped_by"] is None)
    driver.wait("document.getElementById('banner').hidden")


def test_the_button_stops_too_and_only_the_driver_resumes(served: Served, visit: Open):
    at_rest(served)
    one, two = dismiss(visit(served)), dismiss(visit(served))
    one.hold("w", lambda: served.status()["driver"]["leased"])
    two.page.click("#stop")
    wait_until(lambda: served.status()["driver"]["stopped_by"])
    one.page.keyboard.up("w")
    two.page.click("#resume")
    two.page.wait_for_selector("#toasts .toast")
    assert served.status()["driver"]["stopped_by"]
    one.page.click("#resume")
    one.wait(f"{DRIVER}.stopped_by === null")


def test_an_objective_is_clicked_and_reached(visit: Open, tmp_path):
    """With the default lease: where a busy machine makes the page hold its breath for 0.3 s the robot stops, and the
    driver clicks once more, as a person would. But once at least the objective is held for longer than two leases."""
    with demo(tmp_path, "--world", "demo", "--plan", "demo") as served:
        with urllib.request.urlopen(served.address + "api/v1/config", timeout=PATIENCE) as answer:
            radius = json.load(answer)["crunch"]["goal_radius"]
        page = dismiss(visit(served))
        page.wait("crunch.pose")
        x, y, heading = page.value("crunch.pose.pose")
        place = [x + 0.9 * math.cos(heading), y + 0.9 * math.sin(heading)]
        page.value(LISTEN)
        held = 0

        def is_there() -> bool:
            nonlocal held
            page.wait("!crunch.driver.isLocked")
            left, top = page.value(f"crunch.map.toScreen({place})")
            box = page.page.locator("#map").bounding_box()
            assert box is not None
            page.page.mouse.click(box["x"] + left, box["y"] + top)
            clicked = page.value("crunch.map.candidate")
            if math.dist(clicked, place) > 0.1:  # the map has followed the robot meanwhile
                return False
            page.value("said.length = 0")
            page.page.get_by_role("button", name="Drive here").click()
            wait_until(lambda: served.status()["driver"]["goal"] is None and not page.value("crunch.driver.hasGoal"))
            held = max(held, page.value("said.filter((type) => type === 'hold').length"))
            return math.dist(served.status()["robot"]["pose"][:2], clicked) < radius

        wait_until(is_there)
        assert 0.08 * held > 2.0 * ControlParams().lease, "s: it says so every 80 ms"
        page.page.wait_for_selector("#route-state", state="hidden")
        wait_until(lambda: distance_in(served, 0.5) < 0.02)
        page.page.close()


def test_thumb_drives_on_a_phone(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served, **PHONE))
    page.page.locator("#stick").scroll_into_view_if_needed()
    x, y = centre(page.page, "#stick")
    session = page.page.context.new_cdp_session(page.page)
    is_down = False

    def touch(kind: str, *points: tuple[float, float]) -> None:
        places = [{"x": a, "y": b} for a, b in points]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    def drives() -> bool:
        """Whether the thumb does; where a late picture has let go it is put down again."""
        nonlocal is_down
        if page.value("crunch.driver.source") is None:
            if is_down:
                touch("touchEnd")
            touch("touchStart", (x, y))
            touch("touchMove", (x - 20.0, y - 50.0))
            is_down = True
        forward, turn = page.value("crunch.driver.wish")
        return 0.5 < forward <= 1.0 and 0.1 < turn < 0.8 and served.status()["driver"]["leased"]

    wait_until(drives)
    touch("touchEnd")
    page.wait("crunch.driver.source === null && String(crunch.driver.wish) === '0,0'")
    wait_until(lambda: not served.status()["driver"]["leased"])


def test_theme_and_speed_limit_are_remembered(served: Served, visit: Open):
    page = dismiss(visit(served, color_scheme="light"))
    light = page.value("getComputedStyle(document.body).backgroundColor")
    page.page.click("#theme")
    page.page.locator("#limit").fill("0.1")
    page.page.reload()
    page.page.wait_for_selector(GOOD)
    assert page.value("getComputedStyle(document.body).backgroundColor") != light
    assert page.value("crunch.driver.limit") == 0.1
    assert page.page.locator("#hint").is_hidden()


def test_map_grows_while_the_autopilot_drives(visit: Open, tmp_path):
    with demo(tmp_path, "--autopilot", "--speed", "8") as served:
        page = dismiss(visit(served))
        page.wait("crunch.status?.driver.autopilot === true")
        page.wait("crunch.map.map?.path.length >= 3")
        before = page.value("crunch.map.map.path.length")
        page.wait(f"crunch.map.map.path.length >= {before + 5}")
        page.wait("crunch.map.walls.count > 5")
        page.page.click("#map-fit")
        page.page.click("#autopilot")
        page.wait("crunch.status.driver.autopilot === false")
        page.page.close()


def test_a_killed_filter_is_told_and_the_map_stays_whole_and_grows(visit: Open, tmp_path):
    with demo(tmp_path, "--autopilot", "--speed", "4") as served:
        page = dismiss(visit(served))
        page.wait("crunch.map.map?.path.length >= 8")
        page.value(REMEMBER)
        first = page.value("crunch.status.filter.process_id")
        before = page.value("crunch.map.map.path")
        os.kill(first, signal.SIGKILL)
        page.wait("told.some(([banner]) => banner.includes('started again'))")
        page.wait("told.some(([, chip, level]) => chip === 'restarting' && level === 'bad')")
        page.wait("crunch.status.filter.restarts === 1 && ['idle', 'busy'].includes(crunch.status.filter.state)")
        page.wait(f"{RESTARTS} === '1'")
        page.wait("!document.getElementById('banner').textContent.includes('started again')")
        page.wait(f"crunch.map.map.path.length >= {len(before) + 4}")
        page.wait("crunch.map.walls.seen.filter(Boolean).length >= crunch.map.map.path.length - 1")
        assert page.value("Math.min(...lengths)") >= len(before), "the map never shrinks"
        assert page.value("crunch.status.filter.process_id") not in (None, first)
        assert page.value("crunch.status.filter.restarts") == 1
        page.page.click("#autopilot")
        page.wait("crunch.status.driver.autopilot === false")
        page.page.close()


def test_page_greys_when_the_server_is_gone_and_comes_back_with_it(visit: Open, tmp_path):
    with demo(tmp_path) as first:
        page = dismiss(visit(first))
        port = first.address.rsplit(":", 1)[1].strip("/")
    page.page.wait_for_selector('#connection[data-state="bad"]')
    assert page.value("document.body.classList.contains('stale')")
    page.page.keyboard.down("w")
    assert page.value("crunch.driver.source") is None, "driving is locked"
    page.page.keyboard.up("w")
    with demo(tmp_path, "--port", port):
        page.page.wait_for_selector(GOOD)
        page.wait("!document.body.classList.contains('stale')")
        page.page.close()
    page.complaints[:] = [text for text in page.complaints if "WebSocket connection" not in text]
