"""People: still feet, believable speeds, whole bones, the same again."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from x2radar.errors import SceneError
from x2radar.sim.bodies.path.courses import COURSES, draw_course
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.build import NAMES, draw_person_build
from x2radar.sim.bodies.person.gait import STYLES, carriage_at, walking_duty, walking_stride_m
from x2radar.sim.bodies.person.person import draw_person

ANTENNA_M = np.array([0.0, 0.0, 1.2])
RATE_HZ = 500


# In what is done without going.
_FASTEST_HANDS_MPS = {"": 0.7, "busy": 3.0, "sit": 3.0, "exercise": 8.0}


def walker(speed_mps, seed=0, style="walk"):
    rng = np.random.default_rng(seed)
    return draw_person(rng, style=style, path=[(0, 14), (0, 1)], speed_mps=speed_mps)


def steady(person, seconds=4.0, begin_s=2.5):
    """Posture while it goes at its speed."""
    t_s = begin_s + np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return t_s, *person.action.posture(t_s)


def ankles(person, centre, axis):
    shank = person.action.build.shank_m
    for name in ("left shank", "right shank"):
        k = NAMES.index(name)
        yield centre[:, k] - axis[:, k] * shank / 2


def speeds(place):
    return np.linalg.norm(np.diff(place, axis=0), axis=-1) * RATE_HZ


# ---------------------------------------------------------------- legs


@pytest.mark.parametrize("speed", [0.9, 1.2, 1.5])
def test_ankles_stand_still_and_swing_as_fast_as_people_do(speed):
    peaks, stills = [], []
    for seed in range(8):
        person = walker(speed, seed)
        _, centre, axis, _ = steady(person)
        for ankle in ankles(person, centre, axis):
            v = speeds(ankle)
            peaks.append(v.max() / speed)
            stills.append(np.mean(v < 0.05))
    assert 2.7 <= np.mean(peaks) <= 3.5
    assert max(peaks) < 4.0
    # From foot-flat to heel-off, about 40 % of the cycle.
    assert np.mean(stills) == pytest.approx(0.42, abs=0.06)


def test_between_foot_flat_and_heel_off_an_ankle_moves_less_than_a_millimetre():
    person = walker(1.2)
    t_s, centre, axis, _ = steady(person)
    feet = person.action.feet.at(t_s)
    for leg, ankle in enumerate(ankles(person, centre, axis)):
        flat = feet.is_stance[:, leg] & (feet.phase[:, leg] < 0.38)
        flat &= feet.phase[:, leg] > 0.02
        edges = np.flatnonzero(np.diff(flat.astype(int)))
        for a, b in pairwise(edges):
            if flat[a + 1]:
                assert np.ptp(ankle[a + 1 : b], axis=0).max() < 1e-3


@pytest.mark.parametrize("speed", [0.6, 1.0, 1.4])
def test_stride_and_cadence_follow_the_published_relation(speed):
    found = []
    for seed in range(12):
        person = walker(speed, seed)
        t_s, *_ = steady(person)
        strides = person.action.feet.clock.at(t_s)
        rate_hz = (strides[-1] - strides[0]) / (t_s[-1] - t_s[0])
        height_m = person.action.build.hip_height_m
        found.append(speed / rate_hz / (1.346 * np.sqrt(speed / height_m) * height_m))
    # People scatter by 6 %; their mean does not.
    assert np.mean(found) == pytest.approx(1.0, abs=0.05)
    assert 0.0 < np.std(found) < 0.12


def test_the_relation_itself():
    v = np.array([0.93])
    assert walking_stride_m(v, 0.93) == pytest.approx(1.346 * 0.93)
    assert walking_duty(v, 0.93) == pytest.approx(0.752 - 0.143 / 1.346)


@pytest.mark.parametrize("style", STYLES)
def test_bones_keep_their_lengths_and_knees_bend_forward(style):
    person = draw_person(np.random.default_rng(3), style=style, path=[(0, 9), (0, 1)])
    t_s = np.linspace(0, 12, 600)
    centre, axis, _ = person.action.posture(t_s)
    assert np.isfinite(centre).all()
    assert np.linalg.norm(axis, axis=-1) == pytest.approx(np.ones(axis.shape[:2]), abs=0.02)
    b = person.action.build
    if STYLES[style].kind == "crawl":
        return
    forward = -np.array([0.0, 1.0, 0.0])
    for side in ("left", "right"):
        thigh, shank = NAMES.index(f"{side} thigh"), NAMES.index(f"{side} shank")
        knee = centre[:, thigh] - axis[:, thigh] * b.thigh_m / 2
        other = centre[:, shank] + axis[:, shank] * b.shank_m / 2
        assert np.abs(knee - other).max() < 1e-3
        top = centre[:, thigh] + axis[:, thigh] * b.thigh_m / 2
        ankle = centre[:, shank] - axis[:, shank] * b.shank_m / 2
        ahead = (knee - 0.5 * (top + ankle)) @ forward
        moving = (t_s > 1) & (t_s < person.action.path.end_s - 1)
        assert ahead[moving].min(initial=0.0) > -0.02


def test_hips_go_up_and_down_twice_a_stride():
    person = walker(1.2)
    t_s, centre, _, _ = steady(person, seconds=6)
    z = centre[:, NAMES.index("pelvis"), 2]
    spectrum = np.abs(np.fft.rfft((z - z.mean()) * np.hanning(len(z))))
    strongest_hz = np.fft.rfftfreq(len(z), 1 / RATE_HZ)[spectrum.argmax()]
    strides = person.action.feet.clock.at(t_s)
    rate_hz = (strides[-1] - strides[0]) / (t_s[-1] - t_s[0])
    assert strongest_hz == pytest.approx(2 * rate_hz, abs=0.2)


@pytest.mark.parametrize("speed", [0.3, 0.7, 1.3])
def test_hips_surge_twice_a_stride_and_are_slowest_over_the_standing_foot(speed):
    for seed in range(3):
        person = walker(speed, seed)
        t_s, centre, _, _ = steady(person, seconds=6)
        state = person.action.path.at(t_s)
        pelvis = centre[:, NAMES.index("pelvis")]
        # It goes down the y axis, so this is ahead of its even way.
        ahead = state.y_m - pelvis[:, 1]
        phase = 4 * np.pi * (person.action.feet.clock.at(t_s) - 0.5 * person.action.duty)
        amplitude = -2 * np.mean((ahead - ahead.mean()) * np.sin(phase))
        assert amplitude == pytest.approx(person.action.carriage.surge_m, rel=0.25)
        assert 0.008 < amplitude < 0.035


def test_arms_bob_and_pelvis_move_less_at_a_slow_walk():
    style, hip_m = STYLES["walk"], 0.9
    slow, brisk = (carriage_at(style, v, hip_m) for v in (0.3, 1.35))
    for name in ("arm_rad", "bob_m", "yaw_rad"):
        assert getattr(brisk, name) == pytest.approx(getattr(style.carriage, name))
        assert getattr(slow, name) == pytest.approx(0.3 / 1.35 * getattr(brisk, name))
    # Who sneaks, carries or runs has the arms that the style says.
    for name in ("stealth", "carry", "run"):
        style = STYLES[name]
        assert carriage_at(style, 0.3, hip_m).arm_rad == style.carriage.arm_rad


# ---------------------------------------------------------------- whole bodies


@pytest.mark.parametrize("style", STYLES)
def test_nothing_jumps_and_nothing_is_too_fast(style):
    for seed in range(3):
        person = draw_person(np.random.default_rng(seed), style=style)
        t_s = np.arange(8 * 250) / 250
        place = person.at(t_s, ANTENNA_M).position_m
        v = np.linalg.norm(np.diff(place, axis=0), axis=-1) * 250
        fastest = person.action.path.pieces[2].max(initial=0.0)
        assert v.max() <= 4.5 * fastest + _FASTEST_HANDS_MPS[STYLES[style].does]
        assert place[..., 2].min() > -0.02


@pytest.mark.parametrize("style", STYLES)
def test_any_times_in_any_order_give_the_same(style):
    make = lambda: draw_person(np.random.default_rng(5), style=style)  # noqa: E731
    t_s = np.arange(200) / 30
    whole = make().at(t_s, ANTENNA_M)
    order = np.random.default_rng(0).permutation(200)
    shuffled = make().at(t_s[order], ANTENNA_M)
    assert np.allclose(shuffled.position_m, whole.position_m[order], atol=1e-9)
    assert np.allclose(shuffled.rcs_m2, whole.rcs_m2[order], rtol=1e-4, atol=1e-9)
    single = make().at(t_s[17:18], ANTENNA_M)
    assert np.allclose(single.position_m, whole.position_m[17:18], atol=1e-9)
    assert make().label == "human"
    assert len(make().names) == whole.rcs_m2.shape[1]


def test_a_chest_breathes():
    person = draw_person(np.random.default_rng(1), style="stand", path=[(0.0, 2.0), (0.0, 1.0)])
    t_s = np.arange(60 * 30) / 30
    chest = person.at(t_s, ANTENNA_M).position_m[:, 0]
    still = person.action.posture(t_s)[0][:, 0]
    towards = np.linalg.norm(chest - still, axis=-1)
    assert 0.0009 < towards.max() < 0.0031
    breath = person.breath.at(t_s)
    spectrum = np.abs(np.fft.rfft(breath - breath.mean()))
    assert 0.18 < np.fft.rfftfreq(len(t_s), 1 / 30)[spectrum.argmax()] < 0.37


def test_totals_do_not_depend_on_the_body():
    adult, child = [], []
    for seed in range(60):
        for style, out in (("walk", adult), ("toddler", child)):
            person = draw_person(np.random.default_rng([seed, len(style)]), style=style)
            centre, axis, side = person.action.posture(np.linspace(1, 4, 12))
            side = np.broadcast_to(side, axis.shape)
            out.append(10 * np.log10(person.skin.mean_total_m2(centre, axis, side)))
    for levels in (adult, child):
        assert -16.5 < min(levels) < -11
        assert 0 < max(levels) < 4.5
    assert abs(np.mean(adult) - np.mean(child)) < 3


def test_who_searches_works_with_the_hands_where_the_feet_stand_and_not_on_the_way():
    moved = {True: [], False: []}
    for seed in range(6):
        person = draw_person(
            np.random.default_rng(seed), style="search", path=[(0, 7), (0, 1)], speed_mps=1.0
        )
        idle = replace(person.action, doer=None)
        t_s = np.arange(0, person.action.path.end_s + 8, 0.05)
        speed = person.action.path.at(t_s).speed_mps
        hands = [NAMES.index(f"{side} hand") for side in ("left", "right")]
        apart = np.abs(person.action.posture(t_s)[0] - idle.posture(t_s)[0])[:, hands].max((1, 2))
        for goes in moved:
            moved[goes] += apart[speed > 0.999 if goes else speed < 1e-3].tolist()
    assert max(moved[True]) < 0.02
    assert np.quantile(moved[False], 0.5) > 0.05
    assert np.quantile(moved[False], 0.95) > 0.3


def seen(style, seed, seconds=40.0):
    person = draw_person(np.random.default_rng(seed), style=style, path=[(0, 3), (0, 1)])
    t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    centre = person.action.posture(t_s)[0]
    return person, t_s, {name: centre[:, k] for k, name in enumerate(NAMES)}


def test_who_sits_has_level_thighs_still_feet_and_a_head_that_moves():
    rose = 0
    for seed in range(12):
        person, _, place = seen("sit", seed)
        b = person.action.build
        low = np.quantile(place["pelvis"][:, 2], 0.05)
        assert 0.35 * b.leg_m < low - b.ankle_m < 0.75 * b.leg_m
        for side in ("left", "right"):
            assert np.ptp(place[f"{side} foot"], axis=0).max() < 0.01
        assert speeds(place["head"]).max() < 2.0
        assert np.sqrt(np.mean(speeds(place["head"]) ** 2)) > 0.02
        rises = np.isfinite(person.action.doer.period_s)
        stood = place["pelvis"][:, 2].max() - b.ankle_m > 0.85 * b.leg_m
        assert stood == rises
        rose += stood
    assert 2 <= rose <= 9


def test_some_who_sit_move_the_head_alone_and_turning_it_moves_its_echo():
    alone = []
    for seed in range(30):
        person, _, place = seen("sit", seed)
        doer = person.action.doer
        if doer.busy.size or np.isfinite(doer.period_s):
            continue
        alone.append(seed)
        assert np.ptp(place["chest"], axis=0).max() < 0.06
        look = doer.trunk.at(np.arange(20.0))[:, 1]
        assert np.ptp(place["head"][:, :2], axis=0).max() > 0.25 * np.ptp(look) * 0.02
    assert len(alone) >= 2


def test_who_exercises_keeps_one_beat_lifts_the_feet_and_stays():
    lifted, hopped = [], []
    for seed in range(16):
        person, t_s, place = seen("exercise", seed)
        doer = person.action.doer
        assert 0.4 <= doer.beat_hz <= 1.6
        assert np.abs(place["pelvis"][:, :2] - [0, 3]).max() < 0.35
        feet = np.stack([place["left foot"][:, 2], place["right foot"][:, 2]])
        assert feet.min() > -0.01
        lifted.append(np.ptp(feet, axis=1).max())
        hopped.append(np.min(feet, axis=0).max() > feet.min() + 0.04)
        hand = place["left hand"][:, 2]
        spectrum = np.abs(np.fft.rfft((hand - hand.mean()) * np.hanning(len(hand))))
        hz = np.fft.rfftfreq(len(t_s), 1 / RATE_HZ)
        assert hz[spectrum.argmax()] < 2.4 * doer.beat_hz
    assert np.median(lifted) > 0.08
    assert any(hopped)
    assert not all(hopped)


@pytest.mark.parametrize("style", ["busy", "sit", "exercise"])
def test_elbows_never_snap(style):
    for seed in range(20):
        _, _, place = seen(style, seed, seconds=10)
        for side in ("left", "right"):
            upper = speeds(place[f"{side} upper arm"]).max()
            assert upper < speeds(place[f"{side} hand"]).max() + 0.5


def test_physical_totals_are_those_of_people():
    person = draw_person(np.random.default_rng(0), total_rcs_dbsm="physical")
    centre, axis, side = person.action.posture(np.linspace(1, 4, 12))
    total = person.skin.mean_total_m2(centre, axis, np.broadcast_to(side, axis.shape))
    assert 0.3 < total < 1.6


def test_sizes():
    rng = np.random.default_rng(0)
    adults = [draw_person_build(rng).stature_m for _ in range(300)]
    assert 1.64 < np.mean(adults) < 1.76
    assert 0.06 < np.std(adults) < 0.13
    toddlers = [draw_person_build(rng, age="toddler").stature_m for _ in range(50)]
    assert 0.75 <= min(toddlers) <= max(toddlers) <= 0.95
    children = [draw_person_build(rng, age="child") for _ in range(50)]
    assert 0.95 <= min(c.stature_m for c in children) <= max(c.stature_m for c in children) <= 1.45
    legs = [
        draw_person_build(np.random.default_rng(0), age=age, height_m=1.05).hip_height_m
        for age in ("toddler", "child", "adult")
    ]
    assert legs[0] < legs[1] < legs[2]
    build = draw_person_build(rng, height_m=1.9)
    assert build.hip_height_m == pytest.approx(0.53 * 1.9, rel=0.06)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"style": "moonwalk"}, "style: no style 'moonwalk'"),
        ({"height_m": 3.0}, "height_m"),
        ({"height_m": -1.0}, "height_m"),
        ({"speed_mps": 9.0}, "speed_mps: 9 m/s is too fast to walk"),
        ({"style": "crawl", "speed_mps": 4.0}, "too fast to crawl"),
        ({"total_rcs_dbsm": 99.0}, "total_rcs_dbsm"),
    ],
)
def test_what_no_person_can(options, said):
    with pytest.raises(SceneError, match=said):
        draw_person(np.random.default_rng(0), **options)


def test_any_path_with_stops_and_turns_back():
    path = Path.through([(0, 4), (0, 1), (0.1, 4)], 1.1, turn_radius_m=0.2)
    person = draw_person(np.random.default_rng(0), path=path)
    place = person.at(np.arange(10 * 250) / 250, ANTENNA_M).position_m
    assert np.isfinite(place).all()
    assert (np.linalg.norm(np.diff(place, axis=0), axis=-1) * 250).max() < 6


# ---------------------------------------------------------------- courses


@pytest.mark.parametrize("name", COURSES)
def test_courses_go_through_the_swath(name):
    n_seen = 0
    for seed in range(60):
        points = draw_course(np.random.default_rng(seed), name, 0.6, 3.4)
        gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert gaps.min() >= 0.1
        Path.through(points, 1.0)
        way = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(points)])
        distance = np.linalg.norm(way, axis=1)
        n_seen += bool(((distance > 0.6) & (distance < 3.4)).any())
    assert n_seen >= 57


@pytest.mark.parametrize("name", COURSES)
def test_no_course_passes_beneath_the_antenna_or_through_its_wall(name):
    for seed in range(100):
        points = draw_course(np.random.default_rng(seed), name, 0.6, 3.4)
        for radius in (0.3, 0.5, 0.57):
            path = Path.through(points, 1.0, turn_radius_m=radius)
            place = path.at(np.arange(0, path.end_s, 0.05))
            # Between the radii that the course was judged by it may be a little nearer.
            assert place.y_m.min() > 0.37


@pytest.mark.parametrize(("height_m", "least", "most"), [(1.75, 8, 26), (1.2, 13, 34)])
def test_a_heart_beats_on_top_of_the_breath_and_both_are_quicker_in_children(
    height_m, least, most
):
    t_s = np.arange(0, 120, 0.02)
    rates, beats = [], []
    for seed in range(12):
        breath = draw_person(np.random.default_rng(seed), style="stand", height_m=height_m).breath
        for one, wanted_hz in (
            (breath, breath.rate_hz),
            (replace(breath, size_m=0.0), breath.beat_hz),
        ):
            spectrum = np.abs(np.fft.rfft(one.at(t_s) * np.hanning(len(t_s))))
            found_hz = np.fft.rfftfreq(len(t_s), 0.02)[spectrum.argmax()]
            assert found_hz == pytest.approx(wanted_hz, abs=0.02)
        rates.append(60 * breath.rate_hz)
        beats.append(60 * breath.beat_hz)
    assert least < min(rates) < max(rates) < most
    assert 45 < min(beats) < max(beats) < 140
