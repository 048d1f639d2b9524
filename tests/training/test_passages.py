"""Passages and windows: the same for the same seed, and labelled by what can be seen."""

from dataclasses import replace

import numpy as np
import pytest

from radard.stream.ring import DwellShape
from tests.training_helpers import FEATURES
from x2train.sets.families import FAMILIES, LABELS, family
from x2train.sets.passages import Passage, Truth, level_db_of, play
from x2train.sets.sites import X2, draw_site
from x2train.sets.window_set import worth_learning
from x2train.sets.windows import WindowSpec, dwell_ends, windows_of

pytestmark = pytest.mark.integration

FEW = WindowSpec(seed=4, use="train", settings=FEATURES)


def site():
    return replace(draw_site(np.random.default_rng(0), X2), level_db=12.0)


def played(name, seconds=5.0):
    return play(np.random.default_rng(0), site(), (family(name),), duration_s=seconds)


@pytest.fixture(scope="module")
def walk():
    return played("human walk")


def test_a_passage_says_what_a_square_metre_shows():
    quiet = replace(site(), level_db=0.0, surfaces=(), tail=None)
    made = [
        play(np.random.default_rng(3), each, (family("human walk"),), duration_s=4.0)
        for each in (quiet, replace(quiet, level_db=10.0))
    ]
    assert level_db_of(made[1].site) == pytest.approx(level_db_of(made[0].site) + 10)
    for passage in made:
        # Cross section and antenna's pattern, in dB over a square metre on the axis.
        truth = passage.truth
        over_db = truth.snr_db + 40 * np.log10(truth.range_m) - level_db_of(passage.site)
        assert -30 < np.median(over_db) < 10


@pytest.mark.parametrize("name", [f.name for f in FAMILIES])
def test_every_family_can_be_played(name):
    passage = played(name, seconds=0.5)
    assert np.isfinite(passage.frames).all()
    assert passage.truth.range_m.shape == (30, 1)


def test_windows_have_the_shapes_of_their_maps_and_the_labels_of_their_numbers():
    for number in range(5):
        if (rows := FEW(number)) is not None:
            assert rows["velocity_time"].shape[1:] == (101, 40)
            assert rows["range_time"].shape[1:] == (80, 40)
            assert rows["velocity_time"].dtype == np.uint8
            # A fifth of the passages is of things, the others of people and pets.
            assert set(rows["label"]) == {(0, 1, 0, 1, 2)[number]}
            assert set(rows["passage"]) == {number}


def seen(walk, cast, snr_db):
    """Return the windows of a passage whose frames are a walk's, whoever is said to be there."""
    columns = (np.full(snr_db.shape, each) for each in (2.0, 0.5, 1.0))
    return windows_of(Passage(walk.site, cast, walk.frames, Truth(*columns, snr_db)), FEATURES, 7)


@pytest.mark.parametrize(
    ("names", "snr_db", "who"),
    [
        (("human walk", "dog walk"), (30, 30), 0),
        (("dog walk", "human walk"), (30, 30), 1),
        (("fan", "cat walk"), (40, 4), 1),
        (("fan", "human walk"), (40, 4), 1),
        (("human walk", "fan"), (2, 30), 1),
        (("human walk", "fan"), (-np.inf, 30), 1),
        (("dog walk", "cat walk"), (30, 30), 0),
    ],
)
def test_the_label_is_that_of_the_most_alarming_body_in_sight(walk, names, snr_db, who):
    levels = np.repeat(np.array([snr_db], float), len(walk.frames), axis=0)
    windows = seen(walk, tuple(family(name) for name in names), levels)
    f = family(names[who])
    assert set(windows["label"]) == {LABELS.index(f.label)}
    assert {FAMILIES[k].name for k in windows["family"]} == {f.name}
    assert {FAMILIES[k].name for k in windows["company"]} == {names[1 - who]}
    assert set(windows["passage"]) == {7}
    np.testing.assert_allclose(windows["aspect"], 0.5)


def test_who_is_seen_for_an_eighth_of_a_dwell_counts(walk):
    def share_of(n):
        levels = np.full((len(walk.frames), 1), -np.inf)
        levels[-n:] = 30
        return seen(walk, walk.cast, levels)

    dwell = 147
    ends = list(dwell_ends(DwellShape(n_slow=dwell, hop_s=1.0, frame_rate_hz=60.0), 300))
    late = 300 - ends[-1]
    assert share_of(late + int(0.11 * dwell)) is None
    windows = share_of(late + int(0.14 * dwell))
    assert len(windows["label"]) == 1
    assert 0.12 <= windows["share"][0] < 0.15


def test_windows_say_what_made_them_and_how_strong_their_body_is():
    skins = ("surface", "points", "ellipsoids", "capsules")
    laws = replace(FEW, motions=("gait", "footfalls", "angles"), skins=skins)
    laws = replace(laws, physical_share=0.5, plain_share=0.5)
    made = [rows for k in range(24) if (rows := laws(k)) is not None]
    for key, n in (("motion", 3), ("skin", 4), ("is_physical", 2), ("is_plain", 2)):
        assert set(np.concatenate([rows[key] for rows in made]).tolist()) == set(range(n))
    np.testing.assert_equal(laws(7), laws(7))
    assert len({float(rows["level_db"][0]) for rows in made}) == len(made)
    strength_db = np.concatenate([rows["echo_db"] - rows["level_db"] for rows in made])
    label = np.concatenate([rows["label"] for rows in made])
    bodies = strength_db[(label < 2) & np.isfinite(strength_db)]
    assert -40 < bodies.min() <= bodies.max() < 20


def test_what_shows_little_is_learned_in_one_passage_of_five():
    n = 40
    windows = {
        "label": np.tile([0, 1, 1, 2], 10),
        "passage": np.arange(n) // 4,
        "share": np.tile([0.9, 0.9, 0.3, 0.3], 10),
        "speed_mps": np.full(n, 0.5),
        "aspect": np.tile([0.9, 0.1, 0.9, 0.1], 10),
    }
    kept = worth_learning(windows)
    assert len(kept["label"]) == 10 * 2 + 2 * 2  # people who show, things; and two whole passages
    assert (kept["passage"] == 5).sum() == 4
