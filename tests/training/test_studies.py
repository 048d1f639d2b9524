"""The studies in `research/`: each runs as a script, small but whole."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import benchmark
import benchmark_tasks as tasks
import levers
import profiles
import scene
import tradeoff
from benchmark_alarms import MARKS
from benchmarks.blank_bundle import write_blank_bundle
from leave_one_out import main as leave_one_out
from profiles_measure import Candidate
from radard.config.json_file import parse_json
from radard.config.profiles import Front
from radard.judge.bundle import load_bundle
from radard.judge.features import MAP_FEATURES
from study import RESULTS
from tests.processes import ROOT, ran
from tests.sim_helpers import axis_with
from tradeoff_measure import SWITCHES, judged_windows
from walk_numbers import follow, measure
from walks import simulated_walk
from x2radar.cli import main as x2radar
from x2train.cli import main
from x2train.judge import acceptance, acceptance_report
from x2train.judge.acceptance import VERSION as ACCEPT
from x2train.thesis.fit import fit_settings

pytestmark = pytest.mark.nightly

PAGE = (ROOT / "docs/benchmark.md").read_text()


def told(*_):
    pass


@pytest.fixture
def page(tmp_path):
    """A function that makes a page with something old between marks."""

    def make(*marks):
        path = tmp_path / "page.md"
        path.write_text("".join(f"{begin}\nOLD\n{end}\n" for begin, end in marks) + "behind\n")
        return path

    yield make
    text = (tmp_path / "page.md").read_text()
    assert text.endswith("behind\n")
    assert "OLD" not in text


SCRIPTS = [p for p in sorted((ROOT / "research").glob("*.py")) if "if __name__" in p.read_text()]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_tells_how_to_run_it(path, tmp_path):
    assert f"python research/{path.name} " in ran(path, "--help", cwd=tmp_path).stdout


@pytest.mark.parametrize("name", tasks.shipped())
def test_an_entry_of_the_benchmark_learns_what_is_easy(name):
    """People are bright at high velocities."""
    rng, n = np.random.default_rng(0), 120
    is_person = np.arange(n) % 2 == 1
    mu = rng.uniform(0, 0.2, (n, 28, 40)).astype(np.float32)
    mu[is_person, 4:24] = 0.8
    mu[:, 13:16] = 0.9
    vector = np.repeat(mu.mean(axis=2), 28, axis=1).astype(np.float32)
    vector /= np.linalg.norm(vector, axis=1, keepdims=True)
    range_time = rng.uniform(0, 1, (n, 56, 40)).astype(np.float32)
    easy = tasks.Elements(vector, mu, range_time, is_person, np.ones(n, np.float32), 60)
    entry = tasks.module_of(tasks.entry_file(name))
    if name == "thesis_network":
        small = fit_settings("relu", pretrain_epochs=(), output_epochs=0, epochs=20, look_every=10)
        entry.fit_settings = lambda *_args, **_own: replace(small, repeats=1)
    assert ((np.asarray(entry.scores(easy, easy, 0)) > 0.5) == easy.is_person).mean() > 0.9


def example_of_the_page(folder, wanted):
    codes = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (code,) = (each for each in codes if wanted in each)
    (folder / "mine.py").write_text(code)
    return ["--entry", str(folder / "mine.py")]


def test_the_benchmark_s_tasks_and_its_page(page, tmp_path):
    path = page(RESULTS)
    argv = ["--folder", str(tmp_path), "--elements", "40", "--fresh", "40", "--workers", "1"]
    argv += ["--tasks", "T1D60", "--publish", str(path), "--entry", "fast"]
    assert benchmark.main(argv + example_of_the_page(tmp_path, "def scores")) == 0
    assert f"Version `{tasks.VERSION}`, 40 elements to train with" in path.read_text()
    assert "| mean speed, one threshold (`mine`) |" in path.read_text()


def test_the_benchmark_s_alarms_and_its_page(page, tmp_path, monkeypatch):
    kinds = {entry.kind: entry for entry in acceptance.ENTRIES}
    few = [replace(e, duration_s=30.0 if e.kind == "pets stay" else 8.0) for e in kinds.values()]
    for module in (acceptance, acceptance_report):
        monkeypatch.setattr(module, "ENTRIES", tuple(few))
    path = page(MARKS)
    argv = ["--tasks", ACCEPT, "--share", "0.001", "--workers", "1", "--folder", str(tmp_path)]
    argv += ["--publish", str(path), "--entry", "fast", "--entry", "any_motion"]
    assert benchmark.main(argv + example_of_the_page(tmp_path, "def alarms")) == 0
    assert f"Version `{ACCEPT}`; **a share of 0.001 of the test**." in path.read_text()
    assert "| any motion (`any_motion`) | 0 of 1" in path.read_text()
    assert "motion within 2 m (`mine`)" in path.read_text()


def test_profiles_and_levers(page, monkeypatch, tmp_path):
    monkeypatch.setattr(levers, "_RATES_HZ", (60.0,))
    monkeypatch.setattr(levers, "_MOUNTS", (levers.USUAL,))
    monkeypatch.setattr(levers, "_WITHIN_S", (0.0, 3.0))
    monkeypatch.setattr(levers, "_HOPS_S", (1.0,))
    monkeypatch.setattr(levers, "MODELS", ("fast",))
    monkeypatch.setattr(profiles, "candidates", lambda: (Candidate("fast"), profiles.BEST))
    walks = tmp_path / "walks"
    walks.mkdir()
    (walks / "truth.json").write_text(json.dumps([{"file": "walk.h5", "label": "human"}]))
    walk = ["record", str(walks / "walk.h5"), "--port", "sim:human?kind=baseband"]
    assert x2radar([*walk, "--duration", "6", "--speed", "max"]) == 0
    path, file = page(profiles.MARKS, profiles.RESULTS), tmp_path / "measured.json"
    timed = ["--rounds", "1", "--duration", "5", "--file", str(file), "--page", str(path)]
    argv = [*timed, "--passages", "1", "--recorded", str(walks)]
    plots = [tmp_path / "a.png", tmp_path / "b.png"]
    assert profiles.main([*argv, "--plot", str(plots[0]), "--levers-plot", str(plots[1])]) == 0
    assert "1 of 1; 0 of 0" in path.read_text()
    assert min(plot.stat().st_size for plot in plots) > 1000
    before = parse_json(Front, file.read_bytes())
    assert profiles.main(["--cpu-only", *timed]) == 0
    again = parse_json(Front, file.read_bytes())
    kept = [{(p.model, p.missed, p.recorded) for p in f.measured} for f in (before, again)]
    assert kept[0] == kept[1]


def test_every_law_is_left_out_once_and_nothing_is_done_twice(tmp_path, capsys):
    laws, out = tmp_path / "set", tmp_path / "left-out.json"
    made = ["--passages", "80", "--workers", "1", "--radar", "x2", "--plain", "1"]
    kinds = ["--motion", "gait", "footfalls", "--skin", "surface", "points"]
    assert main(["dataset", "--out", str(laws), *made, *kinds]) == 0
    argv = ["--sets", str(laws), "--epochs", "1", "--out", str(out)]
    assert leave_one_out(argv) == 0
    figures = json.loads(out.read_text())
    names = ["motion gait", "motion footfalls", "skin surface", "skin points"]
    assert list(figures) == ["nothing", *names]
    # An interrupted run goes on: what is in the file is taken from there.
    figures["nothing"]["skin points"] = 0.25
    out.write_text(json.dumps(figures))
    assert leave_one_out(argv) == 0
    assert "skin points 0.250\nwithout motion gait" in capsys.readouterr().out


def test_a_scene_is_drawn(tmp_path):
    plot = tmp_path / "scene.png"
    argv = ["human_with_dog", "--plot", str(plot), "--duration", "4", "--seed", "3"]
    assert scene.main(argv) == 0
    assert plot.read_bytes()[:4] == b"\x89PNG"


def test_the_trade_of_accuracy_for_time(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    seen = judged_windows(12, 0, [load_bundle("fast")], told)
    monkeypatch.setattr(tradeoff, "judged_windows", lambda *_: seen)
    write_blank_bundle(tmp_path, "mine", load_bundle("fast").features, MAP_FEATURES)
    argv = ["--scenes", "human", "--draws", "1", "--duration", "6", "--rounds", "1"]
    argv += ["--combine", "mine.onnx", "--passages", "12"]
    path, plot = page(tradeoff.MARKS), tmp_path / "plot.png"
    assert tradeoff.main([*argv, "--page", str(path), "--plot", str(plot)]) == 0
    assert path.read_text().count("| **") == len(SWITCHES) + 1
    assert plot.read_bytes()[:4] == b"\x89PNG"


def test_a_simulated_walk_is_measured():
    axis = axis_with("baseband", 480, 0.00915, 0.8, 4.0e9, 1.7e9, 1.6e10)
    numbers = measure(follow(simulated_walk(3, axis, 30.5, 0.0), axis, 30.5))
    assert 0.1 < numbers.speed_mps < 1.0
    assert numbers.limb_mps > 0.1
