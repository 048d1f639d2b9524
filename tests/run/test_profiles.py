"""Profiles: what they set, what wins over them, and what is told of their price."""

import json
from dataclasses import replace

import pytest

from profiles import dominated
from radard.cli import main
from radard.commands.bench import measure
from radard.config.config import load_config, load_with_origins
from radard.config.profiles import front, with_rate
from radard.errors import RadardError
from tests.alarm_helpers import write_recording
from tests.radar_helpers import noise

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
    path = write(
        tmp_path / "c.yaml",
        "sensor: {port: 'sim:dog?seed=1'}\n"
        "model: {name: fast, profile: eco}\n"
        "decision: {hop_s: 0.5, pet_limit: 0.7}\n",
    )
    config = load_config(path, environ={})
    assert (config.model.name, config.decision.hop_s) == (ECO.model, ECO.hop_s)
    assert config.decision.pet_limit == 0.7
    assert config.sensor.port == with_rate("sim:dog?seed=1", ECO.rate_hz)
    loaded = load_with_origins(path, environ={"RADARD_DECISION__HOP_S": "1.5"})
    assert loaded.config.decision.hop_s == 1.5
    assert loaded.origin("decision", "bodies") == "profile eco"
    assert loaded.origin("decision", "hop_s") == "RADARD_DECISION__HOP_S"
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
    assert [stage.name for stage in cost.stages] == NAMES
    assert all(stage.cpu_s > 0 and stage.ratio > 0 for stage in cost.stages)
    decode, _, _, worst, everything = cost.stages
    assert everything.cpu_s == pytest.approx(decode.cpu_s + worst.cpu_s)
    assert everything.ratio == pytest.approx(decode.ratio + worst.ratio)
    assert (cost.frame_rate_hz, cost.duration_s) == (60.0, pytest.approx(5.0))
    # A recording has no bytes.
    write_recording(tmp_path / "r.h5", noise(300))
    assert [stage.name for stage in measured(f"replay:{tmp_path / 'r.h5'}").stages] == NAMES[1:]
    with pytest.raises(RadardError, match="too short for one window"):
        measured("sim:empty", 1.0)
    assert main(["bench", "--model", "thesis", "--duration", "5", "--rounds", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["stage"] for row in told["stages"]] == NAMES


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
