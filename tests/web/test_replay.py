"""Sessions and replays in a real browser: sessions are named, ended and followed by others; recordings are scrubbed."""

import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from server.map_store import DATABASE
from tests.served import PATIENCE, Served, demo, wait_until
from tests.server.rendered import SECONDS, drive
from tests.web.conftest import HOLD_BACK, Open, Watched

STATE = "crunch.replay.state"
MORE = """(async () => {
  const { connection } = crunch;
  const drawn = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  let count = 0;
  const listen = ({ detail: { topic } }) => (count += topic !== "notice");
  connection.addEventListener("frame", listen);
  for (let turn = 0; turn < 4; turn++) {
    connection.ping();
    await new Promise((done) => connection.addEventListener("notice", done, { once: true }));
    await drawn();
  }
  connection.removeEventListener("frame", listen);
  return count;
})()"""  # frames that come while the server is asked some times and each answer is acknowledged


@pytest.fixture(scope="module")
def shelved(browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server with a recorded drive on its shelf, and the same cut in the middle."""
    assert browser.is_connected()
    folder = tmp_path_factory.mktemp("shelved")
    (folder / "recordings").mkdir()
    whole = drive(folder / "recordings" / "drive.rlog")
    (folder / "recordings" / "cut.rlog").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2 + 3])
    with demo(folder, "--name", "First") as served:
        yield served


def replay(served: Served, visit: Open, name: str, **options) -> Watched:
    """The page that replays a recording, paused at its beginning and rendered to the end."""
    page = visit(served, f"?recording={name}", **options)
    page.wait(f"{STATE}?.state === 'ready'")
    page.wait("crunch.status && crunch.map.map")

    def is_paused() -> bool:
        if page.value(f"{STATE}.playing"):
            page.page.keyboard.press("Space")
        return not page.value(f"{STATE}.playing")

    wait_until(is_paused)
    return page


def command(served: Served, word: dict) -> None:
    """POST commands."""
    headers = {"Content-Type": "application/json", "X-Crunch-Client": "test"}
    request = urllib.request.Request(f"{served.address}api/v1/commands", json.dumps(word).encode(), headers)
    urllib.request.urlopen(request, timeout=PATIENCE).close()


def seek(page: Watched, t: float) -> None:
    """Move the slider, as a person does."""
    page.page.locator("#replay-bar input").fill(str(t))
    page.wait(f"Math.abs({STATE}.t - {t}) < 0.06 && Math.abs(crunch.pose?.t - {t}) < 0.11")
    settle(page)


def settle(page: Watched) -> None:
    """Until everything is shown that the server has to show of a paused replay: all that was sent is acknowledged, and
    a word there and back brings nothing more."""
    while page.value(MORE):
        pass


def picture(page: Watched) -> dict:
    """What the page shows, in numbers."""
    return page.value("({pose: crunch.pose.pose, t: crunch.pose.t, path: crunch.map.map.path.map((p) => [...p]), "
                      "vertices: crunch.status.map.vertices, distance: crunch.pose.distance})")  # fmt: skip


def test_scrubbing_back_and_forth_shows_what_it_showed(shelved: Served, visit: Open):
    page = replay(shelved, visit, "drive")
    shown: dict[float, dict] = {}
    for t in (20.0, 8.0, 24.0, 2.0, 20.0, 8.0, 2.0, 24.0):
        seek(page, t)
        seen = picture(page)
        assert seen == shown.setdefault(t, seen)
    assert len(shown[2.0]["path"]) < len(shown[24.0]["path"])
    assert page.page.inner_text("#connection") == "replay"
    page.page.close()


def test_playing_goes_on_and_pause_bites_at_once(shelved: Served, visit: Open):
    page = replay(shelved, visit, "drive")
    seek(page, 5.0)
    page.page.locator("#replay-bar select").select_option("2")
    page.page.keyboard.press("Space")
    page.wait(f"{STATE}.playing && {STATE}.speed === 2 && {STATE}.t > 6")
    page.page.click("#replay-bar button[aria-label=Pause]")
    page.wait(f"!{STATE}.playing")
    settle(page)
    before = page.value(f"[{STATE}.t, crunch.pose.t]")
    page.page.wait_for_timeout(500)
    assert page.value(f"[{STATE}.t, crunch.pose.t]") == before
    assert before[0] < SECONDS
    page.page.keyboard.press("ArrowLeft")
    page.wait(f"{STATE}.t < {before[0] - 4.9}")
    page.page.close()


def test_a_replay_drives_nothing_but_stop_stops_the_robot(shelved: Served, visit: Open):
    page = replay(shelved, visit, "drive")
    page.page.keyboard.press("w", delay=300)
    x, y = (page.page.locator("#map").bounding_box() or {})["x"] + 80, 300
    page.page.mouse.click(x, y)
    assert page.page.locator("#goal-card").is_hidden()
    assert page.page.locator("#drive-panel").is_hidden()
    assert shelved.status()["driver"]["viewer"] is None
    page.page.click("#stop")
    wait_until(lambda: shelved.status()["driver"]["stopped_by"])
    page.page.click("#replay-bar a")
    page.page.wait_for_selector("#drive-panel:visible")
    page.wait("globalThis.crunch?.status?.driver.stopped_by")
    page.page.click("#resume")
    wait_until(lambda: shelved.status()["driver"]["stopped_by"] is None)
    page.page.close()


def test_a_stop_that_a_replay_cannot_bring_home_is_told(shelved: Served, visit: Open):
    page = replay(shelved, visit, "drive")
    assert "Space (Escape stops" in (page.page.get_attribute("#replay-bar button", "title") or "")
    banner = "document.getElementById('banner')"
    page.page.route("**/api/v1/commands", lambda route: route.fulfill(status=422, json={"detail": "not now"}))
    page.page.click("#stop")
    page.wait(f"{banner}.textContent.includes('STOP did not reach the robot: not now')")
    assert page.page.get_attribute("#banner", "data-level") == "bad"
    page.page.unroute("**/api/v1/commands")
    page.page.route("**/api/v1/commands", lambda route: route.abort())
    page.page.keyboard.press("Escape")
    page.wait(f"{banner}.textContent.includes('the server cannot be reached')")
    page.page.unroute("**/api/v1/commands")
    page.page.click("#stop")
    page.wait(f"{banner}.hidden")
    wait_until(lambda: shelved.status()["driver"]["stopped_by"])
    page.page.close()
    page.complaints[:] = [text for text in page.complaints if "Failed to load resource" not in text]
    live = visit(shelved)
    live.page.click("#resume")
    wait_until(lambda: shelved.status()["driver"]["stopped_by"] is None)


def test_a_cut_recording_says_so_and_a_missing_one_too(shelved: Served, visit: Open):
    page = replay(shelved, visit, "cut")
    assert "is cut" in page.page.inner_text("#replay-bar .note")
    assert 0.3 * SECONDS < page.value(f"{STATE}.duration") < 0.7 * SECONDS
    page.page.goto(f"{shelved.address}?recording=none")
    page.wait("!document.getElementById('banner').hidden")
    assert "there is no recording none" in page.page.inner_text("#banner")
    page.page.close()


def test_a_session_is_named_ended_and_followed_by_another(shelved: Served, visit: Open):
    page = visit(shelved)
    page.page.click("#hint-close")
    first = shelved.status()["session"]
    page.page.click("#library-open")
    page.page.get_by_label("Name of the session").fill("Third floor")
    page.page.click("text=Name it")
    wait_until(lambda: shelved.status()["session"]["name"] == "Third floor")
    page.page.wait_for_selector(f"[data-id='{first['recording']}'] >> text=Third floor")
    page.page.click("text=End session")
    assert shelved.status()["session"]["running"], "the first press only asks"
    end_session(page, shelved)
    page.page.click("#library-close")
    page.page.wait_for_selector("#banner:visible >> text=No session runs")
    page.hold("w", lambda: page.page.is_visible("#toasts >> text=begin one"))
    page.page.keyboard.up("w")
    page.page.click("#library-open")
    page.page.wait_for_selector(".session >> text=Nobody can drive")
    page.page.locator(".session form input[name=name]").fill("Cellar")
    page.page.locator(".session form input[name=particles]").fill("50")
    page.page.click("text=Begin a session")
    second = wait_until(lambda: (now := shelved.status())["session"]["running"] and now)
    assert second["session"]["name"] == "Cellar"
    assert second["session"]["recording"] != first["recording"]
    assert second["filter"]["wanted_particles"] == 50
    page.wait("crunch.status.session.number === 2")
    page.wait("document.getElementById('banner').hidden")
    page.page.click("#library-close")
    page.hold("w", lambda: shelved.status()["robot"]["distance_m"] > 0.2)
    page.page.keyboard.up("w")
    page.page.close()


def end_session(page: Watched, served: Served) -> None:
    """Press the button twice; who takes too long for the second press is asked again."""

    def is_over() -> bool:
        page.value("document.querySelector('.session button.danger:enabled')?.click()")
        return not served.status()["session"]["running"]

    wait_until(is_over)


def test_a_map_that_cannot_be_kept_is_told_with_the_remedy(browser, visit: Open, tmp_path: Path):
    assert browser.is_connected()
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / DATABASE).write_bytes(b"no database at all " * 1000)
    with demo(tmp_path, "--autopilot", "--speed", "8") as served:
        page = visit(served)
        page.page.click("#hint-close")
        page.page.click("#library-open")
        wait_until(lambda: served.status()["map"]["vertices"] >= 3)
        page.page.click("text=New session")
        page.page.click("text=Begin a session")
        page.page.wait_for_selector(".toast >> text=The map was not kept")
        wait_until(lambda: served.status()["session"]["number"] == 2)
        command(served, {"type": "autopilot", "on": True})
        wait_until(lambda: served.status()["map"]["vertices"] >= 3)
        end_session(page, served)
        page.page.wait_for_selector(".session >> text=The map was not kept")
        assert "Keep map" in page.page.inner_text(".session")
        page.page.close()


def test_a_recording_is_renamed_deleted_and_taken_back(shelved: Served, visit: Open):
    page = visit(shelved)
    page.page.click("#hint-close")
    page.page.click("#library-open")
    page.page.click("[data-id=cut] >> text=Rename")
    page.page.keyboard.type("Half a drive")
    page.page.keyboard.press("Enter")
    page.page.wait_for_selector("[data-id=cut] >> text=Half a drive")
    page.page.click("[data-id=cut] >> text=Delete")
    page.page.wait_for_selector("[data-id=cut]", state="detached")
    assert {"drive", "cut"} & set(names(shelved)) == {"drive"}
    page.page.click("#toasts >> text=Undo")
    page.page.wait_for_selector("[data-id=cut] >> text=Half a drive")
    with page.page.expect_download() as download:
        page.page.click("[data-id=cut] >> text=File")
    assert Path(download.value.path()).read_bytes() == (shelved.folder / "recordings" / "cut.rlog").read_bytes()
    page.page.close()


def test_a_late_answer_brings_nothing_back(shelved: Served, visit: Open):
    """Nor does it take anything away: what was asked last is shown, whatever is answered last."""
    page = visit(shelved)
    page.page.click("#hint-close")
    page.page.click("#library-open")
    page.page.wait_for_selector("[data-id=cut]")
    page.value(HOLD_BACK)
    page.value("document.getElementById('recordings-pane').dispatchEvent(new Event('show'))")
    page.wait("letGo")
    page.page.click("[data-id=cut] >> text=Delete")
    page.page.wait_for_selector("[data-id=cut]", state="detached")
    page.value("letGo()")
    page.take_up()
    assert page.page.locator("[data-id=cut]").count() == 0
    page.page.click("#toasts >> text=Undo")
    page.page.wait_for_selector("[data-id=cut]")
    page.page.close()


def names(served: Served) -> list[str]:
    """The shelf, as REST has it."""
    with urllib.request.urlopen(served.address + "api/v1/recordings", timeout=PATIENCE) as answer:
        return [one["id"] for one in json.load(answer)]
