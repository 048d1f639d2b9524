import math

import numpy as np
import pytest

from x2radar.errors import SceneError
from x2radar.sim.bodies.path.path import Agility, Path
from x2radar.sim.bodies.quadruped.actions import Going
from x2radar.sim.bodies.quadruped.gait import (
    DUTY,
    FOOTWORK,
    GRAVITY_MPS2,
    LEGS,
    duty,
    froude,
    gait,
    stride_m,
    usual_gait,
)
from x2radar.sim.bodies.quadruped.jump import Leap
from x2radar.sim.bodies.quadruped.pet_build import draw_build
from x2radar.sim.bodies.quadruped.species import SPECIES

HIP_M = {"dog": 0.44, "cat": 0.24, "rabbit": 0.14}
BRISK = Agility(acceleration_mps2=20.0)


def speed_at(fr, species):
    return math.sqrt(fr * GRAVITY_MPS2 * HIP_M[species])


def going(name, fr, species="dog", *, is_mirrored=False):
    """A straight run at a Froude number, up to speed from 1 s on, for at least 6 s."""
    speed = speed_at(fr, species)
    build = draw_build(np.random.default_rng(0), SPECIES[species])
    h = HIP_M[species]
    steps = gait(
        name,
        h,
        species=SPECIES[species],
        girdle_m=(-0.25, 0.25),
        half_track_m=0.06,
        stride_factor=1.0,
        lift=0.15,
        ramp=0.4,
        is_mirrored=is_mirrored,
    )
    path = Path.through(((0.0, 0.0), (7 * speed, 0.0)), speed, agility=BRISK)
    return Going.plan(path, steps, FOOTWORK[name], build, height_m=0.97 * h)


def landings(action, leg):
    """Times and places at which a leg lands while the speed is steady."""
    falls = action.feet.falls
    t, x = falls.touch_down_s[:, leg], falls.place[:, leg, 0]
    steady = (t > 1.5) & (t < 5.5)
    return t[steady], x[steady]


RUNS = [
    ("walk", 0.1, "dog"),
    ("walk", 0.4, "dog"),
    ("trot", 0.8, "dog"),
    ("trot", 1.9, "dog"),
    ("pace", 1.0, "dog"),
    ("canter", 3.0, "dog"),
    ("canter", 5.0, "dog"),
    ("walk", 0.2, "cat"),
    ("trot", 1.0, "cat"),
    ("bound", 4.0, "cat"),
    ("bound", 0.3, "rabbit"),
    ("bound", 3.0, "rabbit"),
]


@pytest.mark.parametrize(("name", "fr", "species"), RUNS)
def test_strides_are_as_long_as_published(name, fr, species):
    if species == "cat":
        published = 3.5 * fr**0.42
    elif species == "rabbit":
        published = 2.2 * fr**0.40
    elif name == "canter":
        published = 1.9 * fr**0.40
    else:
        published = 2.4 * fr**0.34
    action = going(name, fr, species)
    for leg in range(4):
        t, x = landings(action, leg)
        assert np.diff(x).mean() == pytest.approx(published * HIP_M[species], rel=0.05)
        stride_s = published * HIP_M[species] / speed_at(fr, species)
        assert np.diff(t).mean() == pytest.approx(stride_s, rel=0.05)


def test_the_stride_relations_meet_between_froude_2_and_3():
    hip = 0.5
    speed = np.sqrt(np.linspace(0.01, 12, 400) * GRAVITY_MPS2 * hip)
    dog = stride_m(speed, hip, SPECIES["dog"]) / hip
    fr = froude(speed, hip)
    assert dog[fr < 2] == pytest.approx(2.4 * fr[fr < 2] ** 0.34)
    assert dog[fr > 3] == pytest.approx(1.9 * fr[fr > 3] ** 0.40)
    assert np.abs(np.diff(dog[fr > 1])).max() < 0.05
    # Faster means more strides a second, at any speed.
    assert (np.diff(speed / dog) > 0).all()


@pytest.mark.parametrize(("name", "fr", "species"), RUNS)
def test_paws_stand_for_the_duty_factor(name, fr, species):
    action = going(name, fr, species)
    t = np.arange(2, 5, 0.002)
    share = action.feet.at(t).is_stance.mean(axis=0)
    wanted = float(duty(np.array([speed_at(fr, species)]), HIP_M[species])[0])
    assert share == pytest.approx(wanted, abs=0.06)
    steady = going(name, fr, species).feet.clock.duty
    assert steady[len(steady) // 3] == pytest.approx(wanted, abs=0.01)


def test_duty_falls_from_walk_to_canter():
    speed = np.linspace(0.05, 9, 300)
    share = duty(speed, 0.44)
    assert (np.diff(share) <= 1e-12).all()
    assert DUTY[0] <= share.min() < 0.3
    assert 0.6 < share.max() <= DUTY[1]


def phases(name, fr, species="dog", **keys):
    """When each leg lands, in strides after the left hind, measured."""
    action = going(name, fr, species, **keys)
    t0, _ = landings(action, 0)
    stride_s = np.diff(t0).mean()
    after = [(landings(action, leg)[0] - t0[1]) / stride_s for leg in range(4)]
    # The mean on the circle: phases near 0 and near 1 are neighbours.
    return [float(np.angle(np.exp(2j * np.pi * x).mean()) / (2 * np.pi) % 1) for x in after]


def apart(a, b):
    """Distance of two stride phases, the short way round."""
    return abs((a - b + 0.5) % 1.0 - 0.5)


def test_a_walk_is_a_lateral_sequence():
    left_hind, left_fore, right_hind, right_fore = phases("walk", 0.3)
    assert apart(left_fore, left_hind + 0.25) < 0.03
    assert apart(right_hind, left_hind + 0.5) < 0.03
    assert apart(right_fore, left_hind + 0.75) < 0.03


def test_a_trot_is_diagonal_and_a_pace_is_lateral():
    left_hind, left_fore, right_hind, right_fore = phases("trot", 1.2)
    assert apart(left_hind, right_fore) < 0.03
    assert apart(right_hind, left_fore) < 0.03
    assert apart(left_hind, right_hind) > 0.45
    left_hind, left_fore, right_hind, right_fore = phases("pace", 1.2)
    assert apart(left_hind, left_fore) < 0.1
    assert apart(right_hind, right_fore) < 0.1
    assert apart(left_hind, right_hind) > 0.45


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_a_canter_has_three_beats_on_either_lead(is_mirrored):
    legs = phases("canter", 4.0, is_mirrored=is_mirrored)
    if is_mirrored:
        legs = legs[2:] + legs[:2]
    first, diagonal, with_it, lead = legs
    assert apart(diagonal, with_it) < 0.05
    after = [(x - first) % 1.0 for x in (with_it, diagonal, lead)]
    assert after == sorted(after)
    assert 0.4 < after[2] < 0.7


def test_a_bound_pairs_hind_and_fore_feet():
    left_hind, left_fore, right_hind, right_fore = phases("bound", 4.0, "cat")
    assert apart(left_hind, right_hind) < 0.1
    assert apart(left_fore, right_fore) < 0.1
    assert apart(left_hind, left_fore) > 0.35


@pytest.mark.parametrize(
    ("fr", "dog", "cat"),
    [(0.05, "walk", "walk"), (0.49, "walk", "walk"), (1.0, "trot", "trot"),
     (2.2, "trot", "bound"), (4.0, "canter", "bound")],
)  # fmt: skip
def test_the_gait_goes_with_the_froude_number(fr, dog, cat):
    for species, wanted in (("dog", dog), ("cat", cat)):
        speed = speed_at(fr, species)
        assert usual_gait(speed, HIP_M[species], SPECIES[species]) == wanted


@pytest.mark.parametrize("name", ["walk", "trot", "pace"])
def test_the_trunk_bobs_twice_a_stride(name):
    fr = {"walk": 0.3, "trot": 1.2, "pace": 1.0}[name]
    action = going(name, fr)
    t = np.arange(1.5, 5.5, 0.005)
    stance = action.at(t)
    stride_s = np.diff(landings(action, 0)[0]).mean()
    # Ends of the trunk; in a walk they go against each other.
    front = stance.middle_m[:, 2] + 0.5 * action.build.back_m * np.sin(stance.pitch_rad)
    centred = front - front.mean()
    waves = [
        np.abs((centred * np.exp(-2j * math.pi * k * t / stride_s)).mean()) for k in (1, 2, 3)
    ]
    assert waves[1] > 10 * max(waves[0], waves[2])
    assert 0.003 < np.ptp(front) / 2 < 0.05


def test_the_trunk_keeps_to_the_path():
    action = going("trot", 1.0)
    t = np.arange(0, 8, 0.01)
    state, stance = action.path.at(t), action.at(t)
    off = np.hypot(stance.middle_m[:, 0] - state.x_m, stance.middle_m[:, 1] - state.y_m)
    assert off.max() < 0.03
    assert np.abs(stance.pitch_rad).max() < 0.3
    still = state.speed_mps == 0
    assert still.any()
    assert np.ptp(stance.middle_m[still & (t > 4), 2]) < 1e-12


def test_legs_are_named_as_they_are_counted():
    action = going("walk", 0.3)
    paws = action.feet.at(np.array([3.0])).position_m[0]
    for leg, name in enumerate(LEGS):
        assert (paws[leg, 1] > 0) == name.startswith("left")


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
    fall = np.gradient(np.gradient(up, step_s), step_s)[air]
    assert fall == pytest.approx(-GRAVITY_MPS2, abs=1e-3)
    drift = np.gradient(np.gradient(ahead, step_s), step_s)[air]
    assert drift == pytest.approx(0, abs=1e-3)
    assert leap.begin_s < leap.leave_s < leap.take_off_s < leap.touch_down_s < leap.still_s


@pytest.mark.parametrize("climb_m", [1.3, -1.3, math.nan, math.inf])
def test_an_impossible_leap_is_refused(climb_m):
    with pytest.raises(SceneError, match="climb_m"):
        Leap.over(0.0, climb_m, 0.5, 0.2, 0.4)
