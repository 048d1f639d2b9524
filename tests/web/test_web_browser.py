"""The dashboard in a real browser: what a person sees, with a simulated person before it."""

from radard.judge.bundle import load_bundle
from tests.alarm_helpers import write_recording
from tests.browser_helpers import MARKS, Tab
from tests.radar_helpers import noise
from tests.waiting import wait_for
from tests.web_helpers import is_finished
from x2train.finetune.own_clips import labelled_clips, own_windows

pytestmark = MARKS


def test_heat_maps_move_with_a_simulated_person(one):
    canvases = one.page.locator(".chart canvas")
    one.until("document.querySelectorAll('.chart canvas').length === 6")
    look = """() => [...document.querySelectorAll('.chart canvas')].slice(0, 3).map(c => {
        const d = c.getContext('2d').getImageData(60, 8, c.width - 80, c.height - 40).data;
        let sum = 0; const seen = new Set();
        for (let i = 0; i < d.length; i += 4) {
          sum = (sum * 31 + d[i] + 7 * d[i + 1] + 13 * d[i + 2]) >>> 0;
          seen.add((d[i] << 16) | (d[i + 1] << 8) | d[i + 2]);
        }
        return [sum, seen.size];
      })"""
    first = one.page.evaluate(look)

    def have_moved():
        now = one.page.evaluate(look)
        return all(a != b and n > 20 for (a, _), (b, n) in zip(first, now, strict=True))

    wait_for(have_moved)
    assert canvases.first.get_attribute("role") == "img"
    assert "Range over time" in canvases.first.get_attribute("aria-label")


def test_the_bar_is_as_high_before_it_is_filled(tab):
    one = tab(width=390).open()
    one.until("document.querySelector('#arm')")
    heights = one.page.evaluate(
        """() => {
            const bar = document.querySelector('.bar');
            const filled = bar.offsetHeight;
            document.querySelector('#arming').replaceChildren();
            return [filled, bar.offsetHeight];
        }"""
    )
    assert heights[0] == heights[1]


def test_alarm_arrives_and_is_acknowledged(one, radard):
    radard.post("/api/v1/command", {"command": "disarm"})
    one.until("document.querySelector('#arm').getAttribute('aria-pressed') === 'false'")
    assert one.page.inner_text("#arm") == "Disarmed"
    one.page.click("#arm")
    one.until("document.querySelector('#arm').getAttribute('aria-pressed') === 'true'")
    radard.wait(lambda: radard.status()["panel"]["panel"] == "alarm")
    one.page.wait_for_selector(".banner.alarm[role=alert]")
    assert "person" in one.page.inner_text(".banner.alarm .text")
    with one.page.expect_response("**/api/v1/command") as answered:
        one.page.get_by_role("button", name="Acknowledge").click()
    assert answered.value.status == 202
    events = lambda: radard.get("/api/v1/events?kind=alarm")[1]["events"]  # noqa: E731
    radard.wait(lambda: any(each["phase"] == "end" for each in events()))


def test_arming_by_keyboard_alone(one):
    one.until("!document.querySelector('#arm').disabled")
    one.page.keyboard.press("Tab")
    assert one.page.evaluate("document.activeElement.className") == "skip"
    was = one.page.get_attribute("#arm", "aria-pressed")
    for _ in range(12):
        one.page.keyboard.press("Tab")
        if one.page.evaluate("document.activeElement.id") == "arm":
            break
    one.page.keyboard.press("Enter")
    one.until(f"document.querySelector('#arm').getAttribute('aria-pressed') !== '{was}'")
    one.page.keyboard.press("Enter")
    one.until(f"document.querySelector('#arm').getAttribute('aria-pressed') === '{was}'")


def test_a_decision_says_why_and_freezes_its_pictures(one, radard):
    one.page.locator(".decisions a").first.click()
    one.page.wait_for_selector("#headline")
    one.page.wait_for_selector(".stages .decided")
    assert one.page.locator(".stages .decided").count() == 1
    # In plain words, and with the numbers for those who ask for them.
    assert "threshold" not in one.page.inner_text(".stages")
    one.page.get_by_role("button", name="Details for engineers").click()
    assert "threshold" in one.page.inner_text(".stages")
    one.page.wait_for_selector(".columns.why .chart canvas")
    seq = int(one.page.url.rpartition("/")[2])
    assert f"Decision {seq}" in one.page.inner_text(".whyhead")
    # Wherever the focus is.
    one.page.keyboard.press("ArrowLeft")
    one.until(f"location.hash === '#/why/{seq - 1}'")


def test_events_are_filtered_replayed_and_labelled(tab, radard):
    event_id = radard.ended_alarm("has_clip")
    one = tab().open("events")
    one.page.locator(f"[data-event='{event_id}']").click()
    one.page.get_by_role("button", name="Pet", exact=True).click()
    one.until("document.querySelector('.labels [aria-pressed=true]')?.textContent === 'Pet'")
    assert f'"event": "{event_id}"' in (radard.folder / "labels.jsonl").read_text()
    # What train-export finetune makes of it.
    (clip,), _ = labelled_clips(radard.folder / "labels.jsonl")
    assert (clip.path.name, clip.label) == (f"{event_id}.h5", "pet")
    # It goes on for a while behind the alarm's end.
    radard.wait(lambda: is_finished(clip.path))
    assert own_windows(clip, load_bundle("accurate")).has_alarm
    one.page.select_option("select[name=label]", "pet")
    one.until("document.querySelectorAll('.event').length === 1")
    one.page.select_option("select[name=label]", "")
    # A clip that is still being written has no end yet; this one does.
    one.page.get_by_role("button", name="Replay the pictures").click()
    one.page.wait_for_selector(".clip canvas")
    one.until("parseFloat(document.querySelector('.clip input[type=range]').value) > 0.5")
    with one.page.expect_download() as got:
        one.page.get_by_role("link", name="Export CSV").click()
    assert got.value.suggested_filename == "events.csv"


def test_zones_are_dragged_saved_and_hold(tab, radard):
    one, other = tab().open("setup"), tab().open("setup")
    save = one.page.get_by_role("button", name="Save the zones")
    assert save.is_disabled()
    one.page.get_by_role("button", name="Exclude a range").click()
    low = one.page.locator("input[aria-label='Not here, from, metres']")
    before = float(low.input_value())
    # By its lower end, two hundred pixels towards the radar.
    box = one.page.locator("canvas.zones").bounding_box()
    near, far = one.page.evaluate(
        """async () => { const { state } = await import('/static/state.js');
            const { range_offset_m, bin_length_m, n_range } = state.hello;
            return [range_offset_m, range_offset_m + bin_length_m * n_range]; }"""
    )
    x = box["x"] + 12 + (before - near) / (far - near) * (box["width"] - 24)
    y = box["y"] + box["height"] / 3
    one.page.mouse.move(x, y)
    one.page.mouse.down()
    one.page.mouse.move(x - 200, y, steps=5)
    one.page.mouse.up()
    after = float(low.input_value())
    assert after < before - 0.2
    save.click()
    one.until("document.querySelector('#page').textContent.includes('follows them from now on')")
    (span,) = radard.status()["zones"]["exclude"]
    assert span[0] == after
    assert f"[{after:.3f}, " in (radard.folder / "radar.sim.zones.yaml").read_text()
    # Pages that look on see it, and what is not being edited there follows.
    other.until("document.querySelectorAll('.zonerow').length === 1")
    assert save.is_disabled()
    one.page.get_by_role("button", name="Forget what was saved").click()
    radard.wait(lambda: radard.status()["zones"] == {"include": [], "exclude": [], "away": []})
    one.until("document.querySelectorAll('.zonerow').length === 0")


def test_colours_are_even_and_follow_the_page(one):
    steps = one.page.evaluate(
        """async () => {
          const { colourMap } = await import('/static/charts/colour.js');
          const light = (v) => { const c = v / 255;
            return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4; };
          const okl = (n) => { const [r, g, b] = [n, n >> 8, n >> 16].map((x) => light(x & 255));
            return 0.2104542553 * Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b)
              + 0.793617785 * Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b)
              - 0.0040720468 * Math.cbrt(0.0883024619 * r + 0.2817188376 * g
                + 0.6299787005 * b); };
          return [true, false].map((isDark) => {
            const l = [...colourMap(isDark)].map(okl);
            return [0, 32, 64, 96, 128, 160, 192, 224].map((i) => l[Math.min(255, i + 32)] - l[i]);
          });
        }"""
    )
    for by_theme in steps:
        assert max(by_theme) - min(by_theme) < 0.02
        assert len({value > 0 for value in by_theme}) == 1
    before = one.page.evaluate("getComputedStyle(document.body).backgroundColor")
    one.page.click("#theme")
    assert one.page.evaluate("getComputedStyle(document.body).backgroundColor") != before


def test_a_lost_connection_says_so_and_recovers(browser, empty, launched):
    one, other = Tab(browser, empty).open(), Tab(browser, empty).open("setup")
    one.until("document.querySelector('.health .state').textContent === 'Online'")
    other.until("!document.querySelector('#page button.primary').disabled")
    empty.end()
    enabled = "[...document.querySelectorAll('#arm, #page button.primary, #page input:enabled')]"
    other.until(f"{enabled}.every((e) => e.disabled)")
    other.page.close()
    one.page.wait_for_selector(".banner.lost")
    assert "Connection lost" in one.page.inner_text(".banner")
    assert "radard has ended (stopped)" in one.page.inner_text(".banner")
    launched("--port", "sim:empty", "--model", "none", port=empty.port)
    one.until("document.querySelector('.health .state').textContent === 'Online'")
    assert one.page.locator(".banner.lost").count() == 0
    one.until("document.querySelectorAll('.decisions tbody tr').length > 0")
    one.page.close()


def test_a_replay_has_controls_and_does_not_look_live(tab, launched, tmp_path):
    path = tmp_path / "r.h5"
    write_recording(path, noise(60 * 120))
    argv = ("--port", f"replay:{path}", "--speed", "1", "--model", "none")
    one = tab(launched(*argv).wait_online()).open()
    one.until("document.querySelector('#badge').textContent === 'Replayed'")
    assert "no model" in one.page.inner_text("header")
    one.page.get_by_role("button", name="Pause").click()
    one.page.wait_for_selector("button[aria-label=Play]")
    one.page.get_by_label("Position in the recording").fill("90")
    one.until("document.querySelector('#player output').textContent.startsWith('1:30')")
    one.page.get_by_label("Speed").select_option("4")
    one.page.get_by_role("button", name="Play").click()
    one.until("parseFloat(document.querySelector('#player input').value) > 93")
    # Nothing is wrong with a replay that was held.
    assert one.page.locator(".banner.alarm").count() == 0
    one.page.close()


def test_a_token_is_asked_for_and_kept_out_of_the_page(browser, launched):
    token = "-".join(("a", "token", "for", "looking"))
    environ = {"RADARD_WEB__TOKEN_ENV": "LOOK", "LOOK": token}
    running = launched("--port", "sim:empty", "--model", "none", environ=environ).wait_online()
    one = Tab(browser, running)
    one.page.goto(running.base)
    one.page.fill("#token", "the wrong token")
    one.page.keyboard.press("Enter")
    one.until("document.querySelector('#error').textContent.includes('not the token')")
    one.page.fill("#token", token)
    one.page.keyboard.press("Enter")
    one.page.wait_for_selector("#page .card")
    one.until("document.querySelector('#arm')?.disabled === true")
    assert token not in one.page.content()
    assert one.page.evaluate("document.cookie") == ""
    one.page.close()
