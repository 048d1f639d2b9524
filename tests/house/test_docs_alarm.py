"""docs/what-stops-an-alarm.md: its settings, its quotations, and motion in one place."""

import re
from pathlib import Path

import pytest
import yaml

from radard.alarm.panel import AlarmPanel
from radard.alarm.sensitivity import SENSITIVITIES
from radard.config.config import Config
from radard.web import why
from tests.radar_helpers import run_radard

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "what-stops-an-alarm.md").read_text("utf-8")
SETTINGS = re.findall(r"`([a-z]+(?:\.[a-z_]+)?): ([^`]+)`", PAGE)
BUILT_IN = Config().model_dump(mode="json")


def value_of(name):
    value = BUILT_IN
    for key in name.split("."):
        value = value[key]
    return value


@pytest.mark.parametrize(("name", "text"), sorted(set(SETTINGS)))
def test_settings_are_there_and_have_that_default(name, text):
    assert value_of(name) == yaml.safe_load(text)


def test_settings_without_a_value_are_there_too():
    sections = "|".join(BUILT_IN)
    named = set(re.findall(rf"`((?:{sections})\.[a-z_]+)`", PAGE))
    assert named
    for name in named:
        value_of(name)


def test_no_setting_of_the_alarm_is_left_out():
    described = {name for name, _ in SETTINGS}
    sections = ("decision", "alarm", "zones")
    assert {f"{s}.{key}" for s in sections for key in BUILT_IN[s]} <= described


def test_quotations_are_what_the_dashboard_says():
    source = Path(why.__file__).read_text("utf-8")
    quoted = re.findall(r'\*Why\*[^|]*?"([^"]+)"', PAGE.replace("\n", " "))
    assert len(quoted) > 8
    for text in quoted:
        assert text in source


def test_numbers_of_the_sensitivities():
    flat = " ".join(PAGE.split())
    fused, window = SENSITIVITIES["fused"], SENSITIVITIES["window"]
    assert [fused[n][:2] for n in ("normal", "low", "high")] == [(1, 1), (2, 3), (1, 1)]
    assert [window[n][:2] for n in ("normal", "low", "high")] == [(2, 3), (3, 5), (1, 1)]
    assert "`fused`: 1 of 1, at `low` 2 of 3; `window`: 2 of 3, at `low` 3 of 5, at `high`" in flat
    for table in (fused, window):
        assert [table[n][2] for n in ("normal", "low", "high")] == [0.0, 0.5, 0.0]
        assert [table[n][3] for n in ("normal", "low", "high")] == [0.1, 0.2, 0.05]


def test_rule_is_told_alike_everywhere():
    words = "p(pet) + p(other)"
    pages = ("docs/what-stops-an-alarm.md", "docs/how-it-decides.md")
    for name in ("README.md", "config.yaml", *pages):
        text = " ".join((ROOT / name).read_text("utf-8").replace("#", " ").split())
        assert words in text, name
        assert "at least 0.5" in text, name


def test_no_exit_delay():
    panel = AlarmPanel(is_armed=False)
    panel.arm()
    assert panel.state == "armed"


@pytest.mark.parametrize(("empty_s", "closed_s"), [(0, 24), (70, 31)])
def test_motion_in_one_place_becomes_background(empty_s, closed_s, tmp_path):
    walk = "{body: human, style: walk, waypoints_m: [[0.3, 4.8], [0.0, 2.0]], speed_mps: 0.9"
    here = "{body: human, style: exercise, waypoints_m: [[0.0, 2.0], [0.0, 2.01]]"
    lead = f"  - {{duration_s: {empty_s}}}\n  - {walk}, duration_s: 4}}\n" if empty_s else ""
    scene = tmp_path / "exercise.yaml"
    scene.write_text(f"like: empty\nsteps:\n{lead}  - {here}, duration_s: 90}}\n")
    began_s = empty_s + 4 if empty_s else 0
    argv = ["--port", f"sim:{scene}", "--duration", str(began_s + closed_s + 20)]
    code, records, _ = run_radard(*argv, "--speed", "max", "-o", "json")
    assert code == 0
    open_s = [r["t_s"] for r in records if r["type"] == "decision" and r["gate"] == "open"]
    assert max(open_s) == pytest.approx(began_s + closed_s, abs=1.6)
    events = [r for r in records if r["type"] == "event"]
    assert [e["phase"] for e in events] == ["new", "update", "end"]
    assert events[-1]["reason"] == "nobody seen for 15 s"
