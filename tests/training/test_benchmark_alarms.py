"""The benchmark's task accept-3: bundles and functions as alarms, its table, and its page."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from radard.errors import ModelMismatch, UsageError
from research.benchmark import acceptance_task, entrants
from research.benchmark.acceptance_task import MARKS, alarm_entrant, play
from x2train.cli import main
from x2train.judge import acceptance, acceptance_report
from x2train.judge.acceptance import ENTRIES, VERSION, AcceptSpec
from x2train.judge.alarm_function import AlarmFunction, function_of

PAGE = Path(__file__).parents[2] / "docs" / "benchmark.md"
SHORT = {"walk test": 8.0, "pets cross": 8.0, "pets stay": 30.0, "thing": 8.0}


@pytest.fixture
def short(monkeypatch):
    """One passage of seconds of each kind."""
    kinds = {entry.kind: entry for entry in ENTRIES}
    few = tuple(replace(entry, duration_s=SHORT[kind]) for kind, entry in kinds.items())
    for module in (acceptance, acceptance_report):
        monkeypatch.setattr(module, "ENTRIES", few)
    return few


def played(text, folder):
    return play(alarm_entrant(text), folder, 0.001, workers=1, tell=lambda *_: None)


def counts(score, policy="bundle"):
    return [row[policy]["count"] for row in score.document["entries"]]


@pytest.mark.usefixtures("short")
def test_functions_and_bundles_judge_the_same_passages(tmp_path):
    (tmp_path / "never.py").write_text(
        "TITLE = 'never'\ndef alarms(windows):\n    for _ in windows:\n        yield False\n"
        "def always(windows):\n    for _ in windows:\n        yield True\n"
    )
    never = played(f"{tmp_path / 'never.py'}", tmp_path)
    always = played(f"{tmp_path / 'never.py'}:always", tmp_path)
    motion, fast = played("any_motion", tmp_path), played("fast", tmp_path)
    in_view = [row["in_view"] for row in never.document["entries"]]
    for each in (always, motion, fast):
        assert [row["in_view"] for row in each.document["entries"]] == in_view
    # Misses of people, then passages or minutes of others with an alarm.
    assert counts(never) == [in_view[0], 0, 0, 0]
    assert counts(always) == [0, 1, 1, 1]
    assert counts(motion)[0] == 0
    assert counts(motion)[1] == 1
    assert never.title == "never (`never`)"
    assert fast.is_bundle
    assert not motion.is_bundle


def windows_of(n):
    return [object() for _ in range(n)]


def test_a_function_is_asked_window_by_window():
    seen = []

    def alarms(windows):
        for window in windows:
            seen.append(window)
            yield np.bool_(len(seen) > 1)

    given = windows_of(3)
    function = AlarmFunction(alarms, "mine.py")
    assert [function.is_alarm(each) for each in given] == [False, True, True]
    assert seen == given


def looks_ahead(windows):
    yield from [True for _ in windows]


def ends(windows):
    yield next(windows) is None


def answers_in_words(windows):
    for _ in windows:
        yield "alarm"


def answers_unasked(_windows):
    yield True


@pytest.mark.parametrize(
    ("alarms", "said"),
    [
        (looks_ahead, "took a window before it had answered"),
        (ends, "must yield True or False for every window"),
        (answers_in_words, "must yield True or False for every window"),
        (answers_unasked, "must yield True or False for every window"),
    ],
)
def test_what_is_no_alarm_is_said(alarms, said):
    function = AlarmFunction(alarms, "mine.py")
    with pytest.raises(UsageError, match=f"entry 'mine.py': {said}"):
        list(map(function.is_alarm, windows_of(3)))


def test_who_cannot_enter_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("there.py").write_text("alarms = 1")
    with pytest.raises(UsageError, match="has no function 'alarms'"):
        function_of("there.py", "alarms")
    with pytest.raises(UsageError, match="no such file"):
        alarm_entrant("gone.py")
    with pytest.raises(UsageError, match="learns from a set's elements"):
        alarm_entrant("two_maps")
    with pytest.raises(ModelMismatch):
        alarm_entrant("thesis")
    assert alarm_entrant("x4m03").title == "bundle `x4m03`, X4M03 alone"
    assert main(["benchmark", "--tasks", VERSION, "--share", "2"]) == 2
    assert main(["benchmark", "--tasks", f"T1D60,{VERSION}"]) == 2


def test_another_file_of_the_same_name_is_another_entry(tmp_path):
    text = "def alarms(windows):\n    for _ in windows:\n        yield False\n"
    (tmp_path / "mine.py").write_text(text)
    spec = AcceptSpec(model=f"{tmp_path / 'mine.py'}")
    first = spec.files
    (tmp_path / "mine.py").write_text(text.replace("False", "True"))
    assert spec.files != first


@pytest.mark.usefixtures("short")
def test_one_command_renews_the_page(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{MARKS[0]}\nOLD TABLE\n{MARKS[1]}\nbehind\n")
    argv = ["benchmark", "--tasks", VERSION, "--share", "0.001", "--workers", "1"]
    argv += ["--folder", str(tmp_path), "--publish", str(page)]
    assert main([*argv, "--entry", "fast", "--entry", "any_motion"]) == 0
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("behind\n")
    assert "OLD TABLE" not in text
    assert f"Version `{VERSION}`; **a share of 0.001 of the test**." in text
    assert "| bundle `fast` |" in text
    assert "| the same, by single windows at 0.8 |" in text
    assert "| any motion (`any_motion`) | 0 of 1" in text
    assert f"--entry any_motion --tasks {VERSION} --share 0.001" in text
    made = sorted(tmp_path.glob(f"{VERSION}-*"))
    assert len(made) == 2
    assert all((folder / "acceptance.html").is_file() for folder in made)
    # What is there is not played again.
    times = [(f / "passages" / "manifest.json").stat().st_mtime_ns for f in made]
    assert main([*argv, "--entry", "fast", "--entry", "any_motion"]) == 0
    assert [(f / "passages" / "manifest.json").stat().st_mtime_ns for f in made] == times
    capsys.readouterr()


def test_the_table_of_the_page_is_of_this_version():
    text = PAGE.read_text().partition(MARKS[0])[2].partition(MARKS[1])[0]
    assert f"Version `{VERSION}`" in text
    assert "(`any_motion`)" in text
    assert acceptance_task.default_entries()[0] == "any_motion"
    assert "any_motion" not in entrants.shipped()


@pytest.mark.usefixtures("short")
def test_the_example_of_the_page_enters(tmp_path):
    codes = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (code,) = (each for each in codes if "def alarms" in each)
    (tmp_path / "near.py").write_text(code)
    near, motion = played(f"{tmp_path / 'near.py'}", tmp_path), played("any_motion", tmp_path)
    assert near.title == "motion within 2 m (`near`)"
    assert all(a <= b for a, b in zip(counts(near)[1:], counts(motion)[1:], strict=True))


PASSAGES = {
    (0, 0): (3.23, 23.85, 2.08, -9.31),
    (1, 3): (0.00, 22.08, 2.74, 1.03),
    (2, 1): (0.00, 34.55, 3.08, 9.49),
    (4, 4): (0.00, 25.43, 2.82, -7.97),
    (6, 0): (9.82, 13.90, 2.33, -13.21),
    (7, 5): (0.00, 10.42, 3.09, -21.49),
    (10, 2): (4.07, 11.88, 2.64, -19.11),
}
"""Passages of the version, by entry and number: entry in s, SNR in dB, range in m, mean power."""


@pytest.mark.parametrize("place", PASSAGES, ids=str)
def test_passages_of_the_version_are_what_they_were(place):
    """Whoever changes the simulator so that they differ gives the test another version."""
    file = f"{Path(entrants.entries.__file__).parent / 'any_motion.py'}"
    spec = AcceptSpec(model=file)
    number = sum(e.count for e in ENTRIES[: place[0]]) + place[1]
    assert spec.entry(number) == place
    made = spec(number)
    told = [float(made[name][0]) for name in ("enters_s", "snr_db", "range_m")]
    assert [*told, float(made["power_db"].mean())] == pytest.approx(PASSAGES[place], abs=0.05)
