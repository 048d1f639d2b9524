"""Judging: offline as live, one radar's bundles alike, recordings of one's own."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blank_bundle import write_blank_bundle
from radard.config.config import Config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Answer, Classifier, Probabilities
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from tests.radar_helpers import BASEBAND, dwell_of, frames_of, noise, walker
from tests.training_helpers import FEATURES, one_line
from x2radar.cli import main as x2radar_main
from x2radar.frame import StreamInfo
from x2train.cli import main
from x2train.judge.judging import JudgeSpec, decisions, judge_labelled, read_list
from x2train.judge.page import passage_png
from x2train.judge.suites import SUITES
from x2train.judge.table import PassageTable
from x2train.sets.families import family
from x2train.sets.passages import play
from x2train.sets.sites import P4XX, THESIS, X2, X4M03, draw_site

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    return str(write_blank_bundle(folder, "blank", FEATURES, ("velocity_time", "range_time")))


def passage(radar=X2, name="human walk", seconds=9.0):
    rng = np.random.default_rng(3)
    site = replace(draw_site(rng, radar), level_db=15.0)
    return play(rng, site, (family(name),), duration_s=seconds, lead_s=(2.6, 4.0))


def config(policy=None, **more):
    section = Config().decision.model_copy(update={"policy": policy, **more})
    return Config().model_copy(update={"decision": section})


@pytest.mark.parametrize(
    ("radar", "policy"), [(X2, "fused"), (X2, "window"), (P4XX, "fused"), (X4M03, "fused")]
)
def test_a_passage_is_judged_as_the_daemon_judges_its_stream(model, radar, policy):
    played = passage(radar)
    axis = radar.axis()
    stream = StreamInfo(axis, radar.frame_rate_hz, radar.name)
    network = Classifier(load_bundle(model))
    pipeline = Pipeline(stream, config(policy), network, judges_tracks=False)
    ring = pipeline.make_ring()
    assert ring.axis == axis
    live = []
    for frame in frames_of(played.frames, axis):
        live += [pipeline.decide(dwell) for dwell in ring.items(frame)]
    assert len(live) >= 5
    assert live == decisions(played, model, policy)
    assert any(d.gate == "open" and d.window is not None for d in live)


def test_the_columns_are_those_of_the_decisions(model):
    spec = JudgeSpec(model=model, seed=1, n_passages=400, policy="fused", only=("people",))
    made = decisions(spec.played(5), model, "fused")
    told = PassageTable.of([spec(5)])
    assert told.t_s.tolist() == [d.t_s for d in made]
    assert told.is_alarm.tolist() == [d.alarm for d in made]
    assert told.is_pending.tolist() == [d.label == "pending" for d in made]
    for k, d in enumerate(made):
        assert told.is_open[k] == (d.gate == "open")
        assert np.isnan(told.p_human[k]) == (d.window is None)
        if d.fused is not None:
            assert told.fused_quiet[k] == d.fused.pet + d.fused.other
            assert told.fused_most[k] == max(d.fused.pet, d.fused.other)
    assert (told.label[0], told.build[0], told.duration_s[0]) == ("human", "5", 14.0)
    assert 0 <= told.enters_s[0] < told.leaves_s[0] < 14


def test_passages_do_not_depend_on_the_bundle_or_the_order(model):
    a = JudgeSpec(model=model, seed=1, n_passages=400, policy="fused")
    b = JudgeSpec(model="thesis", seed=1, n_passages=400)
    np.testing.assert_array_equal(a.played(45).frames, b.played(45).frames)
    first, _, again = a(45), a(46), a(45)
    np.testing.assert_equal(dict(first), dict(again))
    assert passage_png(a, 45)[:8] == b"\x89PNG\r\n\x1a\n"


class Says(Classifier):
    """A network whose answers are known."""

    def __init__(self, model, *rows):
        super().__init__(load_bundle(model))
        self.rows = [Answer(Probabilities(*row)) for row in rows]

    def answer(self, *_):
        return self.rows.pop(0)


UNSURE, PET = (0.45, 0.54, 0.01), (0.02, 0.97, 0.01)
RATE_HZ, LENGTH = 60.0, 147


def stream_of(pattern):
    """Return a dwell per letter: somebody goes ('o'), or nobody ('.'), after a quiet start."""
    made = []
    for k, letter in enumerate("...." + pattern):
        frames = noise(LENGTH, seed=k)
        if letter == "o":
            frames = frames + walker(LENGTH, RATE_HZ, speed_mps=0.5, start_m=2.4, level=30)
        made.append(replace(dwell_of(frames, RATE_HZ), t_s=2.45 + k))
    return made


def run(network, pattern, policy, **more):
    stream = StreamInfo(BASEBAND, RATE_HZ, "test")
    # Bodies one by one would ask the network, too.
    pipeline = Pipeline(stream, config(policy, **more), network, judges_tracks=False)
    return [pipeline.decide(dwell) for dwell in stream_of(pattern)][4:]


def test_who_leaves_undecided_alarms_once_and_a_closed_gate_ends_what_was_known(model):
    made = run(Says(model, UNSURE, PET), "o..", "fused")
    told = [(d.gate, d.label, d.alarm) for d in made]
    assert told[:2] == [("open", "pending", False), ("closed", "none", True)]
    assert told[2:] == [("closed", "none", False)]
    made = run(Says(model, PET, PET, UNSURE), "oo.o", "fused")
    assert [d.gate for d in made] == ["open", "open", "closed", "open"]
    assert made[3].label == "pending"
    fresh = 0.45**0.6 / (0.45**0.6 + 0.54**0.6 + 0.01**0.6)
    assert made[3].fused.human == pytest.approx(fresh, rel=1e-9)


def test_a_bundle_of_maps_gets_them_decimated_as_the_daemon_would(model):
    site = replace(draw_site(np.random.default_rng(3), THESIS), level_db=15.0)
    rng = np.random.default_rng(3)
    played = play(rng, site, (family("human walk"),), duration_s=6.5, lead_s=(0.2, 0.4))
    # The maps have an eighth of the bins; the thesis' bundle keeps every one.
    frames = np.ascontiguousarray(played.frames[:, ::8])
    axis = played.site.radar.axis()
    axis = replace(axis, n_range=96, bin_length_m=8 * axis.bin_length_m)
    pipeline = Pipeline(StreamInfo(axis, 60.0, "test"), Config(), Classifier(load_bundle(model)))
    by_hand = []
    for end in (147, 207, 267, 327, 387):
        part = frames[end - 147 : end]
        dwell = Dwell(part, np.ones(147, bool), axis, 60.0, end / 60, end_frame=end)
        by_hand.append(pipeline.decide(dwell))
    told, seed = decisions(played, model), decisions(played, "thesis")
    assert [(d.reading, d.window) for d in told] == [(d.reading, d.window) for d in by_hand]
    assert [d.t_s for d in seed] == [d.t_s for d in told]
    for made in (told, seed):
        assert any(d.window is not None for d in made)
    assert all(d.window.other == 0 for d in seed if d.window)


def evaluate(*argv):
    return main(["evaluate", "--passages", "6", "--seed", "4", "--workers", "1", *argv])


def test_evaluate_compares_them(model, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("x2train.judge.page.passage_png", lambda *_: b"")
    short = tuple(replace(s, duration_s=5.0) for s in SUITES)
    monkeypatch.setattr("x2train.judge.suites.SUITES", short)
    a, b = tmp_path / "a", tmp_path / "b"
    thesis = ("--radar", "thesis")
    assert evaluate("--model", "thesis", *thesis, "--out", str(a)) == 0
    assert json.loads((a / "passages" / "manifest.json").read_text())["about"]["radar"] == "thesis"
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("labelled")
    for scene, seconds in (("demo", "28"), ("empty", "8")):
        argv = ["record", str(folder / f"{scene}.h5"), "--port", f"sim:{scene}?seed=3"]
        assert x2radar_main([*argv, "--duration", seconds, "--speed", "max"]) == 0
    return folder


CSV = """\
file,start,end,label
demo.h5,0,7,empty
demo.h5, 8, 27, pet
empty.h5,,,empty
"""


def test_rows_are_judged_and_reported(folder, tmp_path, capsys):
    (folder / "home.csv").write_text(CSV)
    out = tmp_path / "report"
    argv = ["evaluate", "--model", "fast", "--recordings", str(folder / "home.csv")]
    assert main([*argv, "--out", str(out)]) == 0
    assert "Bundle fast on home.csv" in json.dumps(json.loads((out / "report.json").read_text()))
    assert (out / "report.html").exists()
    assert capsys.readouterr().out.count("\n") == 1
    # Another list is not written over it, and is compared only with its own.
    assert main([*argv, "--out", str(out), "--card"]) == 2


def test_yaml_is_the_same_as_csv(folder):
    (folder / "home.csv").write_text(CSV)
    (folder / "home.yaml").write_text(
        "- {file: demo.h5, start: 0, end: 7, label: empty}\n"
        "- {file: demo.h5, start: 8, end: 27, label: pet}\n"
        "- {file: empty.h5, label: empty}\n"
    )
    rows = read_list(folder / "home.csv")
    assert rows == read_list(folder / "home.yaml")
    table = judge_labelled(rows, "fast")
    assert table.label.tolist() == ["empty", "pet", "empty"]
    np.testing.assert_allclose(table.enters_s, [np.nan, 8.0, np.nan])
    assert table.duration_s == pytest.approx([7.0, 19.0, 8.0], abs=0.1)
    assert not table.chosen(table.label == "empty").is_alarm.any()
    pet = table.chosen(table.label == "pet")
    assert pet.is_open.any()
    assert (pet.t_s > 8).all()
    assert (pet.t_s <= 27).all()


@pytest.mark.parametrize(
    ("text", "words", "code"),
    [
        ("file,start,end,label\n", "must be a list", 2),
        ("file,label\nx.h5,cow\n", "row 1.label: input should be 'human'", 2),
        ("file,start,end,label\nx.h5,9,3,pet\n", "row 1: end 3: must be after start 9", 2),
        ("file,start,end,label\nx.h5,nan,3,pet\n", "row 1.start", 2),
        ("file,label,who\nx.h5,pet,me\n", "row 1.who: unknown key", 2),
        ("file,label\nx.h5,pet,me\n", "row 1.null: unknown key", 2),
        ("file,label\ngone.h5,pet\n", "gone.h5", 66),
        ("file,start,end,label\nempty.h5,0,1,pet\n", "empty.h5", 2),
    ],
)
def test_a_list_that_makes_no_sense_is_one_line(text, words, code, folder, *, tmp_path, capsys):
    path = folder / "bad.csv"
    path.write_text(text)
    argv = ["evaluate", "--model", "fast", "--recordings", str(path), "--out", str(tmp_path / "r")]
    assert main(argv) == code
    assert words in one_line(capsys)
