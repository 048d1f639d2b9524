"""What `train-export tradeoff` measures: small, but whole."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest

from benchmarks.blank_bundle import write_blank_bundle
from radard.detect.clutter_map import ClutterRemover
from radard.dsp.downconvert import DownConverter
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import MAP_FEATURES, FeatureSettings, FeatureStream
from radard.stream.ring import Dwell
from research.tradeoff.combinations import (
    DECIMATIONS,
    PRECISIONS,
    SETTINGS,
    Combination,
    best,
    combinations,
    feeds,
    n_combinations,
)
from research.tradeoff.maps import Chain, MapSetting
from research.tradeoff.measure import SWITCHES, measure, n_steps, picture_loss_db, record
from research.tradeoff.models import parse_model, read_accuracy, time_model
from research.tradeoff.windows import judged_windows
from x2train.bundle.network_cost import quantised, window_ms
from x2train.cli import main
from x2train.nets.bundle_answers import outputs_of
from x2train.report.intervals import Estimate

INT8 = onnx.TensorProto.INT8
BLANK = FeatureSettings(range_decimation=8, clutter="removed", velocity_cpi_s=0.2)
MAPS = MAP_FEATURES
SHIPPED = load_bundle("fast").features


@pytest.fixture(scope="module")
def walk():
    return record("human", 60.0, 7.0, 0)


@pytest.fixture(scope="module")
def seen():
    *steps, windows = judged_windows(12, 0, [SHIPPED], DECIMATIONS)
    assert steps == list(range(1, 13))
    return windows


def hops(recording, setting):
    chain = Chain(recording.axes[setting.source], 60.0, setting)
    frames = recording.frames[setting.source]
    return [chain.hop(frames[k : k + 60]) for k in range(0, len(frames) - 59, 60)]


def test_the_finest_value_loses_nothing_and_coarser_ones_more(walk):
    *steps, rows = measure([walk], 1, SWITCHES[:1])
    assert steps[-1] == n_steps(1, SWITCHES[:1]) == 5
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
        if ours is not None:
            for name in MAPS:
                assert np.abs(ours.maps[name] - wanted.maps[name]).max() < 1e-4


def test_default_chain_shows_what_the_daemons_features_are(walk):
    """The chain is that of the daemon: its pictures are the features of a bundle."""
    converter = DownConverter(walk.axes["rf"], 8)
    rows = converter.convert(walk.frames["rf"])
    remover, stream = ClutterRemover(), FeatureStream(BLANK, MAPS)
    shown = hops(walk, MapSetting())
    for k, pictures in enumerate(shown):
        end = 60 * (k + 1)
        if pictures is None:
            continue
        dwell = Dwell(
            rows[end - 147 : end],
            np.ones(147, np.bool_),
            converter.axis,
            60.0,
            end / 60,
            end_frame=end,
        )
        features = stream.extract(remover.remove(dwell))
        for name in MAPS:
            assert np.abs(features.inputs[name] - pictures.maps[name]).max() < 1e-4


def test_loss_is_the_rms_over_what_is_shown():
    finest = np.zeros((5, 4), np.float32)
    finest[2] = 1.0
    assert picture_loss_db(finest, finest, 25.0) == 0
    assert picture_loss_db(0.8 * finest, finest, 25.0) == pytest.approx(5.0, rel=1e-6)
    assert picture_loss_db(0 * finest, 0 * finest, 25.0) == 0
    # Rows 0, 2, 4 of a coarser picture, interpolated.
    ramp = np.repeat(np.linspace(0, 1, 5, dtype=np.float32)[:, None], 4, axis=1)
    assert picture_loss_db(ramp[::2], ramp, 25.0) == pytest.approx(0, abs=1e-5)


def test_a_blank_bundle_is_one_that_the_daemon_loads(tmp_path):
    path = write_blank_bundle(tmp_path, "blank", BLANK, MAPS)
    classifier = Classifier(load_bundle(str(path)))
    assert classifier.feature_names == MAPS
    again = write_blank_bundle(tmp_path, "again", BLANK, (*MAPS, "thesis_type1"))
    assert "thesis_type1" in Classifier(load_bundle(str(again))).feature_names
    assert path.read_bytes() != again.read_bytes()


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (
            {"windows": {"balanced_accuracy": {"value": 0.97, "low": 0.96, "high": 0.98}}},
            (0.97, 0.96, 0.98),
        ),
        ({"metrics": {"accuracy": 0.8355, "windows": 2000.0}}, (0.8355, None, None)),
        ({"metrics": {"window balanced accuracy": 0.9, "accuracy": 0.1}}, (0.9, None, None)),
        ({"accuracy": 0.5}, (0.5, None, None)),
    ],
)
def test_accuracy_is_found_in_every_kind_of_evaluation(tmp_path, content, wanted):
    path = tmp_path / "eval.json"
    path.write_text(json.dumps(content))
    found = read_accuracy(path)
    assert (found.value, found.low, found.high) == wanted


@pytest.mark.parametrize("text", ["{}", "[]", "nonsense", '{"accuracy": 2}', '{"windows": {}}'])
def test_what_is_no_evaluation_is_refused(tmp_path, text):
    path = tmp_path / "eval.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=r"eval\.json"):
        read_accuracy(path)


@pytest.mark.parametrize("text", ["=a.json", "name=", "="])
def test_a_model_needs_a_name(text):
    with pytest.raises(UsageError, match="NAME=EVALUATION"):
        parse_model(text)


def test_a_still_room_is_refused(walk):
    still = replace(walk, frames={k: np.repeat(v[:1], 420, 0) for k, v in walk.frames.items()})
    with pytest.raises(UsageError, match="the gate never opens"):
        list(measure([still], 1, SWITCHES[:1]))


def test_profiles_are_marked(walk, tmp_path):
    path = write_blank_bundle(tmp_path, "fast", BLANK, MAPS)
    row = time_model(str(path), None, [walk], 1)
    assert row.is_profile
    assert 0 < row.network_ms < row.ms_per_hop


def test_command_writes_page_and_plot(seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Passages that were played already.
    played = "research.tradeoff.windows.judged_windows"
    monkeypatch.setattr(played, lambda n, *_: iter([n, seen]))
    write_blank_bundle(tmp_path, "balanced", SHIPPED, MAPS)
    (tmp_path / "eval.json").write_text('{"accuracy": 0.9}')
    argv = ["tradeoff", "--scenes", "human", "--draws", "1", "--duration", "6", "--rounds", "1"]
    argv += ["--models", "balanced.onnx=eval.json", "--combine", "balanced.onnx"]
    argv += ["--passages", "12"]
    assert main([*argv, "--page", "docs/page.md", "--plot", "docs/images/plot.png"]) == 0
    text = (tmp_path / "docs" / "page.md").read_text()
    assert "![loss against cost](images/plot.png)" in text
    assert text.count("| **") == 8
    assert "| range | CPIs | ms | balanced, fp32 | balanced, int8 |" in text
    assert text.count("\n| 8 | 3 |") == 1
    assert "--combine balanced.onnx --passages 12`" in text
    assert "| **balanced** (profile) |" in text
    assert "0.9000" in text
    assert (tmp_path / "docs" / "images" / "plot.png").read_bytes()[:4] == b"\x89PNG"


def test_dwells_are_the_same_at_every_decimation(seen):
    n = len(seen.is_human)
    assert set(seen.maps) == {(SHIPPED, d) for d in DECIMATIONS}
    assert all(len(m) == n for maps in seen.maps.values() for m in maps.values())
    assert 0 < seen.is_human.sum() < n
    assert (np.diff(seen.passage) >= 0).all()
    assert set(seen.passage) == set(range(seen.passage[-1] + 1))
    # Who is there is shown alike, whatever the bins: of another dwell it would not be.
    fine, coarse = (seen.maps[SHIPPED, d]["velocity_time"] / 255 for d in (4, 8))
    own = np.abs(fine - coarse).mean(axis=(1, 2))
    other = np.abs(fine - np.roll(coarse, n // 2, axis=0)).mean(axis=(1, 2))
    assert np.median(own) < 0.2 * np.median(other)


def test_too_few_passages_are_refused():
    with pytest.raises(UsageError, match="nobody is in view"):
        list(judged_windows(0, 0, [SHIPPED], DECIMATIONS))


def test_every_combination_is_judged(seen, tmp_path):
    bundle = load_bundle(str(write_blank_bundle(tmp_path, "blank", SHIPPED, MAPS)))
    costs = dict.fromkeys(SETTINGS, 1.0)
    *steps, made = combinations([bundle], seen, seen, costs, 0)
    assert steps[-1] == n_combinations(1) == len(made) == 18
    assert {(c.decimation, c.cpis, c.precision) for c in made} == {
        (s.decimation, s.cpis, p) for s in SETTINGS for p in PRECISIONS
    }
    assert [c.decimation for c in made if c.is_shipped] == [8]
    for c in made:
        assert c.ms_per_hop == 1.0 + c.network_ms > 1.0
        assert c.auc.low <= c.auc.value <= c.auc.high
    # A map that is blank is one that the network does not see.
    shown = {(c.cpis, c.auc.value) for c in made if (c.decimation, c.precision) == (8, "fp32")}
    assert len({auc for _, auc in shown}) == 3


def test_what_nothing_beats_is_the_front():
    def one(ms, auc):
        return Combination(
            model="m",
            precision="fp32",
            decimation=8,
            cpis=3,
            ms_per_hop=ms,
            network_ms=0.1,
            auc=Estimate(auc, 0, 1),
        )

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


def test_a_bundle_of_more_than_maps_is_not_combined(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    argv = ["tradeoff", "--scenes", "human", "--draws", "1", "--duration", "6"]
    assert main([*argv, "--combine", "thesis"]) == 2
    assert "takes more than maps" in capsys.readouterr().err


@pytest.mark.parametrize(
    "argv",
    [
        ["--passages", "3"],
        ["--rounds", "0"],
        ["--duration", "1"],
        ["--plot", "a.txt"],
        ["--seed", "-1"],
    ],
)
def test_options_out_of_bounds_are_usage_errors(argv, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["tradeoff", *argv]) == 2
