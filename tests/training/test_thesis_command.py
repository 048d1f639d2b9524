import json
import re
import shutil

import numpy as np
import pytest
import torch

from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import extract
from x2radar.frame import StreamInfo
from x2radar.recording.blocks import Block
from x2radar.recording.hdf5_writer import RecordingWriter, write_labels
from x2train.cli import main
from x2train.thesis.bundle import CLASSES, folded
from x2train.thesis.elements import ElementSpec, dwell
from x2train.thesis.fit import Fitted, RepeatedMlp
from x2train.thesis.recipe import FRESH_FROM
from x2train.thesis.sets import load_recordings

pytestmark = [pytest.mark.nightly, pytest.mark.usefixtures("one_thread")]
SMALL = [
    *("--elements", "80", "--fresh", "40", "--repeats", "2", "--workers", "1"),
    *("--pretrain", "1,1", "--output-epochs", "1", "--epochs", "4", "--look-every", "2"),
    *("--own-epochs", "1", "--own-repeats", "1"),
]
ONE = ["--animal", "dog", "--vector", "2", "--frame-rate", "60"]


def thesis(folder, *more):
    return main(["thesis", "--folder", str(folder), *SMALL, *more])


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    folder = tmp_path_factory.mktemp("thesis")
    path = folder / "docs" / "thesis-results.md"
    args = [*ONE, "--activation", "relu", "--parts", "networks,own", "--publish", str(path)]
    assert thesis(folder / "cache", *args) == 0
    return folder, path, args


def test_the_page_is_written_by_one_command(published):
    folder, path, _ = published
    text = path.read_text()
    assert "T2D60 | relu | 83.6 |" in text
    assert "| D60 | 83.6 |" in text
    assert "--parts networks,own --publish docs/thesis-results.md" in text
    assert "--share 0.01" in text.partition("about a minute")[2]
    assert "2 repeats with new initial weights (the thesis: 10)" in text
    assert str(folder) not in text
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text):
        assert (path.parent / name).stat().st_size > 1000
    result = folder / "cache" / "results" / "T2D60-relu.json"
    confusion = np.array(json.loads(result.read_text())["evaluation"]["confusion"])
    assert (confusion.sum(axis=(1, 2)) == 8).all()


def test_a_second_run_trains_nothing(published, monkeypatch, capsys):
    folder, _, args = published
    monkeypatch.setattr("x2train.thesis.recipe.fit", None)  # would raise
    monkeypatch.setattr("x2train.thesis.own.train_maps", None)
    assert thesis(folder / "cache", *args[:-2]) == 0
    assert "T2D60 relu:" in capsys.readouterr().out
    assert thesis(folder / "cache", "--kept") == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("T2D60 relu:")
    assert thesis(folder / "cache", "--kept", "--rate", "0.5") == 2
    assert "no results of these settings" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["--cpi", "500"], "M = 500: must be 2 to 120, the columns of the record"),
        (["--share", "2"], "--share 2: must be above 0, and 1 at most"),
        (["--train-rate", "0"], "frame rate 0"),
        (["--elements", "20"], "elements 20: must be at least 40"),
        (["--fresh", "0"], "fresh 0: must be at least 2"),
        (["--layers", "100,x"], "--layers '100,x': must be whole numbers"),
        (["--layers", "100"], "pretrain_epochs = (1, 1): none, or one a layer"),
        (["--parts", "all"], "--parts 'all': must be of networks, own, switches"),
        (["--parts", "switches", "--rows", "luck"], "--rows luck: must be of rectified profile"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, args, says):
    assert thesis(tmp_path, *args) == 2
    assert says in capsys.readouterr().err.strip().splitlines()[-1]
    assert not list(tmp_path.rglob("*.npz"))


def test_a_repeat_becomes_a_bundle_that_the_daemon_takes(published, tmp_path, capsys):
    shutil.copytree(published[0] / "cache" / "data", tmp_path / "data")
    out = tmp_path / "models" / "mine"
    # Of dogs alone, whose elements are there; scaled inputs, which are folded into the weights.
    how = [*ONE, "--scaling", "each", "--bundle", str(out)]
    assert thesis(tmp_path, *how) == 0
    assert f"wrote {out}.onnx" in capsys.readouterr().out
    bundle = load_bundle(f"{out}.onnx")
    assert bundle.classes == CLASSES
    assert bundle.stream["frame_rate_hz"] == pytest.approx((57, 63))
    sidecar = json.loads(out.with_suffix(".json").read_text())
    assert "--scaling each" in sidecar["training"]["command"]
    assert sidecar["training"]["command"].endswith("--bundle models/mine")
    assert "people against dogs at 60 Hz" in sidecar["training"]["recipe"]
    metrics = sidecar["metrics"]
    assert metrics["logit difference torch - onnxruntime"] <= 1e-5
    # On the fresh elements, whose vectors the daemon's own code makes of frames.
    classifier, spec, right = Classifier(bundle), ElementSpec(), []
    for number in range(FRESH_FROM, FRESH_FROM + 20):
        for body, name in (("dog", "pet"), ("human", "human")):
            found = extract(dwell(spec, body, number)[0], bundle.features, ("thesis_type2",))
            right.append(getattr(classifier.answer(found).window, name) > 0.5)
    assert metrics["accuracy"] == pytest.approx(np.mean(right), abs=1e-4)
    assert metrics["windows"] == 40
    # Both of lone elements and of visits, by body.
    for kind in ("of lone elements without alarm", "without alarm", "of visits with an alarm"):
        assert {f"share {kind}, {body}" for body in ("dog", "human")} <= set(metrics)
    assert metrics["streams of each body"] == 4
    first = out.with_suffix(".onnx").read_bytes()
    assert b"site-packages" not in first
    assert thesis(tmp_path, *how) == 0
    assert out.with_suffix(".onnx").read_bytes() == first
    assert thesis(tmp_path, *how, "--rectified") == 2
    assert "--rectified: the daemon makes no such" in capsys.readouterr().err


@pytest.mark.parametrize(("n_outputs", "activation"), [(2, "tanh"), (1, "sigmoid")])
def test_what_is_folded_says_the_same(n_outputs, activation):
    rng = np.random.default_rng(0)
    net = RepeatedMlp(3, (8, 5, 4, n_outputs), activation, seed=2)
    mean, scale = rng.standard_normal((2, 8)).astype(np.float32)
    empty = np.zeros((1, 3))
    fitted = Fitted(net, mean, scale, empty, empty)
    x = rng.standard_normal((20, 8)).astype(np.float32)
    p = torch.softmax(folded(fitted, 1)(torch.from_numpy(x)), dim=1).detach().numpy()
    np.testing.assert_allclose(p, fitted.predict(x)[1], atol=1e-6)


def test_frames_themselves_are_a_row(tmp_path, capsys):
    how = [*ONE, "--parts", "switches", "--rows", "raw frames"]
    assert thesis(tmp_path, *how) == 0
    path = tmp_path / "results" / "T2D60-raw-frames.json"
    result = json.loads(path.read_text())
    assert (result["evaluation"]["n"], result["fresh"]["n"]) == (8, 40)
    assert len(result["fresh"]["total"]) == 2
    assert "T2D60 raw frames:" in capsys.readouterr().out
    assert thesis(tmp_path, *how, "--kept") == 0
    assert json.loads(path.read_text()) == result


def record(path, labels, rate_hz=60, seconds=6):
    parts = []
    for k in range(seconds // 2):
        made, _ = dwell(ElementSpec(), "human" if k % 2 else "dog", k)
        parts.append(made.frames[:120])
    samples = np.concatenate(parts)
    with RecordingWriter(path, StreamInfo(made.axis, rate_hz, "sim")) as writer:
        n = len(samples)
        writer.write_block(Block(samples, np.arange(n, dtype=np.uint32), np.arange(n) / rate_hz))
    write_labels(path, labels)
    return path


def test_recordings_stop_and_retrain(published, tmp_path, capsys):
    shutil.copytree(published[0] / "cache" / "data", tmp_path / "data")
    path = record(tmp_path / "a.h5", [(0, 6, "dog"), (0, 6, "human"), (0, 6, "chair")])
    loaded = load_recordings([path], ElementSpec(), 2)
    whole = [tmp_path / f"a.h5={label}" for label in ("dog", "human")]
    np.testing.assert_array_equal(load_recordings(whole, ElementSpec(), 2).x, loaded.x)
    assert loaded.x.shape == (8, 1176)
    np.testing.assert_array_equal(loaded.y, [0, 1] * 4)
    assert load_recordings([path], ElementSpec(), 1).x.shape == (8, 784)
    assert thesis(tmp_path, *ONE, "--activation", "relu", "--finetune", str(path)) == 0
    made = json.loads((tmp_path / "results" / "T2D60-relu-retrained.json").read_text())
    assert made["stopped_by"] == "4 windows of recordings, after retraining on 4"
    assert "T2D60 relu retrained" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("labels", "rate_hz", "says"),
    [
        ([(0, 6, "dog")], 60, "both classes are needed"),
        ([(0, 6, "chair")], 60, "no labels of pet, dog, cat, human, person"),
        ([(0, 6, "dog")], 200, "200 frames a second; these sets have 60"),
        ([(0, 1, "dog"), (1, 2, "human")], 60, "both classes are needed"),
    ],
)
def test_recordings_that_cannot_train(tmp_path, labels, rate_hz, says):
    path = record(tmp_path / "a.h5", labels, rate_hz)
    with pytest.raises(UsageError, match=says):
        load_recordings([path], ElementSpec(), 2)
