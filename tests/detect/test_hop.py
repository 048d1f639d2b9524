"""How often decisions come, whom they judge, and what they know of an installation."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.commands.config import run as run_config
from radard.config.config import Config, load_config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import FEATURES, FeatureSettings, FeatureStream, feature_shape
from radard.judge.installation import (
    INSTALLATION,
    N_INSTALLATION,
    echo_at_1m_db,
    installation,
    size_nats,
)
from radard.pipeline import Pipeline
from tests import radar_helpers as radar
from tests.clutter_helpers import body
from tests.radar_helpers import BASEBAND, decisions, dwells_in, frames_of, noise, run_radard
from x2radar.command import run_command
from x2radar.frame import StreamInfo


@pytest.mark.parametrize("hop_s", [0.5, 2.0])
def test_live_replayed_and_in_a_table_they_are_the_same(hop_s, tmp_path, monkeypatch):
    monkeypatch.setenv("RADARD_DECISION__HOP_S", str(hop_s))
    path, argv = tmp_path / "r.h5", ("--speed", "max", "-o", "json")
    code, live, said = run_radard(
        "--port", "sim:human", "--duration", "9", *argv, "--record", str(path)
    )
    assert code == 0, said
    assert live[0]["hop_s"] == hop_s
    assert said.count(f"decision.hop_s {hop_s:g}: model 'accurate' learned from windows 1 s") == 1
    assert f"spans {max(1.0, hop_s):g} s" in said
    made = decisions(radar.stable(live))
    assert np.diff([r["t_s"] for r in made]) == pytest.approx(hop_s, abs=0.02)
    assert any(r["alarm"] for r in made)
    _, replayed, _ = run_radard("--port", f"replay:{path}", "-o", "json")
    assert decisions(radar.stable(replayed)) == made
    _, table, _ = run_radard("detect", str(path), "--to", "jsonl", "--jobs", "1")
    rows = decisions(radar.stable(table))
    assert [{k: v for k, v in r.items() if k != "file"} for r in rows] == made


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
    """Frames of two bodies that go to and fro, 1 m apart."""
    turns = 2 * np.pi * 0.4 * np.arange(n)[:, None] / 60 * [1.0, 1.3]
    range_m = BASEBAND.range_m[[16, 48]] + 0.3 * np.sin(turns)
    return (noise(n, seed=1, sigma=2**0.5) + body(range_m, 35.6, BASEBAND)).astype(np.complex64)


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


RANGE_M = np.arange(0.5, 3.5, 0.03)


def power_of(at_m, excess, noise=2.0):
    power = np.full(len(RANGE_M), noise)
    power[int(np.argmin(np.abs(RANGE_M - at_m)))] += excess
    return power, np.full(len(RANGE_M), noise)


def test_an_echo_is_as_strong_at_1_m_wherever_it_is():
    near = echo_at_1m_db(*power_of(1.01, 2000.0), RANGE_M)
    far = echo_at_1m_db(*power_of(2.03, 2000.0 / 2.0099**4), RANGE_M)
    assert near == pytest.approx(30.0, abs=0.3)
    assert far == pytest.approx(near, abs=0.3)
    # A body over several bins counts whole.
    one, floor = power_of(2.0, 3000.0)
    spread = floor.copy()
    at = int(np.argmax(one))
    spread[at - 1 : at + 2] += 1000.0
    wanted_db = echo_at_1m_db(one, floor, RANGE_M)
    assert echo_at_1m_db(spread, floor, RANGE_M) == pytest.approx(wanted_db, abs=0.3)


def test_strength_does_not_depend_on_the_unit_and_nothing_that_moves_has_none():
    power, floor = power_of(1.5, 500.0)
    usual = echo_at_1m_db(power, floor, RANGE_M)
    for scale in (1e-150, 1e150):
        assert echo_at_1m_db(power * scale, floor * scale, RANGE_M) == pytest.approx(usual)
    for power, floor in (np.ones((2, 4)), np.zeros((2, 4)), (np.full(4, np.inf), np.ones(4))):
        assert echo_at_1m_db(power, floor, RANGE_M[:4]) is None


def test_the_feature_is_what_is_known_or_the_rate_alone():
    dwell = radar.dwell_of(noise(120), rate_hz=30.0)
    settings = FeatureSettings(n_cpi=14)
    assert INSTALLATION in FEATURES
    assert feature_shape(INSTALLATION, settings) == (N_INSTALLATION,)
    stream = FeatureStream(settings, (INSTALLATION,))
    assert stream.extract(dwell)[INSTALLATION].tolist() == [-1.0] + [0.0] * 6
    known = installation(30.0, height_m=2.0)
    again = FeatureStream(settings, (INSTALLATION,)).extract(dwell, known)
    assert again[INSTALLATION].tolist() == known.tolist()


@pytest.mark.parametrize(
    ("known", "made"),
    [
        ((60.0,), [0, 0, 0, 0, 0, 0, 0]),
        ((120.0, 3.0, -15.0, -10.0), [1, 1, 1, 1, -0.5, 1, -1]),
        ((1e-9, None, None, 2e9), [-4, 0, 0, 0, 0, 1, 4]),
    ],
)
def test_what_is_known_is_told_within_bounds_and_the_rest_is_zero(known, made):
    found = installation(*known)
    assert found.dtype == np.float32
    assert found.tolist() == made


@given(st.lists(st.floats(-1e6, 1e6), min_size=2))
def test_more_strength_never_speaks_for_a_pet_and_never_for_more_than_its_bounds(strengths_db):
    nats = [size_nats(each) for each in sorted(strengths_db)]
    assert all(a <= b for a, b in itertools.pairwise(nats))
    assert min(nats) >= -2.0
    assert max(nats) <= 0.5
    # Of bodies as strong as an adult it says next to nothing.
    assert abs(size_nats(0.0)) < 0.1
    assert size_nats(-8.0) == pytest.approx(-1.07, abs=0.02)


def test_a_level_changes_the_verdict_by_what_size_says_and_nothing_else():
    """The network sees the same; as strong an echo before a stronger radar is a smaller body."""
    classifier = Classifier(load_bundle("fast"))
    moving = radar.walker(480, 60.0, speed_mps=0.2, start_m=2.0, level=60.0)
    frames = (moving + noise(480)).astype(np.complex64)
    made = {}
    for level_db in (None, 20.0, 90.0):
        config = load_config(environ={}, options={"mount": {"level_db": level_db}})
        pipeline = Pipeline(StreamInfo(BASEBAND, 60.0, "module"), config, classifier)
        dwells = dwells_in(pipeline.make_ring(), frames_of(frames))
        decided = [d for d in map(pipeline.decide, dwells) if d.fused is not None]
        made[level_db] = [d.window for d in decided], [d.fused for d in decided]
    plain, large, small = (np.log([p.human / p.pet for p in fused]) for _, fused in made.values())
    assert len(plain) >= 3
    assert made[None][0] == made[20.0][0] == made[90.0][0]
    assert large - plain == pytest.approx(np.full(len(plain), 0.5), abs=1e-6)
    assert small - plain == pytest.approx(np.full(len(plain), -2.0), abs=1e-6)


def test_a_body_that_stands_and_goes_on_is_remembered_one_elsewhere_is_not():
    stream, bundle = StreamInfo(BASEBAND, 60.0, "module"), load_bundle("fast")
    swing = 0.3 * np.sin(2 * np.pi * 0.4 * np.arange(1080) / 60)
    quiet = noise(1080, seed=1, sigma=2**0.5)
    is_still = np.arange(1080)[:, None] // 360 == 1

    def visits(first_bin):
        """The last decision of the first visit and the first of the next, at bin 50."""
        begins_m = BASEBAND.range_m[np.where(np.arange(1080) < 360, first_bin, 50)]
        moved = np.where(is_still, 0, body((begins_m + swing)[:, None], 35.6, BASEBAND))
        frames = (quiet + moved).astype(np.complex64)
        pipeline = Pipeline(stream, Config(), Classifier(bundle))
        made = [pipeline.decide(d) for d in dwells_in(pipeline.make_ring(), frames_of(frames))]
        gates = [d.gate for d in made]
        closed = gates.index("closed", gates.index("open"))
        return made[closed - 1], made[gates.index("open", closed)]

    (before, here), (_, elsewhere) = visits(50), visits(10)
    assert here.window.human == pytest.approx(elsewhere.window.human, abs=1e-5)
    assert here.t_s == elsewhere.t_s
    logit = [math.log(d.fused.human / (d.fused.pet + d.fused.other)) for d in (elsewhere, here)]
    prior = 1 / (1 + 2 * math.exp(-bundle.evidence["prior_human"]))
    same = 0.8 * math.exp((before.t_s - here.t_s) / 60)
    mixed = same * before.fused.human + (1 - same) * prior
    lean = math.log(mixed / (1 - mixed)) - math.log(prior / (1 - prior))
    assert abs(lean) > 0.2
    assert logit[1] - logit[0] == pytest.approx(lean, abs=1e-3)
