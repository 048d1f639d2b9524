import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from radard.errors import BundleError, ModelMismatch
from radard.judge.bundle import bundle_names, load_bundle, sidecar_path
from radard.judge.classifier import Classifier, softmax
from tests.sim_helpers import axis_with

AXIS = axis_with("baseband", 768, 299_792_458 / 82e9, 0.6, sample_rate_hz=0.0)


def features(vector):
    return {"thesis_type2": vector.astype(np.float32)}


@pytest.fixture
def copy(tmp_path):
    """The shipped bundle as files, with a sidecar to spoil."""
    (tmp_path / "mine.onnx").write_bytes(load_bundle("thesis").onnx)
    sidecar = json.loads(sidecar_path("thesis").read_text())

    def write(**changes):
        (tmp_path / "mine.json").write_text(json.dumps({**sidecar, **changes}))
        return str(tmp_path / "mine.onnx")

    return write


def test_shipped_bundles_answer_extremes_too():
    assert {"thesis", "balanced"} <= set(bundle_names())
    for name in bundle_names():
        bundle = load_bundle(name)
        classifier = Classifier(bundle)
        rng = np.random.default_rng(0)
        inputs = {i.feature: rng.random(i.shape, np.float32) for i in bundle.inputs}
        p = classifier.answer(inputs).window
        assert p.human + p.pet + p.other == pytest.approx(1, abs=1e-6)
        assert min(p.human, p.pet, p.other) >= 0
    classifier = Classifier(load_bundle("thesis"))
    for vector in (np.zeros(1176), np.ones(1176) * 1e4):
        p = classifier.answer(features(vector)).window
        assert 0 <= p.human <= 1
    with pytest.raises(ModelMismatch, match="answered"):
        classifier.answer(features(np.full(1176, np.nan)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": 9}, "schema: input should be 1 .got 9"),
        ({"onnx_sha256": "0" * 64}, "sha256"),
        ({"classes": ["pet", "alien"]}, "classes"),
        ({"classes": ["pet", "human", "other"]}, "classes"),
        ({"features": {"n_cpi": 32}}, "input features"),
        ({"features": {"n_moon": 1}}, "n_moon"),
        ({"features": {"cell_s": 1e-320}}, "features.cell_s: input should be greater than"),
        ({"features": {"range_decimation": -8}}, "range_decimation: input should be greater"),
        ({"inputs": [{"name": "x", "shape": [1176], "feature": "thesis_type2"}]}, "takes"),
        (
            {"inputs": [{"name": "features", "shape": [9], "feature": "thesis_type2"}]},
            "thesis_type2",
        ),
        ({"stream": {}}, "stream needs"),
        ({"temperature": "warm"}, "temperature: input should be a valid number"),
        ({"hidden": -1}, "hidden: input should be greater than or equal to 0 .got -1"),
        ({"hidden": True}, "hidden: .*got True"),
        ({"hidden": "24"}, "hidden: .*got '24'"),
        ({"hidden": 24}, r"the sidecar says .*'hidden': \[1, 24\]"),
    ],
)
def test_a_sidecar_that_does_not_fit_is_refused(copy, changes, words):
    with pytest.raises(ModelMismatch, match=words):
        Classifier(load_bundle(copy(**changes)))


@pytest.mark.parametrize("key", ["pet_limit", "n_cpi"])
def test_a_sidecar_with_a_key_twice_is_refused_as_it_is_in_yaml(copy, tmp_path, key):
    path, file = copy(), tmp_path / "mine.json"
    text = file.read_text()
    file.write_text(text.replace(f'"{key}": ', f'"{key}": 1, "{key}": ', 1))
    assert file.read_text() != text
    with pytest.raises(ModelMismatch, match=f"'{key}' stands twice"):
        load_bundle(path)


def test_missing_and_broken_files(copy, tmp_path):
    with pytest.raises(BundleError, match="no model"):
        load_bundle("nope")
    with pytest.raises(BundleError, match="cannot read"):
        load_bundle(str(tmp_path / "gone.onnx"))
    path = copy(onnx_sha256=hashlib.sha256(b"rubbish").hexdigest())
    (tmp_path / "mine.onnx").write_bytes(b"rubbish")
    with pytest.raises(ModelMismatch, match="no ONNX file"):
        Classifier(load_bundle(path))
    (tmp_path / "mine.json").write_text("{")
    with pytest.raises(BundleError, match="not JSON"):
        load_bundle(path)


def test_what_of_a_stream_does_not_fit_is_named_and_the_bundle_that_does():
    bundle = load_bundle("thesis")
    for axis in (AXIS, replace(AXIS, bandwidth_hz=0)):
        bundle.check_stream(axis, 60)
    with pytest.raises(ModelMismatch, match=r"frame_rate_hz is 17\.06.*bin_length_m is 0\.0514"):
        bundle.check_stream(replace(AXIS, bin_length_m=0.0514), 17.06)
    upper = {"carrier_hz": 8.748e9, "bandwidth_hz": 1.4e9, "sample_rate_hz": 23.328e9}
    upper = axis_with("baseband", 150, 0.0514, 0.4, **upper)
    with pytest.raises(ModelMismatch, match=r"carrier_hz is 8\.748e\+09.*take it: x4m03$"):
        load_bundle("balanced").check_stream(upper, 60.0)
    with pytest.raises(ModelMismatch, match=r"it takes 14\.5 to 210$"):
        load_bundle("balanced").check_stream(replace(upper, carrier_hz=7.29e9), 300.0)


@pytest.mark.parametrize(
    "logits",
    [[1e4, -1e4], [-1e4, -1e4, -1e4], [1e4, 1e4, 1e4], [1e4, 1e4 - 1, -1e4], [0.0], [3e38, -3e38]],
)
def test_softmax_at_its_extremes_against_extended_precision(logits):
    x = np.array(logits)
    e = np.exp(x.astype(np.longdouble) - x.max())
    p = softmax(x)
    assert np.abs(p - (e / e.sum()).astype(float)).max() < 1e-15
    assert abs(p.sum() - 1) < 1e-15


@pytest.mark.parametrize(
    "changed",
    [
        {"temperature": 9.0},
        {"pet_limit": 0.9},
        {"policy": "window"},
        {"onnx": b""},
        {"evidence": {**load_bundle("fast").evidence, "prior_human": 9.0}},
        {"features": replace(load_bundle("fast").features, cell_s=0.1)},
    ],
)
def test_whatever_decides_makes_another_judge(changed):
    """Tests and figures once went on with what another prior had judged."""
    bundle = load_bundle("fast")
    assert replace(bundle, **changed).judges_as != bundle.judges_as
    assert replace(bundle, name="other").judges_as == bundle.judges_as
