"""Families, suites and sites: who moves where, and what never leaks into training."""

from collections import Counter

import numpy as np
import pytest

from radard.errors import UsageError
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2train.commands.fit import stream_of
from x2train.judge.suites import SUITES, check_suites, n_more_pets, suite_of
from x2train.sets.families import FAMILIES, LABELS, PAIRS, draw_cast, families
from x2train.sets.sites import X2, draw_radar, draw_site

N_DRAWS = 1500


def casts(label, use, n=N_DRAWS, seed=0):
    rng = np.random.default_rng(seed)
    return [draw_cast(rng, label, use) for _ in range(n)]


@pytest.mark.parametrize("label", LABELS)
def test_training_sees_nothing_that_is_held_out(label):
    made = casts(label, "train")
    assert {f.use for cast in made for f in cast} == {"train"}
    assert not any({"human", "pet"} == {f.label for f in cast} for cast in made)
    # All that may be drawn is drawn.
    assert {cast[0].name for cast in made} == {f.name for f in families(label, "train")}


def test_an_animal_that_is_trained_on_is_a_row_of_the_species_table():
    taught = {s.name: s for s in SPECIES.values() if s.taught}
    trained = [f for f in families("pet", "train") if f.kind != "bird"]
    assert {f.kind for f in trained} == set(taught) < set(SPECIES)
    for name, species in taught.items():
        assert set(species.taught) <= set(species.styles)
        drawn = {f.options["style"]: f.weight for f in trained if f.kind == name}
        assert drawn == species.taught
    assert len({f.name for f in FAMILIES}) == len(FAMILIES)


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("use", ["train", "all"])
def test_the_first_gives_the_label_and_company_comes_as_often_as_stated(label, use):
    made = casts(label, use)
    assert {cast[0].label for cast in made} == {label}
    counts = Counter(cast[1].label for cast in made if len(cast) == 2)
    for (who, company), share in PAIRS.items():
        is_left_out = use == "train" and (who, company) == ("human", "pet")
        if who == label and not is_left_out:
            expected = share * N_DRAWS
            assert abs(counts[company] - expected) < 4 * np.sqrt(expected)
        elif who == label:
            assert counts[company] == 0


@pytest.mark.parametrize("n", [12, 100, 3000])
def test_suites_have_their_share_of_any_run(n):
    drawn = Counter(suite_of(k, n).name for k in range(n))
    total = sum(s.share for s in SUITES)
    for s in SUITES:
        assert abs(drawn[s.name] - n * s.share / total) <= 1
    if n == 3000:
        assert set(drawn) == {s.name for s in SUITES}


@pytest.mark.parametrize("hours", [0.0, 0.2, 5.0, 180.0])
def test_more_visits_of_pets_make_up_the_hours(hours):
    n = 200
    more = n_more_pets(hours, n)
    visits = [s for k in range(n + more) if (s := suite_of(k, n)).is_of_pets]
    lasting_h = sum(s.duration_s for s in visits) / 3600
    assert lasting_h >= hours
    assert more == 0 or lasting_h < hours + 0.01
    assert all(suite_of(n + k, n).is_of_pets for k in range(100))


def test_some_suites_share_a_run_alone():
    only = ("fan", "empty room")
    drawn = Counter(suite_of(k, 300, only).name for k in range(300))
    assert drawn == {"fan": 100, "empty room": 200}
    with pytest.raises(UsageError, match="none of the suites is of pets"):
        n_more_pets(1.0, 300, only)
    assert n_more_pets(0.0, 300, only) == 0
    pets = ("fan", "largest dogs")
    n = n_more_pets(2.0, 10, pets)
    assert {suite_of(10 + k, 10, pets).name for k in range(n)} == {"largest dogs"}
    with pytest.raises(UsageError, match="--only 'cats': suites are people, pets"):
        check_suites(["fan", "cats"])


@pytest.mark.parametrize("kind", ["any", "x2", "x4m03"])
def test_a_bundle_takes_every_radar_that_its_sets_were_drawn_with(kind):
    stream = stream_of([{"radar": kind}, {"radar": kind}])
    rng = np.random.default_rng(1)
    for radar in (draw_radar(rng, kind) for _ in range(400)):
        for key, (low, high) in stream.items():
            assert low <= getattr(radar, key) <= high
    assert stream_of([{"radar": kind}, {}]) == stream_of([{}])


def test_unseen_rooms_are_built_otherwise():
    rng = np.random.default_rng(0)
    usual = [draw_site(rng, X2) for _ in range(60)]
    unseen = [draw_site(rng, X2, "unseen") for _ in range(60)]
    assert {len(s.surfaces) for s in unseen} == {4}
    assert max(len(s.surfaces) for s in usual) <= 3
    assert "x" not in {each.axis for s in usual for each in s.surfaces}
    assert {s.room.profile for s in unseen} == {"power"}
    assert "power" not in {s.room.profile for s in usual if s.room}
    assert max(s.antenna.tilt_deg for s in usual) < 33 < min(s.antenna.tilt_deg for s in unseen)
    assert max(s.antenna.height_m for s in usual) < 2.55 < min(s.antenna.height_m for s in unseen)
    # Nothing between a switch and a door frame.
    assert not [s for s in usual if 1.65 < s.antenna.height_m < 1.85]
