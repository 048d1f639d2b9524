"""Gaits and sizes of people, pets and birds: strides, footfalls and masses as published."""

import math

import numpy as np
import pytest

from tests.body_helpers import PETS, draw, drawn, parts, past, speeds, strongest_hz
from x2radar.sim.bodies.flyer import BIRD_MASS_KG, MOTH_BEAT_HZ
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.motion.quadrupeds.gait import GRAVITY_MPS2, duty, froude, stride_m
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.pet import PET_STYLES
from x2radar.sim.bodies.skeleton.skeleton import LEGS, PERSON, PersonBuild, QuadrupedBuild
from x2radar.sim.bodies.skeleton.species import SPECIES

STAYING = [(k, s) for k, s in PETS if not PET_STYLES[s].froude and s != "jump"]
HIP_M = {"dog": 0.44, "cat": 0.24, "rabbit": 0.14}


def speed_at(fr, species):
    return math.sqrt(fr * GRAVITY_MPS2 * HIP_M[species])


def footing(pet):
    """For each leg: when and where it lands at a steady speed, and the share of time it stands."""
    t_s = np.linspace(1.5, 5.5, 2001)
    at = parts(pet, t_s)
    legs = []
    for leg in LEGS:
        x = at[f"{leg} paw"][:, 0]
        stands = np.abs(np.diff(x)) < 1e-9
        lands = np.flatnonzero(stands[1:] & ~stands[:-1]) + 1
        legs.append((t_s[lands], x[lands], stands.mean()))
    return legs


@pytest.mark.parametrize(
    ("species", "style", "fr", "factor", "power"),
    [
        ("dog", "walk", 0.1, 2.4, 0.34),
        ("dog", "trot", 1.9, 2.4, 0.34),
        ("dog", "pace", 1.0, 2.4, 0.34),
        ("dog", "canter", 4.0, 1.9, 0.40),
        ("cat", "walk", 0.2, 3.5, 0.42),
        ("cat", "bound", 4.0, 3.5, 0.42),
        ("rabbit", "bound", 0.3, 2.2, 0.40),
        ("rabbit", "bound", 3.0, 2.2, 0.40),
    ],
)
def test_strides_and_stances_are_as_long_as_published(species, style, fr, factor, power):
    speed = speed_at(fr, species)
    ratio, stands = [], []
    for seed in range(8):
        pet = drawn(species, style, seed, path=past(speed))
        h = QuadrupedBuild(np.random.default_rng(seed), SPECIES[species]).hip_m
        fr_own = float(froude(speed, h))
        wanted = pytest.approx(factor * h * fr_own**power, rel=0.25)
        assert stride_m(np.array([speed]), h, SPECIES[species]) == wanted
        feet = footing(pet)
        steps = np.concatenate([np.diff(x) for _, x, _ in feet])
        ratio.append(np.mean(steps) / stride_m(np.array([speed]), h, SPECIES[species])[0])
        share = np.mean([stand for *_, stand in feet])
        stands.append(share - float(duty(np.array([speed]), h)[0]))
    # Animals scatter by 6 %; their mean does not.
    assert np.mean(ratio) == pytest.approx(1, abs=0.05)
    assert 0.02 < np.std(ratio) < 0.1
    assert np.mean(stands) == pytest.approx(0, abs=0.06)


PAIRS = {
    # Lateral sequence: hind, fore of the same side, other hind, other fore.
    "walk": (0.25, 0.5, 0.75),
    "trot": (0.5, 0.5, 0.0),
    "pace": (0.06, 0.5, 0.56),
    # Three beats: one hind, the other with the fore across, the leading fore.
    "canter": (0.3, 0.28, 0.56),
    "bound": (0.46, 0.06, 0.53),
}


@pytest.mark.parametrize(
    ("species", "style"),
    [("dog", "walk"), ("dog", "trot"), ("dog", "pace"), ("dog", "canter"), ("cat", "bound")],
)
def test_feet_fall_in_the_order_of_the_gait_on_either_lead(species, style):
    leads = set()
    low, high = PET_STYLES[style].froude
    for seed in range(8):
        pet = drawn(species, style, seed, path=past(speed_at(0.5 * (low + high), species)))
        first = [t for t, *_ in footing(pet)]
        stride_s = np.diff(first[0]).mean()
        after = [np.exp(2j * np.pi * (t - first[0][1]) / stride_s).mean() for t in first]
        found = [float(np.angle(x) / (2 * np.pi) % 1) for x in after]
        mirrored = [(x - found[2]) % 1 for x in (found[3], found[0], found[1])]
        apart = [
            max(abs((a - b + 0.5) % 1 - 0.5) for a, b in zip(order, PAIRS[style], strict=True))
            for order in (found[1:], mirrored)
        ]
        assert min(apart) < 0.05
        leads.add(int(np.argmin(apart)))
    if style in {"canter", "bound"}:
        assert leads == {0, 1}


def test_masses_and_hips_are_those_of_pets():
    rng = np.random.default_rng(0)
    builds = {k: [QuadrupedBuild(rng, row) for _ in range(300)] for k, row in SPECIES.items()}
    kg = {name: np.array([b.mass_kg for b in rows]) for name, rows in builds.items()}
    for name, low, high in (("cat", 2.5, 7.0), ("dog", 3.0, 60.0), ("rabbit", 1.0, 3.0)):
        assert low <= kg[name].min() < kg[name].max() <= high
    bands = ((3, 10), (10, 25), (25, 60))
    share = [((kg["dog"] >= low) & (kg["dog"] < high)).mean() for low, high in bands]
    assert share == pytest.approx([0.4, 0.35, 0.25], abs=0.08)
    assert np.mean([b.hip_m for b in builds["cat"]]) == pytest.approx(0.24, abs=0.015)
    twenty = [QuadrupedBuild(rng, SPECIES["dog"], 20.0).hip_m for _ in range(100)]
    assert np.mean(twenty) == pytest.approx(0.44, abs=0.02)
    assert np.std(twenty) > 0.02
    for b in builds["cat"] + builds["dog"] + builds["rabbit"]:
        # A trunk of water holds 55 % of the mass.
        volume_m3 = 4 / 3 * math.pi * np.prod(b.half_lengths()[0])
        assert 1000 * volume_m3 == pytest.approx(0.55 * b.mass_kg)
        assert b.upper_m + b.lower_m > b.hip_m


@pytest.mark.parametrize(("species", "style"), STAYING)
def test_one_that_stays_does_so_where_the_path_begins(species, style):
    pet = drawn(species, style, 0, path=Path.through(((1.0, 2.0), (1.0, 4.0)), 0.5))
    pose = pet.motion(np.arange(0, 30, 0.5))
    plays = style == "play"
    assert np.abs(pose.centre_m[:, 0, :2] - [1.0, 2.0]).max() < (0.4 if plays else 0.03)
    assert (pose.axis[:, 0, 1].min() > 0.7) is not plays


def beat_hz(flyer):
    """How often its wings beat, by what their height does over 20 s."""
    up = flyer.motion(np.arange(0, 20, 1 / 200)).axis[:, flyer.names.index("left inner wing"), 2]
    return strongest_hz(up, 1 / 200)


def span_m(moth):
    """Its wings' span: the middle of an inner wing is at 11 % of it from the body's."""
    at = parts(moth, np.zeros(1))
    return float(np.linalg.norm(at["left inner wing"] - at["body"])) / 0.11


def test_small_birds_and_moths_beat_faster_and_within_what_is_published():
    beats = {
        kg: np.mean([beat_hz(draw("pigeon", "", k, mass_kg=kg)) for k in range(12)])
        for kg in (0.02, 0.035, 0.1, 0.3)
    }
    assert list(beats.values()) == sorted(beats.values(), reverse=True)
    assert beats[0.035] == pytest.approx(14, abs=1.5)
    assert beats[0.3] == pytest.approx(7.7, abs=0.8)
    every = [beat_hz(draw(kind, "", k)) for kind in BIRD_MASS_KG for k in range(10)]
    assert 6 < min(every) < max(every) < 20
    drawn_moths = [draw("moth", "", seed) for seed in range(60)]
    moths = np.array([beat_hz(m) for m in drawn_moths])
    assert MOTH_BEAT_HZ[0] <= moths.min() < 28
    assert 45 < moths.max() <= MOTH_BEAT_HZ[1]
    assert np.corrcoef([span_m(m) for m in drawn_moths], moths)[0, 1] < -0.7


STEP_S = 1 / 200
T_S = 2.5 + np.arange(800) * STEP_S
"""Four seconds in which a walker goes at its speed."""


def walker(speed_mps, seed=0, motion="gait"):
    return drawn("human", "walk", seed, path=((0, 14), (0, 1)), speed_mps=speed_mps, motion=motion)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("speed", [0.6, 1.3])
def test_every_motion_has_the_cadence_and_the_feet_of_people(motion, speed):
    cadence, peak, head = [], [], []
    for seed in range(16):
        place = parts(walker(speed, seed, motion), T_S)
        foot = speeds(place["left foot"], STEP_S)
        # A foot goes once a stride of two steps.
        cadence.append(120 * strongest_hz(foot, STEP_S, 0.35, 1.4))
        peak.append(foot.max() / speed)
        head.append(np.median(speeds(place["head"], STEP_S)))
    # Steps of 6.5 mm for every step a minute (docs/research/scenes.md).
    assert np.median(cadence) == pytest.approx(np.sqrt(60 * speed / 0.0065), rel=0.12)
    assert 2.7 < np.median(peak) < 4.1
    assert np.median(head) == pytest.approx(speed, rel=0.15)


def test_sizes_are_those_of_adults_children_and_toddlers():
    rng = np.random.default_rng(0)
    adults = [PersonBuild(rng).stature_m for _ in range(300)]
    assert 1.64 < np.mean(adults) < 1.76
    assert 0.06 < np.std(adults) < 0.13
    for age, low, high in (("toddler", 0.75, 0.95), ("child", 0.95, 1.45)):
        statures = [PersonBuild(rng, age=age).stature_m for _ in range(50)]
        assert low <= min(statures) <= max(statures) <= high
    legs = [
        PersonBuild(np.random.default_rng(0), age=age, height_m=1.05).hip_height_m
        for age in ("toddler", "child", "adult")
    ]
    assert legs == sorted(legs)
    build = PersonBuild(rng, height_m=1.9)
    assert build.hip_height_m == pytest.approx(0.53 * 1.9, rel=0.06)
    # The trunk is as long as its ends.
    trunk, chest, pelvis = build.half_lengths()[: PERSON.n_trunk]
    assert trunk[0] > chest[0] + pelvis[0]
    assert trunk[1:] == pytest.approx(chest[1:])
