"""Four-legged animals: published strides, orders of footfalls, paws that stand, what they do."""

import math

import numpy as np
import pytest

from tests.body_helpers import (
    ANTENNA_M,
    GOING,
    PETS,
    drawn,
    parts,
    past,
    places,
    speeds,
    strongest_hz,
)
from x2radar.sim.bodies.motion.quadrupeds.gait import GRAVITY_MPS2, duty, froude, stride_m
from x2radar.sim.bodies.motion.quadrupeds.jumping import Leap
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.pet import PET_STYLES
from x2radar.sim.bodies.skeleton.quadrupeds import LEGS, draw_build
from x2radar.sim.bodies.skeleton.species import SPECIES

STAYING = [(k, s) for k, s in PETS if not PET_STYLES[s].froude and s != "jump"]
PAWS = [f"{leg} paw" for leg in LEGS]
HIP_M = {"dog": 0.44, "cat": 0.24, "rabbit": 0.14}


def speed_at(fr, species):
    return math.sqrt(fr * GRAVITY_MPS2 * HIP_M[species])


def landings(pet, leg):
    """When and where a leg lands while the speed is steady."""
    falls = pet.motion.action.feet.falls
    t, x = falls.touch_down_s[:, leg], falls.place[:, leg, 0]
    steady = (t > 1.5) & (t < 5.5)
    return t[steady], x[steady]


# ---------------------------------------------------------------- gaits


@pytest.mark.parametrize(
    ("species", "style", "fr", "factor", "power"),
    [
        ("dog", "walk", 0.1, 2.4, 0.34),
        ("dog", "walk", 0.4, 2.4, 0.34),
        ("dog", "trot", 0.8, 2.4, 0.34),
        ("dog", "trot", 1.9, 2.4, 0.34),
        ("dog", "pace", 1.0, 2.4, 0.34),
        ("dog", "canter", 4.0, 1.9, 0.40),
        ("cat", "walk", 0.2, 3.5, 0.42),
        ("cat", "trot", 1.0, 3.5, 0.42),
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
        h = pet.motion.build.hip_m
        fr_own = float(froude(speed, h))
        wanted_m = factor * h * fr_own**power
        assert stride_m(np.array([speed]), h, SPECIES[species]) == pytest.approx(
            wanted_m, rel=0.25
        )
        steps = np.concatenate([np.diff(landings(pet, leg)[1]) for leg in range(4)])
        ratio.append(np.mean(steps) / stride_m(np.array([speed]), h, SPECIES[species])[0])
        t_s = np.linspace(1.5, 5.5, 400)
        share = pet.motion.action.feet.at(t_s).is_stance.mean()
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
        first = [landings(pet, leg)[0] for leg in range(4)]
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


@pytest.mark.parametrize(("species", "style"), GOING)
def test_paws_stand_still_where_they_stand(species, style):
    pet = drawn(species, style, 2)
    t_s = np.arange(0, 8, 0.005)
    stands = pet.motion.action.feet.at(t_s).is_stance
    place, b = places(pet, t_s), pet.motion.build
    for leg, name in enumerate(PAWS):
        both = stands[1:, leg] & stands[:-1, leg]
        # A stance lost between two samples would show as a step of centimetres.
        assert both.mean() > 0.2
        assert np.abs(np.diff(place[name], axis=0)[both]).max() < 1e-12
        assert place[name][stands[:, leg], 2] == pytest.approx(0.25 * b.paw_m)
        lifted = place[name][:, 2].max() - 0.25 * b.paw_m
        assert 0.05 * b.hip_m < lifted < 0.25 * b.hip_m


@pytest.mark.parametrize("motion", ["footfalls", "angles"])
@pytest.mark.parametrize(
    ("species", "style"),
    [("dog", "walk"), ("dog", "trot"), ("dog", "canter"), ("dog", "roam"), ("cat", "stalk")],
)
def test_paws_of_drawn_gaits_reach_the_floor_and_do_not_go_through_it(species, style, motion):
    for seed in range(4):
        pet = drawn(species, style, seed, path=((0.0, 5.0), (0.0, 1.0)), motion=motion)
        place = parts(pet, np.arange(0.5, 4.0, 1 / 60))
        height = np.stack([place[name][:, 2] for name in PAWS], axis=1)
        assert height.min() > -0.06
        assert (height.min(axis=1) < 0.12).mean() > 0.6


@pytest.mark.parametrize("style", ["walk", "trot", "pace"])
def test_the_trunk_bobs_twice_a_stride_keeps_to_the_path_and_rests_at_its_end(style):
    fr = {"walk": 0.3, "trot": 1.2, "pace": 1.0}[style]
    pet = drawn("dog", style, 1, path=past(speed_at(fr, "dog")))
    action = pet.motion.action
    t_s = np.arange(1.5, 5.5, 0.005)
    stance, state = action.at(t_s), action.path.at(t_s)
    off = np.hypot(stance.middle_m[:, 0] - state.x_m, stance.middle_m[:, 1] - state.y_m)
    assert off.max() < 0.05
    assert np.abs(stance.pitch_rad).max() < 0.3
    # Ends of the trunk; in a walk they go against each other.
    front = stance.middle_m[:, 2] + 0.5 * action.build.back_m * np.sin(stance.pitch_rad)
    stride_s = np.diff(landings(pet, 0)[0]).mean()
    assert strongest_hz(front, 0.005, 0.3) == pytest.approx(2 / stride_s, rel=0.1)
    assert 0.003 < np.ptp(front) / 2 < 0.05
    rest = action.at(action.path.end_s + np.linspace(3, 9, 30))
    assert np.ptp(rest.middle_m[:, 2]) < 1e-12


# ---------------------------------------------------------------- sizes and styles


def test_masses_and_hips_are_those_of_pets():
    rng = np.random.default_rng(0)
    builds = {name: [draw_build(rng, row) for _ in range(300)] for name, row in SPECIES.items()}
    kg = {name: np.array([b.mass_kg for b in rows]) for name, rows in builds.items()}
    for name, low, high in (("cat", 2.5, 7.0), ("dog", 3.0, 60.0), ("rabbit", 1.0, 3.0)):
        assert low <= kg[name].min() < kg[name].max() <= high
    bands = ((3, 10), (10, 25), (25, 60))
    share = [((kg["dog"] >= low) & (kg["dog"] < high)).mean() for low, high in bands]
    assert share == pytest.approx([0.4, 0.35, 0.25], abs=0.08)
    assert np.mean([b.hip_m for b in builds["cat"]]) == pytest.approx(0.24, abs=0.015)
    twenty = [draw_build(rng, SPECIES["dog"], 20.0).hip_m for _ in range(100)]
    assert np.mean(twenty) == pytest.approx(0.44, abs=0.02)
    assert np.std(twenty) > 0.02
    for b in builds["cat"] + builds["dog"] + builds["rabbit"]:
        # A trunk of water holds 55 % of the mass.
        volume_m3 = 4 / 3 * math.pi * np.prod(b.half_lengths()[0])
        assert 1000 * volume_m3 == pytest.approx(0.55 * b.mass_kg)
        assert b.upper_m + b.lower_m > b.hip_m


@pytest.mark.parametrize(
    ("species", "style", "least", "most"),
    [
        ("dog", "lie", 15, 30),
        ("cat", "lie", 20, 30),
        ("rabbit", "lie", 30, 60),
        ("dog", "pant", 240, 360),
    ],
)
def test_breathing_has_the_rate_and_the_depth_of_the_animal(species, style, least, most):
    t_s = np.arange(0, 40, 0.05)
    for seed in range(3):
        pet = drawn(species, style, seed)
        still, seen = parts(pet, t_s)["trunk"], places(pet, t_s)["trunk"]
        # What breathing adds to the range of the trunk, its sway apart.
        swell = np.linalg.norm(still - ANTENNA_M, axis=1) - np.linalg.norm(
            seen - ANTENNA_M, axis=1
        )
        assert 0.0003 < np.abs(swell).max() < 0.006
        assert np.abs(swell).max() == pytest.approx(pet.breath.size_m, rel=0.03)
        assert least - 1 <= 60 * strongest_hz(swell, 0.05) <= most + 1
        assert swell == pytest.approx(pet.breath.at(t_s), abs=1e-9)
        if style == "lie":
            assert np.ptp(still, axis=0).max() < 0.001


@pytest.mark.parametrize(("species", "style"), STAYING)
def test_one_that_stays_does_so_where_the_path_begins(species, style):
    pet = drawn(species, style, 0, path=Path.through(((1.0, 2.0), (1.0, 4.0)), 0.5))
    pose = pet.motion.pose(np.arange(0, 30, 0.5))
    plays = style == "play"
    assert np.abs(pose.centre_m[:, 0, :2] - [1.0, 2.0]).max() < (0.4 if plays else 0.03)
    assert (pose.axis[:, 0, 1].min() > 0.7) is not plays


@pytest.mark.parametrize("species", SPECIES)
def test_who_scratches_does_so_with_one_hind_paw_in_bouts(species):
    pet = drawn(species, "scratch", 3)
    place = parts(pet, np.arange(0, 40, 0.01))
    speed = np.stack([speeds(place[name], 0.01) for name in PAWS], axis=1)
    scratch = pet.motion.action.scratch
    assert LEGS[scratch.leg].endswith("hind")
    assert 0.2 < (speed[:, scratch.leg] > 0.2).mean() < 0.95
    assert np.delete(speed, scratch.leg, axis=1).max() < 1e-9
    height = place[PAWS[scratch.leg]][:, 2]
    assert strongest_hz(np.diff(height), 0.01) == pytest.approx(scratch.hz, abs=0.2)


# ---------------------------------------------------------------- jumps


@pytest.mark.parametrize("species", SPECIES)
@pytest.mark.parametrize("seed", range(4))
def test_a_jump_leads_onto_furniture_and_down_again(species, seed):
    pet = drawn(species, "jump", seed)
    up, down = pet.motion.action.leaps
    h, climb = pet.motion.build.hip_m, up.climb_m
    assert 0.2 <= climb <= 0.9
    times = (
        up.begin_s - 0.1,
        down.begin_s - 0.05,
        down.still_s + 2,
        0.5 * (up.take_off_s + up.touch_down_s),
    )
    place = parts(pet, np.array(times))
    for name in PAWS:
        before, above, after, aloft = place[name][:, 2]
        assert above - before == pytest.approx(climb)
        assert after == pytest.approx(before)
        assert aloft > 0.1 * h
    assert np.diff(place["trunk"][:2, 2])[0] == pytest.approx(climb, abs=0.02 * h)
    hind = parts(pet, np.linspace(up.begin_s, up.take_off_s, 300))["left hind paw"]
    assert np.ptp(hind, axis=0).max() < 1e-9


@pytest.mark.parametrize("climb_m", [0.3, 0.6, 1.0, -0.4, -1.0])
@pytest.mark.parametrize("hip_m", [0.2, 0.6])
def test_a_leap_is_smooth_and_gets_there(climb_m, hip_m):
    leap = Leap.over(1.0, climb_m, 0.7, hip_m, 0.4)
    step_s = 0.0005
    t = np.arange(0, 6, step_s)
    ahead, up, pitch = leap.trunk(t)
    assert (ahead[0], up[0], pitch[0]) == (0.0, 0.0, 0.0)
    assert up[-1] == pytest.approx(climb_m, abs=1e-9)
    assert ahead[-1] == pytest.approx(leap.ahead_m)
    assert pitch[-1] == pytest.approx(0, abs=1e-9)
    # Speeds do not jump, and in the air there is gravity and nothing else.
    for way in (ahead, up):
        assert np.abs(np.diff(way, n=2)).max() / step_s**2 < 250
    air = (t > leap.take_off_s + 0.01) & (t < leap.touch_down_s - 0.01)
    for way, wanted in ((up, -GRAVITY_MPS2), (ahead, 0.0)):
        force = np.gradient(np.gradient(way, step_s), step_s)[air]
        assert force == pytest.approx(wanted, abs=1e-3)
    assert leap.begin_s < leap.leave_s < leap.take_off_s < leap.touch_down_s < leap.still_s
