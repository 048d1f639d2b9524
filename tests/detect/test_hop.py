"""`decision.hop_s` and `decision.bodies`: how often decisions come, and whom they judge."""

import json

import numpy as np
import pytest

from radard.commands.config import run as run_config
from radard.commands.detect import run as run_detect
from radard.config.config import Config, load_config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from tests.radar_helpers import BASEBAND, dwells_in, frames_of, noise, run_radard, stable
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


def two_bodies(n):
    """Frames of two bodies that go to and fro, 1.5 m apart."""
    t_s = np.arange(n) / 60
    frames = noise(n, seed=1, sigma=2**0.5)
    near_m, far_m = BASEBAND.range_m[[0, -1]]
    for share, turn in ((0.25, 1.0), (0.75, 1.3)):
        at_m = near_m + share * (far_m - near_m)
        range_m = at_m + 0.3 * np.sin(2 * np.pi * 0.4 * turn * t_s)
        bins = np.exp(-(((BASEBAND.range_m[None] - range_m[:, None]) / 0.05) ** 2))
        phase = np.exp(-4j * np.pi * BASEBAND.carrier_hz / 3e8 * range_m)
        frames = frames + 60 * bins * phase[:, None]
    return frames.astype(np.complex64)


def test_what_is_made_of_bodies_changes_no_verdict():
    stream = StreamInfo(BASEBAND, 60.0, "module")
    frames = two_bodies(480)
    classifier = Classifier(load_bundle("fast"))
    made = {}
    for bodies in ("apart", "together", "unfollowed"):
        config = load_config(environ={})
        decision = config.decision.model_copy(update={"bodies": bodies})
        pipeline = Pipeline(stream, config.model_copy(update={"decision": decision}), classifier)
        dwells = dwells_in(pipeline.make_ring(), frames_of(frames))
        made[bodies] = [pipeline.decide(dwell) for dwell in dwells]
    apart, together, unfollowed = made.values()
    assert [d.fused for d in apart] == [d.fused for d in together]
    assert [d.fused for d in apart] == [d.fused for d in unfollowed]
    assert not any(d.tracks for d in unfollowed)
    several = [k for k, d in enumerate(apart) if len(d.tracks) > 1]
    assert several
    for k in several:
        assert all(track.window is not None for track in apart[k].tracks)
        assert [t.range_m for t in apart[k].tracks] == [t.range_m for t in together[k].tracks]
        assert all(track.window is None for track in together[k].tracks)
