"""A real headless Chromium on a real session."""

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from tests.served import PATIENCE, Served, demo, wait_until
from tests.tools import miss

FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
MAC = Path("/Applications/Google Chrome.app/Contents/MacOS/Google Chrome")
GOOD = '#connection[data-state="good"]'
UNHURRIED = ("--set", "control.idle=300", "--set", "control.patience=300")  # a busy machine looks like an idle driver
FRAMES = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))))"
LISTEN = """(() => {
  globalThis.said = [];
  const send = crunch.connection.send.bind(crunch.connection);
  crunch.connection.send = (word) => send(word, said.push(word.type));
})()"""  # what the page says from now on
HOLD_BACK = """(() => {
  const ask = globalThis.fetch;
  const count = (...request) => ask(...request).finally(() => answered++);
  Object.assign(globalThis, { letGo: null, answered: 0 });
  globalThis.fetch = async (...request) => {
    globalThis.fetch = count;
    const answer = await ask(...request);
    await new Promise((done) => (letGo = done));
    return answer;
  };
})()"""  # the next answer comes when it is let go; later questions are answered, and counted, meanwhile


class Watched(NamedTuple):
    """An open page and everything that it should not have done."""

    page: Page
    complaints: list[str]

    def value(self, expression: str) -> Any:
        """What a JavaScript expression is now."""
        return self.page.evaluate(expression)

    def wait(self, expression: str) -> None:
        """Until a JavaScript expression is true; the page's own policy forbids Playwright to wait inside it."""
        end = time.monotonic() + PATIENCE
        while not self.value(f"!!({expression})"):
            assert time.monotonic() < end, f"never came true: {expression}"
            self.page.wait_for_timeout(50)

    def hold(self, key: str, holds: Callable[[], Any]) -> None:
        """Hold a key until something has come of it, and repeat it meanwhile as keyboards do.

        A page whose picture comes late on a busy machine lets go, and takes the key up again with the next repetition.
        """

        def is_so() -> Any:
            self.page.keyboard.down(key)
            return holds()

        wait_until(is_so)

    def take_up(self) -> None:
        """Until the page has looked at what it was given, as it does with each picture."""
        self.value(FRAMES)


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
    with demo(tmp_path_factory.mktemp("served"), "--world", "demo", "--plan", "demo", *UNHURRIED) as served:
        yield served


@pytest.fixture
def visit(browser: Browser) -> Iterator[Open]:
    """Opens pages; each must have loaded nothing from elsewhere and complained of nothing when the test ends."""
    contexts: list[BrowserContext] = []
    opened: list[Watched] = []

    def visit(served: Served, address: str = "", **options: Any) -> Watched:
        context = browser.new_context(**options)
        context.set_default_timeout(1000.0 * PATIENCE)
        contexts.append(context)
        watched = Watched(context.new_page(), [])
        opened.append(watched)
        watch(watched, served.address)
        watched.page.goto(served.address + address)
        watched.page.wait_for_selector(GOOD)
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
