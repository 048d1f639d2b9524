"""People: feet that stand, published strides, trunks and arms over them, what hands do."""

from dataclasses import replace

import numpy as np
import pytest

from tests.body_helpers import drawn, parts, places, speeds, strongest_hz
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.motion.people.gait import STYLES
from x2radar.sim.bodies.skeleton.people import PERSON, draw_person_build

STEP_S = 1 / 200
T_S = 2.5 + np.arange(800) * STEP_S
"""Four seconds in which a walker goes at its speed."""


def walker(speed_mps, seed=0, motion="gait"):
    path = ((0, 14), (0, 1))
    return drawn("human", "walk", seed, path=path, speed_mps=speed_mps, motion=motion)


def ankles(person):
    """Where both ankles are at the times `T_S`."""
    pose, shank_m = person.motion.pose(T_S), person.motion.build.shank_m
    for name in ("left shank", "right shank"):
        k = PERSON.names.index(name)
        yield pose.centre_m[:, k] - pose.axis[:, k] * shank_m / 2


def rate_hz(person):
    """Strides a second, by its own clock."""
    strides = person.motion.feet.clock.at(T_S[[0, -1]])
    return np.diff(strides)[0] / np.diff(T_S[[0, -1]])[0]


@pytest.mark.parametrize("speed", [0.9, 1.2, 1.5])
def test_ankles_stand_still_and_swing_as_fast_as_people_do(speed):
    v = np.array([speeds(a, STEP_S) for seed in range(8) for a in ankles(walker(speed, seed))])
    peaks = v.max(axis=1) / speed
    assert 2.7 <= peaks.mean() <= 3.5
    assert peaks.max() < 4.0
    # From foot-flat to heel-off, about 40 % of the cycle.
    assert np.mean(v < 0.05) == pytest.approx(0.42, abs=0.06)


@pytest.mark.parametrize("speed", [0.6, 1.0, 1.4])
def test_strides_follow_the_published_relation(speed):
    ratio = []
    for seed in range(12):
        person = walker(speed, seed)
        height_m = person.motion.build.hip_height_m
        wanted_m = 1.346 * np.sqrt(speed / height_m) * height_m
        ratio.append(speed / rate_hz(person) / wanted_m)
    # People scatter by 6 %; their mean does not.
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)
    assert 0.0 < np.std(ratio) < 0.12


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


@pytest.mark.parametrize("style", [s for s in STYLES if STYLES[s].kind != "crawl"])
def test_knees_bend_forward(style):
    person = drawn("human", style, 3, path=((0.0, 9.0), (0.0, 1.0)))
    motion = getattr(person.motion, "motion", person.motion)
    t_s = np.linspace(1, max(motion.path.end_s - 1, 3), 300)
    pose, b = motion.pose(t_s), motion.build
    for side in ("left", "right"):
        thigh, shank = (PERSON.names.index(f"{side} {name}") for name in ("thigh", "shank"))
        top = pose.centre_m[:, thigh] + pose.axis[:, thigh] * b.thigh_m / 2
        knee = pose.centre_m[:, thigh] - pose.axis[:, thigh] * b.thigh_m / 2
        ankle = pose.centre_m[:, shank] - pose.axis[:, shank] * b.shank_m / 2
        # Everybody goes down the y axis.
        assert (0.5 * (top + ankle) - knee)[:, 1].min() > -0.02


@pytest.mark.parametrize("speed", [0.3, 0.7, 1.3])
def test_hips_bob_and_surge_twice_a_stride_and_are_slowest_over_the_standing_foot(speed):
    for seed in range(3):
        person = walker(speed, seed)
        pelvis = parts(person, T_S)["pelvis"]
        if speed > 1:
            bob_hz = strongest_hz(pelvis[:, 2], STEP_S, 0.5)
            assert bob_hz == pytest.approx(2 * rate_hz(person), abs=0.1)
        ahead = person.motion.path.at(T_S).y_m - pelvis[:, 1]
        phase = 4 * np.pi * (person.motion.feet.clock.at(T_S) - 0.5 * person.motion.duty)
        amplitude = -2 * np.mean((ahead - ahead.mean()) * np.sin(phase))
        assert amplitude == pytest.approx(person.motion.carriage.surge_m, rel=0.25)
        assert 0.008 < amplitude < 0.035


# ---------------------------------------------------------------- what is done besides


@pytest.mark.parametrize("height_m", [1.75, 1.2])
def test_a_chest_breathes_and_a_heart_beats_and_both_are_quicker_in_children(height_m):
    t_s, rates, beats = np.arange(0, 60, 0.1), [], []
    for seed in range(8):
        person = drawn("human", "stand", seed, height_m=height_m, path=((0.0, 2.0), (0.0, 1.0)))
        breath = person.breath
        still, moved = parts(person, t_s)["trunk"], places(person, t_s)["trunk"]
        swell = np.linalg.norm(moved - still, axis=-1).max()
        assert 0.0009 < swell < 0.0035
        assert strongest_hz(breath.at(t_s), 0.1) == pytest.approx(breath.rate_hz, abs=0.02)
        heart = replace(breath, size_m=0.0).at(t_s)
        assert strongest_hz(heart, 0.1) == pytest.approx(breath.beat_hz, abs=0.02)
        rates.append(60 * breath.rate_hz)
        beats.append(60 * breath.beat_hz)
    low, high = (8, 26) if height_m > 1.5 else (13, 34)
    assert low < min(rates) < max(rates) < high
    assert 45 < min(beats) < max(beats) < 140


def seen(style, seed, seconds=40.0, step_s=0.02):
    person = drawn("human", style, seed, path=((0, 3), (0, 1)))
    t_s = np.arange(0, seconds, step_s)
    return person, parts(person, t_s)


@pytest.mark.parametrize("style", ["busy", "sit", "exercise"])
def test_elbows_never_snap(style):
    for seed in range(6):
        _, place = seen(style, seed, seconds=6, step_s=0.005)
        for side in ("left", "right"):
            upper, hand = (
                speeds(place[f"{side} {part}"], 0.005).max() for part in ("upper arm", "hand")
            )
            assert upper < hand + 0.5


# ---------------------------------------------------------------- sizes


def test_sizes_are_those_of_adults_children_and_toddlers():
    rng = np.random.default_rng(0)
    adults = [draw_person_build(rng).stature_m for _ in range(300)]
    assert 1.64 < np.mean(adults) < 1.76
    assert 0.06 < np.std(adults) < 0.13
    for age, low, high in (("toddler", 0.75, 0.95), ("child", 0.95, 1.45)):
        statures = [draw_person_build(rng, age=age).stature_m for _ in range(50)]
        assert low <= min(statures) <= max(statures) <= high
    legs = [
        draw_person_build(np.random.default_rng(0), age=age, height_m=1.05).hip_height_m
        for age in ("toddler", "child", "adult")
    ]
    assert legs == sorted(legs)
    build = draw_person_build(rng, height_m=1.9)
    assert build.hip_height_m == pytest.approx(0.53 * 1.9, rel=0.06)
    # The trunk is as long as its ends.
    trunk, chest, pelvis = build.half_lengths()[: PERSON.n_trunk]
    assert trunk[0] > chest[0] + pelvis[0]
    assert trunk[1:] == pytest.approx(chest[1:])
