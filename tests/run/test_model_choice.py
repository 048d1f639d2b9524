"""Which bundle judges when none is named: that of the module, told by its stream alone."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import radard.models
from radard.config.config import load_config
from radard.config.sections import AUTO_MODEL, DEFAULT_MODEL
from radard.judge.bundle import load_bundle
from radard.judge.model_choice import OF_ONE_MODULE, model_for
from radard.run.components import classifier_for, make_classifier
from tests.radar_helpers import run_radard
from tests.sim_helpers import axis_with
from x2radar.frame import StreamInfo

X2 = axis_with("rf", 768, 0.00366, 0.6, sample_rate_hz=0.0)
X4 = axis_with(
    "baseband", 90, 0.0514, 0.18, carrier_hz=7.29e9, bandwidth_hz=1.4e9, sample_rate_hz=0.0
)
UPPER_X4 = replace(X4, carrier_hz=8.748e9)


def stream(axis, rate_hz=60.0):
    return StreamInfo(axis, rate_hz, "module")


@pytest.mark.parametrize(
    ("axis", "rate_hz", "name"),
    [
        (X2, 60.0, DEFAULT_MODEL),
        (X4, 60.0, DEFAULT_MODEL),
        (X4, 17.06, DEFAULT_MODEL),
        (UPPER_X4, 60.0, "x4m03"),
        (UPPER_X4, 200.0, "x4m03"),
        (replace(X4, bandwidth_hz=0.0), 60.0, DEFAULT_MODEL),
        (replace(X2, carrier_hz=4.0e9, bandwidth_hz=1.7e9), 30.0, DEFAULT_MODEL),
    ],
)
def test_the_stream_chooses(axis, rate_hz, name):
    assert model_for(AUTO_MODEL, stream(axis, rate_hz)) == name
    assert model_for("fast", stream(axis, rate_hz)) == "fast"
    load_bundle(name).check_stream(axis, rate_hz)
    if name in OF_ONE_MODULE:
        assert not load_bundle(name).takes(X2, 60.0)


def test_a_classifier_is_made_anew_only_where_another_is_meant():
    config = load_config(environ={})
    known = make_classifier(config)
    assert known.bundle.name == DEFAULT_MODEL
    assert classifier_for(stream(X2), config, known) is known
    other = classifier_for(stream(UPPER_X4), config, known)
    assert other.bundle.name == "x4m03"
    assert classifier_for(stream(UPPER_X4), config, other) is other
    assert classifier_for(stream(X2), config, other).bundle.name == DEFAULT_MODEL
    named = load_config(environ={}, options={"model": {"name": "balanced"}})
    asked = make_classifier(named)
    assert classifier_for(stream(X4), named, asked) is asked
    alone = load_config(environ={}, options={"model": {"name": "none"}})
    assert classifier_for(stream(X4), alone, make_classifier(alone)) is None


def test_a_recording_is_judged_by_what_judged_it_live(tmp_path):
    path = tmp_path / "x4.h5"
    live = ("--port", "sim:human?device=x4m03&rate=40", "--speed", "max", "--duration", "6")
    code, records, errors = run_radard(*live, "--record", str(path))
    assert code == 0, errors
    code, again, errors = run_radard("--port", f"replay:{path}")
    assert code == 0, errors
    assert records[0]["model"] == again[0]["model"] == DEFAULT_MODEL


def test_radars_with_the_same_bundle_share_its_network(tmp_path):
    def classifier(model):
        return make_classifier(load_config(environ={}, options={"model": {"name": model}}))

    first = classifier("fast")
    assert classifier("fast") is first
    assert classifier("balanced") is not first
    # The same name says nothing: the file may be another by now.
    bundle = load_bundle("fast")
    (tmp_path / "fast.onnx").write_bytes(bundle.onnx)
    sidecar = json.loads((Path(radard.models.__file__).parent / "fast.json").read_text())
    (tmp_path / "fast.json").write_text(json.dumps(sidecar))
    name = str(tmp_path / "fast.onnx")
    assert classifier(name) is first
    (tmp_path / "fast.json").write_text(json.dumps({**sidecar, "pet_limit": 0.5}))
    assert classifier(name).bundle.pet_limit == 0.5
