"""Tabs of a real browser, before a dashboard."""

import os
import shutil

import pytest

from tests.waiting import wait_for

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium")
MARKS = [
    pytest.mark.nightly,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

PANELS = {
    "disarmed": {"panel": "disarmed", "armed": False, "open": {}},
    "exit": {"panel": "exit", "armed": True, "delay_left_s": 20, "open": {}},
    "entry": {"panel": "entry", "armed": True, "delay_left_s": 20, "open": {}},
    "alarm": {"panel": "alarm", "armed": True, "open": {"alarm": "human at 1.8 m"}},
    "tamper": {"panel": "armed", "armed": True, "open": {"tamper": "covered"}},
}
"""What a daemon tells of its panel, by the state that the page shows."""


class Tab:
    """A page, and everything that its console complained of."""

    def __init__(self, browser, running, *, width=1280, height=900, scheme="light"):
        self.running = running
        size = {"width": width, "height": height}
        self.page = browser.new_page(viewport=size, color_scheme=scheme)
        self.page.set_default_timeout(60_000)
        self.complaints = []
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._note)

    def _note(self, message):
        # Reading canvases back is these tests' own doing.
        is_ours = "willReadFrequently" in message.text
        if message.type in {"error", "warning"} and not is_ours:
            self.complaints.append(message.text)

    def open(self, page="live"):
        self.page.goto(f"{self.running.base}/#/{page}")
        self.page.wait_for_selector("#page .card:not(.hero)")
        return self

    def until(self, script):
        """Wait until an expression of the page is true; what is not there yet is not true."""
        # Not wait_for_function: the page's own policy forbids what that does.
        asked = f"() => {{ try {{ return {script} }} catch {{ return false }} }}"
        wait_for(lambda: self.page.evaluate(asked), explain=lambda: script)
