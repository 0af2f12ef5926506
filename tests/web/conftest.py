"""A real headless Chromium on a real session."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from tests.served import Served, demo
from tests.tools import miss

FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
MAC = Path("/Applications/Google Chrome.app/Contents/MacOS/Google Chrome")
GOOD = '#connection[data-state="good"]'


class Watched(NamedTuple):
    """An open page and everything that it should not have done."""

    page: Page
    complaints: list[str]

    def value(self, expression: str) -> Any:
        """What a JavaScript expression is now."""
        return self.page.evaluate(expression)

    def wait(self, expression: str) -> None:
        """Until a JavaScript expression is true; the page's own policy forbids Playwright to wait inside it."""
        for _ in range(1200):
            if self.page.evaluate(f"Boolean({expression})"):
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"never came true: {expression}")


Open = Callable[..., Watched]


def find_browser() -> str | None:
    """A Chromium on this machine."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    return found or (str(MAC) if MAC.exists() else None)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium without a window."""
    path = find_browser()
    if path is None:
        miss(f"no browser found (looked for {', '.join(NAMES)})")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def served(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A virtual robot that waits for a driver, where there is a browser to look at it."""
    assert browser.is_connected()
    with demo(tmp_path_factory.mktemp("served"), "--world", "demo", "--plan", "demo") as served:
        yield served


@pytest.fixture
def visit(browser: Browser) -> Iterator[Open]:
    """Opens pages; each must have loaded nothing from elsewhere and complained of nothing when the test ends."""
    contexts: list[BrowserContext] = []
    opened: list[Watched] = []

    def visit(served: Served, address: str = "", **options: Any) -> Watched:
        context = browser.new_context(**options)
        contexts.append(context)
        watched = Watched(context.new_page(), [])
        opened.append(watched)
        watch(watched, served.address)
        watched.page.goto(served.address + address)
        watched.page.wait_for_selector(GOOD, timeout=60_000)
        return watched

    yield visit
    complaints = [complaint for watched in opened for complaint in watched.complaints]
    for context in contexts:
        context.close()
    assert not complaints


def watch(watched: Watched, address: str) -> None:
    """Collect errors of the page and requests to other hosts."""
    page, complaints = watched
    ours = (address, address.replace("http", "ws", 1), "data:", "blob:")
    page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
    page.on("console", lambda word: complaints.append(word.text) if word.type in ("error", "warning") else None)
    page.on("request", lambda request: None if request.url.startswith(ours) else complaints.append(request.url))
