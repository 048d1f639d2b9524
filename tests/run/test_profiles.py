"""Bundles and profiles: which holds when none is named, what wins, what is told of the price."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import radard.models
from profiles import dominated
from radard.cli import main
from radard.commands.bench import measure
from radard.config.config import load_config, load_with_origins
from radard.config.profiles import front, with_rate
from radard.config.sections import AUTO_MODEL, DEFAULT_MODEL
from radard.errors import RadardError
from radard.judge.bundle import load_bundle
from radard.judge.model_choice import OF_ONE_MODULE, model_for
from radard.run.components import classifier_for, make_classifier
from tests.alarm_helpers import write_recording
from tests.dsp_reference import X4
from tests.radar_helpers import noise
from tests.sim_helpers import axis_with
from x2radar.frame import StreamInfo

PROFILES = front().profiles
ECO, BEST = PROFILES[0], PROFILES[-1]


def write(path, text):
    path.write_text(text)
    return path


def test_none_is_dearer_and_no_better_than_another():
    assert list(dominated(PROFILES)) == []
    worse = replace(BEST, name="worse", cpu_open=2 * BEST.cpu_open)
    assert list(dominated((*PROFILES, worse))) == ["worse"]
    costs = [p.cpu_open for p in PROFILES]
    assert costs == sorted(costs)
    assert (ECO.name, BEST.name) == ("eco", "accurate")
    assert ECO.cpu_open <= 0.25 * BEST.cpu_open
    # The dearest is what holds when nothing is set.
    config = load_config(environ={})
    assert (BEST.model, BEST.rate_hz) == (config.model.name, None)
    assert (BEST.hop_s, BEST.bodies) == (config.decision.hop_s, config.decision.bodies)


def test_a_profile_wins_over_what_stands_beside_or_before_it(tmp_path):
    text = (
        "sensor: {port: 'sim:dog?seed=1'}\nmodel: {name: fast, profile: eco}\n"
        "decision: {hop_s: 0.5, pet_limit: 0.7}\n"
    )
    path = write(tmp_path / "c.yaml", text)
    config = load_config(path, environ={})
    assert (config.model.name, config.decision.hop_s) == (ECO.model, ECO.hop_s)
    assert config.decision.pet_limit == 0.7
    assert config.sensor.port == with_rate("sim:dog?seed=1", ECO.rate_hz)
    config, places = load_with_origins(path, environ={"RADARD_DECISION__HOP_S": "1.5"})
    assert config.decision.hop_s == 1.5
    assert places["decision", "bodies"] == "profile eco"
    assert places["decision", "hop_s"] == "RADARD_DECISION__HOP_S"
    asked = {"model": {"profile": BEST.name, "name": "balanced"}}
    config = load_config(path, environ={"RADARD_DECISION__HOP_S": "1.5"}, options=asked)
    assert (config.model.name, config.decision.hop_s) == ("balanced", BEST.hop_s)
    assert config.sensor.port == "sim:dog?seed=1"


def test_each_of_several_radars_has_its_own(tmp_path):
    path = write(
        tmp_path / "c.yaml",
        "model: {profile: eco}\n"
        "sensors:\n"
        "  hall: {port: sim:dog}\n"
        "  loft: {port: sim:cat, model: {profile: accurate}}\n"
        "  shed: {port: 'sim:cat?rate=60', decision: {pet_limit: 0.7}}\n",
    )
    hall, loft, shed = load_config(path, environ={}).each()
    assert hall.sensor.port == with_rate("sim:dog", ECO.rate_hz)
    assert hall.decision.hop_s == shed.decision.hop_s == ECO.hop_s
    assert (loft.sensor.port, loft.decision.hop_s) == ("sim:cat", BEST.hop_s)
    assert (shed.sensor.port, shed.decision.pet_limit) == ("sim:cat?rate=60", 0.7)


@pytest.mark.parametrize(
    ("port", "asked"),
    [
        ("/dev/ttyACM0", "/dev/ttyACM0?rate=30"),
        ("sim:dog?seed=1", "sim:dog?seed=1&rate=30"),
        ("sim:dog?rate=200", "sim:dog?rate=200"),
        ("auto?device=x2m200", "auto?device=x2m200"),
        ("replay:night.h5", "replay:night.h5"),
        ("", ""),
    ],
)
def test_ports_that_can_be_asked_for_a_rate_are(port, asked):
    assert with_rate(port, 30.0) == asked


NAMES = [
    "bytes to frames",
    "frames to windows",
    "... and decisions, as heard",
    "... and decisions, always open",
    "all, at its worst",
]


def test_stages_of_bench_add_up(capsys, tmp_path):
    def measured(port, seconds=5.0):
        options = {"sensor": {"port": port}, "model": {"name": "thesis"}}
        return measure(load_config(environ={}, options=options), seconds, 1)

    cost = measured("sim:human")
    assert [stage.stage for stage in cost.stages] == NAMES
    for key in ("cpu_s_per_stream_s", "times_reference"):
        decode, heard, always, worst, everything = (getattr(s, key) for s in cost.stages)
        assert min(decode, heard, always, worst) > 0
        assert everything == pytest.approx(decode + worst)
    assert (cost.frame_rate_hz, cost.duration_s) == (60.0, pytest.approx(5.0))
    # A recording has no bytes.
    write_recording(tmp_path / "r.h5", noise(300))
    assert [stage.stage for stage in measured(f"replay:{tmp_path / 'r.h5'}").stages] == NAMES[1:]
    with pytest.raises(RadardError, match="too short for one window"):
        measured("sim:empty", 1.0)
    assert main(["bench", "--model", "thesis", "--duration", "5", "--rounds", "1", "--json"]) == 0
    assert [row["stage"] for row in json.loads(capsys.readouterr().out)["stages"]] == NAMES


def test_bench_says_which_fits(capsys):
    argv = ["bench", "--radars", "1", "--duration", "4", "--rounds", "1"]
    assert main(argv) == 0
    out = capsys.readouterr().out
    assert all(p.name in out for p in PROFILES)
    assert "1 radars with 30 % to spare" in out
    assert main([*argv[:2], "10000", *argv[3:], "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["fits"] is None
    assert [row["profile"] for row in told["profiles"]] == [p.name for p in PROFILES]
    assert told["profiles"][0]["missed"] == list(ECO.missed)
    assert main([*argv, "--model", "fast"]) == 2
    assert main(["bench", "--radars", "0"]) == 2
    assert "--radars 0: must be 1" in capsys.readouterr().err


def test_explain_tells_the_price(capsys):
    assert main(["explain"]) == 0
    assert f"profile {BEST.name}: " in capsys.readouterr().out
    assert main(["explain", "--profile", "eco"]) == 0
    out = capsys.readouterr().out
    assert f"profile eco: CPU {100 * ECO.cpu_open:.0f} % of what 'accurate' takes" in out
    assert f"people missed {100 * ECO.missed[0]:.2g} %" in out
    assert main(["explain", "--port", "sim:dog?rate=200"]) == 0
    assert "no profile: " in capsys.readouterr().out


X2 = axis_with("rf", 768, 0.00366, 0.6, sample_rate_hz=0.0)
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


def test_radars_with_the_same_bundle_share_its_network(tmp_path):
    def classifier(model):
        return make_classifier(load_config(environ={}, options={"model": {"name": model}}))

    first = classifier("fast")
    assert classifier("fast") is first
    assert classifier("balanced") is not first
    # The same name says nothing: the file may be another by now.
    (tmp_path / "fast.onnx").write_bytes(load_bundle("fast").onnx)
    sidecar = json.loads((Path(radard.models.__file__).parent / "fast.json").read_text())
    (tmp_path / "fast.json").write_text(json.dumps(sidecar))
    name = str(tmp_path / "fast.onnx")
    assert classifier(name) is first
    (tmp_path / "fast.json").write_text(json.dumps({**sidecar, "pet_limit": 0.5}))
    assert classifier(name).bundle.pet_limit == 0.5
