"""Takes the page's pictures, in a real browser on a virtual robot.

Every panel and every state, on a desk and on a phone, in light and dark: `.venv/bin/python docs/pictures.py [FOLDER]`;
with `--docs` those in `docs/images` are renewed too, with `--robot` only one robot's are taken.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.served import Served, demo, wait_until  # noqa: E402
from tests.web.conftest import FLAGS, GOOD, Watched, find_browser  # noqa: E402

Scheme = Literal["light", "dark"]

VERTICES = 180  # of the map in the pictures
REPLAYED = 60.0  # s of the recording at which the replay is shown, or as far as it goes
SCHEMES: tuple[Scheme, ...] = ("light", "dark")
SCREENS: dict[str, dict[str, Any]] = {
    "desk": {"viewport": {"width": 1440, "height": 900}},
    "phone": {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True},
}
WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # without a graphics card
SLOW = 120_000  # ms; a first comparison compiles, the third dimension is drawn by the processor
WELCOMED = "localStorage.setItem('welcomed', 'yes')"
OFFLINE = '#connection[data-state="bad"]'
SHOWN = {
    "crunch": {"dashboard": "desk-light", "phone": "phone-dark", "replay": "desk-dark-replay"},
    "bumper_cart": {"bumper-cart-page": "desk-light-two-places"},
}  # in README.md and docs, by whose page it is
BUMPS = 18  # of the cart in the picture


class Studio(NamedTuple):
    """Where pictures are taken: a browser, a robot's page on a device, and the start of the files' names."""

    browser: Browser
    served: Served
    device: str
    scheme: Scheme
    folder: Path

    def visit(self, query: str = "") -> Page:
        """The page as somebody sees it who knows it already."""
        context = self.browser.new_context(**SCREENS[self.device], color_scheme=self.scheme)
        context.set_default_timeout(SLOW)
        page = context.new_page()
        page.add_init_script(WELCOMED)
        page.goto(self.served.address + query)
        page.wait_for_selector(GOOD)
        Watched(page, []).wait("crunch.status && crunch.pose && crunch.map.map")
        return page

    def take(self, page: Page, state: str = "", panel: str = "") -> None:
        """A picture of the page's screen, or of a panel."""
        path = self.folder / f"{'-'.join(filter(None, (self.device, self.scheme, state)))}.png"
        page.wait_for_timeout(800)  # until what moves has come to rest
        if state not in ("offline", "scene"):  # a busy machine greys the page now and then
            Watched(page, []).wait("!document.body.classList.contains('stale')")
        if panel:
            page.locator(panel).screenshot(path=path)
        else:
            page.evaluate("document.activeElement.blur(), scrollTo(0, 0)")
            page.screenshot(path=path)


def panels(studio: Studio) -> None:
    """The page, and each of its panels."""
    page = studio.visit()
    page.click("#map-fit")
    studio.take(page)
    for name in page.evaluate("[...document.querySelectorAll('main .panel:not([hidden])')].map((panel) => panel.id)"):
        studio.take(page, name, f"#{name}")
    page.context.close()


def library(studio: Studio) -> None:
    """Both tabs of the library, a saved map, and another one laid over it."""
    page = studio.visit()
    page.click("#library-open")
    page.wait_for_selector(".recordings li")
    studio.take(page, "recordings")
    page.click("#maps-tab")
    page.wait_for_selector(".map-cards button")
    studio.take(page, "maps")
    page.click(".map-cards button >> nth=0")
    studio.take(page, "map")
    other = page.get_by_label("Compare with another map")
    other.select_option(index=1)
    page.locator(".map-side", has_text="Within").wait_for()
    studio.take(page, "comparison")
    page.context.close()


def driving(studio: Studio) -> None:
    """A place that is proposed, control that is asked for, and a stop that holds."""
    page, other = studio.visit(), studio.visit()
    page.locator("#map").click()
    page.wait_for_selector("#goal-card:not([hidden])")
    studio.take(page, "goal")
    page.click("#goal-cancel")
    page.keyboard.down("w")
    Watched(page, []).wait("crunch.status.driver.viewer === crunch.connection.viewer")
    other.click("#ask")
    page.wait_for_selector("#driver-request:not([hidden])")
    studio.take(page, "hand-over", "#drive-panel")
    page.get_by_role("button", name="Keep").click()
    page.keyboard.up("w")
    page.click("#stop")
    page.wait_for_selector("#banner:not([hidden])")
    studio.take(page, "stopped")
    page.click("#resume")
    page.wait_for_selector("#banner", state="hidden")
    for one in (page, other):
        one.context.close()


def scene(studio: Studio) -> None:
    """The view in three dimensions, which takes long to begin without a graphics card."""
    page = studio.visit()
    if not page.is_visible("#scene-open"):
        page.click("#menu-open")
    page.click("#scene-open")
    page.frame_locator("#scene iframe").locator("canvas").first.wait_for()
    page.wait_for_timeout(15_000)
    studio.take(page, "scene")
    page.context.close()


def replay(studio: Studio, recording: str) -> None:
    """A replay in its midst."""
    page = studio.visit(f"?recording={recording}")
    watched = Watched(page, [])
    watched.wait("crunch.map.frames.replay")
    until = f"Math.min({REPLAYED}, 0.5 * crunch.map.frames.replay.header.duration)"
    watched.wait(f"crunch.connection.send({{ type: 'seek', t: {until} }}) || crunch.pose.t >= 0.99 * {until}")
    page.click("#map-fit")
    studio.take(page, "replay")
    page.context.close()


def keep_map(served: Served, browser: Browser, name: str) -> None:
    """Save the present map."""
    context = browser.new_context()
    assert context.request.post(served.address + "api/v1/maps", data={"name": name}).ok
    context.close()


def cart(browser: Browser, folder: Path) -> None:
    """Bumper Cart on a map that looks alike after half a turn, so that it may be in two places, and without a map."""
    flags = ("--robot", "bumper_cart", "--world", "rectangle", "--seed", "3", "--speed", "4", "--particles", "2000")
    flags = (*flags, "--set", f"bumper_cart.run.bumps={BUMPS}")
    for state, given in (("two-places", ("--map", "rectangle")), ("own-map", ())):
        with tempfile.TemporaryDirectory() as place, demo(Path(place), *flags, *given) as served:
            studios = [Studio(browser, served, *way, folder) for way in itertools.product(SCREENS, SCHEMES)]
            for studio in studios:
                page = studio.visit()
                if studio is studios[0]:
                    page.click("#arm")
                    wait_until(lambda served=served: served.status()["map"]["vertices"] >= BUMPS, 600.0)
                page.wait_for_selector("#arm:not([hidden])")
                studio.take(page, state)
                page.context.close()


def crunch(browser: Browser, folder: Path, vertices: int) -> None:
    """Each picture of each state, on each device and in each scheme."""
    flags = ("--autopilot", "--speed", "2", "--particles", "2000")
    with tempfile.TemporaryDirectory() as place:
        with demo(Path(place), *flags) as served:
            for share, name in ((0.6, "Before lunch"), (1.0, "Whole drive")):
                wait_until(lambda share=share: served.status()["map"]["vertices"] >= share * vertices, 600.0)
                keep_map(served, browser, name)
            recording = served.recording().stem
            studios = [Studio(browser, served, *way, folder) for way in itertools.product(SCREENS, SCHEMES)]
            for studio in studios:
                panels(studio)
                library(studio)
                replay(studio, recording)
                scene(studio)
            for studio in studios:  # after the others: it takes the robot from the autopilot
                driving(studio)
            left = [(studio, studio.visit()) for studio in studios]
        for studio, page in left:
            page.wait_for_selector(OFFLINE)
            studio.take(page, "offline")


def main(folder: Path, robots: Sequence[str], vertices: int) -> None:
    """The pictures of the pages of these robots."""
    folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_browser(), headless=True, args=[*FLAGS, *WEBGL])
        if "crunch" in robots:
            crunch(browser, folder, vertices)
        if "bumper_cart" in robots:
            cart(browser, folder)
        browser.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("pictures"))
    parser.add_argument("--vertices", type=int, default=VERTICES, help="of the map that is shown")
    parser.add_argument("--docs", action="store_true", help="renew docs/images too")
    parser.add_argument("--robot", choices=list(SHOWN), action="append", help="whose page is shown (default: all)")
    chosen = parser.parse_args()
    wanted = chosen.robot or list(SHOWN)
    main(chosen.folder, wanted, chosen.vertices)
    if chosen.docs:
        for name, source in (image for robot in wanted for image in SHOWN[robot].items()):
            shutil.copyfile(chosen.folder / f"{source}.png", ROOT / "docs" / "images" / f"{name}.png")
