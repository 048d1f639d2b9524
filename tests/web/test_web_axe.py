"""axe-core finds nothing on any page: light and dark, phone to desk, plain and with details."""

import os
from pathlib import Path

import pytest

from tests.browser_helpers import MARKS, PANELS, Tab

# Where .ci/run has npm put it.
AXE = Path(
    os.environ.get("AXE")
    or Path(__file__).parents[2] / ".venv/axe/node_modules/axe-core/axe.min.js"
)
pytestmark = [
    *MARKS,
    pytest.mark.skipif(
        not AXE.is_file(), reason="no axe-core: npm install --prefix .venv/axe axe-core"
    ),
]
SIZES = {"desk": (1280, 900), "tablet": (820, 1180), "phone": (390, 844)}


def faults(one):
    """What axe-core finds on a page as it stands, by rule and element."""
    one.page.evaluate(AXE.read_text("utf-8"))
    found = one.page.evaluate(
        "axe.run(document, { resultTypes: ['violations'] }).then(r => r.violations)"
    )
    return [
        f"{rule['id']}: {node['html'][:160]} {node['failureSummary']}"
        for rule in found
        for node in rule["nodes"]
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_every_page(tab, radard, scheme, size):
    width, height = SIZES[size]
    radard.post("/api/v1/command", {"command": "arm"})

    def alarm():
        events = radard.get("/api/v1/events?kind=alarm")[1]["events"]
        return next((e["id"] for e in events if e["has_picture"]), None)

    event_id = radard.wait(
        lambda: (radard.post("/api/v1/command", {"command": "ack"}) and None) or alarm()
    )
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
