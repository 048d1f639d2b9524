"""The tools that print the evaluation page's tables say what the reports hold."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.report_helpers import drawn, passage, table_of
from x2train.judge.report import write

pytestmark = pytest.mark.integration

ROOT = Path(__file__).resolve().parents[2]
ABOUT = {"seed": 51, "radar": "suites"}
UNDECIDED = [0.5, 0.5, 0.5]


def known():
    """Four people, of whom one is missed; three pets, of whom one raises an alarm; a fan."""
    return table_of(
        passage([0.1] * 4, family="walker", suite="people"),
        passage([0.1] * 4, family="walker", suite="people"),
        passage([0.99] * 4, family="walker", suite="people", is_open=False),
        passage(UNDECIDED, family="crawler", suite="crawling"),
        passage([0.3] * 4, "pet", family="dog sit", suite="pets"),
        passage([0.99] * 4, "pet", family="dog trot", suite="pets"),
        passage([0.99] * 4, "pet", family="cat sit", suite="pets"),
        passage([0.99] * 4, "other", family="fan", suite="fan"),
        # Beyond the suites, as --pet-hours adds them.
        passage([0.3] * 4, "pet", family="dog trot", suite="pets"),
    )


def report(folder, table, title="Bundle mine, policy fused", n_passages=None):
    """Leave what `train-export evaluate` would."""
    write(table, folder, title=title)
    table.save(folder / "passages", {**ABOUT, "n_passages": n_passages or len(table)})
    return folder


def run(tool, *folders):
    return subprocess.run(
        [sys.executable, ROOT / "tools" / tool, *folders],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def printed(tool, *folders):
    done = run(tool, *folders)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def cells(lines, name):
    row = next(line for line in lines if line.startswith(f"| {name} |"))
    return [cell.strip() for cell in row.strip("|").split("|")][1:]


@pytest.fixture(scope="module")
def suites(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tools")
    first = report(folder / "mine", known(), n_passages=8)
    other = report(folder / "theirs", known(), "Bundle theirs, policy fused", n_passages=8)
    return printed("suite_rows.py", first, other)


def test_intrusions_by_suite(suites):
    assert cells(suites, "people")[:2] == ["3", "33.3 %"]
    assert cells(suites, "crawling")[:2] == ["1", "0.0 %"]
    n, missed, _, theirs = cells(suites, "**all**")
    assert n == "4"
    assert missed.startswith("25.0 % (")
    assert theirs == "25.0 %"


def test_false_alarms_by_suite_without_what_was_added(suites):
    assert cells(suites, "pets") == ["3", "33.3 %", "33.3 %"]
    assert cells(suites, "fan") == ["1", "0.0 %", "0.0 %"]
    assert cells(suites, "**all visits of pets**") == ["3", "33.3 %", "33.3 %"]


def test_what_is_told_beside_the_tables(suites):
    text = "\n".join(suites)
    assert "1 missed, of which the gate never opened for 1" in text
    assert "{'undecided': 0, 'left undecided': 0, 'for a person': 1}" in text
    assert "dogs that stay (1, 1), that go (0, 1) (with an alarm, of)" in text
    assert "cats that stay (0, 1), that go (0, 0) (with an alarm, of)" in text


def test_bundles_on_the_same_passages(tmp_path):
    good = report(tmp_path / "good", drawn(300))
    bad = report(tmp_path / "bad", drawn(300, skill=1.0), "Bundle poor, policy fused")
    lines = printed("report_rows.py", good, bad)
    table = drawn(300)
    n_pets = int((table.label == "pet").sum())
    assert lines[0].startswith("300 passages (seed 51, --radar suites): ")
    assert f" {n_pets} visits of pets, " in lines[0]
    rows = [line for line in lines if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == ["mine", "mine", "poor", "poor"]
    mine, poor = (cells(lines, f"`{name}`, fused") for name in ("mine", "poor"))
    loud = table.is_alarm & (table.label == "pet")[table.passage]
    n_loud = len(np.unique(table.passage[loud]))
    assert mine[1].startswith(f"{100 * n_loud / n_pets:.1f} % (")
    at_equal = [float(row[5].removesuffix(" %")) for row in (mine, poor)]
    assert at_equal[0] < at_equal[1]
    assert cells(lines, "`mine`, window")[3:] == ["as above"] * 4


@pytest.mark.parametrize("tool", ["report_rows.py", "suite_rows.py"])
def test_a_folder_without_a_report_is_told(tool, tmp_path):
    done = run(tool, tmp_path)
    assert done.returncode == 2
    assert "holds no report.json" in done.stderr
    assert "Traceback" not in done.stderr
