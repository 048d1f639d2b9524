"""axe-core finds nothing on any page: light and dark, phone to desk, plain and with details."""

import os
from pathlib import Path

import pytest

from tests.browser_helpers import MARKS, PANELS, Tab

# Where .ci/run has npm put it.
USUAL = Path(__file__).parents[2] / ".venv/axe/node_modules/axe-core/axe.min.js"
AXE = Path(os.environ.get("AXE") or USUAL)
WHY = "no axe-core: npm install --prefix .venv/axe axe-core"
pytestmark = [*MARKS, pytest.mark.skipif(not AXE.is_file(), reason=WHY)]
SIZES = {"desk": (1280, 900), "tablet": (820, 1180), "phone": (390, 844)}


def faults(one):
    """What axe-core finds on a page as it stands, by rule and element."""
    one.page.evaluate(AXE.read_text("utf-8"))
    script = "axe.run(document, { resultTypes: ['violations'] }).then(r => r.violations)"
    found = [(rule["id"], node) for rule in one.page.evaluate(script) for node in rule["nodes"]]
    return [f"{id_}: {node['html'][:160]} {node['failureSummary']}" for id_, node in found]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_every_page(tab, radard, scheme, size):
    width, height = SIZES[size]
    event_id = radard.ended_alarm("has_picture")
    one = tab(width=width, height=height, scheme=scheme)
    for page in ("live", "why", f"events/{event_id}", "setup"):
        one.open(page)
        one.until("document.querySelectorAll('#page canvas, .thumb img').length > 0")
        assert faults(one) == [], page
    one.page.get_by_role("button", name="Details for engineers").click()
    for page in ("live", "why", "setup"):
        one.open(page)
        one.until("document.querySelectorAll('#page canvas').length > 0")
        assert faults(one) == [], page


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_banners(tab, scheme):
    one = tab(scheme=scheme).open("events")
    one.page.evaluate(AXE.read_text("utf-8"))
    for name in set(PANELS) - {"disarmed"}:
        # In one go: the daemon tells its own state every second.
        shown, found = one.page.evaluate(
            """async (panel) => {
                const { take } = await import('/static/state.js');
                take({ type: 'now', panel });
                const shown = document.querySelector('#banner strong')?.textContent;
                const { violations } = await axe.run('#banner', { resultTypes: ['violations'] });
                return [shown, violations.map((v) => v.id)];
            }""",
            PANELS[name],
        )
        assert (bool(shown), found) == (True, []), name


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_question_for_a_token(browser, launched, scheme):
    environ = {"RADARD_WEB__TOKEN_ENV": "LOOK", "LOOK": "-".join(("a", "token", "to", "look"))}
    running = launched("--port", "sim:empty", "--model", "none", environ=environ).wait_online()
    one = Tab(browser, running, scheme=scheme)
    one.page.goto(running.base)
    one.page.wait_for_selector("#token")
    assert faults(one) == []
    one.page.close()
