"""Networks joined to one bundle: it says their mean, and is calibrated like any other."""

import json
from dataclasses import replace

import numpy as np
import pytest

from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from tests import training_helpers as small
from x2train.bundle.joined import joined
from x2train.bundle.temporal_graph import n_parameters
from x2train.cli import main
from x2train.nets.bundle_answers import outputs_of

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with two bundles, one of them with a head as well, and a set."""
    folder = tmp_path_factory.mktemp("joined")
    small.write_tiny(folder, small.tiny()[0], name="one")
    small.write_tiny(folder, small.tiny()[0], name="headed")
    small.give_head(folder / "headed.onnx")
    other = small.trained(replace(small.TINY, epochs=2, seed=1, hidden=10))[0]
    small.write_tiny(folder, replace(other, temperature=1.7), name="two")
    small.write_set(folder / "check", small.toy(48, seed=1))
    return folder


@pytest.fixture(scope="module")
def bundles(folder):
    return [load_bundle(str(folder / f"{name}.onnx")) for name in ("one", "two")]


def test_it_says_the_mean_of_what_each_says(bundles):
    both = joined(bundles)
    maps = {name: small.toy(48, seed=4)[name] for name in small.NAMES}
    each = [outputs_of(b.onnx, maps).logits / b.temperature for b in bundles]
    np.testing.assert_allclose(
        outputs_of(both.onnx, maps).logits, np.mean(each, axis=0), atol=1e-5
    )
    assert (both.name, both.temperature, both.inputs) == ("one", 1.0, bundles[0].inputs)
    # Three biases are one sum.
    assert n_parameters(both.onnx) == sum(n_parameters(b.onnx) for b in bundles) - 3
    assert joined(bundles).onnx == both.onnx
    assert joined(bundles[:1]) is bundles[0]
    # Its last layer is given what both were given.
    widths = [small.given(b, small.toy(8)).values.shape[1] for b in (*bundles, both)]
    assert widths[2] == widths[0] + widths[1]


def test_what_cannot_be_joined_is_refused(bundles, folder):
    other = replace(bundles[1], features=replace(bundles[1].features, dwell_s=3.0))
    with pytest.raises(UsageError, match="'one' and 'two' do not take the same maps"):
        joined([bundles[0], other])
    with pytest.raises(UsageError, match="has a temporal head already"):
        joined([bundles[0], load_bundle(str(folder / "headed.onnx"))])


def test_a_head_goes_on_the_mean_and_the_card_says_of_which(folder, capsys):
    models = [str(folder / f"{name}.onnx") for name in ("one", "two")]
    sets = ["--train", str(folder / "check"), "--validate", str(folder / "check")]
    argv = ["temporal", *sets, "--name", "both", "--out", str(folder), "--size", "fast"]
    argv += ["--epochs", "1", "--prior", "-1", "--human-limit", "0.7", "--model", *models]
    assert main(argv) == 0
    assert f"wrote {folder / 'both'}.onnx, .json and .md" in capsys.readouterr().out
    bundle = load_bundle(str(folder / "both.onnx"))
    assert bundle.evidence == {"prior_human": -1, "human_limit": 0.7}
    assert (bundle.name, bundle.policy, bundle.n_hidden) == ("both", "fused", 20)
    training = json.loads((folder / "both.json").read_text())["training"]
    assert [each["name"] for each in training["joined"]] == ["one", "two"]
    # Both were made by one command here.
    assert training["command"].startswith("train-export fit && train-export temporal --model ")
    windows = small.toy(48, seed=2)
    window = Classifier(bundle).classify(
        {name: small.as_float(windows[name][:1])[0] for name in small.NAMES}
    )
    assert np.argmax([window.human, window.pet, window.other]) == windows["label"][0]
    assert main([*argv, str(folder / "none.onnx")]) == 66
    assert small.one_line(capsys)
