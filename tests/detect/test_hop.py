"""`decision.hop_s`: how often decisions come, the same live, replayed and in a table."""

import json

import numpy as np
import pytest

from radard.commands.config import run as run_config
from radard.commands.detect import run as run_detect
from radard.config.config import Config
from radard.pipeline import Pipeline
from tests.radar_helpers import BASEBAND, run_radard, stable
from x2radar.command import run_command
from x2radar.frame import StreamInfo


def decisions_of(records):
    return [r for r in stable(records) if r["type"] == "decision"]


@pytest.mark.parametrize("hop_s", [0.5, 2.0])
def test_live_replayed_and_in_a_table_they_are_the_same(hop_s, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("RADARD_DECISION__HOP_S", str(hop_s))
    path, argv = tmp_path / "r.h5", ("--speed", "max", "-o", "json")
    code, live, said = run_radard(
        "--port", "sim:human", "--duration", "9", *argv, "--record", str(path)
    )
    assert code == 0, said
    assert live[0]["hop_s"] == hop_s
    assert said.count(f"decision.hop_s {hop_s:g}: model 'accurate' learned from windows 1 s") == 1
    assert f"spans {max(1.0, hop_s):g} s" in said
    made = decisions_of(live)
    assert np.diff([r["t_s"] for r in made]) == pytest.approx(hop_s, abs=0.02)
    assert any(r["alarm"] for r in made)
    _, replayed, _ = run_radard("--port", f"replay:{path}", "-o", "json")
    assert decisions_of(replayed) == made
    capsys.readouterr()
    assert run_command("radard", run_detect, [str(path), "--to", "jsonl", "--jobs", "1"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    table = [{k: v for k, v in r.items() if k not in {"file", "time"}} for r in rows]
    assert [r for r in table if r["type"] == "decision"] == made


def test_decisions_come_no_oftener_than_frames():
    config = Config(decision={"hop_s": 0.25})
    assert Pipeline(StreamInfo(BASEBAND, 2.0, "slow"), config).shape.hop_s == 0.5
    assert Pipeline(StreamInfo(BASEBAND, 60.0, "usual"), config).shape.hop_s == 0.25


@pytest.mark.parametrize(
    "case",
    [
        ("1", "fast", 0, ""),
        ("0.5", "fast", 0, "decision.hop_s 0.5: model 'fast' learned"),
        ("0.5", "thesis", 0, ""),
        ("0.5", "none", 0, ""),
        ("0.2", "fast", 78, "decision.hop_s"),
        ("2.5", "fast", 78, "decision.hop_s"),
    ],
)
def test_a_check_says_what_it_means_for_the_model(case, monkeypatch, capsys):
    hop_s, model, code, said = case
    monkeypatch.setenv("RADARD_DECISION__HOP_S", hop_s)
    assert run_command("radard", run_config, ["check", "--model", model]) == code
    err = capsys.readouterr().err
    assert (said in err) if said else err == ""
