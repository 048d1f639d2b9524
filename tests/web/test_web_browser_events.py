"""The events page in a real browser: counts, small pictures, and alarms labelled in a row."""

import json
import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from radard.clips.spectrogram_png import encode_png
from radard.log import EventLog
from tests.browser_helpers import MARKS
from tests.sink_helpers import event, ulid
from tests.web_helpers import Running

pytestmark = MARKS
AXES = {"velocity_mps": [-0.66, 0.66], "range_m": [0.6, 3.41], "length_s": 17.2}


def days_ago(days, seconds=0):
    """A time of a day before this one, at noon where this runs."""
    noon = datetime.now().astimezone().replace(hour=12, minute=0, second=seconds, microsecond=0)
    return (noon - timedelta(days=days)).astimezone(UTC).isoformat().replace("+00:00", "Z")


@pytest.fixture(scope="module")
def radard(tmp_path_factory):
    """A daemon that remembers three alarms and a fault of days before, one alarm with a clip."""
    folder = tmp_path_factory.mktemp("events")
    clip = folder / f"{ulid(3)}.h5"
    clip.write_bytes(b"")
    clip.with_suffix(".png").write_bytes(encode_png(np.zeros((40, 60, 3), np.uint8), AXES))
    log = EventLog(folder / "log.db")
    for record in (
        event(1) | {"time": days_ago(5)},
        event(2, kind="fault") | {"time": days_ago(3), "reason": "no frames for 3 s"},
        event(4) | {"time": days_ago(3, 1)},
        event(3)
        | {"time": days_ago(3, 2), "clip": str(clip), "reason": "undecided for 3 s at 2.2 m"},
    ):
        log.append(record)
    log.close()
    running = Running(folder, "--port", "sim:empty", "--model", "none").wait_online()
    yield running
    running.end()


def test_days_are_counted_and_pictures_have_axes(tab, radard):
    one = tab(radard).open("events")
    one.until("document.querySelectorAll('.event').length === 4")
    heads = one.page.locator(".eventlist h3 small").all_inner_texts()
    assert heads == ["2 alarms, 1 fault", "1 alarm"]
    told = one.page.get_attribute(".hours", "aria-label")
    assert sorted(re.findall(r" 12:00 to 13:00: (\d)", told)) == ["1", "2"]
    first = one.page.locator(".event").first
    assert "something that may be a person at 2.2 m" in first.inner_text()
    one.until("document.querySelector('.thumb img')?.naturalWidth === 30")
    words = "+0.7 m/s \N{MINUS SIGN}0.7 3.4 m 0.6 0 s 17"
    assert first.locator(".thumb").inner_text().split() == words.split()
    one.page.select_option("select[name=kind]", "fault")
    one.until("document.querySelectorAll('.event').length === 1")


def test_alarms_without_a_label_are_gone_through(tab, radard):
    one = tab(radard).open("events")
    one.page.get_by_role("button", name="Review next, 3 without a label").click()
    said = "(document.querySelector('.detail dd')?.textContent ?? '')"
    one.until(f"location.hash.endsWith('{ulid(3)}') && {said} !== ''")
    assert "not remembered any more" in one.page.inner_text(".detail")
    # By its key, then the next one older; the fault between them is none to label.
    one.page.wait_for_selector(".labels button")
    one.page.keyboard.press("2")
    one.until(f"location.hash.endsWith('{ulid(4)}')")
    one.page.get_by_role("button", name="Skip this one").click()
    one.until(f"location.hash.endsWith('{ulid(1)}')")
    one.page.wait_for_selector(".labels button")
    one.page.get_by_role("button", name="Person", exact=True).click()
    one.until(f"location.hash.endsWith('{ulid(4)}')")
    one.page.wait_for_selector(".labels button")
    one.page.get_by_role("button", name="Wrong").click()
    one.page.wait_for_selector("button:disabled >> text=Every alarm here has a label")
    lines = (radard.folder / "labels.jsonl").read_text().splitlines()
    found = {each["event"]: each["label"] for each in map(json.loads, lines)}
    assert found == {ulid(3): "pet", ulid(1): "human", ulid(4): "wrong"}
