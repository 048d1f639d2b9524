"""What `research/tradeoff.py` measures: small, but whole."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest

import tradeoff
from benchmarks.blank_bundle import write_blank_bundle
from radard.detect.clutter_map import ClutterRemover
from radard.dsp.downconvert import DownConverter
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import MAP_FEATURES, FeatureSettings, FeatureStream
from radard.stream.ring import Dwell
from tradeoff_bundles import (
    DECIMATIONS,
    PRECISIONS,
    SETTINGS,
    Combination,
    best,
    combinations,
    feeds,
    judged_windows,
    read_accuracy,
    time_bundle,
)
from tradeoff_chain import SWITCHES, Chain, MapSetting, measure, picture_loss_db, record
from x2train.bundle.network_cost import quantised, window_ms
from x2train.judge.estimates import Estimate
from x2train.nets.bundle_answers import outputs_of

pytestmark = pytest.mark.nightly
INT8 = onnx.TensorProto.INT8
BLANK = FeatureSettings(range_decimation=8, clutter="removed", velocity_cpi_s=0.2)
SHIPPED = load_bundle("fast").features


def told(*_):
    pass


@pytest.fixture(scope="module")
def walk():
    return record("human", 60.0, 7.0, 0)


@pytest.fixture(scope="module")
def seen():
    return judged_windows(12, 0, [load_bundle("fast")], told)


def hops(recording, setting):
    chain = Chain(recording.axes[setting.source], 60.0, setting)
    return [chain.hop(samples) for samples in recording.hops(setting.source)]


def test_the_finest_value_loses_nothing_and_coarser_ones_more(walk):
    rows = measure([walk], 1, told, SWITCHES[:1])
    losses = [row.loss_db["range_time"] for row in rows]
    assert losses[0] == 0
    assert losses == sorted(losses)
    assert losses[-1] > 0.1
    assert [row.is_default for row in rows] == [False, False, False, True, False]
    assert rows[0].ratio == 1
    assert all(row.ms_per_hop > 0 for row in rows)


@pytest.mark.parametrize("stride", [1, 3, 7])
def test_maps_in_single_and_double_agree(walk, stride):
    single = hops(walk, MapSetting(stride=stride))
    double = hops(walk, MapSetting(stride=stride, precision=64))
    assert [each is None for each in single] == [each is None for each in double]
    assert single[0] is None
    for ours, wanted in zip(single, double, strict=True):
        for name in () if ours is None else MAP_FEATURES:
            assert np.abs(ours.maps[name] - wanted.maps[name]).max() < 1e-4


def test_default_chain_shows_what_the_daemons_features_are(walk):
    converter = DownConverter(walk.axes["rf"], 8)
    rows = converter.convert(walk.frames["rf"])
    remover, stream = ClutterRemover(), FeatureStream(BLANK, MAP_FEATURES)
    valid = np.ones(147, np.bool_)
    for k, pictures in enumerate(hops(walk, MapSetting())):
        if pictures is None:
            continue
        end = 60 * (k + 1)
        frames = rows[end - 147 : end]
        dwell = Dwell(frames, valid, converter.axis, 60.0, end / 60, end_frame=end)
        features = stream.extract(remover.remove(dwell))
        for name in MAP_FEATURES:
            assert np.abs(features[name] - pictures.maps[name]).max() < 1e-4


def test_loss_is_the_rms_over_what_is_shown():
    finest = np.zeros((5, 4), np.float32)
    finest[2] = 1.0
    assert picture_loss_db(finest, finest, 25.0) == 0
    assert picture_loss_db(0.8 * finest, finest, 25.0) == pytest.approx(5.0, rel=1e-6)
    assert picture_loss_db(0 * finest, 0 * finest, 25.0) == 0
    # Rows 0, 2, 4 of a coarser picture, interpolated.
    ramp = np.repeat(np.linspace(0, 1, 5, dtype=np.float32)[:, None], 4, axis=1)
    assert picture_loss_db(ramp[::2], ramp, 25.0) == pytest.approx(0, abs=1e-5)


def test_a_blank_bundle_is_one_that_the_daemon_loads(walk, tmp_path):
    path = write_blank_bundle(tmp_path, "blank", BLANK, MAP_FEATURES)
    assert Classifier(load_bundle(str(path))).feature_names == MAP_FEATURES
    row = time_bundle(str(path), None, [walk], 1)
    assert 0 < row.network_ms < row.ms_per_hop


def test_the_accuracy_is_that_of_a_report(tmp_path):
    path = tmp_path / "report.json"
    found = {"value": 0.97, "low": 0.96, "high": 0.98}
    path.write_text(json.dumps({"windows": {"balanced_accuracy": found}}))
    assert read_accuracy(path) == Estimate(0.97, 0.96, 0.98)
    for text in ("{}", "[]", "nonsense", '{"windows": {}}'):
        path.write_text(text)
        with pytest.raises(UsageError, match=r"report\.json: no report"):
            read_accuracy(path)


def test_a_still_room_is_refused(walk):
    still = replace(walk, frames={k: np.repeat(v[:1], 420, 0) for k, v in walk.frames.items()})
    with pytest.raises(UsageError, match="the gate never opens"):
        measure([still], 1, told, SWITCHES[:1])


def test_the_script_writes_page_and_plot(seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Passages that were played already.
    monkeypatch.setattr(tradeoff, "judged_windows", lambda *_: seen)
    write_blank_bundle(tmp_path, "balanced", SHIPPED, MAP_FEATURES)
    found = {"value": 0.9, "low": 0.8, "high": 0.95}
    (tmp_path / "report.json").write_text(json.dumps({"windows": {"balanced_accuracy": found}}))
    argv = ["--scenes", "human", "--draws", "1", "--duration", "6", "--rounds", "1"]
    argv += ["--models", "balanced.onnx=report.json", "--combine", "balanced.onnx"]
    argv += ["--passages", "12", "--page", "docs/page.md", "--plot", "docs/images/plot.png"]
    assert tradeoff.main(argv) == 0
    text = (tmp_path / "docs" / "page.md").read_text()
    assert "![loss against cost](images/plot.png)" in text
    assert text.count("| **") == 8
    assert "| range | CPIs | ms | balanced, fp32 | balanced, int8 |" in text
    assert text.count("\n| 8 | 3 |") == 1
    assert "`python research/tradeoff.py --models balanced.onnx=report.json --combine" in text
    assert "| **balanced** (profile) |" in text
    assert "0.9000 (0.8000 to 0.9500)" in text
    assert (tmp_path / "docs" / "images" / "plot.png").read_bytes()[:4] == b"\x89PNG"


def test_dwells_are_the_same_at_every_decimation(seen):
    n = len(seen.is_human)
    assert set(seen.maps) == {(SHIPPED, d) for d in DECIMATIONS}
    assert all(len(m) == n for maps in seen.maps.values() for m in maps.values())
    assert 0 < seen.is_human.sum() < n
    assert set(np.diff(seen.passage)) <= {0, 1}
    # Who is there is shown alike, whatever the bins: of another dwell it would not be.
    fine, coarse = (seen.maps[SHIPPED, d]["velocity_time"] / 255 for d in (4, 8))
    own = np.abs(fine - coarse).mean(axis=(1, 2))
    other = np.abs(fine - np.roll(coarse, n // 2, axis=0)).mean(axis=(1, 2))
    assert np.median(own) < 0.2 * np.median(other)
    with pytest.raises(UsageError, match="nobody is in view"):
        judged_windows(0, 0, [load_bundle("fast")], told)


def test_every_combination_is_judged(seen, tmp_path):
    bundle = load_bundle(str(write_blank_bundle(tmp_path, "blank", SHIPPED, MAP_FEATURES)))
    made = combinations([bundle], seen, seen, dict.fromkeys(SETTINGS, 1.0), 0)
    assert {(c.decimation, c.cpis, c.precision) for c in made} == {
        (s.decimation, s.cpis, p) for s in SETTINGS for p in PRECISIONS
    }
    assert len(made) == 18
    assert [c.decimation for c in made if c.is_shipped] == [8]
    for c in made:
        assert c.ms_per_hop == 1.0 + c.network_ms > 1.0
        assert c.auc.low <= c.auc.value <= c.auc.high
    # A map that is blank is one that the network does not see.
    shown = {(c.cpis, c.auc.value) for c in made if (c.decimation, c.precision) == (8, "fp32")}
    assert len({auc for _, auc in shown}) == 3


def test_what_nothing_beats_is_the_front():
    def one(ms, auc):
        found = {"ms_per_hop": ms, "network_ms": 0.1, "auc": Estimate(auc, 0, 1)}
        return Combination(model="m", precision="fp32", decimation=8, cpis=3, **found)

    cheap, good, dear, bad = one(1, 0.8), one(2, 0.9), one(3, 0.9), one(2.5, 0.7)
    assert best([dear, bad, good, cheap]) == [cheap, good]


def test_a_network_in_int8_says_nearly_the_same(seen):
    bundle = load_bundle("fast")
    maps = seen.maps[SHIPPED, 8]
    rows = feeds(bundle, maps)
    small = quantised(bundle.onnx, rows)
    inputs = {i.name: maps[i.feature] for i in bundle.inputs}
    whole, rough = outputs_of(bundle.onnx, inputs), outputs_of(small, inputs)
    off = np.abs(whole.p(1.0) - rough.p(1.0))
    assert 0 < off.max() < 0.25
    assert off.mean() < 0.02
    # Processors without dot products in int8 add pairs of products in 16 bits: none saturates.
    arrays = [w for w in onnx.load_from_string(small).graph.initializer if w.data_type == INT8]
    weights = [onnx.numpy_helper.to_array(w).astype(int) for w in arrays if w.dims]
    assert 2 * 255 * max(np.abs(w).max() for w in weights) < 2**15
    assert min(window_ms({"a": (small, rows[0]), "b": (bundle.onnx, rows[0])}, 3).values()) > 0


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--combine", "thesis"], "takes more than maps"),
        (["--models", "=a.json"], "NAME=REPORT"),
        (["--models", "name="], "NAME=REPORT"),
        (["--passages", "3"], "--passages 3: must be 12 to"),
        (["--duration", "1"], "--duration 1: must be 5 to"),
        (["--plot", "a.txt"], "must end in .png"),
    ],
)
def test_wrong_use_is_named_in_one_line(argv, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert tradeoff.main(argv) == 2
    assert said in capsys.readouterr().err
