"""The set-up page, what a browser keeps, and the pages of several radars."""

import json
import re
from importlib import resources

import numpy as np
import pytest
import yaml

from radard.detect.calibration import Calibration, Provenance
from tests.browser_helpers import MARKS, Tab
from tests.web_helpers import Running, decision, open_decision

pytestmark = MARKS

STATIC = resources.files("radard.web") / "static"
FEED = """async (decisions) => {
    const { take } = await import('/static/state.js');
    for (const d of decisions) take(d);
}"""
"""Gives the page decisions as the daemon would, far ahead of those that it gets."""


def test_settings_are_chosen_saved_and_hold(empty, tab):
    one, other = tab(empty).open("setup"), tab(empty).open("setup")
    form = one.page.locator("form.settings").first
    save = form.get_by_role("button", name="Save")
    one.until("document.querySelector('input[value=normal]').checked")
    assert (save.is_disabled(), "Nothing is changed yet" in form.inner_text()) == (True, True)
    one.page.get_by_label("Low").check()
    one.page.get_by_label("Entry delay").fill("700")
    assert (save.is_disabled(), "Entry delay: " in form.inner_text()) == (True, True)
    one.page.get_by_label("Entry delay").fill("12.5")
    one.page.get_by_label("Exit delay").fill("30")
    save.click()
    one.until("document.querySelector('#page').textContent.includes('holds from now on')")
    wanted = {"sensitivity": "low", "entry_delay_s": 12.5, "exit_delay_s": 30}
    assert empty.status()["settings"]["alarm"] == wanted
    # Pages that look on follow.
    other.until("document.querySelector('input[value=low]').checked")
    # How it hangs: a number, and back to not known.
    height = one.page.get_by_label("Height above the floor")
    mounting = one.page.locator("form.settings").nth(1)
    for text, value in (("2.2", 2.2), ("", None)):
        height.fill(text)
        mounting.get_by_role("button", name="Save").click()
        empty.wait(lambda at=value: empty.status()["settings"]["mount"]["height_m"] == at)
    one.page.get_by_role("button", name="Forget these settings").click()
    one.until("document.querySelector('input[value=normal]').checked")
    assert not (empty.folder / "radar.sim.settings.yaml").exists()


def test_a_test_alarm_shows_what_each_output_answered(empty, tab):
    one = tab(empty).open("setup")
    one.page.get_by_role("button", name="Send a test alarm").click()
    one.until("document.querySelector('.outputs tbody td:last-child')?.textContent === 'taken'")
    assert "Every output has it" in one.page.inner_text("#page")
    # It is no alarm of the panel, and the list of events says what it was.
    assert one.page.locator(".banner.alarm").count() == 0
    one.page.goto(f"{empty.base}/#/events")
    one.until("document.querySelector('.event .what')?.textContent === 'Test nobody was seen'")
    assert one.page.locator(".labels").count() == 0


def walk(steps):
    """Decisions of a walk: a range with whether it is taken for a person, or None: unseen."""
    found = []
    for k, step in enumerate(steps):
        range_m, is_person = step or (None, False)
        seen = open_decision(human=0.9 if is_person else 0.05, range_m=range_m)
        # A long way ahead, so that none of the daemon's own is newer.
        found.append((seen if step else decision()) | {"seq": 100_000 + k, "t_s": 100_000.0 + k})
    return found


WALKS = (
    ([(3.2, True), (2.4, True), (1.9, True), (1.3, True), (0.8, True)], "Passed."),
    # A decision is of all the way since the last one.
    ([(3.2, True), (2.0, True), (0.8, True)], "Passed."),
    ([(3.2, True), (2.4, False), (2.3, False), (1.2, True)], "less than half of the time, at"),
    ([(3.2, True), None, None, None, (0.8, True)], "less than half of the time, at"),
    ([(3.2, True), (3.0, True)], "Walk at least 1.5 m"),
    ([None, None], "nobody was seen"),
)


def test_a_walk_test_passes_or_fails(empty, tab):
    one = tab(empty)
    for steps, verdict in WALKS:
        one.page.goto("about:blank")
        one.open("setup").page.get_by_role("button", name="Start the walk test").click()
        one.page.evaluate(FEED, walk(steps))
        one.page.get_by_role("button", name="Stop").click()
        assert verdict in one.page.inner_text(".verdict")
        is_pass = one.page.get_attribute(".verdict", "data-pass") == "true"
        assert is_pass is (verdict == "Passed.")
        with one.page.expect_download() as got:
            one.page.get_by_role("button", name="Save the report").click()
        assert json.loads(got.value.path().read_text())["isPass"] is is_pass
        suggest = one.page.get_by_role("button", name="Suggest zones")
        suggest.click()
        one.until("document.querySelector('#page').textContent.includes('no calibration yet')")
        if is_pass:
            suggest.click()
            # In place of those before, not beside them.
            one.until("document.querySelectorAll('.zonerow').length === 1")
            assert "include: [[0.6" in one.page.inner_text("pre >> nth=0")


def test_a_walk_test_disarms_and_arms_again(empty, tab):
    one = tab(empty).open("setup")
    one.page.get_by_role("button", name="Disarm for the test").click()
    empty.wait(lambda: empty.status()["panel"]["armed"] is False)
    one.page.get_by_role("button", name="Arm again").click()
    empty.wait(lambda: empty.status()["panel"]["armed"] is True)


def test_zones_are_suggested_from_the_calibration(empty, tab):
    floor = np.full(40, 1e-6)
    floor[10:16] = 1e-3
    axis = {"frame_rate_hz": 60.0, "bin_length_m": 0.07, "range_offset_m": 0.6}
    origin = Provenance(made_utc="2026-11-21T06:00:00Z")
    made = Calibration(**axis, floor=floor, threshold_db=np.full(40, 3.0), provenance=origin)
    made.save(empty.folder / "radar.sim.calibration.json")
    one = tab(empty).open("setup")
    one.page.get_by_role("button", name="Suggest zones").click()
    one.until("document.querySelector('pre').textContent.includes('exclude: [[1.30, 1.80]]')")
    assert "At 1.3 to 1.8 m something moved in the empty room" in one.page.inner_text("#page")
    # Nothing is saved until it is looked at.
    assert empty.status()["zones"]["exclude"] == []


def test_at_home_is_offered_where_it_differs(empty, tab):
    one = tab(empty).open()
    assert one.page.locator("#arm-home").count() == 0
    empty.post("/api/v1/zones", {"include": [], "exclude": [], "away": [[0.5, 1.0]]})
    empty.post("/api/v1/command", {"command": "disarm"})
    one.page.locator("#arm-home").click()
    one.until("document.querySelector('#arm').textContent === 'Armed at home'")
    empty.post("/api/v1/settings", {"alarm": {"exit_delay_s": 300}})
    empty.post("/api/v1/command", {"command": "disarm"})
    one.page.locator("#arm-home").click()
    one.until("document.querySelector('#arm').textContent === 'Arming'")
    one.page.wait_for_selector(".banner.calm")
    assert re.search(r"Armed in \d+ s", one.page.inner_text(".banner.calm"))


def test_the_shell_opens_while_the_daemon_is_away(browser, empty):
    one = Tab(browser, empty).open()
    one.page.evaluate("navigator.serviceWorker.ready.then(() => true)")
    paths = """async () => {
        const cache = await caches.open('radard-shell');
        return (await cache.keys()).map(k => new URL(k.url).pathname).sort(); }"""
    kinds, apart = {".js", ".css", ".svg"}, {"sw.js", "login.js"}
    files = [p for p in STATIC.rglob("*") if p.suffix in kinds and p.name not in apart]
    shell = {"/"} | {f"/static/{path.relative_to(STATIC)}" for path in files}
    # All of it is asked for at once, not one module after the other.
    page = (STATIC / "index.html").read_text("utf-8")
    assert {path for path in shell if f'"{path[1:]}"' not in page} == {"/"}
    one.until(f"(async () => (await ({paths})()).length === {len(shell)})()")
    assert set(one.page.evaluate(paths)) == shell
    one.page.goto(f"{empty.base}/#/events")
    one.page.wait_for_selector(".event, .loading")
    # Nothing that the radar says is kept.
    assert set(one.page.evaluate(paths)) == shell
    empty.end()
    one.page.goto("about:blank")
    one.page.goto(empty.base)
    one.until("document.querySelector('.health .state').textContent === 'No connection'")
    assert one.page.inner_text("#page .loading") == "Connecting to the radar …"
    one.page.close()


def test_the_page_can_be_installed(one, radard):
    session = one.page.context.new_cdp_session(one.page)
    told = session.send("Page.getAppManifest")
    assert told["errors"] == []
    manifest = json.loads(told["data"])
    assert (manifest["start_url"], manifest["display"]) == ("../", "standalone")
    one.page.evaluate("navigator.serviceWorker.ready.then(() => true)")
    found = session.send("Page.getInstallabilityErrors")["installabilityErrors"]
    # A private window, as tests have, is never installed from.
    assert {each["errorId"] for each in found} <= {"in-incognito"}


def test_an_alarm_notifies_the_browser(browser, radard):
    context = browser.new_context()
    context.grant_permissions(["notifications"], origin=radard.base)
    page = context.new_page()
    page.goto(f"{radard.base}/#/setup")
    page.evaluate("navigator.serviceWorker.ready.then(() => true)")
    page.get_by_role("button", name="Show notifications here").click()
    page.wait_for_selector("button[aria-pressed=true] >> text=Notifications are on")
    assert radard.post("/api/v1/command", {"command": "disarm"})[0] == 202
    radard.wait(lambda: not radard.status()["panel"]["alarm_id"])
    radard.wait(lambda: radard.post("/api/v1/test-alarm", {})[0] == 200)
    seen = """async () => (await (await navigator.serviceWorker.ready).getNotifications())
        .map(n => [n.title, n.body])"""
    radard.wait(lambda: page.evaluate(seen))
    assert page.evaluate(seen)[0] == ["Test: Alarm, radar", "test alarm: nobody was seen"]
    context.close()


@pytest.fixture
def radard(tmp_path):
    """Two simulated rooms, both empty, as fast as they are judged: no frame is lost for haste."""
    config = tmp_path / "house.yaml"
    sensors = {name: {"port": "sim:empty", "speed": "max"} for name in ("hall", "attic")}
    gate = {"calibrate_after_s": 30, "calibrate_s": 60}
    text = {"sensors": sensors, "model": {"name": "none"}, "gate": gate}
    config.write_text(yaml.safe_dump(text, sort_keys=False))
    running = Running(tmp_path, "--config", str(config))
    running.wait(lambda: running.get("/sensor/attic/healthz")[0] == 200)
    yield running
    assert running.end() == 0


def test_one_sensor_is_chosen_and_commanded_and_the_other_is_left_alone(browser, radard, tmp_path):
    tab = Tab(browser, radard)
    page = tab.open("live").page
    assert page.locator("#sensor option").all_inner_texts() == ["hall", "attic"]
    page.select_option("#sensor select", label="attic")
    page.wait_for_url("**/sensor/attic/**")
    tab.until("document.querySelector('#sensor option')?.textContent === 'attic'")
    page.goto(f"{radard.base}/sensor/attic/#/setup")
    page.get_by_role("button", name="Calibrate the empty room").click()
    tab.until("document.body.textContent.includes('Leave the room now')")
    tab.until("document.body.textContent.includes('Listening to the empty room')")
    tab.until("document.body.textContent.includes('predicted false gates')")
    radard.wait((tmp_path / "attic.sim.calibration.json").exists)
    assert not (tmp_path / "hall.sim.calibration.json").exists()
    page.goto(f"{radard.base}/sensor/attic/#/live")
    code, status = radard.get("/api/v1/status")
    assert (code, status["sensor"], status["panel"]["calibration"]) == (200, "hall", None)
    file = tmp_path / "attic.status.json"
    radard.wait(lambda: json.loads(file.read_text())["calibration"]["phase"] == "made")
    page.close()
    assert tab.complaints == []
