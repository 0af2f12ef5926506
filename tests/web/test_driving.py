"""Driving in a real browser beyond keys and thumb: a gamepad with its dead man's button, hand-over, shared driving."""

from playwright.sync_api import Route

from tests.served import Served, wait_until
from tests.web.conftest import Open, Watched
from tests.web.test_page import DRIVER, PHONE, at_rest, centre, dismiss, distance_in

PAD = """(() => {
    globalThis.pad = {
        index: 0, id: "Test Pad (STANDARD GAMEPAD Vendor: 0000 Product: 0000)", mapping: "standard", connected: true,
        axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })),
        frozen: null, get timestamp() { return this.frozen ?? performance.now(); },
    };
    globalThis.plugged = [pad];
    navigator.getGamepads = () => plugged;
    dispatchEvent(new Event("gamepadconnected"));
})()"""
TEXT = "document.getElementById('gamepad').textContent"


def with_pad(served: Served, visit: Open) -> Watched:
    """A page with a synthetic gamepad that has been seen at rest."""
    at_rest(served)
    page = dismiss(visit(served))
    page.value(PAD)
    page.wait(f"{TEXT}.startsWith('Test Pad: hold RB')")
    return page


def press(page: Watched, button: int, is_down: bool) -> None:
    """Press or let go of one of the pad's buttons."""
    page.value(f"pad.buttons[{button}] = {{ pressed: {str(is_down).lower()}, value: {int(is_down)} }}")


def drives(page: Watched) -> None:
    """Until the pad drives the robot."""
    page.wait("crunch.driver.source === 'gamepad' && crunch.driver.wish[0] === 1")
    page.wait(f"{DRIVER}?.leased && {DRIVER}.viewer === crunch.connection.viewer")


def test_a_pad_drives_only_while_its_button_is_held(served: Served, visit: Open):
    page = with_pad(served, visit)
    page.value("pad.axes[1] = -1")
    page.take_up()
    assert page.value("crunch.driver.source") is None, "the stick alone does nothing"
    assert served.status()["driver"]["viewer"] is None
    press(page, 5, True)
    drives(page)
    wait_until(lambda: distance_in(served, 0.3) > 0.03)
    assert page.value(TEXT) == "Test Pad drives"
    press(page, 5, False)
    page.wait("crunch.driver.source === null")
    wait_until(lambda: not served.status()["driver"]["leased"])
    wait_until(lambda: distance_in(served, 0.5) < 0.02)


def test_a_pad_that_is_pulled_out_or_changed_lets_go(served: Served, visit: Open):
    page = with_pad(served, visit)
    page.value("pad.axes[1] = -1")
    press(page, 5, True)
    drives(page)
    page.value("plugged = []; dispatchEvent(new Event('gamepaddisconnected'))")
    assert page.value("crunch.driver.source") is None
    assert page.value("document.getElementById('gamepad').hidden")
    page.value("plugged = [pad]; dispatchEvent(new Event('gamepadconnected'))")
    page.take_up()
    assert page.value("crunch.driver.source") is None, "its button was down when it came: it counts once it has been up"
    press(page, 5, False)
    page.take_up()
    press(page, 5, True)
    drives(page)
    page.value("pad.id = 'Another Pad'")
    page.wait("crunch.driver.source === null")
    wait_until(lambda: not served.status()["driver"]["leased"])


def test_a_frozen_pad_lets_go_and_a_living_one_drives_again(served: Served, visit: Open):
    page = with_pad(served, visit)
    page.value("pad.axes[1] = -1")
    press(page, 5, True)
    drives(page)
    page.value("pad.frozen = performance.now()")
    page.wait(f"{TEXT}.includes('nothing new')")
    assert page.value("crunch.driver.source") is None
    wait_until(lambda: not served.status()["driver"]["leased"])
    page.value("pad.frozen = null")
    drives(page)
    press(page, 5, False)


def test_a_pads_stop_button_stops(served: Served, visit: Open):
    page = with_pad(served, visit)
    press(page, 1, True)
    wait_until(lambda: served.status()["driver"]["stopped_by"])
    press(page, 1, False)
    stop = served.status()["stops"][0]
    assert (stop["reason"], stop["by"]) == ("pressed Stop", page.value("crunch.connection.viewer"))
    page.page.click("#resume")
    page.wait(f"{DRIVER}.stopped_by === null")


def asking(served: Served, visit: Open) -> tuple[Watched, Watched]:
    """One drives and another asks, and both see it."""
    at_rest(served)
    one, two = dismiss(visit(served)), dismiss(visit(served))
    one.hold("w", lambda: one.value(f"{DRIVER}?.viewer === crunch.connection.viewer"))
    two.page.click("#ask")
    one.page.wait_for_selector("#driver-request:not([hidden])")
    two.page.wait_for_selector("#driver-request:has-text('You asked')")
    return one, two


def test_the_driver_hands_over_and_the_robot_stands(served: Served, visit: Open):
    one, two = asking(served, visit)
    assert two.value("crunch.connection.viewer") in one.page.inner_text("#driver-request")
    one.page.get_by_role("button", name="Hand over").click()
    two.page.wait_for_selector("#toasts >> text=You drive now.")
    assert two.value(f"{DRIVER}.viewer === crunch.connection.viewer")
    one.page.keyboard.up("w")
    one.page.wait_for_selector("#driver-request", state="hidden")
    wait_until(lambda: distance_in(served, 0.5) < 0.02)
    assert one.page.is_visible("#ask")
    assert not two.page.is_visible("#ask")


def test_the_driver_keeps_control_and_who_asked_is_told(served: Served, visit: Open):
    one, two = asking(served, visit)
    one.page.get_by_role("button", name="Keep").click()
    two.wait("document.getElementById('toasts').innerText.includes('keeps control')")
    assert served.status()["driver"]["viewer"] == one.value("crunch.connection.viewer")
    assert two.page.is_visible("#ask"), "to ask again"
    one.page.keyboard.up("w")


def test_a_driver_who_closes_the_page_makes_way(served: Served, visit: Open):
    one, two = asking(served, visit)
    one.page.close()
    two.wait(f"{DRIVER}.viewer === crunch.connection.viewer")


def test_the_driver_chooses_whether_obstacles_bend_the_way(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    assert page.page.is_checked("#shared")
    for is_shared in (True, False):
        page.page.set_checked("#shared", is_shared)
        page.hold(
            "a", lambda wanted=is_shared: page.value(f"{DRIVER}?.leased && {DRIVER}.shared === {str(wanted).lower()}")
        )
        page.page.keyboard.up("a")
        page.wait(f"!{DRIVER}.leased")
    page.page.reload()
    assert not page.page.is_checked("#shared"), "it is remembered"


def test_the_page_says_when_an_obstacle_bends_the_way(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    page.hold("w", lambda: page.value("/obstacle|ahead/.test(document.getElementById('assist').textContent)"))
    page.page.keyboard.up("w")
    page.wait("document.getElementById('assist').hidden")


def elsewhere(page: Watched, x: float, y: float) -> None:
    """A place that somebody clicked in another view reaches this page."""
    page.value(f"crunch.connection.announce('notice', {{ header: {{ kind: 'proposal', x: {x}, y: {y} }} }})")


def test_a_place_from_elsewhere_takes_neither_the_focus_nor_an_open_card(served: Served, visit: Open):
    page = dismiss(visit(served))
    page.wait("crunch.pose")
    page.page.focus("#limit")
    elsewhere(page, 1.0, 2.0)
    assert page.page.inner_text("#goal-place") == "1.0, 2.0 m"
    assert page.value("document.activeElement.id") == "limit"
    page.page.click("text=Name it")
    page.page.keyboard.type("Kit")
    elsewhere(page, 3.0, 4.0)
    page.page.keyboard.type("chen")
    assert page.value("document.activeElement.value") == "Kitchen", "the name is typed on"
    assert page.value("crunch.map.candidate") == [1, 2]
    elsewhere(page, 5.0, 6.0)
    assert page.page.locator("#toasts .toast").all_inner_texts() == ["Another place was proposed: 5.0, 6.0 m.\nShow"]
    page.page.click("#toasts >> text=Show")
    assert page.value("crunch.map.candidate") == [5, 6]
    assert page.page.inner_text("#goal-place") == "5.0, 6.0 m"
    assert page.value("document.querySelector('#goal-card input').value") == ""


def test_what_lies_over_the_page_lets_go_and_only_stops_meanwhile(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served))
    page.hold("w", lambda: page.value("crunch.driver.source === 'keys'") and served.status()["driver"]["leased"])
    page.page.click("#library-open")
    page.wait("crunch.driver.source === null")
    page.page.keyboard.up("w")
    wait_until(lambda: not served.status()["driver"]["leased"])
    for key in ("w", "ArrowUp"):
        page.page.keyboard.down(key)
        assert page.value("crunch.driver.source") is None
        page.page.keyboard.up(key)
    page.page.keyboard.press("Space")
    page.wait(f"{DRIVER}.stopped_by === crunch.connection.viewer")
    page.page.click("#library-close")
    page.page.click("#resume")
    page.wait(f"{DRIVER}.stopped_by === null")
    page.hold("w", lambda: served.status()["driver"]["leased"])
    page.page.keyboard.up("w")


def test_the_frame_of_the_3d_view_stops_the_robot_before_it_has_loaded(served: Served, visit: Open):
    page = dismiss(visit(served))

    def half_a_page(route: Route) -> None:
        route.fulfill(content_type="text/html", body="<p>Half a page</p><img src='/viser/never.png'>")

    page.page.route("**/viser/*", half_a_page)
    page.page.route("**/viser/never.png", lambda route: None)
    page.page.evaluate("document.getElementById('scene-open').click()")
    page.page.frame_locator("#scene iframe").locator("p").click()
    page.page.keyboard.press("Space")
    page.wait(f"{DRIVER}.stopped_by === crunch.connection.viewer")
    page.page.click("#scene-close")
    page.page.click("#resume")
    page.wait(f"{DRIVER}.stopped_by === null")
    page.page.unroute_all(behavior="ignoreErrors")


def test_a_pad_that_was_held_under_the_library_drives_once_it_has_let_go(served: Served, visit: Open):
    page = with_pad(served, visit)
    page.page.click("#library-open")
    page.value("pad.axes[1] = -1")
    press(page, 5, True)
    page.take_up()
    page.page.click("#library-close")
    page.take_up()
    assert page.value("crunch.driver.source") is None
    press(page, 5, False)
    page.take_up()
    press(page, 5, True)
    drives(page)
    press(page, 5, False)
    page.wait("crunch.driver.source === null")


def test_the_phones_menu_makes_way_for_the_stick(served: Served, visit: Open):
    at_rest(served)
    page = dismiss(visit(served, **PHONE))
    page.page.locator("#stick").scroll_into_view_if_needed()
    x, y = centre(page.page, "#stick")

    def drives() -> bool:
        """Whether the stick does, through the open menu; in front of a late picture it does not, and is tried again."""
        page.page.mouse.up()
        if page.page.locator("#menu").is_hidden():
            page.page.click("#menu-open")
        page.page.keyboard.down("w")
        assert page.value("crunch.driver.source") is None
        page.page.keyboard.up("w")
        page.page.mouse.move(x, y)
        page.page.mouse.down()
        page.page.mouse.move(x, y - 30)
        return page.value("crunch.driver.source") == "stick"

    wait_until(drives)
    assert page.page.locator("#menu").is_hidden()
    page.page.mouse.up()
