"""Training end to end, small: reproducible, exported, and loadable by the daemon."""

import json

import numpy as np
import pytest

from radard.classify.bundle import load_bundle
from radard.classify.classifier import Classifier
from x2train.cli import main
from x2train.studies.baseline.dataset import CLASSES, LabelledSet, ThesisSetSpec, element, generate

SMALL = ["--elements", "120", "--epochs", "3", "--name", "small"]


def made(spec, workers):
    *_, result = generate(spec, workers=workers)
    assert isinstance(result, LabelledSet)
    return result


def test_any_number_of_workers_gives_the_same_set():
    spec = ThesisSetSpec(n_elements=130, seed=5)
    one, two = made(spec, 1), made(spec, 2)
    assert np.array_equal(one.x, two.x)
    assert one.x.shape == (130, 1176)
    assert np.bincount(one.y).tolist() == [65, 65]
    assert set(one.body) == {"thesis_human", "thesis_dog", "thesis_cat"}
    assert not np.array_equal(one.x, made(ThesisSetSpec(n_elements=130, seed=6), 1).x)


def test_elements_are_dwells_as_the_daemon_sees_them():
    dwell = element(ThesisSetSpec(n_elements=1, seed=0), 0)
    assert dwell.frames.shape == (147, 768)
    assert dwell.frames.dtype == np.complex64
    assert dwell.is_whole


def test_train_export_writes_the_same_loadable_bundle_twice(tmp_path, capsys):
    files = []
    for name in ("a", "b"):
        assert main(["train", *SMALL, "--out", str(tmp_path / name)]) == 0
        files.append((tmp_path / name / "small.onnx").read_bytes())
    assert files[0] == files[1]
    assert b"/" + b"site-packages" not in files[0]
    classifier = Classifier(load_bundle(str(tmp_path / "a" / "small.onnx")))
    assert classifier.bundle.classes == CLASSES
    sidecar = json.loads((tmp_path / "a" / "small.json").read_text())
    assert sidecar["metrics"]["logit difference torch - onnxruntime"] <= 1e-5
    assert sidecar["training"]["command"].startswith("train-export train --name small")
    assert "small" in (tmp_path / "a" / "small.md").read_text()
    assert "accuracy" in capsys.readouterr().out


@pytest.mark.parametrize("argv", [["--elements", "3"], ["--seed", "-1"], ["--workers", "0"]])
def test_wrong_numbers_are_refused(argv, capsys, tmp_path):
    assert main(["train", *argv, "--out", str(tmp_path / "m")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "m").exists()
