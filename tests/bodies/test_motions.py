"""Motion generators: feet that stand, limbs of one length, bodies that go where they should."""

import numpy as np
import pytest

from x2radar.sim.bodies.motion.curves import N_HARMONICS, WALK_KNEE, JointCurve, harmonics
from x2radar.sim.bodies.motion.limbs import bent
from x2radar.sim.bodies.motion.stride_phase import Footprints, StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.angle_motion import AnglePerson
from x2radar.sim.bodies.person.build import NAMES, draw_person_build
from x2radar.sim.bodies.person.footfall_motion import (
    FootfallPerson,
    draw_gesture,
    draw_ways,
    sides,
)
from x2radar.sim.bodies.person.person import draw_person
from x2radar.sim.bodies.person.torso import Torso
from x2radar.sim.bodies.quadruped.pet import draw_pet

T_S = np.arange(0, 6, 1 / 60)


def person(kind, seed=0, style="walk", speed=1.2):
    rng = np.random.default_rng(seed)
    build = draw_person_build(rng)
    path = Path.through([(0.0, 8.0), (0.0, 0.5)], speed)
    if kind == "footfalls":
        return FootfallPerson.plan(
            rng, path, build, draw_ways(rng, style), draw_gesture(rng)
        ), build
    return AnglePerson.draw(rng, path, build, style, draw_gesture(rng)), build


def ends(motion, build, t_s):
    centre, axis, _ = motion.posture(t_s)
    half = build.half_lengths()[:, :1]
    return centre - half * axis, centre + half * axis


@pytest.mark.parametrize("kind", ["footfalls", "angles"])
@pytest.mark.parametrize("seed", range(5))
def test_limbs_keep_their_length_and_join(kind, seed):
    motion, build = person(kind, seed)
    begin, end = ends(motion, build, T_S)
    for upper, lower in (("left thigh", "left shank"), ("right upper arm", "right forearm")):
        knee = end[:, NAMES.index(upper)] - begin[:, NAMES.index(lower)]
        assert np.abs(knee).max() < 0.02


@pytest.mark.parametrize("kind", ["footfalls", "angles"])
@pytest.mark.parametrize("seed", range(5))
def test_the_trunk_goes_where_the_path_goes(kind, seed):
    motion, _ = person(kind, seed)
    centre, _, _ = motion.posture(T_S)
    state = motion.path.at(T_S)
    trunk = centre[:, 0]
    assert np.abs(trunk[:, 0] - state.x_m).max() < 0.15
    assert np.abs(trunk[:, 1] - state.y_m).max() < 0.45  # somebody who leans
    assert (np.abs(centre[:, NAMES.index("head"), 2]) < 2.3).all()


@pytest.mark.parametrize("seed", range(8))
def test_a_standing_foot_stands(seed):
    rng = np.random.default_rng(seed)
    path = Path.through([(0.0, 6.0), (1.0, 3.0), (-1.0, 1.0)], 1.1)
    phase = StridePhase.along(path, lambda v: 0.4 + 0.6 * v)
    duty = rng.uniform(0.4, 0.7)
    prints = Footprints.plan(path, phase, offset=0.3, duty=duty, home_m=(0.0, 0.1), lift_m=0.1)
    t_s = np.arange(0, 8, 0.01)
    place, swing = prints.at(t_s, np.ones(len(t_s)))
    stands = (swing[1:] == 0) & (swing[:-1] == 0)
    assert stands.mean() > 0.3
    assert np.abs(np.diff(place, axis=0)[stands]).max() < 1e-12
    assert (place[:, 2] >= 0).all()
    assert place[:, 2].max() == pytest.approx(0.1, rel=0.05)
    # It stands under the body: half-way through a stance the body is over it.
    middle = phase.time_s(np.arange(2.0, 5.0) + 0.3 + 0.5 * duty)
    at, _ = prints.at(middle, np.ones(3))
    body = path.at(middle)
    assert np.hypot(at[:, 0] - body.x_m, at[:, 1] - body.y_m) == pytest.approx(0.1, abs=0.01)


def test_standing_still_stops_the_phase():
    path = Path.stop_and_go([(0.0, 6.0), (0.0, 2.0)], 1.0, [(1.5, 2.0)])
    phase = StridePhase.along(path, lambda v: np.full_like(v, 1.2))
    t_s = np.arange(path.start_s, path.end_s, 0.01)
    still = path.at(t_s).speed_mps == 0
    assert still.sum() > 150
    strides = phase.at(t_s)
    assert np.abs(np.diff(strides)[still[1:] & still[:-1]]).max() < 2e-3
    assert strides[-1] == pytest.approx(path.length_m / 1.2, rel=0.02)


@pytest.mark.parametrize("far_m", [0.3, 0.8, 1.5])
def test_a_limb_reaches_or_is_stretched(far_m):
    top, end = np.array([[0.0, 0.0, 1.0]]), np.array([[far_m, 0.0, 1.0]])
    joint, reached = bent(top, end, 0.5, 0.5, np.array([[0.0, 0.0, 1.0]]))
    assert np.linalg.norm(joint - top) == pytest.approx(0.5)
    assert np.linalg.norm(reached - joint) == pytest.approx(0.5)
    assert reached[0, 0] == pytest.approx(min(far_m, 0.995))
    assert joint[0, 2] >= 1.0


def test_a_curve_without_spread_is_the_published_one():
    c = harmonics(WALK_KNEE)
    curve = JointCurve(float(c[0].real), 2 * np.abs(c[1:]), np.angle(c[1:]))
    phase = np.arange(10) / 10
    made = np.rad2deg(curve.at(phase, np.ones(10)))
    # Four harmonics hold a knee to two degrees.
    assert np.abs(made - WALK_KNEE).max() < 2.5
    assert len(curve.amplitude_rad) == N_HARMONICS


@pytest.mark.parametrize("motion", ["gait", "footfalls", "angles"])
@pytest.mark.parametrize("seed", range(4))
def test_feet_are_faster_than_the_trunk_and_heads_are_not(motion, seed):
    rng = np.random.default_rng(seed)
    body = draw_person(
        rng,
        style="walk",
        path=[(0.0, 9.0), (0.0, 0.5)],
        speed_mps=1.3,
        motion=motion,
        skin="points",
    )
    t_s = np.arange(2.0, 5.0, 1 / 120)
    place = body.at(t_s, np.array([0.0, 0.0, 1.0])).position_m
    speed = np.linalg.norm(np.diff(place, axis=0), axis=-1) * 120
    names = np.array(body.names)
    feet = speed[:, np.char.endswith(names, "foot")].max()
    head = np.median(speed[:, names == "head"])
    assert 2.4 < feet < 7.5
    assert head == pytest.approx(1.3, abs=0.45)


@pytest.mark.parametrize("motion", ["gait", "footfalls", "angles"])
@pytest.mark.parametrize("speed_mps", [0.6, 1.3])
def test_people_walk_at_the_cadence_of_people(motion, speed_mps):
    cadence, peak = [], []
    for seed in range(16):
        body = draw_person(
            np.random.default_rng(seed),
            style="walk",
            path=[(0.0, 9.0), (0.0, 0.5)],
            speed_mps=speed_mps,
            motion=motion,
            skin="points",
        )
        t_s = np.arange(2.0, 5.0, 1 / 120)
        place = body.at(t_s, np.array([0.0, 0.0, 1.0])).position_m
        foot = place[:, body.names.index("left foot")]
        speed = np.linalg.norm(np.diff(foot, axis=0), axis=-1) * 120
        spectrum = np.abs(np.fft.rfft((speed - speed.mean()) * np.hanning(len(speed)), 4096))
        rate_hz = np.fft.rfftfreq(4096, 1 / 120)
        # A foot goes once a stride of two steps.
        spectrum[(rate_hz < 0.35) | (rate_hz > 1.4)] = 0
        cadence.append(120 * rate_hz[spectrum.argmax()])
        peak.append(speed.max() / speed_mps)
    # Steps of 6.5 mm for every step a minute (docs/research/scenes.md).
    assert np.median(cadence) == pytest.approx(np.sqrt(60 * speed_mps / 0.0065), rel=0.12)
    assert 2.7 < np.median(peak) < 3.9


@pytest.mark.parametrize("seed", range(6))
def test_a_trunk_swings_twice_and_rolls_once_a_stride(seed):
    torso = Torso.draw(np.random.default_rng(seed))
    # Half a second in which the slow wander hardly moves, and one stride.
    phase = np.linspace(0, 1, 128, endpoint=False)
    t_s, level = 0.01 * phase, np.zeros(128)
    up = torso.up(t_s, level, level + 0.2, phase, level + 1)
    assert np.linalg.norm(up, axis=1) == pytest.approx(np.ones(128))
    lean, roll = np.arctan2(up[:, 0], up[:, 2]), np.arcsin(up[:, 1])
    swing, tilt = (2 * np.abs(np.fft.rfft(x)) / 128 for x in (lean, roll))
    assert swing[2] == pytest.approx(torso.pitch_rad, abs=0.003)
    assert tilt[1] == pytest.approx(torso.roll_rad, abs=0.003)
    assert lean == pytest.approx(0.2, abs=torso.pitch_rad + 0.13)


def test_a_trunk_that_stands_only_wanders():
    t_s, level = np.arange(0, 20, 0.05), np.zeros(400)
    swings = []
    for seed in range(20):
        torso = Torso.draw(np.random.default_rng(seed))
        up = torso.up(t_s, level, level, 0.9 * t_s, level)
        assert np.abs(np.arctan2(up[:, 0], up[:, 2])).max() < 0.121
        assert np.abs(np.arcsin(up[:, 1])).max() < 0.101
        swings.append(np.ptp(up[:, 0]))
    assert min(swings) > 0.01


@pytest.mark.parametrize("motion", ["footfalls", "angles"])
def test_a_dog_of_the_second_and_third_motion_strolls_and_one_of_the_first_walks(motion):
    def slowest(name):
        dogs = (
            draw_pet(np.random.default_rng(k), species="dog", style="walk", motion=name)
            for k in range(20)
        )
        t_s = np.array([1.9, 2.1])
        there = [d.motion.posture(t_s)[0][:, 0] for d in dogs]
        return min(np.linalg.norm(b - a) / 0.2 for a, b in there)

    assert slowest(motion) < 0.4
    assert slowest("gait") > 0.45


@pytest.mark.parametrize("motion", ["footfalls", "angles"])
@pytest.mark.parametrize("style", ["walk", "trot", "canter", "roam", "stalk"])
def test_a_pets_paws_reach_the_floor_and_do_not_go_through_it(motion, style):
    species = "cat" if style == "stalk" else "dog"
    for seed in range(4):
        body = draw_pet(
            np.random.default_rng(seed),
            species=species,
            style=style,
            path=[(0.0, 5.0), (0.0, 1.0)],
            motion=motion,
        )
        t_s = np.arange(0.5, 4.0, 1 / 60)
        centre, _, _ = body.motion.posture(t_s)
        paws = centre[:, 10::3, 2]
        assert paws.min() > -0.06
        assert (paws.min(axis=1) < 0.12).mean() > 0.6


@pytest.mark.parametrize("motion", ["gait", "footfalls", "angles"])
@pytest.mark.parametrize("skin", ["surface", "points", "ellipsoids", "capsules"])
@pytest.mark.parametrize("style", ["carry", "carry_pet"])
def test_what_is_carried_is_a_part_with_every_motion_and_skin(motion, skin, style):
    body = draw_person(np.random.default_rng(1), style=style, motion=motion, skin=skin)
    points = body.at(T_S[:30], np.array([0.0, 0.0, 1.0]))
    assert len(body.names) == points.rcs_m2.shape[1]
    assert np.isfinite(points.position_m).all()


@pytest.mark.parametrize("kind", ["footfalls", "angles"])
def test_the_trunk_gains_and_loses_speed_twice_a_stride(kind):
    motion, _ = person(kind, 3)
    t_s = np.arange(1.5, 5.0, 0.01)
    speed = np.linalg.norm(np.diff(motion.posture(t_s)[0][:, 2, :2], axis=0), axis=1) / 0.01
    strides = motion.phase.at(t_s[:-1])
    wave = np.exp(-4j * np.pi * strides)
    once, twice = (abs(np.mean((speed - speed.mean()) * w)) for w in (np.sqrt(wave), wave))
    assert twice > 0.02
    assert speed.mean() == pytest.approx(1.2, rel=0.1)
    assert twice > once / 3


def test_chest_and_pelvis_turn_against_each_other():
    left = np.array([[0.0, 1.0, 0.0]])
    side = sides(left, np.array([0.2]))
    assert side.shape == (1, len(NAMES), 3)
    assert np.linalg.norm(side, axis=-1) == pytest.approx(np.ones((1, len(NAMES))))
    turn = np.arctan2(-side[0, :, 0], side[0, :, 1])
    assert turn[NAMES.index("pelvis")] == pytest.approx(0.2)
    assert turn[NAMES.index("chest")] == pytest.approx(-0.14)
