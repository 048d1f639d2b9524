"""Remake docs/images/dashboard-*.png: every page of the dashboard, as a browser shows it.

    python tools/screenshots.py [--out DIR] [--only NAME ...]

Needs the package playwright and a chromium ($CHROMIUM, or chromium in the PATH). A simulated
person walks before a simulated module; the pictures differ a little from run to run.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
PORT = 8493
BASE = f"http://127.0.0.1:{PORT}"
WIDE, TABLET, PHONE = (1440, 1000), (1180, 820), (390, 844)


def get(path: str) -> Any:
    """Return what the daemon answers."""
    with urllib.request.urlopen(BASE + path, timeout=5) as answer:  # noqa: S310 - our own daemon
        return json.load(answer)


def wait_for(what: Callable[[], Any], timeout_s: float = 60.0) -> Any:
    """Return what `what` returns once that is true."""
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        try:
            if found := what():
                return found
        except OSError:
            pass
        time.sleep(0.3)
    msg = "the daemon did not get there in time"
    raise SystemExit(msg)


def alarm_with_clip() -> Any:
    """Return the id of an alarm whose clip is there and at an end."""
    events = get("/api/v1/events?kind=alarm")["events"]
    return next((e["id"] for e in events if e["has_clip"] and e["phase"] == "end"), None)


def decision(label: str, after: int = 0) -> Any:
    """Return the number of the last decision with a label, behind some other."""
    found = get("/api/v1/decisions?limit=60")["decisions"]
    fitting = (d["seq"] for d in reversed(found) if d["label"] == label and d["seq"] > after)
    return next(fitting, None)


def shrink(path: Path) -> None:
    """Keep 256 colours of a picture, where pillow is installed."""
    try:
        from PIL import Image  # noqa: PLC0415
    except ImportError:
        return
    with Image.open(path) as image:
        few = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def live(page: Page) -> None:
    """Fill the pictures and wait for the dog."""
    page.goto(f"{BASE}/#/live")
    page.wait_for_timeout(24_000)
    wait_for(lambda: page.inner_text("#verdict") == "Pet")
    page.wait_for_timeout(2500)


def alarm(page: Page) -> None:
    """Fill the pictures and wait for an alarm."""
    page.goto(f"{BASE}/#/live")
    page.wait_for_timeout(24_000)
    page.wait_for_selector(".banner.alarm", timeout=60_000)
    page.wait_for_timeout(2500)


def why(page: Page) -> None:
    """Open a decision that was made while the page looked on."""
    page.goto(f"{BASE}/#/live")
    page.wait_for_timeout(8_000)
    before = get("/api/v1/status")["panel"]["seq"]
    seq = wait_for(lambda: decision("human", after=before))
    page.goto(f"{BASE}/#/why/{seq}")
    page.wait_for_timeout(4000)


def events(page: Page) -> None:
    """Open the clip of an alarm in the middle."""
    page.goto(f"{BASE}/#/events/{alarm_with_clip()}")
    page.get_by_role("button", name="Replay the pictures").click()
    page.wait_for_selector(".clip canvas")
    page.wait_for_timeout(9000)


def setup(page: Page) -> None:
    """Walk, look at the zones that it speaks for, and send a test alarm."""
    page.goto(f"{BASE}/#/setup")
    page.get_by_role("button", name="Start the walk test").click()
    page.wait_for_timeout(20_000)
    page.get_by_role("button", name="Stop").click()
    page.get_by_role("button", name="Suggest zones").click()
    # Not while an alarm is on.
    wait_for(lambda: not get("/api/v1/status")["panel"]["alarm_id"])
    page.get_by_role("button", name="Send a test alarm").click()
    page.get_by_text("marked as a test").wait_for()
    page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(500)


SHOTS: dict[str, tuple[Callable[[Page], None], tuple[int, int], str]] = {
    "live": (live, WIDE, "light"),
    "live-dark": (alarm, WIDE, "dark"),
    "live-phone": (live, PHONE, "light"),
    "why": (why, WIDE, "light"),
    "events": (events, WIDE, "light"),
    "setup": (setup, TABLET, "dark"),
}


def shoot(out: Path, names: list[str]) -> None:
    """Take the pictures that are named."""
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name in names:
            prepare, (width, height), scheme = SHOTS[name]
            page = browser.new_page(
                viewport={"width": width, "height": height},
                color_scheme=scheme,  # type: ignore[arg-type]
                device_scale_factor=1,
            )
            said: list[str] = []
            page.on("console", lambda message, to=said: to.append(message.text))
            page.on("pageerror", lambda error, to=said: to.append(str(error)))
            prepare(page)
            page.screenshot(path=out / f"dashboard-{name}.png", full_page=width > PHONE[0])
            shrink(out / f"dashboard-{name}.png")
            page.close()
            sys.stdout.write(f"{name} {said or ''}\n")
            sys.stdout.flush()
        browser.close()


def main() -> None:
    """Run the daemon, wait until there is something to see, take the pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("--only", nargs="+", choices=SHOTS, default=list(SHOTS))
    parser.add_argument("--port", default="sim:demo?seed=3", help="what radard watches")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        command = [Path(sys.executable).parent / "radard", "--port", args.port, "-o", BASE]
        command += ["-o", "store:radard.db"]
        environ = {**os.environ, "RADARD_SERVICE__STATE_DIR": folder}
        environ |= {"RADARD_ALARM__LATCH_S": "4", "RADARD_CLIPS__POST_S": "2"}
        with subprocess.Popen(command, env=environ, cwd=folder) as daemon:  # noqa: S603 - our own
            try:
                needs_clip = any(name.startswith("events") for name in args.only)
                wait_for(alarm_with_clip if needs_clip else lambda: decision("human"), 120)
                shoot(args.out, args.only)
            finally:
                daemon.terminate()


if __name__ == "__main__":
    main()
