"""The studies in `research/`: each runs as a script, small but whole."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import levers
import profiles
import scene
from leave_one_out import main as leave_one_out
from leave_one_out import sources_of
from levers import USUAL, cases
from profiles_measure import Candidate
from radard.config.json_file import parse_json
from radard.config.profiles import Front, front
from radard.errors import UsageError
from tests.processes import ROOT, ran
from x2radar.cli import main as x2radar
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


def test_profiles_are_the_best_of_their_price_and_none_is_beaten():
    (like,) = front().profiles[-1:]
    shares = (like.missed[1:], like.pets[1:])

    def made(cpu, missed, pets):
        (m, p) = shares
        return replace(
            like, name="", cpu_open=cpu, missed=(missed, *m), pets=(pets, *p), slow_s=5.0
        )

    tried = [made(0.2, 0.0, 0.5), made(0.24, 0.0, 0.3), made(0.24, 0.1, 0.1)]
    tried += [made(0.38, 0.0, 0.3), made(0.6, 0.0, 0.25), made(1.0, 0.0, 0.2)]
    chosen = profiles.choose(tried)
    named = {p.name: (p.cpu_open, p.pets[0]) for p in chosen if p.name}
    assert named == {"eco": (0.24, 0.3), "balanced": (0.6, 0.25), "accurate": (1.0, 0.2)}
    told = list(profiles.table(replace(front(), measured=chosen)))
    assert sum("**eco**" in line for line in told) == 1
    assert len(told) == 4 + len(tried)


def test_cpu_time_is_a_share_of_the_usual_settings():
    cheap = profiles.Candidate("fast", 30.0, 2.0)
    shares = profiles.cpu_shares((cheap, profiles.BEST), 5.0, 1, lambda *_: None)
    assert shares[profiles.BEST]["open"] == 1.0
    assert all(0 < share < 2 for cpu in shares.values() for share in cpu.values())
    assert set(shares[cheap]) == {"open", "one", "closed"}


@pytest.mark.usefixtures("few")
def test_all_that_was_measured_goes_into_a_page(monkeypatch, tmp_path, capsys):
    page, plot, levers_plot = (tmp_path / name for name in ("page.md", "a.png", "b.png"))
    marks = (profiles.MARKS, profiles.RESULTS)
    page.write_text("".join(f"{begin}\nOLD\n{end}\n" for begin, end in marks) + "behind\n")
    monkeypatch.setattr(levers, "_HOPS_S", (1.0,))
    monkeypatch.setattr(levers, "MODELS", FEW)
    monkeypatch.setattr(profiles, "candidates", lambda: (Candidate("fast"), profiles.BEST))
    (tmp_path / "walks").mkdir()
    truth = [{"file": "walk.h5", "label": "human"}]
    (tmp_path / "walks" / "truth.json").write_text(json.dumps(truth))
    walk = ["record", str(tmp_path / "walks" / "walk.h5"), "--port", "sim:human?kind=baseband"]
    assert x2radar([*walk, "--duration", "6", "--speed", "max"]) == 0
    file = tmp_path / "measured.json"
    timed = ["--rounds", "1", "--duration", "5", "--file", str(file), "--page", str(page)]
    argv = [*timed, "--passages", "1", "--recorded", str(tmp_path / "walks")]
    argv += ["--plot", str(plot), "--levers-plot", str(levers_plot)]
    assert profiles.main(argv) == 0
    text = page.read_text()
    assert text.count("    python research/profiles.py --passages 1\n") == 2
    assert "| hop | **1 s** |" in text
    assert "1 of 1; 0 of 0" in text
    assert text.endswith("behind\n")
    assert "OLD" not in text
    assert min(plot.stat().st_size, levers_plot.stat().st_size) > 1000
    assert "people missed" in capsys.readouterr().out
    before = parse_json(Front, file.read_bytes())
    assert profiles.main(["--cpu-only", *timed]) == 0
    again = parse_json(Front, file.read_bytes())
    kept = [{(p.model, p.missed, p.recorded) for p in f.measured} for f in (before, again)]
    assert kept[0] == kept[1]
    page.write_text("no marks")
    assert profiles.main(["--cpu-only", *timed]) == 2


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
