"""Training of the map networks: steps, teachers, interruptions, bundles, evidence."""

import json
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, EvidenceSettings, load_bundle
from radard.judge.classifier import Classifier, softmax
from tests.training_helpers import FEATURES, INPUTS, TINY, as_float, tiny, toy, trained, write_tiny
from x2train.bundle.export import exported
from x2train.bundle.metrics import map_metrics
from x2train.nets import map_fit
from x2train.nets.bundle_answers import outputs_of, taught_by
from x2train.nets.calibration import first_windows, fit_evidence, fused, log_loss
from x2train.nets.map_fit import INPUTS as NAMES
from x2train.nets.map_fit import MAPS, fit_maps, logits_of
from x2train.nets.nets import MapNet, start_from

pytestmark = pytest.mark.integration

SETTINGS = replace(TINY, epochs=3, dropout=0.2)


@pytest.fixture(scope="module")
def made():
    return tiny()


@pytest.mark.parametrize("is_half", [False, True])
def test_what_a_glance_tells_apart_is_learnt(made, is_half):
    network, epochs = trained(replace(TINY, is_half=True)) if is_half else made
    assert [e.number for e in epochs] == list(range(1, TINY.epochs + 1))
    assert epochs[-1].validation_loss < 0.2 < epochs[0].validation_loss
    assert {p.dtype for p in network.net.parameters()} == {torch.float32}
    unseen = toy(48, seed=2)
    assert (logits_of(network.net, unseen).argmax(axis=1) == unseen["label"]).all()


def test_a_compiled_network_learns_the_same(monkeypatch):
    # What torch makes machine code of, run by torch itself: making it takes a minute.
    monkeypatch.setattr(torch, "compile", partial(torch.compile, backend="eager"))
    settings = replace(TINY, epochs=2)
    a, b = (trained(replace(settings, is_compiled=c), n=33)[0] for c in (False, True))
    for x, y in zip(a.net.state_dict().values(), b.net.state_dict().values(), strict=True):
        assert torch.allclose(x, y, atol=1e-4)


def test_training_goes_on_from_what_a_bundle_says(made, tmp_path):
    write_tiny(tmp_path, made[0])
    bundle = load_bundle(str(tmp_path / "tiny.onnx"))
    unseen = toy(48, seed=2)
    net = MapNet(tuple(unseen[name].shape[1] for name in MAPS), TINY)
    start_from(net, bundle, [torch.from_numpy(as_float(unseen[name])) for name in NAMES])
    wanted = outputs_of(bundle.onnx, {name: unseen[name] for name in NAMES}).logits
    np.testing.assert_allclose(logits_of(net, unseen), wanted, atol=1e-4)
    once = replace(TINY, epochs=1)
    first, _ = fit_maps(toy(96), toy(48, seed=1), once, start=bundle)
    assert first.validation_loss < 0.2
    with pytest.raises(UsageError, match=r"junction.0.weight is \(8, .*this size has \(10, "):
        list(fit_maps(toy(96), unseen, replace(once, hidden=10), start=bundle))


@pytest.mark.parametrize("rows", [(101, 80, 61, 81), (101, 80)])
def test_onnxruntime_agrees_with_torch(rows):
    torch.manual_seed(3)
    net = MapNet(rows, TINY).eval()
    inputs = (*INPUTS[: len(rows)], INPUTS[-1])
    rng = np.random.default_rng(0)
    for n in (1, 5):
        x = {i.name: rng.random((n, *i.shape), np.float32) for i in inputs}
        assert exported(net, inputs, x)[1] < 1e-4


def test_a_bundle_comes_back_as_it_was_written(made, tmp_path):
    network, validation = made[0], toy(48, seed=1)
    evidence, metrics = map_metrics(network, validation)
    write_tiny(tmp_path, network, evidence=evidence, metrics=metrics)
    bundle = load_bundle(str(tmp_path / "tiny.onnx"))
    assert (bundle.inputs, bundle.features) == (INPUTS, FEATURES)
    assert (bundle.classes, bundle.policy) == (CLASSES, "fused")
    assert EvidenceSettings.from_mapping(bundle.evidence) == evidence
    assert bundle.temperature == network.temperature
    logits = logits_of(network.net, validation)
    classifier = Classifier(bundle)
    for k in range(0, 48, 7):
        p = classifier.answer({i.name: as_float(validation[i.name][k]) for i in INPUTS}).window
        expected = softmax(logits[k] / network.temperature)
        np.testing.assert_allclose([p.human, p.pet, p.other], expected, atol=1e-5)
    card = (tmp_path / "tiny.md").read_text()
    assert "some notes" in card
    assert "`fused`" in card
    assert str(tmp_path) not in (tmp_path / "tiny.json").read_text()
    sidecar = json.loads((tmp_path / "tiny.json").read_text())
    assert sidecar["metrics"]["window AUC, human against pet"] == 1.0
    assert sidecar["evidence"] == asdict(evidence)


def test_the_discount_is_what_repetition_asks_for():
    rng = np.random.default_rng(0)
    n, length = 120, 8
    label = np.repeat(np.arange(n) % 2, length)
    passage, t_s = np.repeat(np.arange(n), length), np.tile(3.0 + np.arange(length), n)
    mean = np.where(label == 0, 0.4, -0.4)
    fresh = mean + rng.normal(0, 0.9, n * length)
    once = np.repeat(mean[::length] + rng.normal(0, 0.9, n), length)
    found = []
    for ratio in (fresh, once):
        logits = np.stack([ratio, 0 * ratio, 0 * ratio - 9], axis=1)
        p = np.stack([softmax(row) for row in logits])
        is_first, is_human = first_windows({"passage": passage, "t_s": t_s}), label == 0
        best = fit_evidence(p, is_first, is_human)
        loss = log_loss(fused(p, is_first, best), is_human)
        for discount in (0.2, 0.5, 1.0):
            assert loss <= log_loss(fused(p, is_first, replace(best, discount=discount)), is_human)
        found.append(best.discount)
    # Windows that say the same again and again must count less.
    assert found[1] < found[0]


class Stopped(Exception):
    """The machine was switched off."""


def fitted(path):
    *epochs, made = fit_maps(toy(96), toy(24, seed=1), SETTINGS, checkpoint=path)
    return epochs, made


@pytest.fixture
def often(monkeypatch):
    """Checkpoints after every step; `often(n)` switches the machine off after so many."""
    monkeypatch.setattr(map_fit, "_EVERY_S", 0.0)

    def stop_after(n):
        write, count = map_fit.write_whole, [0]

        def counted(path, data):
            write(path, data)
            count[0] += 1
            if count[0] == n:
                raise Stopped

        monkeypatch.setattr(map_fit, "write_whole", counted)

    return stop_after


@pytest.mark.parametrize("n", [1, 6, 17])
def test_an_interrupted_training_ends_with_the_same_network(tmp_path, often, n):
    path = tmp_path / "net.checkpoint"
    whole_epochs, whole = fitted(None)
    often(n)
    with pytest.raises(Stopped):
        fitted(path)
    assert path.exists()
    epochs, made = fitted(path)
    for key, value in whole.net.state_dict().items():
        assert torch.equal(made.net.state_dict()[key], value), key
    assert made.temperature == whole.temperature
    assert epochs[-1] == whole_epochs[-1]
    assert len(epochs) <= len(whole_epochs)
    assert not path.exists()


@pytest.mark.parametrize("data", [b"", b"rubbish", b"PK\x03\x04" + bytes(100)])
def test_a_damaged_checkpoint_is_begun_afresh(tmp_path, data):
    path = tmp_path / "net.checkpoint"
    path.write_bytes(data)
    epochs, _ = fitted(path)
    assert len(epochs) == SETTINGS.epochs


def test_nothing_that_runs_code_is_read(tmp_path):
    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / "ran"), "w"))

    path = tmp_path / "net.checkpoint"
    torch.save({"run": Evil()}, path)
    fitted(path)
    assert not (tmp_path / "ran").exists()


def shaped(bundle, n):
    """Windows of a bundle's own maps, as bytes."""
    rng = np.random.default_rng(0)
    return {i.feature: rng.integers(0, 256, (n, *i.shape), np.uint8) for i in bundle.inputs}


def test_a_teacher_says_what_the_daemon_would():
    bundle = load_bundle("fast")
    windows = shaped(bundle, 5)
    said = taught_by(bundle, windows, {"settings": asdict(bundle.features)}, Path())
    classifier = Classifier(bundle)
    assert said.dtype == np.float32
    for k, row in enumerate(said):
        inputs = {name: values[k].astype(np.float32) / 255 for name, values in windows.items()}
        p = classifier.answer(inputs).window
        assert row == pytest.approx([p.human, p.pet, p.other], abs=1e-5)
