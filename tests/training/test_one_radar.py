"""`--radar thesis`: the thesis' bundle and the maps judge the same passages, fairly."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blank_bundle import write_blank_bundle
from radard.config.config import Config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from tests.training_helpers import FEATURES
from x2radar.frame import StreamInfo
from x2train.cli import main
from x2train.judge.judging import JudgeSpec, decisions
from x2train.judge.suites import SUITES, suite_of
from x2train.sets.families import family
from x2train.sets.passages import play
from x2train.sets.sites import P4XX, THESIS, X2, draw_site

pytestmark = pytest.mark.integration

STEP = 8
N = 400
NUMBERS = {s.name: next(k for k in range(N) if suite_of(k, N) is s) for s in SUITES}


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    return str(write_blank_bundle(folder, "blank", FEATURES, ("velocity_time", "range_time")))


def decimated(played):
    """Return what a bundle of maps sees of frames with all bins."""
    frames = np.ascontiguousarray(played.frames[:, ::STEP])
    axis = played.site.radar.axis()
    return frames, replace(axis, n_range=96, bin_length_m=STEP * axis.bin_length_m)


def test_a_bundle_of_maps_gets_them_decimated_as_the_daemon_would(model):
    site = replace(draw_site(np.random.default_rng(3), THESIS), level_db=15.0)
    rng = np.random.default_rng(3)
    played = play(rng, site, (family("human walk"),), duration_s=6.5, lead_s=(0.2, 0.4))
    frames, axis = decimated(played)
    config = Config()
    pipeline = Pipeline(StreamInfo(axis, 60.0, "test"), config, Classifier(load_bundle(model)))
    by_hand = []
    for end in (147, 207, 267, 327, 387):
        part = frames[end - 147 : end]
        dwell = Dwell(part, np.ones(147, bool), axis, 60.0, end / 60, end_frame=end)
        by_hand.append(pipeline.decide(dwell))
    told = decisions(played, model)
    assert [d.reading for d in told] == [d.reading for d in by_hand]
    assert [d.window for d in told] == [d.window for d in by_hand]
    assert any(d.window is not None for d in told)
    # The thesis' bundle keeps every bin.
    assert load_bundle("thesis").features.range_decimation == 1
    seed = decisions(played, "thesis")
    assert [d.t_s for d in seed] == [d.t_s for d in told]
    assert any(d.window is not None for d in seed)
    assert all(d.window.other == 0 for d in seed if d.window)


def test_every_suite_can_be_before_one_radar():
    names = {s.name for s in SUITES}
    for s in SUITES:
        before = s.before(THESIS)
        assert before.radar is THESIS
        assert before.name in names
        assert before.drawn_site(np.random.default_rng(0)).radar is THESIS
        assert before.split != "other radars"
        assert (before.cast, before.rooms, before.duration_s) == (s.cast, s.rooms, s.duration_s)
        if s.radar is X2:
            assert replace(before, radar=X2) == s
    spec = JudgeSpec(model="thesis", seed=0, n_passages=N, radar="thesis")
    assert spec.suite(NUMBERS["pets, P4xx"]).name == "pets"
    assert replace(spec, radar="suites").suite(NUMBERS["pets, P4xx"]).radar is P4XX


def evaluate(*argv):
    return main(["evaluate", "--passages", "6", "--seed", "4", "--workers", "1", *argv])


def one_line(capsys):
    err = capsys.readouterr().err.splitlines()
    lines = [line for line in err if not line.startswith("passages:")]
    assert len(lines) == 1
    return lines[0]


def test_evaluate_compares_them(model, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("x2train.judge.plots.passage_png", lambda *_: None)
    short = tuple(replace(s, duration_s=5.0) for s in SUITES)
    monkeypatch.setattr("x2train.judge.suites.SUITES", short)
    a, b = tmp_path / "a", tmp_path / "b"
    thesis = ("--radar", "thesis")
    assert evaluate("--model", "thesis", *thesis, "--out", str(a)) == 0
    about = json.loads((a / "passages" / "manifest.json").read_text())["about"]
    assert about["radar"] == "thesis"
    assert evaluate("--model", model, *thesis, "--against", str(a), "--out", str(b)) == 0
    report = json.loads((b / "report.json").read_text())
    assert report["title"].endswith("before the X2 of the thesis")
    assert sum(report["passages"].values()) == 6
    assert len(report["other"]["pairings"]) == 2
    capsys.readouterr()
    # Neither is a folder taken for one before other radars, nor compared with one.
    assert evaluate("--model", model, "--out", str(b)) == 2
    assert "radar: 'thesis', not 'suites'" in one_line(capsys)
    assert evaluate("--model", model, "--against", str(a), "--out", str(tmp_path / "c")) == 2
    assert f"--against {a}: judged with --radar thesis, not suites" in one_line(capsys)
    assert not (tmp_path / "c").exists()


def test_what_does_not_fit_is_told_in_one_line_before_anything_is_played(tmp_path, capsys):
    out = tmp_path / "out"
    assert evaluate("--model", "thesis", "--out", str(out)) == 4
    told = one_line(capsys)
    assert "--radar suites: model 'thesis' does not fit" in told
    assert "it takes --radar thesis" in told
    assert not out.exists()
