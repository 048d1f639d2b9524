"""Families, suites, sites: who moves where, and what makes windows of training unlike."""

from collections import Counter
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
import torch

from radard.errors import UsageError
from radard.judge.installation import N_INSTALLATION
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.points import Points
from x2train.commands.fit import stream_of
from x2train.judge.suites import SUITES, n_more_pets, named_suites, suite_of
from x2train.nets.map_fit import augmented
from x2train.sets.families import FAMILIES, LABELS, PAIRS, draw_cast, families
from x2train.sets.passages import DomainRandomization, RandomizedActor
from x2train.sets.sites import X2, draw_radar, draw_site
from x2train.sets.window_set import ADULT_DB, known_of

N_DRAWS = 1500
ANTENNA_M = np.array([0.0, 0.0, 1.2])
KINDS = [("human", "walk"), ("dog", "trot"), ("cat", "stalk"), ("fan", None)]
T_S = np.linspace(0, 9, 90)


def casts(label, use):
    rng = np.random.default_rng(0)
    return [draw_cast(rng, label, use) for _ in range(N_DRAWS)]


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
        assert {f.options["style"]: f.weight for f in trained if f.kind == name} == species.taught
    assert len({f.name for f in FAMILIES}) == len(FAMILIES)


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("use", ["train", "all"])
def test_the_first_gives_the_label_and_company_comes_as_often_as_stated(label, use):
    made = casts(label, use)
    assert {cast[0].label for cast in made} == {label}
    counts = Counter(cast[1].label for cast in made if len(cast) == 2)
    for (who, company), share in PAIRS.items():
        is_left_out = use == "train" and (who, company) == ("human", "pet")
        if who == label:
            expected = 0 if is_left_out else share * N_DRAWS
            assert abs(counts[company] - expected) <= 4 * np.sqrt(expected)


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
        named_suites(["fan", "cats"])


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


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


def maps():
    draws = rng()
    shapes = ((101, 40), (80, 40), (61, 24), (81, 9))
    made = [torch.rand(64, *shape, generator=draws) for shape in shapes]
    # Mostly empty, like the true ones.
    return [m * (m > 0.6) for m in made]


def test_shapes_and_range_stay_and_what_was_given_too():
    given, before = maps(), maps()
    for seed in range(5):
        for new, old in zip(augmented(*given, rng=rng(seed)), given, strict=True):
            assert (new.shape, new.dtype) == (old.shape, torch.float32)
            assert 0 <= new.min() <= new.max() <= 1
    for old, same in zip(given, before, strict=True):
        assert torch.equal(old, same)
    assert len(augmented(*given[:2], rng=rng())) == 2


def actor(kind="human", style="walk", **more):
    options = {"position_m": [0.1, 1.5]} if style is None else {"style": style, "course": "cross"}
    made = RandomizedActor(kind, MappingProxyType(options), kind, antenna_m=(0.0, 0.0, 1.2))
    return replace(made, **more)


class Clock:
    """A mover of three points that tells its own time."""

    label = "pet"
    names = ("a", "b", "c")

    def at(self, t_s, antenna_m):  # noqa: ARG002 - a mover's signature
        position = np.repeat(t_s[:, None, None], 3, axis=1) * np.ones(3)
        return Points(position, 1 + 0.5 * np.sin(t_s[:, None] + np.arange(3)))


@pytest.mark.parametrize(("kind", "style"), KINDS)
def test_label_names_and_mean_gain_stay(kind, style):
    for seed in range(6):
        plain = actor(kind, style, is_plain=True).make(np.random.default_rng(seed))
        made = actor(kind, style).make(np.random.default_rng(seed))
        assert isinstance(made, DomainRandomization)
        assert (made.label, made.names) == (plain.label, plain.names)
        assert made.gain.mean() == pytest.approx(1, abs=1e-12)
        assert made.gain.min() > 0
        assert made.gain.shape == (len(made.names),)


@pytest.mark.parametrize(("kind", "style"), KINDS)
def test_its_clock_never_stops_and_never_runs_back(kind, style):
    t_s = np.arange(0, 30, 1 / 200)
    for seed in range(8):
        made = replace(actor(kind, style).make(np.random.default_rng(seed)), mover=Clock())
        made = replace(made, gain=np.ones(3), is_constant=False)
        pace = np.diff(made.at(t_s, ANTENNA_M).position_m[:, 0, 0]) * 200
        assert 0.4 < pace.min() <= pace.max() < 1.7
        assert 0.8 < made.pace < 1.25


def randomization(**more):
    settings = {"gain": np.array([0.5, 1.0, 1.5]), "contrast": 1.0, "joins": False}
    settings |= {"is_constant": False, "begin_s": 0.0, "pace": 1.0, "wave": np.zeros((3, 4))}
    return DomainRandomization(Clock(), Clock.label, Clock.names, **settings | more)


def test_constant_cross_sections_keep_their_mean():
    made = randomization(is_constant=True)
    rcs = made.at(T_S, ANTENNA_M).rcs_m2
    free = replace(made, is_constant=False).at(T_S, ANTENNA_M).rcs_m2
    assert np.ptp(rcs, axis=0).max() == 0
    np.testing.assert_allclose(rcs[0], free.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(free, Clock().at(T_S, ANTENNA_M).rcs_m2 * made.gain, rtol=1e-12)


@pytest.mark.parametrize("contrast", [0.7, 1.0, 1.8])
def test_contrast_parts_strong_from_weak_and_keeps_the_whole(contrast):
    plain, made = (
        randomization(gain=np.array([0.1, 0.9, 2.0]), contrast=each)
        .at(T_S, ANTENNA_M)
        .rcs_m2.mean(axis=0)
        for each in (1.0, contrast)
    )
    assert made.sum() == pytest.approx(plain.sum(), rel=1e-12)
    ratios = [np.log(each[2] / each[0]) for each in (plain, made)]
    assert ratios[1] == pytest.approx(contrast * ratios[0], rel=1e-9)


def test_joined_parts_are_one_in_their_middle_and_the_weak_stay():
    class Spread(Clock):
        def at(self, t_s, antenna_m):
            points = super().at(t_s, antenna_m)
            return Points(points.position_m + np.arange(3)[:, None], points.rcs_m2)

    apart = replace(randomization(gain=np.array([1.0, 1.0, 0.01])), mover=Spread())
    before, after = apart.at(T_S, ANTENNA_M), replace(apart, joins=True).at(T_S, ANTENNA_M)
    np.testing.assert_allclose(after.rcs_m2.sum(axis=1), before.rcs_m2.sum(axis=1), rtol=1e-12)
    assert (after.rcs_m2[:, 1] == 0).all()
    assert (after.position_m[:, 0] >= before.position_m[:, 0]).all()
    assert (after.position_m[:, 0] <= before.position_m[:, 1]).all()
    np.testing.assert_array_equal(after.position_m[:, 2], before.position_m[:, 2])
    np.testing.assert_array_equal(after.rcs_m2[:, 2], before.rcs_m2[:, 2])


def test_who_goes_is_met_on_the_way_and_not_long_after_the_arrival():
    # Across the room in some seconds, and then standing there, often in view.
    t_s = np.arange(0, 14, 0.05)
    for seed in range(30):
        made = actor(lead_s=(0.2, 2.5), is_plain=True).make(np.random.default_rng(seed))
        middle = made.at(t_s, ANTENNA_M).position_m.mean(axis=1)
        assert np.linalg.norm(middle[-1] - middle[0]) > 0.5


def windows(n=400):
    rng = np.random.default_rng(1)
    names = ("height_m", "tilt_deg", "level_db")
    made = {name: np.repeat(rng.uniform(1, 3, n // 4), 4) for name in names}
    made |= {"passage": np.arange(n) // 4, "frame_rate_hz": np.full(n, 120.0)}
    made |= {"echo_db": made["level_db"] + ADULT_DB, "is_physical": np.ones(n, bool)}
    return made | {"label": np.zeros(n, np.int64)}


def test_a_passage_knows_the_same_all_along():
    made = windows()
    known = known_of(made)
    assert known.shape == (400, N_INSTALLATION)
    assert (known[:, 0] == 1).all()
    by_passage = known.reshape(100, 4, N_INSTALLATION)
    assert (by_passage == by_passage[:, :1]).all()
    for k in (1, 5):
        assert 0.4 < by_passage[:, 0, k].mean() < 0.8
    assert (known[:, 1] == known[:, 3]).all()  # a mount is known as a whole
    # It draws the same in any company.
    made = windows()
    some = {key: values[100:120] for key, values in made.items()}
    np.testing.assert_array_equal(known_of(made)[100:120], known_of(some))
    # Fewer know the level where size says nothing of the echo.
    shares = [
        known_of(windows(4000) | {"is_physical": np.full(4000, is_physical)})[:, 5].mean()
        for is_physical in (True, False)
    ]
    assert shares == pytest.approx([0.6, 0.04], abs=0.02)
