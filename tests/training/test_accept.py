"""`train-export accept`: what is asked, that a share is a part, and what the report says."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from radard.config.config import Config
from radard.errors import ModelMismatch
from radard.judge.bundle import load_bundle, sidecar_path
from tests.report_helpers import passage as passage_of
from tests.training.motion_helpers import stander, walker, write_clip
from x2train.cli import main
from x2train.judge import acceptance, acceptance_report
from x2train.judge.acceptance import ENTRIES, SEED, SETTINGS, VERSION, AcceptSpec, site_of
from x2train.judge.acceptance_report import alarms_by_window, document, lines
from x2train.judge.judging import KNOWS, installed
from x2train.judge.table import PassageTable
from x2train.motion.clips import read_clip
from x2train.sets.passages import level_db_of
from x2train.sets.window_set import ADULT_DB

pytestmark = pytest.mark.integration


def casts(entry):
    return [[(f.name, f.options) for f in cast] for cast in entry.casts]


def test_a_version_stands_for_its_entries_and_settings():
    """Whoever changes them changes the version, too: results are compared by it."""
    asked = [(e.name, e.kind, e.duration_s, e.count, casts(e)) for e in ENTRIES]
    places = [(s.name, s.height_m, s.tilt_deg, s.far_m) for s in SETTINGS]
    digest = hashlib.sha256(repr((SEED, asked, places)).encode()).hexdigest()
    assert (VERSION, digest[:16]) == ("accept-3", "ed3b13c9440c409f")
    assert AcceptSpec(model="fast").version == VERSION
    assert AcceptSpec(model="fast", seed=1).version == f"{VERSION}, seed 1"


def test_a_share_of_the_test_is_a_part_of_it():
    whole, tenth = AcceptSpec(model="fast", seed=1), AcceptSpec(model="fast", seed=1, share=0.1)
    assert whole.n_passages == sum(e.count for e in ENTRIES)
    assert tenth.n_passages < whole.n_passages / 9
    places = [tenth.entry(n) for n in range(tenth.n_passages)]
    assert {index for index, _ in places} == set(range(len(ENTRIES)))
    assert set(places) <= {whole.entry(n) for n in range(whole.n_passages)}
    (number,) = [n for n in range(whole.n_passages) if whole.entry(n) == (1, 0)]
    (other,) = [n for n in range(tenth.n_passages) if tenth.entry(n) == (1, 0)]
    first, again = whole(number), tenth(other)
    assert all(np.array_equal(first[k], again[k]) or first[k].dtype == float for k in first)
    np.testing.assert_array_equal(first["p_human"], again["p_human"])


def test_a_bundle_for_no_such_radar_is_refused(tmp_path, capsys):
    with pytest.raises(ModelMismatch):
        AcceptSpec(model="thesis", seed=1)
    assert main(["accept", "--model", "thesis", "--out", str(tmp_path / "a")]) == 4
    assert capsys.readouterr().err.count("\n") == 1


def test_short_form(tmp_path, monkeypatch, capsys):
    short = [
        replace(e, duration_s=60.0 if e.kind == "pets stay" else 8.0)
        for e in ENTRIES
        if e.kind != "thing" or e.name in {"fan", "empty room"}
    ]
    for module in (acceptance, acceptance_report):
        monkeypatch.setattr(module, "ENTRIES", tuple(short))
    out = tmp_path / "accept"
    argv = ["accept", "--model", "fast", "--share", "0.002", "--workers", "1", "--out", str(out)]
    assert main(argv) == 0
    made = json.loads((out / "acceptance.json").read_text())
    assert [row["name"] for row in made["entries"]] == [e.name for e in short]
    assert all(row["passages"] == 1 for row in made["entries"])
    assert made["entries"][-1]["bundle"]["count"] == 0
    assert "ceiling, 2.6 m, 60 degrees down" in (out / "acceptance.html").read_text()
    assert (made["version"], made["bundle"]) == (VERSION, "fast")
    out_lines = capsys.readouterr().out.splitlines()
    assert out_lines[0] == f"{VERSION}, a share of 0.002"
    assert len(out_lines) == len(short) + 2
    # What is there is not made again.
    manifest = (out / "passages" / "manifest.json").stat().st_mtime_ns
    assert main(argv) == 0
    assert (out / "passages" / "manifest.json").stat().st_mtime_ns == manifest


def test_recorded_bodies_come_that_the_bundle_does_not_know(tmp_path, capsys):
    clips, models = tmp_path / "clips", tmp_path / "models"
    for each in (clips, models, tmp_path / "known"):
        each.mkdir()
    write_clip(clips / "walk.npz", walker(), "person", "anna")
    write_clip(clips / "known.npz", walker(speed_mps=1.6), "person", "ben")
    write_clip(clips / "stand.npz", stander(), "quadruped", "rex")
    write_clip(tmp_path / "known" / "known.npz", walker(speed_mps=1.6), "person", "ben")
    sidecar = json.loads(sidecar_path("fast").read_text())
    sidecar["training"]["clips"] = {"known": {"sha256": read_clip(clips / "known.npz").sha256}}
    (models / "mine.onnx").write_bytes(load_bundle("fast").onnx)
    (models / "mine.json").write_text(json.dumps(sidecar))
    out = tmp_path / "accept"
    argv = ["accept", "--model", str(models / "mine.onnx"), "--clips", str(clips)]
    assert main([*argv, "--share", "0.003", "--workers", "1", "--out", str(out)]) == 0
    made = json.loads((out / "acceptance.json").read_text())
    assert (made["version"], [c["clip"] for c in made["clips"]]) == ("accept-4", ["walk", "stand"])
    rows = [(row["name"], row["passages"]) for row in made["entries"]]
    assert rows == [("recorded people who go", 1), ("recorded animals in one place", 1)]
    assert main([*argv[:-1], str(tmp_path / "known"), "--out", str(out)]) == 2
    assert "none is left" in capsys.readouterr().err


def passage(entry, *, alarm, p_human, enters_s=1.0, setting="X2, 1.2 m"):
    n = 4
    told = {"family": entry.name, "suite": entry.name, "split": setting, "enters_s": enters_s}
    told |= {"t_s": np.arange(n) + 2.45, "duration_s": entry.duration_s or 1800.0}
    told |= {"is_alarm": np.full(n, alarm), "p_human": np.full(n, p_human)}
    return passage_of([0.0] * n, entry.label, window=[1 - p_human] * n, **told)


def test_the_report_counts_misses_alarms_and_hours():
    walk, cat = ENTRIES[0], next(e for e in ENTRIES if e.kind == "pets cross")
    fan = next(e for e in ENTRIES if e.name == "fan")
    rows = [passage(walk, alarm=k > 0, p_human=0.9) for k in range(10)]
    rows.append(passage(walk, alarm=False, p_human=0.0, enters_s=np.nan))
    rows += [passage(cat, alarm=False, p_human=0.1, setting="X4M03, 1.2 m") for _ in range(5)]
    rows.append(passage(cat, alarm=True, p_human=0.5))
    rows += [passage(fan, alarm=k == 0, p_human=0.1, enters_s=np.nan) for k in range(6)]
    table = PassageTable.of(rows)
    by_name = {row["name"]: row for row in document(table, {})["entries"]}
    missed = by_name[walk.name]
    assert (missed["passages"], missed["in_view"]) == (11, 10)
    assert (missed["bundle"]["count"], missed["bundle"]["of"]) == (1, 10)
    assert missed["bundle"]["high"] == pytest.approx(0.445, abs=0.001)  # Clopper and Pearson
    assert missed["bundle"]["median_s"] == pytest.approx(1.45)
    # No window of those who were seen is a pet's by more than 0.8.
    assert missed["window"]["count"] == 0
    assert by_name[cat.name]["bundle"]["count"] == by_name[cat.name]["window"]["count"] == 1
    assert by_name[cat.name]["settings"]["X4M03, 1.2 m"]["bundle"]["count"] == 0
    assert by_name["fan"]["hours"] == 1.0
    assert by_name["fan"]["bundle"]["count"] == 1
    assert by_name["fan"]["window"]["high"] == pytest.approx(2.996, abs=0.001)
    assert by_name["moth"]["bundle"]["value"] is None
    told = {name: (of, own) for name, _, of, own, _ in lines(document(table, {}))}
    assert told[walk.name] == ("10 of 11 in view", "1: 10.0 % (0.3 to 44.5)")
    assert told["moth"][1] == "-"
    assert alarms_by_window(table).sum() == 4 * 10 + 4


def test_an_installation_says_as_much_as_it_knows():
    place = site_of(np.random.default_rng(3), SETTINGS[1])
    made = {
        knows: installed(Config(), place, knows, np.random.default_rng(1)).mount for knows in KNOWS
    }
    assert made["nothing"] == Config().mount
    assert made["mount"].height_m == made["mount and level"].height_m == SETTINGS[1].height_m
    assert made["mount"].level_db is None
    assert abs(made["mount and level"].level_db - level_db_of(place) - ADULT_DB) < 8


PASSAGES = {
    (0, 0): (3.23, 23.85, 2.08, -9.31),
    (1, 3): (0.00, 22.08, 2.74, 1.03),
    (2, 1): (0.00, 34.55, 3.08, 9.49),
    (4, 4): (0.00, 25.43, 2.82, -7.97),
    (6, 0): (9.82, 13.90, 2.33, -13.21),
    (7, 5): (0.00, 10.42, 3.09, -21.49),
    (10, 2): (4.07, 11.88, 2.64, -19.17),
}
"""Passages of the version, by entry and number: entry in s, SNR in dB, range in m, mean power."""


@pytest.mark.nightly
@pytest.mark.parametrize("place", PASSAGES, ids=str)
def test_passages_of_the_version_are_what_they_were(place):
    """A change of the simulator by which they differ is another version of the test."""
    spec = AcceptSpec(model="fast")
    number = sum(e.count for e in ENTRIES[: place[0]]) + place[1]
    assert spec.entry(number) == place
    made = spec(number)
    shown = [float(made[name][0]) for name in ("enters_s", "snr_db", "range_m")]
    assert [*shown, float(made["power_db"].mean())] == pytest.approx(PASSAGES[place], abs=0.05)
