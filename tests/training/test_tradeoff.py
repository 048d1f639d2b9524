"""What `research/tradeoff.py` measures: small, but whole."""

from dataclasses import replace

import numpy as np
import pytest

import tradeoff
from benchmarks.blank_bundle import write_blank_bundle
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.features import MAP_FEATURES, FeatureSettings, extract
from tradeoff_measure import (
    DECIMATIONS,
    SETTINGS,
    SWITCHES,
    Chain,
    Combination,
    MapSetting,
    best,
    combinations,
    judged_windows,
    measure,
    picture_loss_db,
    record,
)
from x2train.judge.estimates import Estimate

pytestmark = pytest.mark.nightly
BUNDLES = FeatureSettings(clutter="removed", velocity_cpi_s=0.2)
SHIPPED = load_bundle("fast").features


def told(*_):
    pass


@pytest.fixture(scope="module")
def walk():
    return record("human", 60.0, 7.0, 0)


@pytest.fixture(scope="module")
def seen():
    return judged_windows(12, 0, [load_bundle("fast")], told)


@pytest.mark.parametrize("switch", SWITCHES[:2], ids=lambda s: s.name)
def test_the_finest_value_loses_nothing_and_coarser_ones_more(walk, switch):
    rows = measure([walk], 1, told, [switch])
    name = {"decimation": "range_time", "stride": "velocity_time"}[switch.name]
    losses = [row.loss_db[name] for row in rows]
    assert losses[0] == 0
    assert losses == sorted(losses)
    assert losses[-1] > 0.1
    assert [row.value for row in rows if row.is_default] == [getattr(MapSetting(), switch.name)]
    assert rows[0].ratio == 1
    assert all(row.ms_per_hop > 0 for row in rows)


def test_default_chain_shows_what_the_daemons_features_are(walk):
    chain = Chain(walk.axes["rf"], 60.0, MapSetting())
    found = [each for each in map(chain.hop, walk.hops("rf")) if each is not None]
    assert len(found) == 5
    moving, shown = found[0]
    for name, picture in extract(moving, BUNDLES, MAP_FEATURES).items():
        assert np.abs(picture - shown[name]).max() < 1e-4


def test_loss_is_the_rms_over_what_is_shown():
    finest = np.zeros((5, 4), np.float32)
    finest[2] = 1.0
    assert picture_loss_db(finest, finest, 25.0) == 0
    assert picture_loss_db(0.8 * finest, finest, 25.0) == pytest.approx(5.0, rel=1e-6)
    assert picture_loss_db(0 * finest, 0 * finest, 25.0) == 0
    # Rows 0, 2, 4 of a coarser picture, interpolated.
    ramp = np.repeat(np.linspace(0, 1, 5, dtype=np.float32)[:, None], 4, axis=1)
    assert picture_loss_db(ramp[::2], ramp, 25.0) == pytest.approx(0, abs=1e-5)


def test_the_script_writes_page_and_plot(seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Passages that were played already.
    monkeypatch.setattr(tradeoff, "judged_windows", lambda *_: seen)
    write_blank_bundle(tmp_path, "mine", SHIPPED, MAP_FEATURES)
    argv = ["--scenes", "human", "--draws", "1", "--duration", "6", "--rounds", "1"]
    argv += ["--combine", "mine.onnx", "--passages", "12"]
    page, plot = tmp_path / "page.md", tmp_path / "plot.png"
    page.write_text("before\n{}\nOLD\n{}\nbehind\n".format(*tradeoff.MARKS))
    argv += ["--page", str(page), "--plot", str(plot)]
    assert tradeoff.main(argv) == 0
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("behind\n")
    assert "OLD" not in text
    assert text.count("| **") == len(SWITCHES) + 1
    assert "| range | CPIs | ms | mine |" in text
    assert text.count("\n| 8 | 3 |") == 1
    assert "    python research/tradeoff.py --combine mine.onnx --passages 12\n" in text
    assert plot.read_bytes()[:4] == b"\x89PNG"


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


def test_every_combination_is_judged(seen, tmp_path):
    bundle = load_bundle(str(write_blank_bundle(tmp_path, "blank", SHIPPED, MAP_FEATURES)))
    made = combinations([bundle], seen, dict.fromkeys(SETTINGS, 1.0), 0)
    assert [c.setting for c in made] == list(SETTINGS)
    assert [c.setting.decimation for c in made if c.is_shipped] == [8]
    for c in made:
        assert c.ms_per_hop == 1.0 + c.network_ms > 1.0
        assert c.auc.low <= c.auc.value <= c.auc.high
    # A map that is blank is one that the network does not see.
    assert len({c.auc.value for c in made if c.setting.decimation == 8}) == 3


def test_what_nothing_beats_is_the_front():
    def one(ms, auc):
        found = {"map_ms": ms, "network_ms": 0.1, "auc": Estimate(auc, 0, 1)}
        return Combination(model="m", setting=MapSetting(), **found)

    cheap, good, dear, bad = one(1, 0.8), one(2, 0.9), one(3, 0.9), one(2.5, 0.7)
    assert best([dear, bad, good, cheap]) == [cheap, good]


def test_what_cannot_be_measured_is_named(walk, tmp_path, monkeypatch, capsys):
    still = replace(walk, frames={k: np.repeat(v[:1], 420, 0) for k, v in walk.frames.items()})
    with pytest.raises(UsageError, match="the gate never opens"):
        measure([still], 1, told, SWITCHES[:1])
    with pytest.raises(UsageError, match="nobody is in view"):
        judged_windows(0, 0, [load_bundle("fast")], told)
    monkeypatch.chdir(tmp_path)
    for argv, said in (
        (["--combine", "thesis"], "takes more than maps"),
        (["--passages", "3"], "--passages 3: must be 12 to"),
        (["--plot", "a.txt"], "must end in .png"),
    ):
        assert tradeoff.main(argv) == 2
        assert said in capsys.readouterr().err
