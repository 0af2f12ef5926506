"""Takes the page's pictures, in a real browser on a virtual robot: `.venv/bin/python docs/pictures.py [FOLDER]`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.served import Served, demo, wait_until  # noqa: E402
from tests.web.conftest import FLAGS, GOOD, Watched, find_browser  # noqa: E402

VERTICES = 180  # of the map in the pictures
REPLAYED = 60.0  # s of the recording at which the replay is shown
SCHEMES: list[Literal["light", "dark"]] = ["light", "dark"]
DESK: dict[str, Any] = {"viewport": {"width": 1440, "height": 900}}
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
WELCOMED = "localStorage.setItem('welcomed', 'yes')"


def visit(
    browser: Browser, served: Served, screen: dict[str, Any], scheme: Literal["light", "dark"], query: str = ""
) -> Page:
    """The page as somebody sees it who knows it already."""
    page = browser.new_context(**screen, color_scheme=scheme).new_page()
    page.add_init_script(WELCOMED)
    page.goto(served.address + query)
    page.wait_for_selector(GOOD)
    Watched(page, []).wait("crunch.status && crunch.pose")
    if query:
        Watched(page, []).wait(
            f"crunch.connection.send({{ type: 'seek', t: {REPLAYED} }}) || crunch.pose.t >= {REPLAYED}"
        )
    Watched(page, []).wait("crunch.map.map")
    page.click("#map-fit")
    page.wait_for_timeout(1500)
    return page


def library(page: Page, folder: Path, name: str) -> None:
    """Both tabs of the library, and a saved map."""
    page.click("#library-open")
    page.wait_for_selector(".recordings li")
    page.screenshot(path=folder / f"{name}-recordings.png")
    page.click("#maps-tab")
    page.click("#maps-pane button[type=submit]")
    page.wait_for_selector(".map-cards button")
    page.wait_for_timeout(1500)
    page.screenshot(path=folder / f"{name}-maps.png")
    page.click(".map-cards button >> nth=0")
    page.wait_for_timeout(1500)
    page.screenshot(path=folder / f"{name}-map.png")


def main(folder: Path) -> None:
    """Desk and phone, light and dark: the live page, the library, a map and a replay."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_browser(), headless=True, args=FLAGS)
        with demo(Path(place), "--autopilot", "--speed", "2", "--particles", "2000") as served:
            wait_until(lambda: served.status()["map"]["vertices"] >= VERTICES, 600.0)
            recording = served.recording().stem
            for screen, device in ((DESK, "desk"), (PHONE, "phone")):
                for scheme in SCHEMES:
                    page = visit(browser, served, screen, scheme)
                    page.screenshot(path=folder / f"{device}-{scheme}.png")
                    library(page, folder, f"{device}-{scheme}")
                    page = visit(browser, served, screen, scheme, f"?recording={recording}")
                    page.screenshot(path=folder / f"{device}-{scheme}-replay.png")
                    page.context.close()
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("pictures"))
