"""Map networks: they learn, the same every time, and leave torch as they were."""

import json
from dataclasses import asdict, replace
from functools import partial

import numpy as np
import pytest
import torch

from benchmarks.bench_training import step_of
from radard.errors import RadardError, UsageError
from radard.judge.bundle import CLASSES, EvidenceSettings, load_bundle
from radard.judge.classifier import Classifier, softmax
from tests.training_helpers import FEATURES, INPUTS, TINY, as_float, tiny, toy, trained, write_tiny
from x2train.bundle.export import checked, exported
from x2train.bundle.metrics import HUMAN_LIMIT, PRIOR_HUMAN, TRUST, map_metrics
from x2train.commands.fit import WIDTHS
from x2train.nets.evidence_fit import fit_evidence, fused, log_loss, sequences
from x2train.nets.map_fit import logits_of
from x2train.nets.nets import MapNet, n_parameters

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def made():
    return tiny()


def test_what_a_glance_tells_apart_is_learnt(made):
    network, epochs = made
    assert [e.number for e in epochs] == list(range(1, TINY.epochs + 1))
    assert epochs[-1].validation_loss < 0.2 < epochs[0].validation_loss
    unseen = toy(48, seed=2)
    assert (logits_of(network.net, unseen).argmax(axis=1) == unseen["label"]).all()


def test_same_seed_same_weights():
    settings = replace(TINY, epochs=2)
    a, b, c = (trained(replace(settings, seed=s))[0] for s in (0, 0, 1))
    for x, y in zip(a.net.state_dict().values(), b.net.state_dict().values(), strict=True):
        assert torch.equal(x, y)
    assert a.temperature == b.temperature
    pairs = zip(a.net.parameters(), c.net.parameters(), strict=True)
    assert not all(torch.equal(x, y) for x, y in pairs)


def test_half_precision_learns_the_same_and_the_weights_stay_single():
    network, epochs = trained(replace(TINY, is_half=True))
    assert epochs[-1].validation_loss < 0.2
    assert {p.dtype for p in network.net.parameters()} == {torch.float32}
    unseen = toy(48, seed=2)
    assert (logits_of(network.net, unseen).argmax(axis=1) == unseen["label"]).all()


def test_a_compiled_network_learns_the_same(monkeypatch):
    # What torch makes machine code of, run by torch itself: making it takes a minute.
    traced = partial(torch.compile, backend="eager")
    monkeypatch.setattr(torch, "compile", traced)
    settings = replace(TINY, epochs=2)
    a, b = (trained(replace(settings, is_compiled=c), n=33)[0] for c in (False, True))
    for x, y in zip(a.net.state_dict().values(), b.net.state_dict().values(), strict=True):
        assert torch.allclose(x, y, atol=1e-4)


def test_logits_do_not_depend_on_the_company(made):
    net = made[0].net
    windows = toy(40)
    alone = [logits_of(net, {k: v[i : i + 1] for k, v in windows.items()}) for i in range(5)]
    np.testing.assert_allclose(np.concatenate(alone), logits_of(net, windows)[:5], atol=1e-4)
    assert logits_of(net, {k: v[:0] for k, v in windows.items()}).shape == (0, 3)


def test_the_three_sizes_ascend():
    sizes = [
        n_parameters(MapNet(101, 80, (61, 81), widths=widths, long_widths=long, hidden=hidden))
        for widths, long, hidden in (WIDTHS[name] for name in ("fast", "balanced", "accurate"))
    ]
    assert sizes[1] < 60_000
    assert sizes == sorted(sizes)
    assert sizes[-1] < 250_000


@pytest.mark.parametrize("rows", [(101, 80, (61, 81)), (101, 80, ()), (101, 0, ())])
def test_onnxruntime_agrees_with_torch(rows):
    torch.manual_seed(3)
    net = MapNet(*rows).eval()
    given = (*rows[:2], *rows[2])
    inputs = tuple(i for i, n in zip(INPUTS, given, strict=False) if n)
    rng = np.random.default_rng(0)
    for n in (1, 5):
        x = {i.name: rng.random((n, *i.shape), np.float32) for i in inputs}
        assert exported(net, inputs, x)[1] < 1e-4


def test_a_bundle_comes_back_as_it_was_written(made, tmp_path):
    network, validation = made[0], toy(48, seed=1)
    evidence, metrics = map_metrics(network, validation)
    write_tiny(tmp_path, network, evidence=evidence, metrics=metrics)
    bundle = load_bundle(str(tmp_path / "tiny.onnx"))
    assert bundle.inputs == INPUTS
    assert bundle.features == FEATURES
    assert bundle.features.n_cpi == 0
    assert bundle.classes == CLASSES
    assert bundle.policy == "fused"
    assert EvidenceSettings.from_mapping(bundle.evidence) == evidence
    assert bundle.temperature == network.temperature
    logits = logits_of(network.net, validation)
    classifier = Classifier(bundle)
    for k in range(0, 48, 7):
        inputs = {i.name: as_float(validation[i.name][k]) for i in INPUTS}
        p = classifier.classify(inputs)
        expected = softmax(logits[k] / network.temperature)
        np.testing.assert_allclose([p.human, p.pet, p.other], expected, atol=1e-5)
    card = (tmp_path / "tiny.md").read_text()
    assert "some notes" in card
    assert "`fused`" in card
    assert str(tmp_path) not in (tmp_path / "tiny.json").read_text()
    sidecar = json.loads((tmp_path / "tiny.json").read_text())
    assert sidecar["metrics"]["window AUC, human against pet"] == 1.0
    assert sidecar["evidence"] == asdict(evidence)


@pytest.mark.parametrize("difference", [float("nan"), 2e-4])
def test_a_network_that_onnxruntime_runs_otherwise_is_refused(difference):
    with pytest.raises(RadardError, match="torch and onnxruntime differ by"):
        checked(difference)


def test_a_bundle_is_shipped_with_less_trust_than_its_own_families_ask_for(made):
    validation = toy(48, seed=1)
    shipped, _ = map_metrics(made[0], validation)
    windows = sequences(
        logits_of(made[0].net, validation),
        made[0].temperature,
        label=validation["label"],
        passage=validation["passage"],
        t_s=validation["t_s"],
    )
    best = fit_evidence(windows, EvidenceSettings())
    assert shipped.discount == pytest.approx(TRUST * best.discount, abs=0.006)
    assert (shipped.prior_human, shipped.human_limit) == (PRIOR_HUMAN["balanced"], HUMAN_LIMIT)
    other, _ = map_metrics(made[0], validation, PRIOR_HUMAN["accurate"])
    assert other == replace(shipped, prior_human=PRIOR_HUMAN["accurate"])
    assert PRIOR_HUMAN.keys() == WIDTHS.keys()


@pytest.mark.parametrize("label", [0, 1])
def test_a_set_of_one_class_cannot_calibrate(made, label):
    validation = toy(48, seed=1)
    keep = validation["label"] == label
    with pytest.raises(UsageError, match="people and others"):
        map_metrics(made[0], {k: v[keep] for k, v in validation.items()})


def in_sequence(logits, label, passage, t_s):
    return sequences(
        np.asarray(logits, float),
        1.0,
        label=np.array(label),
        passage=np.array(passage),
        t_s=np.array(t_s, float),
    )


def test_evidence_begins_anew_with_each_passage_and_after_a_closed_gate():
    rows = [[0, 0, 0]] * 7
    windows = in_sequence(
        rows, [0, 0, 0, 1, 1, 2, 2], [4, 4, 4, 5, 5, 5, 0], [3, 4, 6, 3, 4, 5, 6]
    )
    assert windows.is_first.tolist() == [True, False, True, True, False, False, True]
    assert windows.is_human.tolist() == [True] * 3 + [False] * 4


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
        windows = in_sequence(logits, label, passage, t_s)
        best = fit_evidence(windows, EvidenceSettings(most=8.0, prior_human=0.1))
        assert best.most == 8.0
        assert best.prior_human == 0.1
        loss = log_loss(fused(windows, best), windows.is_human)
        for discount in (0.2, 0.5, 1.0):
            other = replace(best, discount=discount)
            assert loss <= log_loss(fused(windows, other), windows.is_human)
        found.append(best.discount)
    # Windows that say the same again and again must count less.
    assert found[1] < found[0]


def test_the_benchmark_takes_such_a_step():
    step_of("fast", is_half=False, is_compiled=False)()
