"""The studies in `research/`: each runs as a script, small but whole."""

import json
import math

import numpy as np
import pytest

import levers
import scene
from leave_one_out import main as leave_one_out
from leave_one_out import sources_of
from levers import USUAL, cases
from radard.errors import UsageError
from tests.processes import ROOT, ran
from x2train.cli import main

pytestmark = pytest.mark.nightly
FEW = ("fast",)


@pytest.mark.parametrize("path", sorted((ROOT / "research").glob("*.py")), ids=lambda p: p.stem)
def test_a_script_tells_how_to_run_it(path, tmp_path):
    if "if __name__" not in path.read_text():
        pytest.skip("a module beside a script")
    assert f"python research/{path.name} " in ran(path, "--help", cwd=tmp_path).stdout


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
    counts = []
    figures = levers.measure(few, 2, lambda *count: counts.append(count))
    assert counts[-1] == (4, 4)
    usual = [f for f in figures if f.case.is_usual]
    assert len(usual) == 6
    assert len({(f.missed.value, f.pets.value, f.median_s) for f in usual}) == 1
    at_once, waits = (f for f in figures if f.case.lever == "`decide_within_s`")
    assert at_once.pets.value >= waits.pets.value
    assert at_once.median_s <= waits.median_s
    assert all(f.cpu_ms > 0 and math.isfinite(f.kib_per_s) for f in figures)


@pytest.mark.usefixtures("few")
def test_the_levers_table_goes_into_a_page(monkeypatch, tmp_path, capsys):
    page, plot = tmp_path / "levers.md", tmp_path / "levers.png"
    page.write_text("before\n\n<!-- results -->\nOLD\n<!-- end of results -->\nbehind\n")
    monkeypatch.setattr(levers, "_HOPS_S", (1.0,))
    argv = ["--passages", "1", "--models", *FEW]
    assert levers.main([*argv, "--page", str(page), "--plot", str(plot)]) == 0
    text = page.read_text()
    assert "    python research/levers.py --passages 1 --models fast\n" in text
    assert "| hop | **1 s** |" in text
    assert text.endswith("behind\n")
    assert "OLD" not in text
    assert plot.stat().st_size > 1000
    assert "people missed" in capsys.readouterr().out
    page.write_text("no marks")
    assert levers.main([*argv, "--page", str(page)]) == 2


@pytest.fixture(scope="module")
def laws(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laws") / "set"
    made = ["--passages", "80", "--workers", "1", "--radar", "x2", "--plain", "1"]
    kinds = ["--motion", "gait", "footfalls", "--skin", "surface", "points"]
    assert main(["dataset", "--out", str(folder), *made, *kinds]) == 0
    return folder


def test_every_law_is_left_out_once_and_nothing_is_done_twice(laws, tmp_path, capsys):
    out = tmp_path / "left-out.json"
    argv = ["--sets", str(laws), "--epochs", "1", "--out", str(out)]
    assert leave_one_out(argv) == 0
    figures = json.loads(out.read_text())
    names = ["motion gait", "motion footfalls", "skin surface", "skin points"]
    assert list(figures) == ["nothing", *names]
    assert all(list(row) == names for row in figures.values())
    assert capsys.readouterr().out.splitlines()[1].startswith("without motion gait: ")
    # An interrupted run goes on: what is in the file is taken from there.
    figures["nothing"]["skin points"] = 0.25
    out.write_text(json.dumps(figures))
    assert leave_one_out(argv) == 0
    assert "skin points 0.250\nwithout motion gait" in capsys.readouterr().out


def test_sources_are_groups_of_individuals_and_all_of_their_windows():
    names = ["cmu_subject_16 goes", "cmu_subject_3 stays", "quat_fox goes", "tencent_dog goes"]
    abouts = [{"use": "all"}, {"clips": [{"individual": n} for n in (*names, names[0])]}]
    windows = {
        "individual": np.array([0, 2, -1, 1, 2, 0]),
        "label": np.array([0, 1, 1, 0, 1, 0]),
    }
    laws = {str(law): law for law in sources_of(windows, abouts)}
    # A source without a window is none; subjects go by their number.
    assert list(laws) == ["source people 0", "source people 3", "source quat"]
    assert laws["source quat"].of(windows).tolist() == [False, True, False, False, True, False]
    with pytest.raises(UsageError, match="no recorded motion"):
        sources_of(windows, abouts[:1])


def test_a_scene_is_drawn(tmp_path, capsys):
    plot = tmp_path / "scene.png"
    argv = ["human_with_dog", "--plot", str(plot), "--duration", "4", "--seed", "3"]
    assert scene.main(argv) == 0
    assert plot.read_bytes()[:4] == b"\x89PNG"
    assert capsys.readouterr().out == f"{plot}\n"
    assert scene.main(["human", "--plot", "human.txt"]) == 2
    assert scene.main(["human", "--plot", str(plot), "--duration", "1"]) == 2
