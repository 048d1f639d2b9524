"""Bundles made of bundles: with a temporal head, and joined to say their mean."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch

from radard.errors import ModelMismatch, UsageError
from radard.judge.bundle import EvidenceSettings, load_bundle
from radard.judge.classifier import Answer, Classifier, Probabilities
from radard.judge.evidence import Evidence
from tests import training_helpers as small
from x2train.bundle.export import head_of, joined, n_parameters, with_head
from x2train.bundle.temporal_bundle import HUMAN_LIMIT
from x2train.cli import main
from x2train.nets.bundle_answers import outputs_of
from x2train.nets.graph_net import GraphNet
from x2train.nets.temporal_head import Given, HeadSettings, fit_head, logits_over

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the bundles `plain`, `two`, and `tiny` with a head, and sets."""
    folder = tmp_path_factory.mktemp("temporal")
    for name in ("plain", "tiny"):
        small.write_tiny(folder, small.tiny()[0], name=name)
    small.give_head(folder / "tiny.onnx")
    other = small.trained(replace(small.TINY, epochs=2, seed=1, hidden=10))[0]
    small.write_tiny(folder, replace(other, temperature=1.7), name="two")
    small.write_set(folder / "set", small.toy(96))
    small.write_set(folder / "check", small.toy(48, seed=1))
    return folder


def array(p):
    return np.array([p.human, p.pet, p.other])


def runs_of(n, length, rng):
    """Return stays whose class shows in their first window alone."""
    label = np.repeat(rng.integers(0, 3, n), length)
    is_first = np.arange(n * length) % length == 0
    values = rng.standard_normal((n * length, 6)).astype(np.float32)
    values[is_first, label[is_first]] += 6
    p = np.where(is_first[:, None] & (label[:, None] == range(3)), 0.8, 0.1)
    p /= p.sum(axis=1, keepdims=True)
    return Given(values, np.log(p).astype(np.float32), label, is_first)


def test_it_recalls_what_only_the_first_window_showed():
    rng = np.random.default_rng(3)
    train, other = runs_of(200, 5, rng), runs_of(60, 5, rng)
    settings = HeadSettings(n_projected=8, n_hidden=12, n_said=8, epochs=15, batch=16, dropout=0.0)
    *epochs, made = fit_head(train, other, settings)
    assert [e.number for e in epochs] == list(range(1, 16))
    logits = logits_over(made.net, other)
    assert (logits.argmax(axis=1) == other.label).mean() > 0.95
    # Each of its parts does, so neither leans on the other.
    windows = torch.from_numpy(other.values), torch.from_numpy(other.log_p)
    for part in made.net(*(each.reshape(60, 5, -1) for each in windows)):
        assert (part.detach().numpy().argmax(axis=2).ravel() == other.label).mean() > 0.9
    # And nothing of the stay before.
    columns = (other.values, other.log_p, other.label, other.is_first)
    turned = Given(*(each[5:] for each in columns))
    np.testing.assert_array_equal(logits_over(made.net, turned), logits[5:])


@pytest.mark.parametrize("n_said", [0, 8])
def test_onnxruntime_computes_what_torch_trained(folder, n_said):
    bundle, windows = load_bundle(str(folder / "plain.onnx")), small.toy(48, seed=4)
    made = replace(small.head_for(bundle, n_said=n_said), temperature=1.7)
    network = with_head(bundle.onnx, made, bundle.temperature)
    maps = {name: windows[name] for name in small.NAMES}
    seen = small.given(bundle, windows)
    found = outputs_of(network, maps, is_first=seen.is_first)
    np.testing.assert_allclose(found.fused, logits_over(made.net, seen) / 1.7, atol=1e-4)
    plain = outputs_of(bundle.onnx, maps)
    np.testing.assert_array_equal(found.logits, plain.logits)
    assert plain.fused is None
    assert n_parameters(network) > n_parameters(bundle.onnx)
    n_head = sum(p.numel() for p in made.net.parameters())
    # The last layers' biases are added up.
    assert n_parameters(network) - n_parameters(bundle.onnx) == n_head - (3 if n_said else 0)
    # Gone on from, with another network's values beside its own, it says the same at first.
    settings = HeadSettings(n_projected=6, n_hidden=5, n_said=n_said, epochs=1, started_rate=0)
    more = np.random.default_rng(1).standard_normal((48, 3)).astype(np.float32)
    wider = replace(seen, values=np.hstack([more, seen.values]))
    *_, again = fit_head(wider, wider, settings, head_of(network, settings, wider.values.shape[1]))
    np.testing.assert_allclose(logits_over(again.net, wider), found.fused, atol=1e-4)
    for other in (bundle.onnx, network):
        with pytest.raises(UsageError, match="no temporal head of this size"):
            head_of(other, replace(settings, n_hidden=4), 99)


def test_the_daemon_hands_on_what_the_head_wants_until_the_gate_closes(folder):
    bundle, windows = load_bundle(str(folder / "tiny.onnx")), small.toy(24, seed=5)
    classifier, evidence = Classifier(bundle), Evidence(EvidenceSettings(prior_human=0.3))
    whole = {name: small.as_float(windows[name]) for name in small.NAMES}
    is_first = np.arange(24) % 4 == 0
    at_once = outputs_of(bundle.onnx, whole, is_first=is_first)
    log_p = at_once.fused_log_p()
    p = at_once.p(bundle.temperature)
    for k in range(24):
        if is_first[k]:
            evidence.reset()
        features = {name: whole[name][k] for name in small.NAMES}
        answer = classifier.answer(features, evidence.hidden)
        np.testing.assert_allclose(answer.fused_log_p, log_p[k], atol=1e-5)
        np.testing.assert_allclose(array(answer.window), p[k], atol=1e-6)
        assert answer.window == classifier.answer(features).window
        expected = np.exp(log_p[k] + [0.3, 0, 0])
        fused = array(evidence.fuse(answer))
        np.testing.assert_allclose(fused, expected / expected.sum(), atol=1e-5)
        assert abs(fused.sum() - 1) < 1e-12


def test_what_a_network_with_a_head_may_not_answer_or_lack(folder):
    bundle = load_bundle(str(folder / "tiny.onnx"))
    maps = {i.name: np.zeros(i.shape, np.float32) for i in small.INPUTS}
    with pytest.raises(ModelMismatch, match="answered"):
        Classifier(bundle).answer(maps, np.full(bundle.n_hidden, np.nan, np.float32))
    # The outputs that its sidecar promises are there.
    model = onnx.load_from_string(bundle.onnx)
    del model.graph.output[2]
    with pytest.raises(ModelMismatch, match="does not give next_hidden"):
        Classifier(replace(bundle, onnx=model.SerializeToString()))
    # And one that was left out of the sidecar is an input nobody feeds.
    with pytest.raises(ModelMismatch, match="'hidden': \\[1, 13\\]"):
        Classifier(replace(bundle, n_hidden=0))
    # A class that it does not know stays impossible.
    answer = Answer(Probabilities(0.5, 0.5, 0.0), np.array([-0.1, -2.0, -np.inf]), np.zeros(2))
    fused = Evidence(EvidenceSettings()).fuse(answer)
    assert fused.other == 0.0
    assert fused.human + fused.pet == pytest.approx(1, abs=1e-12)


def test_torch_computes_the_graph_with_its_head(folder):
    bundle = load_bundle(str(folder / "tiny.onnx"))
    net = GraphNet(bundle.onnx)
    assert sum(int(p.count_nonzero()) for p in net.parameters()) == n_parameters(bundle.onnx)
    maps, is_first = {n: small.toy(12)[n] for n in small.NAMES}, np.arange(12) % 4 == 0
    both = (net.to_onnx(), bundle.onnx)
    again, first = (outputs_of(x, maps, is_first=is_first) for x in both)
    np.testing.assert_array_equal(again.fused, first.fused)
    assert (first.hidden[is_first] == 0).all()
    inputs = [torch.from_numpy(small.as_float(m)) for m in maps.values()]
    with torch.no_grad():
        made = net(*inputs, torch.from_numpy(first.hidden))
    np.testing.assert_allclose(made[0], first.logits, atol=1e-4)
    np.testing.assert_allclose(made[1], first.fused, atol=1e-4)


def temporal(folder, *argv, models=("plain",), on="set"):
    sets = ["--train", str(folder / on), "--validate", str(folder / "check")]
    paths = [str(folder / f"{m}.onnx") if m in {"plain", "tiny", "two"} else m for m in models]
    return main(["temporal", "--model", *paths, *sets, "--epochs", "2", *argv])


def test_the_command_writes_a_bundle_that_the_daemon_takes(folder, tmp_path, capsys):
    out = ("--out", str(tmp_path), "--name", "own", "--size", "fast")
    assert temporal(folder, *out) == 0
    assert f"wrote {tmp_path / 'own'}.onnx, .json and .md" in capsys.readouterr().out
    sidecar = json.loads((tmp_path / "own.json").read_text())
    plain = load_bundle(str(folder / "plain.onnx"))
    assert (sidecar["hidden"], sidecar["policy"]) == (20, "fused")
    assert sidecar["evidence"] == {"human_limit": HUMAN_LIMIT["fast"]}
    assert sidecar["training"]["temporal"]["base_onnx_sha256"] == plain.sha256
    assert sidecar["training"]["recipe"].endswith("kept out of its training: none.")
    assert sidecar["training"]["command"].startswith("train-export fit && train-export temporal")
    assert sidecar["training"]["command"].endswith("--size fast --name own --epochs 2 --seed 0")
    assert sidecar["metrics"]["parameters"] == n_parameters((tmp_path / "own.onnx").read_bytes())
    assert {"log loss, fused", "log loss, windows summed"} <= set(sidecar["metrics"])
    bundle = load_bundle(str(tmp_path / "own.onnx"))
    assert (bundle.n_hidden, bundle.temperature) == (20, plain.temperature)
    Classifier(bundle)
    first = (tmp_path / "own.onnx").read_bytes()
    assert temporal(folder, *out) == 0
    assert (tmp_path / "own.onnx").read_bytes() == first


@pytest.mark.parametrize(
    ("model", "argv", "words"),
    [
        ("tiny", [], "has a temporal head already"),
        ("thesis", [], "holds no thesis_type2, which model 'thesis' takes"),
        ("plain", ["--epochs", "0"], "--epochs 0"),
        ("nope", [], "no model 'nope'"),
    ],
)
def test_what_cannot_be_is_one_line(folder, model, argv, words, capsys):
    assert temporal(folder, "--out", str(folder / "none"), *argv, models=[model]) in {2, 66}
    assert words in small.one_line(capsys)
    assert not (folder / "none").exists()


@pytest.fixture(scope="module")
def bundles(folder):
    return [load_bundle(str(folder / f"{name}.onnx")) for name in ("plain", "two")]


def test_it_says_the_mean_of_what_each_says(bundles):
    both = joined(bundles)
    maps = {name: small.toy(48, seed=4)[name] for name in small.NAMES}
    each = [outputs_of(b.onnx, maps).logits / b.temperature for b in bundles]
    found = outputs_of(both.onnx, maps).logits
    np.testing.assert_allclose(found, np.mean(each, axis=0), atol=1e-5)
    assert (both.name, both.temperature, both.inputs) == ("plain", 1.0, bundles[0].inputs)
    # Three biases are one sum.
    assert n_parameters(both.onnx) == sum(n_parameters(b.onnx) for b in bundles) - 3
    assert joined(bundles).onnx == both.onnx
    assert joined(bundles[:1]) is bundles[0]
    # Its last layer is given what both were given.
    widths = [small.given(b, small.toy(8)).values.shape[1] for b in (*bundles, both)]
    assert widths[2] == widths[0] + widths[1]


def test_what_cannot_be_joined_is_refused(bundles, folder):
    other = replace(bundles[1], features=replace(bundles[1].features, dwell_s=3.0))
    with pytest.raises(UsageError, match="'plain' and 'two' do not take the same maps"):
        joined([bundles[0], other])
    with pytest.raises(UsageError, match="has a temporal head already"):
        joined([bundles[0], load_bundle(str(folder / "tiny.onnx"))])


def test_a_head_goes_on_the_mean_and_the_card_says_of_which(folder, capsys):
    argv = ["--name", "both", "--out", str(folder), "--size", "fast", "--prior", "-1"]
    argv += ["--human-limit", "0.7", "--leaning", "0.6", "--brief", "2"]
    assert temporal(folder, *argv, models=("plain", "two"), on="check") == 0
    assert f"wrote {folder / 'both'}.onnx, .json and .md" in capsys.readouterr().out
    bundle = load_bundle(str(folder / "both.onnx"))
    waits = {"human_limit": 0.7, "leaning": 0.6, "brief_s": 2.0}
    assert bundle.evidence == {"prior_human": -1, **waits}
    assert (bundle.name, bundle.policy, bundle.n_hidden) == ("both", "fused", 20)
    training = json.loads((folder / "both.json").read_text())["training"]
    assert [each["name"] for each in training["joined"]] == ["plain", "two"]
    # Both were made by one command here.
    assert training["command"].startswith("train-export fit && train-export temporal --model ")
    windows = small.toy(48, seed=2)
    first = {name: small.as_float(windows[name][0]) for name in small.NAMES}
    assert np.argmax(array(Classifier(bundle).answer(first).window)) == windows["label"][0]


def test_a_network_of_a_mean_is_heard_apart_as_well(folder, capsys):
    def made(name, *more):
        argv = ("--out", str(folder), "--size", "fast", "--name", name, *more)
        return temporal(folder, *argv, models=("plain", "two"), on="check")

    assert made("mean") == 0
    start = ("--start", str(folder / "mean.onnx"), "--apart")
    assert made("apart", *start, str(folder / "two.onnx")) == 0
    before, after = (load_bundle(str(folder / f"{name}.onnx")) for name in ("mean", "apart"))
    assert (before.n_hidden, after.n_hidden) == (20, 40)
    # What was there before is a part of it, and has learned nothing.
    maps, is_first = {n: small.toy(12)[n] for n in small.NAMES}, np.arange(12) % 4 == 0
    hidden = [outputs_of(b.onnx, maps, is_first=is_first).hidden for b in (before, after)]
    np.testing.assert_allclose(hidden[1][:, :20], hidden[0], atol=1e-6)
    assert np.ptp(hidden[1][:, 20:]) > 0.01
    capsys.readouterr()
    assert made("none", *start, "nope") == 2
    assert small.one_line(capsys) == "train-export: --apart nope: it is none of --model"
    # A head with such parts is the end of the line.
    assert made("none", "--start", str(folder / "apart.onnx")) == 2


def test_what_parts_count_is_one_together():
    shares = HeadSettings(n_said=8, apart=((0, 4), (8, 12))).shares
    assert shares == {"given": 0.3, "said": 0.3, "apart.0": 0.2, "apart.1": 0.2}
    assert HeadSettings().shares == {"given": 1.0}
