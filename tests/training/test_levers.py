"""What `train-export levers` measures: few cases, but whole."""

import math

import pytest

from research.levers import cases as levers
from research.levers.cases import USUAL, cases
from research.levers.measure import measure, n_played
from x2train.cli import main
from x2train.commands import last

FEW = ("fast",)


@pytest.fixture
def few(monkeypatch):
    """Play before one radar at one mount alone."""
    monkeypatch.setattr(levers, "_RATES_HZ", (60.0,))
    monkeypatch.setattr(levers, "_MOUNTS", (USUAL,))
    monkeypatch.setattr(levers, "_WITHIN_S", (0.0, 3.0))
    return tuple(cases(FEW))


def test_each_case_changes_one_setting():
    rows = tuple(cases(("fast", "balanced")))
    for lever in dict.fromkeys(row.lever for row in rows):
        assert sum(row.is_usual for row in rows if row.lever == lever) == 1
    assert len({row.value for row in rows if row.lever == "frame rate"}) == 4


def test_cases_are_judged_on_the_same_passages(few):
    figures = last(measure(few, 2), n_played(few, 2), "passages")
    assert n_played(few, 2) == 4
    usual = [f for f in figures if f.case.is_usual]
    assert len(usual) == 6
    assert len({(f.missed.value, f.pets.value, f.median_s) for f in usual}) == 1
    at_once, waits = (f for f in figures if f.case.lever == "`decide_within_s`")
    assert at_once.pets.value >= waits.pets.value
    assert at_once.median_s <= waits.median_s
    assert all(f.cpu_ms > 0 and math.isfinite(f.kib_per_s) for f in figures)


def test_the_table_goes_into_a_page(few, monkeypatch, tmp_path, capsys):
    page, plot = tmp_path / "levers.md", tmp_path / "levers.png"
    page.write_text("before\n\n<!-- results -->\n<!-- end of results -->\nbehind\n")
    monkeypatch.setattr(levers, "_HOPS_S", (1.0,))
    argv = ["levers", "--passages", "1", "--models", *FEW]
    assert main([*argv, "--page", str(page), "--plot", str(plot)]) == 0
    text = page.read_text()
    assert "    train-export levers --passages 1 --models fast\n" in text
    assert "| hop | **1 s** |" in text
    assert text.endswith("behind\n")
    assert plot.stat().st_size > 1000
    assert "people missed" in capsys.readouterr().out
    page.write_text("no marks")
    assert main([*argv, "--page", str(page)]) == 2
