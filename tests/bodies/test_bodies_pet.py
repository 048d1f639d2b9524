import math

import numpy as np
import pytest

from x2radar.errors import SceneError
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.quadruped.gait import FOOTWORK, GRAVITY_MPS2, LEGS, stride_m
from x2radar.sim.bodies.quadruped.pet import PET_AGILITY, PET_STYLES, draw_pet
from x2radar.sim.bodies.quadruped.pet_build import draw_build
from x2radar.sim.bodies.quadruped.quadruped import breath_m
from x2radar.sim.bodies.quadruped.species import SPECIES

ANTENNA = np.array([0.0, 0.0, 1.0])
WAYS = [(name, style) for name, species in SPECIES.items() for style in species.styles]
MOVING = [way for way in WAYS if PET_STYLES[way[1]].froude]
STAYING = [way for way in WAYS if not PET_STYLES[way[1]].froude and way[1] != "jump"]


def pet(seed=0, **keys):
    return draw_pet(np.random.default_rng(seed), **keys)


def run_past(speed_mps):
    """A path across the room, on which it is up to speed for some seconds."""
    length = 3.0 * speed_mps + 2.0
    return Path.through(((-length / 2, 3.0), (length / 2, 3.0)), speed_mps, agility=PET_AGILITY)


def strongest_hz(place_m, step_s):
    """Frequency at which a coordinate moves fastest."""
    speed = np.diff(place_m)
    spectrum = np.abs(np.fft.rfft(speed * np.hanning(len(speed))))
    return np.fft.rfftfreq(len(speed), step_s)[spectrum.argmax()]


def part(one, name):
    return one.names.index(name)


def physical_m2(one, t=None):
    times = np.linspace(0, 12, 12) if t is None else t
    return one.skin.mean_total_m2(*one.motion.posture(times))


def test_every_style_says_what_it_is():
    for name, how in PET_STYLES.items():
        assert name.isidentifier()
        assert 3 <= len(how.sentence.split()) <= 15
        assert any(name in species.styles for species in SPECIES.values())


def test_styles_are_drawn_by_weight_and_fit_the_species():
    # Who moves, and how, tells most styles apart.
    kinds = {name: [] for name in SPECIES}
    for seed in range(1000, 1300):
        for species, found in kinds.items():
            one = pet(seed, species=species)
            found.append(type(one.motion.action).__name__)
    for species, found in kinds.items():
        styles = {name: PET_STYLES[name] for name in SPECIES[species].styles}
        weights = sum(s.weight for s in styles.values())
        moving = sum(s.weight for s in styles.values() if s.froude) / weights
        assert found.count("Going") / 300 == pytest.approx(moving, abs=0.08)
        jumping = styles["jump"].weight / weights
        assert found.count("Jumping") / 300 == pytest.approx(jumping, abs=0.04)


@pytest.mark.parametrize(("species", "style"), WAYS)
def test_points_are_what_a_mover_gives(species, style):
    one = pet(1, species=species, style=style)
    t = np.arange(0, 6, 0.02)
    points = one.at(t, ANTENNA)
    assert one.label == "pet"
    assert points.position_m.shape == (len(t), 20, 3)
    assert points.rcs_m2.shape == (len(t), 20)
    assert len(set(one.names)) == 20
    assert np.isfinite(points.position_m).all()
    assert (points.rcs_m2 > 0).all()
    assert one.at(np.zeros(0), ANTENNA).rcs_m2.shape == (0, 20)


@pytest.mark.parametrize(("species", "style"), WAYS)
def test_one_seed_one_pet_and_no_state(species, style):
    t = np.random.default_rng(1).uniform(-2, 40, 60)
    whole = pet(5, species=species, style=style).at(t, ANTENNA)
    again = pet(5, species=species, style=style).at(t[::-1], ANTENNA)
    assert again.position_m[::-1] == pytest.approx(whole.position_m, abs=1e-12)
    assert again.rcs_m2[::-1] == pytest.approx(whole.rcs_m2, rel=1e-5)
    one = pet(5, species=species, style=style)
    for k in (0, 31, 59):
        alone = one.at(t[k : k + 1], ANTENNA)
        assert alone.position_m[0] == pytest.approx(whole.position_m[k], abs=1e-12)
        assert alone.rcs_m2[0] == pytest.approx(whole.rcs_m2[k], rel=1e-5)
    other = pet(6, species=species, style=style).at(t, ANTENNA)
    assert np.abs(other.position_m - whole.position_m).max() > 0.01


@pytest.mark.parametrize(("species", "style"), WAYS)
@pytest.mark.parametrize("seed", range(2))
def test_it_stays_above_the_floor_and_moves_without_jumps(species, style, seed):
    one = pet(seed, species=species, style=style)
    step_s = 0.001
    points = one.at(np.arange(0, 6, step_s), ANTENNA)
    assert points.position_m[..., 2].min() > 0
    speed = np.linalg.norm(np.diff(points.position_m, axis=0), axis=-1) / step_s
    assert speed.max() < 12
    assert np.abs(np.diff(speed, axis=0)).max() < 0.8  # 80 g, at a knee
    # A leg ten times as long as thick flashes by in some milliseconds.
    assert np.abs(np.diff(np.log(points.rcs_m2), axis=0)).max() < 0.8


@pytest.mark.parametrize(("species", "style"), MOVING)
def test_paws_stand_still_where_they_stand(species, style):
    one = pet(2, species=species, style=style)
    t = np.arange(0, 8, 0.005)
    stands = one.motion.action.feet.at(t).is_stance
    place = one.at(t, ANTENNA).position_m
    for leg, name in enumerate(LEGS):
        paw = place[:, part(one, f"{name} paw")]
        both = stands[1:, leg] & stands[:-1, leg]
        # A stance lost between two samples would show as a step of centimetres.
        assert both.mean() > 0.2
        assert np.abs(np.diff(paw, axis=0)[both]).max() < 1e-12
        assert paw[stands[:, leg], 2] == pytest.approx(0.25 * one.motion.build.paw_m)
        lifted = paw[:, 2].max() - 0.25 * one.motion.build.paw_m
        assert 0.05 * one.motion.build.hip_m < lifted < 0.25 * one.motion.build.hip_m


@pytest.mark.parametrize(("species", "style"), [("dog", "walk"), ("dog", "trot"), ("cat", "walk")])
def test_drawn_strides_scatter_about_the_published_one(species, style):
    ratio = []
    for seed in range(50):
        one = pet(seed, species=species, style=style, path=run_past(0.7))
        h = one.motion.build.hip_m
        falls = one.motion.action.feet.falls
        x = falls.place[:, 0, 0]
        steady = np.diff(x[np.abs(x) < 1.0])
        wanted = stride_m(np.array([0.7]), h, SPECIES[species])[0]
        ratio.append(steady.mean() / wanted)
    assert np.mean(ratio) == pytest.approx(1, abs=0.03)
    assert 0.03 < np.std(ratio) < 0.1


def test_speeds_follow_the_froude_numbers_of_the_style():
    for species, style in MOVING:
        low, high = PET_STYLES[style].froude
        for seed in range(10):
            one = pet(seed, species=species, style=style, path=[(-30.0, 3.0), (30.0, 3.0)])
            fr = one.motion.action.path.pieces[2].max() ** 2 / (
                GRAVITY_MPS2 * one.motion.build.hip_m
            )
            assert fr <= high * 1.0001
            assert fr >= low * 0.9999 or style in {"bound", "canter"}  # limited indoors


def test_masses_and_hips_are_those_of_pets():
    rng = np.random.default_rng(0)
    cats = [draw_build(rng, SPECIES["cat"]) for _ in range(400)]
    dogs = [draw_build(rng, SPECIES["dog"]) for _ in range(400)]
    assert 2.5 <= min(b.mass_kg for b in cats) < max(b.mass_kg for b in cats) <= 7.0
    kg = np.array([b.mass_kg for b in dogs])
    assert 3.0 <= kg.min() < 3.5
    assert 55 < kg.max() <= 60.0
    share = [((kg >= low) & (kg < high)).mean() for low, high in ((3, 10), (10, 25), (25, 60))]
    assert share == pytest.approx([0.4, 0.35, 0.25], abs=0.08)
    assert np.mean([b.hip_m for b in cats]) == pytest.approx(0.24, abs=0.015)
    twenty = [draw_build(rng, SPECIES["dog"], 20.0).hip_m for _ in range(100)]
    assert np.mean(twenty) == pytest.approx(0.44, abs=0.02)
    assert np.std(twenty) > 0.02
    for b in cats + dogs:
        # A trunk of water holds 55 % of the mass.
        half = np.prod(b.half_lengths()[0])
        assert 4 / 3 * math.pi * half * 1000 == pytest.approx(0.55 * b.mass_kg)
        assert b.upper_m + b.lower_m > b.hip_m


def test_a_rabbit_is_small_and_bounds_at_any_speed():
    strides_hz, length_m = [], []
    for seed in range(40):
        one = pet(seed, species="rabbit", style="roam", path=run_past(1.8))
        assert one.motion.action.footwork is FOOTWORK["bound"]
        b = one.motion.build
        assert 1.0 <= b.mass_kg <= 3.0
        length_m.append(1.16 * b.back_m + b.neck_m + b.head_m)
        t_s = one.motion.action.feet.falls.touch_down_s[:, 0]
        strides_hz.append(1 / np.diff(t_s[(t_s > 1.2) & (t_s < 3.5)]).mean())
    assert 0.30 < np.mean(length_m) < 0.50
    assert np.mean(strides_hz) == pytest.approx(4.1, abs=0.3)
    slow = pet(0, species="rabbit", style="sniff")
    assert slow.motion.action.footwork is FOOTWORK["bound"]


@pytest.mark.parametrize("style", ["sit", "stand"])
def test_a_dogs_tail_tip_goes_at_one_to_three_metres_a_second(style):
    peaks, hz = [], []
    for seed in range(15):
        one = pet(seed, species="dog", style=style)
        t = np.arange(0, 20, 0.005)
        centre, axis, _ = one.motion.posture(t)
        k = part(one, "tail tip")
        tip = centre[:, k] + axis[:, k] * one.motion.build.tail_m / 6
        speed = np.linalg.norm(np.gradient(tip - centre[:, 0], t, axis=0), axis=-1)
        peaks.append(speed.max())
        hz.append(one.manner.wag_hz)
    assert 0.85 * 1.0 < min(peaks) < max(peaks) < 1.05 * 3.0
    assert 2 <= min(hz) < 3 < max(hz) <= 6


def test_a_dogs_tail_rests_at_times_and_a_cats_tail_is_slow():
    one = pet(0, species="dog", style="lie")
    t = np.arange(0, 60, 0.01)
    tail = one.motion.posture(t)[1][:, part(one, "tail base")]
    rate = np.linalg.norm(np.diff(tail, axis=0), axis=1)
    assert 0.2 < (rate < 1e-4).mean() < 0.98
    for seed in range(8):
        cat = pet(seed, species="cat", style="sit")
        centre = cat.motion.posture(t)[0][:, part(cat, "tail tip")]
        assert np.linalg.norm(np.diff(centre, axis=0), axis=1).max() / 0.01 < 1.0


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
    for seed in range(6):
        one = pet(seed, species=species, style=style)
        t = np.arange(0, 60, 0.02)
        centre = one.motion.posture(t)[0][:, 0]
        seen = one.at(t, ANTENNA).position_m[:, 0]
        # What breathing adds to the range of the trunk, its sway apart.
        swell = np.linalg.norm(centre - ANTENNA, axis=1) - np.linalg.norm(seen - ANTENNA, axis=1)
        assert 0.0003 < np.abs(swell).max() < 0.006
        assert np.abs(swell).max() == pytest.approx(one.manner.breath_m, rel=0.02)
        spectrum = np.abs(np.fft.rfft(swell * np.hanning(len(t))))
        per_minute = 60 * np.fft.rfftfreq(len(t), 0.02)[spectrum.argmax()]
        assert least - 1 <= per_minute <= most + 1
        assert swell == pytest.approx(breath_m(one.manner, t), abs=1e-9)
        if style == "lie":
            sway = np.ptp(centre, axis=0)
            assert sway.max() < 0.001


def test_a_sniffing_dog_stops_with_its_nose_at_the_floor():
    low, stops = [], []
    for seed in range(6):
        one = pet(seed, style="sniff")
        t = np.arange(0, one.motion.action.path.end_s, 0.05)
        height = one.motion.posture(t)[0][:, part(one, "head"), 2]
        low.append((height < 0.6 * one.motion.build.hip_m).mean())
        still = one.motion.action.path.at(t).speed_mps == 0
        stops.append(np.flatnonzero(np.diff(still.astype(int)) > 0).size)
    assert np.mean(low) > 0.5
    assert min(low) < 0.95
    assert min(stops) >= 2


@pytest.mark.parametrize("species", SPECIES)
@pytest.mark.parametrize("seed", range(4))
def test_a_jump_leads_onto_furniture_and_down_again(species, seed):
    one = pet(seed, species=species, style="jump")
    up, down = one.motion.action.leaps
    h, climb = one.motion.build.hip_m, up.climb_m
    assert 0.2 <= climb <= 0.9
    before, above, after = (
        one.at(np.array([t]), ANTENNA).position_m[0]
        for t in (up.begin_s - 0.1, down.begin_s - 0.05, down.still_s + 2)
    )
    paws = [part(one, f"{leg} paw") for leg in LEGS]
    assert above[paws, 2] - before[paws, 2] == pytest.approx(climb)
    assert after[paws, 2] == pytest.approx(before[paws, 2])
    assert above[0, 2] - before[0, 2] == pytest.approx(climb, abs=0.02 * h)
    t = np.arange(up.begin_s, up.take_off_s, 0.001)
    hind = one.at(t, ANTENNA).position_m[:, part(one, "left hind paw")]
    assert np.ptp(hind, axis=0).max() < 1e-9
    middle = one.at(np.array([up.take_off_s + 0.5 * up.flight_s]), ANTENNA).position_m[0]
    assert middle[paws, 2].min() > 0.1 * h


@pytest.mark.parametrize("total_dbsm", [-15.0, 3.0])
@pytest.mark.parametrize(("species", "style"), [("dog", "trot"), ("cat", "sit"), ("dog", "sniff")])
def test_total_is_what_was_asked_for(species, style, total_dbsm):
    one = pet(3, species=species, style=style, total_rcs_dbsm=total_dbsm)
    path = getattr(one.motion.action, "path", None)
    t = np.linspace(0.0, path.end_s if path else 40.0, 150)
    around = np.linspace(0, 2 * math.pi, 36, endpoint=False)
    views = [
        one.at(t + 1e-3 * k, 1e5 * np.array([math.cos(a), math.sin(a), 0])).rcs_m2.sum(axis=1)
        for k, a in enumerate(around)
    ]
    # Of one that stays, each part shows a few aspects only: its fluctuation has not averaged out.
    assert 10 * math.log10(np.mean(views)) == pytest.approx(total_dbsm, abs=1.0)


def test_the_total_tells_nothing_about_species_and_mass():
    pets = [pet(seed, species=species) for seed in range(100) for species in ("cat", "dog")]
    dbsm = np.array([10 * math.log10(physical_m2(one)) for one in pets])
    assert -15.5 < dbsm.min() < -13
    assert 1 < dbsm.max() < 3.5
    assert abs(dbsm[::2].mean() - dbsm[1::2].mean()) < 1.5
    mass = np.log([one.motion.build.mass_kg for one in pets])
    assert abs(np.corrcoef(mass, dbsm)[0, 1]) < 0.2


@pytest.mark.parametrize(
    ("species", "mass_kg", "least_m2", "most_m2"),
    [
        ("cat", 4.0, 0.02, 0.09),
        ("cat", 6.5, 0.02, 0.09),
        ("dog", 20.0, 0.08, 0.35),
        ("rabbit", 2.0, 0.01, 0.04),
    ],
)
@pytest.mark.parametrize("style", ["roam", "sit", "lie"])
def test_physical_totals_are_those_of_cats_and_dogs(species, mass_kg, least_m2, most_m2, style):
    for seed in range(6):
        one = pet(seed, species=species, style=style, mass_kg=mass_kg, total_rcs_dbsm="physical")
        assert one.skin.scale == 1
        assert least_m2 < physical_m2(one) < most_m2


def test_broadside_a_dog_is_larger_than_end_on():
    one = pet(4, style="stand", path=Path.standing((0.0, 3.0)), total_rcs_dbsm="physical")
    t = np.linspace(0, 60, 300)
    side, front = (
        one.at(t, 1e5 * np.array(d)).rcs_m2.sum(axis=1).mean()
        for d in ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0))
    )
    assert 5 < 10 * math.log10(side / front) < 20


@pytest.mark.parametrize(("species", "style"), STAYING)
def test_one_that_stays_does_so_where_the_path_begins(species, style):
    path = Path.through(((1.0, 2.0), (1.0, 4.0)), 0.5)
    one = pet(0, species=species, style=style, path=path)
    centre, axis, _ = one.motion.posture(np.arange(0, 30, 0.5))
    plays = style == "play"
    assert np.abs(centre[:, 0, :2] - [1.0, 2.0]).max() < (0.4 if plays else 0.03)
    assert (axis[:, 0, 1].min() > 0.7) is not plays


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"species": "horse"}, "species"),
        ({"style": "moonwalk"}, "style"),
        ({"species": "cat", "style": "pace"}, "style"),
        ({"species": "dog", "style": "bound"}, "style"),
        ({"mass_kg": 0.5}, "mass_kg"),
        ({"species": "cat", "mass_kg": 20.0}, "mass_kg"),
        ({"mass_kg": math.nan}, "mass_kg"),
        ({"style": "walk", "path": run_past(4.0)}, "path"),
        ({"species": "cat", "style": "roam", "path": run_past(11.0)}, "path"),
        ({"style": "roam", "path": [(0.0, 1.0)]}, "waypoints_m"),
        ({"total_rcs_dbsm": 90.0}, "total_rcs_dbsm"),
    ],
)
def test_impossible_pets_are_refused(keys, named):
    with pytest.raises(SceneError, match=named):
        pet(**keys)


@pytest.mark.parametrize("species", SPECIES)
def test_who_grooms_licks_with_the_nose_down(species):
    one = pet(3, species=species, style="groom")
    t = np.arange(0, 40, 0.01)
    head = one.at(t, ANTENNA).position_m[:, part(one, "head"), 2]
    assert strongest_hz(head, 0.01) == pytest.approx(one.manner.lick_hz, abs=0.1)
    assert 1.5 <= one.manner.lick_hz <= 3.5
    assert pet(3, species=species, style="sit").manner.lick_rad == 0


@pytest.mark.parametrize("species", SPECIES)
def test_who_scratches_does_so_with_one_hind_paw_in_bouts(species):
    one = pet(3, species=species, style="scratch")
    t = np.arange(0, 40, 0.01)
    place = one.at(t, ANTENNA).position_m
    paws = np.stack([place[:, part(one, f"{leg} paw")] for leg in LEGS], axis=1)
    speed = np.linalg.norm(np.diff(paws, axis=0), axis=-1) / 0.01
    leg = one.motion.action.scratch.leg
    assert LEGS[leg].endswith("hind")
    busy = speed[:, leg] > 0.2
    assert 0.2 < busy.mean() < 0.95
    assert np.delete(speed, leg, axis=1).max() < 1e-9
    assert strongest_hz(paws[:, leg, 2], 0.01) == pytest.approx(
        one.motion.action.scratch.hz, abs=0.2
    )


@pytest.mark.parametrize("species", SPECIES)
def test_who_plays_turns_on_paws_that_stand_in_turn(species):
    for seed in range(4):
        one = pet(seed, species=species, style="play")
        t = np.arange(0, 40, 0.005)
        stance = one.motion.action.at(t)
        speed = np.linalg.norm(np.diff(stance.paw_m, axis=0), axis=-1) / 0.005
        assert speed.max() < 5
        assert 0.45 < np.mean(speed < 1e-6) < 0.75
        # Two paws at least carry it most of the time, and each comes down under the trunk.
        assert np.mean((speed < 1e-6).sum(axis=1) >= 2) > 0.7
        assert np.ptp(stance.heading_rad) > 1.0
        assert stance.paw_m[..., 2].min() >= 0
        away = np.linalg.norm((stance.paw_m - stance.middle_m[:, None])[..., :2], axis=-1)
        assert away.max() < 1.6 * (one.motion.build.back_m / 2 + one.motion.build.half_track_m)
        assert one.manner.breath_hz > pet(seed, species=species, style="sit").manner.breath_hz
