"""The dashboard's words in a real browser: for a person, for an engineer, and what is not real."""

import pytest

from tests.browser_helpers import MARKS, PANELS

pytestmark = MARKS
SHOWN = "[...document.querySelectorAll('{}')].filter(e => e.checkVisibility()).length"


def test_a_simulated_module_does_not_look_real(one, radard):
    one.until("document.querySelector('#badge').textContent === 'Simulated'")
    assert one.page.is_visible("#badge")
    header = one.page.inner_text("header")
    assert radard.status()["hello"]["model"] in header
    assert "sim:" not in one.page.content()
    radard.post("/api/v1/command", {"command": "arm"})
    one.page.wait_for_selector(".banner.alarm")
    assert "Simulated alarm" in one.page.inner_text(".banner.alarm")
    one.page.goto(f"{radard.base}/#/events")
    one.page.wait_for_selector(".event .mark-unreal")


def test_details_are_for_those_who_ask(one):
    assert one.page.evaluate(SHOWN.format(".exact")) == 0
    assert one.page.evaluate(SHOWN.format(".plain")) > 5
    words = one.page.inner_text("main")
    assert "Over the noise" in words
    for jargon in ("threshold", "Latency", "clutter", "micro-Doppler", "µ"):
        assert jargon not in words
    one.page.get_by_role("button", name="Details for engineers").click()
    assert one.page.evaluate(SHOWN.format(".plain")) == 0
    assert "Over threshold" in one.page.inner_text("main")
    one.page.reload()
    one.page.wait_for_selector(".hero")
    assert one.page.get_attribute("#details", "aria-pressed") == "true"
    assert "Latency" in one.page.inner_text(".hero")


def test_on_a_phone_decisions_come_before_the_charts(tab):
    top = "document.querySelector('{}').getBoundingClientRect().top"
    phone, desk = tab(width=390, height=844).open(), tab().open()
    for one in (phone, desk):
        one.until("document.querySelectorAll('.decisions tbody tr').length > 5")
    # The widest row there is.
    phone.page.evaluate(
        """async () => {
            const { take, lastDecision } = await import('/static/state.js');
            const d = lastDecision();
            take({ ...d, seq: d.seq + 1, t_s: d.t_s + 1, label: 'none', alarm: true,
                   fused_p_human: 1, range_m: 2.5 });
        }"""
    )
    for one, is_first in ((phone, True), (desk, False)):
        decisions, charts = (one.page.evaluate(top.format(s)) for s in (".latest", ".columns"))
        assert (decisions < charts) is is_first
    cut = """[...document.querySelectorAll('main h2, main h3, main small, .caption, dt, td')]
        .filter(e => e.checkVisibility() && (e.scrollWidth > e.clientWidth + 1
          && getComputedStyle(e).display !== 'inline'
          || e.getBoundingClientRect().right > innerWidth)).map(e => e.textContent)"""
    assert phone.page.evaluate(cut) == []
    assert phone.page.evaluate("document.documentElement.scrollWidth") <= 390


BAR = ".brand svg, .sensor, #badge, .dot, .state, #theme, #arming button, .tabs a"


@pytest.mark.parametrize("width", [320, 430, 820, 900, 1170, 1280])
def test_nothing_overlaps_in_any_state_and_the_alarm_is_the_largest_word(tab, width):
    one = tab(width=width).open()
    one.until("document.querySelector('#badge').textContent === 'Simulated'")
    for name, panel in PANELS.items():
        # In one go: the daemon tells its own state every second.
        overlaps, size, said, told = one.page.evaluate(
            """async ([panel, parts]) => {
                const { take } = await import('/static/state.js');
                take({ type: 'now', panel, zones: { include: [], exclude: [], away: [[1, 2]] } });
                const shown = [...document.querySelector('.bar').querySelectorAll(parts)]
                  .filter((e) => e.checkVisibility()).map((e) => e.getBoundingClientRect());
                const meets = (a, b) => a.left < b.right - 1 && b.left < a.right - 1
                  && a.top < b.bottom - 1 && b.top < a.bottom - 1;
                const isOut = (a) => a.left < -1 || a.right > innerWidth + 1;
                const size = (e) => e ? parseFloat(getComputedStyle(e).fontSize) : 0;
                return [
                  shown.filter((a, i) => isOut(a) || shown.some((b, k) => k > i && meets(a, b))),
                  size(document.querySelector('#banner strong'))
                    - size(document.querySelector('.word')),
                  document.querySelector('.present')?.textContent ?? '',
                  document.querySelector('#verdict-sub').textContent,
                ];
            }""",
            [panel, BAR],
        )
        assert overlaps == [], name
        assert (size > 0, said.startswith("Now: ")) == (name == "alarm", name == "alarm")
        assert "all is well" not in told
    assert one.page.evaluate("document.documentElement.scrollWidth") <= width


def test_nothing_is_well_while_no_frames_come(one):
    one.until("document.querySelectorAll('.decisions tbody tr').length > 0")
    banner, told, is_dim = one.page.evaluate(
        """async (panel) => {
            const { take } = await import('/static/state.js');
            take({ type: 'now', state: 'offline', reason: 'no answer', panel });
            const text = (id) => document.querySelector(id).textContent;
            return [text('#banner'), text('#verdict-sub'),
                    document.body.classList.contains('is-lost')];
        }""",
        {"panel": "armed", "armed": True, "open": {}},
    )
    assert (banner, told) == ("Nobody is watchingno answer", "Last known; nobody is watching")
    assert is_dim


def test_a_page_that_opens_late_takes_the_backlog_and_stays(tab):
    def counted(one):
        lines = []

        def note(line):
            lines.append({"pictures": 0, "is_closed": False})
            now = lines[-1]

            def took(data):
                now["pictures"] += isinstance(data, bytes)

            line.on("framereceived", took)
            line.on("close", lambda _: now.update(is_closed=True))

        one.page.on("websocket", note)
        one.open()
        return lines

    first, late = tab(), tab()
    (line,) = counted(first)
    while line["pictures"] < 200:
        first.page.wait_for_timeout(100)
    lines = counted(late)
    while lines[0]["pictures"] < 230 and not lines[0]["is_closed"]:
        late.page.wait_for_timeout(100)
    assert [line["is_closed"] for line in lines] == [False]
