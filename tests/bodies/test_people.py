"""People: feet that stand, published strides, trunks and arms over them, what hands do."""

import numpy as np
import pytest

from tests.body_helpers import drawn, parts, speeds, strongest_hz
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skeleton.people import PERSON, draw_person_build

STEP_S = 1 / 200
T_S = 2.5 + np.arange(800) * STEP_S
"""Four seconds in which a walker goes at its speed."""


def walker(speed_mps, seed=0, motion="gait"):
    path = ((0, 14), (0, 1))
    return drawn("human", "walk", seed, path=path, speed_mps=speed_mps, motion=motion)


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
