"""`radard.classify`, `radard.features` and `radard.spectrogram`: the daemon's own way, by hand."""

import numpy as np
import pytest

import radard
import x2radar
from radard.config.config import Config
from radard.errors import BundleError, ModelMismatch, UsageError
from radard.run.replays import moment_of
from tests.processes import ran
from tests.radar_helpers import BASEBAND, noise, run_radard
from tests.recording_helpers import record_scene

LOST = range(250, 256)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("api") / "dog.h5"
    record_scene(path, "human_with_dog", n=420, lost=LOST)
    return path


def test_an_array_is_judged_as_a_replay_of_it(recorded):
    frames, stream = x2radar.read_frames(recorded)
    assert np.isnan(frames[list(LOST)]).all()
    ours = radard.classify(frames, stream.axis, stream.frame_rate_hz)
    _, records, _ = run_radard("--port", f"replay:{recorded}", "-o", "json")
    theirs = [r for r in records if r["type"] == "decision"]
    assert len(ours) == len(theirs) >= 5
    for mine, record in zip(ours, theirs, strict=True):
        assert (mine.label, mine.alarm, mine.gate) == tuple(
            record[key] for key in ("label", "alarm", "gate")
        )
        assert mine.dropped == record["dropped"]
        p = mine.fused
        assert (p and round(p.human, 4)) == record["fused_p_human"]
    assert "invalid" in {d.gate for d in ours}


def test_features_are_those_that_the_network_was_given(recorded):
    frames, stream = x2radar.read_frames(recorded)
    given = frames, stream.axis, stream.frame_rate_hz
    made = {window.t_s: window.inputs for window in radard.features(*given, model="fast")}
    opened = [d.t_s for d in radard.classify(*given, model="fast") if d.gate == "open"]
    # The first of all, one of two bodies, and the first behind a gap.
    assert len(opened) == 3
    for t_s in opened:
        seen = moment_of(recorded, t_s, Config(model={"name": "fast"})).seen
        for name, values in seen.features.items():
            assert np.abs(made[t_s][name] - values).max() < 1e-3, name


def test_features_by_name_and_the_cut_of_windows():
    frames = noise(240)
    windows = radard.features(frames, BASEBAND, 60.0, names=["thesis_type1"])
    assert [round(w.t_s, 2) for w in windows] == [2.45, 3.45]
    made = windows[1].inputs["thesis_type1"]
    assert 0.9 < float(np.dot(made, made)) <= 1.0001
    with pytest.raises(ModelMismatch, match="feature 'colour': unknown"):
        radard.features(frames, BASEBAND, 60.0, names=["colour"])
    # A window with many lost frames has none.
    frames[200:210] = np.nan
    assert [round(w.t_s, 2) for w in radard.features(frames, BASEBAND, 60.0)] == [2.45]


def test_a_spectrogram_shows_the_velocity_of_a_point():
    t_s = np.arange(180) / 60
    rows = np.zeros((180, 64), np.complex64)
    rows[:, 20] = np.exp(4j * np.pi * 6.8e9 / 299792458.0 * 0.3 * t_s)
    mu = radard.spectrogram(rows, BASEBAND, 60.0)
    assert mu.velocity_mps[mu.power.mean(axis=1).argmax()] == pytest.approx(0.3, abs=0.03)
    assert mu.t_s[0] == pytest.approx(28 / 60 / 2)


@pytest.mark.parametrize("function", [radard.classify, radard.features, radard.spectrogram])
def test_what_does_not_fit_is_said(function):
    for frames, why in (
        (noise(150)[:, :5], r"shape \(150, 5\): the axis wants \(n, 64\)"),
        (noise(150).real, "baseband frames are complex"),
        (noise(150)[0], "the axis wants"),
    ):
        with pytest.raises(UsageError, match=why):
            function(frames, BASEBAND, 60.0)
    with pytest.raises(UsageError, match="frame_rate_hz 0"):
        function(noise(150), BASEBAND, 0)
    if function is not radard.spectrogram:
        with pytest.raises(ModelMismatch):
            function(noise(150), BASEBAND, 5.0, model="thesis")
        with pytest.raises(BundleError):
            function(noise(150), BASEBAND, 60.0, model="gone")


@pytest.mark.integration
def test_every_name_is_there_and_nothing_else_is_imported_for_it():
    for name in radard.__all__:
        assert getattr(radard, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = radard.nothing
    code = (
        "import sys, radard; assert 'numpy' not in sys.modules; "
        "import radard.judge.bundle; import x2radar; "
        "f, s = x2radar.simulate('empty', duration_s=2.5); "
        "print(radard.classify(f, s.axis, s.frame_rate_hz, model='none')[0].gate)"
    )
    done = ran("-c", code)
    assert done.stdout.strip() == "closed", done.stderr
