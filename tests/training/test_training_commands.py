"""dataset, fit and evaluate: small from end to end, and wrong input in one line."""

import json

import numpy as np
import pytest

from radard.config.sections import GateSettings
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from tests.training_helpers import one_line, toy, write_set
from x2train.cli import main
from x2train.judge.table import PassageTable
from x2train.sets.shards import read_all

pytestmark = pytest.mark.integration

SETTINGS = {"dwell_s": 2.0, "n_cpi": 0}
SPOILT = {
    "holds no windows but 'passages'": {"kind": "passages"},
    "other settings": {"settings": {"dwell_s": 3.0}},
    "holds no window": {"columns": {}},
    "people and others": {"columns": toy(12) | {"label": np.ones(12, np.int64)}},
    "no set of shards here": None,
}
"""What is said of sets to validate on, by what they hold."""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """Return the file of a bundle that the three commands made, hardly trained."""
    folder = tmp_path_factory.mktemp("made")
    sets = folder / "sets"
    small = ["--passages", "15", "--families", "all", "--workers", "1"]
    assert main(["dataset", "--out", str(sets), "--seed", "1", *small]) == 0
    fit = ["fit", "--half", "--threads", "2", "--train", str(sets), "--validate", str(sets)]
    fit += ["--epochs", "1"]
    out = ["--name", "tiny", "--size", "fast", "--out", str(folder / "models")]
    assert main([*fit, *out]) == 0
    return folder / "models" / "tiny.onnx"


def test_the_sidecar_says_how_it_came_about(bundle):
    sidecar = json.loads(bundle.with_suffix(".json").read_text())
    assert sidecar["policy"] == "fused"
    assert sidecar["training"]["command"].startswith("train-export fit --train ")
    assert sidecar["training"]["command"].endswith(" --half --threads 2")
    assert "Families kept out of training: none" in sidecar["training"]["recipe"]
    about, columns = read_all(bundle.parents[1] / "sets")
    assert sidecar["training"]["sets"] == [about]
    assert sidecar["gate"] == about["gate"] == GateSettings().model_dump()
    assert "false_alarms_per_day 0.01" in bundle.with_suffix(".md").read_text()
    assert sidecar["metrics"]["windows"] == len(columns["label"])
    assert set(columns["label"]) == {0, 1, 2}


def test_what_goes_on_may_learn_from_every_window(bundle, monkeypatch, tmp_path):
    shown = []

    def fit(train, *_, **__):
        shown.append(len(train["label"]))
        raise UsageError("enough")

    monkeypatch.setattr("x2train.nets.map_fit.fit_maps", fit)
    sets = bundle.parents[1] / "sets"
    argv = ["fit", "--train", str(sets), "--validate", str(sets), "--out", str(tmp_path)]
    assert main(argv) == main([*argv, "--all-windows"]) == 2
    assert shown[0] < shown[1] == len(read_all(sets)[1]["label"])


def test_a_set_that_is_there_is_not_made_again(bundle, monkeypatch, capsys):
    monkeypatch.setattr("x2train.sets.windows.play", lambda *_, **__: pytest.fail("made again"))
    sets = bundle.parents[1] / "sets"
    argv = ["dataset", "--out", str(sets), "--passages", "15", "--families", "all"]
    assert main([*argv, "--seed", "1", "--workers", "1"]) == 0
    assert "windows of 15 passages" in capsys.readouterr().out
    assert main([*argv, "--seed", "2", "--workers", "1"]) == 2
    assert "seed: 1, not 2" in one_line(capsys)


def test_evaluate_judges_it(bundle, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("x2train.judge.page.passage_png", lambda *_: b"")
    small = ["--model", str(bundle), "--passages", "12", "--workers", "1"]
    assert main(["evaluate", *small, "--out", str(tmp_path / "a")]) == 0
    report = json.loads((tmp_path / "a" / "report.json").read_text())
    assert sum(report["passages"].values()) == 12
    assert "policy fused" in report["title"]
    assert (tmp_path / "a" / "report.html").stat().st_size > 1000
    table = PassageTable.load(tmp_path / "a" / "passages")
    assert [int(b) for b in table.build] == list(range(12))
    capsys.readouterr()
    against = ["--against", str(tmp_path / "a"), "--policy", "window"]
    assert main(["evaluate", *small, *against, "--out", str(tmp_path / "a")]) == 2
    assert "policy: '', not 'window'" in one_line(capsys)
    # Other answers of the same network are other passages' decisions.
    sidecar = json.loads(bundle.with_suffix(".json").read_text())
    (tmp_path / "tiny.onnx").write_bytes(bundle.read_bytes())
    (tmp_path / "tiny.json").write_text(json.dumps({**sidecar, "temperature": 7.5}))
    monkeypatch.chdir(tmp_path)
    other = load_bundle("tiny.onnx")
    monkeypatch.setattr("x2train.commands.evaluate.load_bundle", lambda _: other)
    assert main(["evaluate", *small, "--out", str(tmp_path / "a")]) == 2
    assert "judges_as" in one_line(capsys)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["dataset", "--passages", "0"], "--passages 0"),
        (["dataset", "--seed", "-1"], "--seed -1"),
        (["dataset", "--longest", "1.5"], "--longest 1.5: must be 2 to 600 s"),
        (["fit", "--train", "x", "--validate", "x", "--epochs", "0"], "--epochs 0"),
        (["evaluate", "--workers", "-1"], "--workers -1"),
        (["evaluate", "--only", "fans"], "--only 'fans': suites are people"),
        (["evaluate", "--only", "fan", "--card"], "--card with --only"),
        (["evaluate", "--model", "nope"], "no model 'nope'"),
    ],
)
def test_wrong_numbers_and_names_are_refused(argv, words, tmp_path, capsys):
    code = main([*argv, "--out", str(tmp_path / "out")])
    assert words in one_line(capsys)
    assert code in {2, 66, 78}
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", SPOILT)
def test_sets_that_cannot_be_used_are_refused(words, tmp_path, capsys):
    good, bad, out = (tmp_path / name for name in ("good", "bad", "out"))
    usual = {"columns": toy(12), "use": "train", "settings": SETTINGS}
    write_set(good, **usual)
    if SPOILT[words] is not None:
        write_set(bad, **usual | SPOILT[words])
    code = 66 if SPOILT[words] is None else 2
    both = ["--train", str(good), str(bad), "--validate", str(good)]
    each = ["--train", str(good), "--validate", str(bad)]
    for sets in (each, both)[: 1 if words == "people and others" else 2]:
        assert main(["fit", *sets, "--out", str(out)]) == code
        assert words in one_line(capsys)
    assert not out.exists()


@pytest.mark.parametrize(("teacher", "words"), [("fast", "takes; make"), ("thesis", "holds no")])
def test_a_teacher_of_other_maps_is_refused(teacher, words, tmp_path, capsys):
    write_set(tmp_path / "good", toy(12), use="train", settings=SETTINGS)
    sets = ["--train", str(tmp_path / "good"), "--validate", str(tmp_path / "good")]
    assert main(["fit", *sets, "--teacher", teacher, "--out", str(tmp_path / "out")]) == 2
    assert words in one_line(capsys)
