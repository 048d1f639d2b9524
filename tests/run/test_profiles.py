"""Profiles: what they set, what wins over them, and what is told of their price."""

import json
from dataclasses import replace

import pytest

from profiles import dominated
from radard.cli import main
from radard.config.config import load_config, load_with_origins
from radard.config.profiles import front, with_rate

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
    assert ECO.cpu_closed <= 0.125 * BEST.cpu_open


def test_the_dearest_is_what_holds_when_nothing_is_set():
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


def test_explain_tells_the_price(monkeypatch, capsys):
    assert main(["explain"]) == 0
    assert f"profile {BEST.name}: " in capsys.readouterr().out
    assert main(["explain", "--profile", "eco"]) == 0
    out = capsys.readouterr().out
    assert f"profile eco: CPU {100 * ECO.cpu_open:.0f} % of what 'accurate' takes" in out
    assert f"people missed {100 * ECO.missed[0]:.2g} %" in out
    for other in (["--port", "sim:dog?rate=200"], ["--sensitivity", "high"]):
        assert main(["explain", *other]) == 0
        assert "no profile: " in capsys.readouterr().out
    monkeypatch.setenv("RADARD_DECISION__HOP_S", "0.7")
    assert main(["explain"]) == 0
    assert "no profile: " in capsys.readouterr().out
