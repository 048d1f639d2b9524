import math

import numpy as np
import pytest

from x2radar.errors import SceneError
from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.flyer.flyer import (
    BIRD_MASS_KG,
    BIRD_STYLES,
    MOTH_BEAT_HZ,
    draw_bird,
    draw_moth,
)

ANTENNA = np.array([0.0, 0.0, 1.2])
MANY_S = np.arange(0, 60, 0.37)


def bird(seed=0, **keys):
    return draw_bird(np.random.default_rng(seed), **keys)


def moth(seed=0, **keys):
    return draw_moth(np.random.default_rng(seed), **keys)


FLYERS = {
    **{
        f"{species} {style}": lambda seed=0, species=species, style=style: bird(
            seed, species=species, style=style
        )
        for species in BIRD_MASS_KG
        for style in BIRD_STYLES
    },
    "moth": moth,
}


def main_line_hz(signal, rate_hz, above_hz=0.0):
    """Frequency of the strongest line, to a tenth of a bin."""
    n = len(signal)
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(n)))
    hz = np.fft.rfftfreq(n, 1 / rate_hz)
    spectrum[hz < above_hz] = 0
    k = spectrum.argmax()
    left, mid, right = np.log(spectrum[k - 1 : k + 2])
    return (k + 0.5 * (left - right) / (left - 2 * mid + right)) * rate_hz / n


@pytest.mark.parametrize("name", FLYERS)
def test_points_are_what_a_mover_gives(name):
    one = FLYERS[name](3)
    t = np.arange(400) / 200
    points = one.at(t, ANTENNA)
    assert one.label == ("other" if name == "moth" else "pet")
    assert points.position_m.shape == (400, len(one.names), 3)
    assert points.rcs_m2.shape == (400, len(one.names))
    assert np.isfinite(points.position_m).all()
    assert (points.rcs_m2 > 0).all()
    nothing = one.at(np.zeros(0), ANTENNA)
    assert nothing.position_m.shape == (0, len(one.names), 3)


@pytest.mark.parametrize("name", FLYERS)
def test_one_seed_one_flyer_and_no_state(name):
    t = np.random.default_rng(1).uniform(0, 300, 80)
    whole = FLYERS[name](5).at(t, ANTENNA)
    again = FLYERS[name](5).at(t[::-1], ANTENNA)
    assert again.position_m[::-1] == pytest.approx(whole.position_m, abs=1e-12)
    assert again.rcs_m2[::-1] == pytest.approx(whole.rcs_m2, rel=1e-5)
    for k in (0, 33, 79):
        alone = FLYERS[name](5).at(t[k : k + 1], ANTENNA)
        assert alone.position_m[0] == pytest.approx(whole.position_m[k], abs=1e-12)
        assert alone.rcs_m2[0] == pytest.approx(whole.rcs_m2[k], rel=1e-5)
    other = FLYERS[name](6).at(t, ANTENNA)
    assert np.abs(other.position_m - whole.position_m).max() > 1e-3


@pytest.mark.parametrize("name", FLYERS)
@pytest.mark.parametrize("seed", range(3))
def test_it_moves_without_jumps(name, seed):
    one = FLYERS[name](seed)
    step_s = 0.0005
    t = np.arange(0, 62, step_s)
    place = np.array([one.flight.at(part)[0] for part in np.split(t, 8)]).reshape(-1, 3)
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / step_s
    assert speed.max() < 8
    # Wings turn at up to 400 rad/s past the antenna: a hundredth of a radian a step.
    fine_s = 2e-5
    points = one.at(np.arange(8000) * fine_s, ANTENNA)
    tips = np.linalg.norm(np.diff(points.position_m, axis=0), axis=-1) / fine_s
    assert tips.max() < 20
    assert np.abs(np.diff(np.log(points.rcs_m2), axis=0)).max() < 0.15


@pytest.mark.parametrize("seed", range(6))
def test_wings_beat_at_the_rate_of_the_build(seed):
    for one in (bird(seed, style="flutter"), bird(seed, species="pigeon"), moth(seed)):
        t = np.arange(8000) / 1000
        axis = one.posture(t)[1]
        lift = axis[:, one.names.index("left outer wing"), 2]
        assert main_line_hz(lift, 1000, 4) == pytest.approx(one.build.beat_hz, abs=0.2)


def test_small_birds_beat_faster_and_within_eight_to_twenty_hertz():
    beats = {
        kg: np.mean([bird(seed, mass_kg=kg).build.beat_hz for seed in range(40)])
        for kg in (0.02, 0.035, 0.1, 0.3)
    }
    assert list(beats.values()) == sorted(beats.values(), reverse=True)
    assert beats[0.035] == pytest.approx(14, abs=1.5)
    assert beats[0.3] == pytest.approx(7.7, abs=0.8)
    every = [
        bird(seed, species=species).build.beat_hz for species in BIRD_MASS_KG for seed in range(40)
    ]
    assert 6 < min(every) < max(every) < 20


def test_moths_beat_at_twenty_to_sixty_hertz_and_large_ones_slower():
    builds = [moth(seed).build for seed in range(200)]
    beats = np.array([b.beat_hz for b in builds])
    assert MOTH_BEAT_HZ[0] <= beats.min() < 25
    assert 50 < beats.max() <= MOTH_BEAT_HZ[1]
    assert np.corrcoef([b.span_m for b in builds], beats)[0, 1] < -0.7


def test_wings_keep_their_length_and_mirror():
    one = bird(1)
    centre, axis, _ = one.posture(np.arange(0, 3, 0.01))
    assert np.linalg.norm(axis, axis=-1) == pytest.approx(1, abs=1e-12)
    from_body = np.linalg.norm(centre - centre[:, :1], axis=-1)
    left, right = (one.names.index(f"{side} outer wing") for side in ("left", "right"))
    assert from_body[:, left] == pytest.approx(from_body[:, right])
    assert from_body[:, left].max() < one.build.span_m / 2
    inner = one.names.index("left inner wing")
    assert from_body[:, inner] == pytest.approx(0.11 * one.build.span_m)


def test_a_perched_bird_sits_breathes_and_hops():
    one = bird(4, style="perch")
    t = np.arange(0, 2 * one.flight.period_s, 0.01)
    place, _, effort = one.flight.at(t)
    sits = effort == 0
    assert sits.mean() > 0.85
    starts = np.flatnonzero(~sits[1:] & sits[:-1])
    assert len(starts) == pytest.approx(2 * len(one.flight.hop_s), abs=1)
    body = one.posture(t)[0][:, 0] - place
    swell = body[sits, 2]
    assert swell.max() == pytest.approx(one.build.breath_m, rel=0.02)
    assert 0.0003 < one.build.breath_m < 0.003
    # The same hops come again, and nothing jumps where a period ends.
    period = one.flight.period_s
    edge = one.flight.at(np.array([period - 1e-6, period + 1e-6]))[0]
    assert edge[0] == pytest.approx(edge[1], abs=1e-4)


def test_resting_wings_lie_along_a_bird_that_sits_and_stay_out_in_a_glide():
    sitting = bird(2, style="perch")
    t = np.arange(0, 30, 0.05)
    left = sitting.names.index("left inner wing")
    nose = sitting.posture(t)[1][:, 0]
    wing = sitting.posture(t)[1][:, left]
    rest = sitting.flight.at(t)[2] == 0
    assert (nose * wing).sum(axis=1)[rest].max() < -0.9
    gliding = bird(2, style="circle")
    axis = gliding.posture(t)[1]
    assert (gliding.flight.at(t)[2] == 0).any()
    assert np.abs((axis[:, 0] * axis[:, left]).sum(axis=1)).max() < 0.1


def test_flyers_stay_near_home():
    home = (0.3, 2.0, 1.5)
    for seed in range(5):
        for one, reach in ((bird(seed, home_m=home), 1.6), (moth(seed, home_m=home), 0.4)):
            away = np.linalg.norm(one.at(MANY_S, ANTENNA).position_m - home, axis=-1)
            assert away.max() < reach + one.build.span_m


@pytest.mark.parametrize("total_dbsm", [-30.0, -5.0])
def test_total_is_what_was_asked_for(total_dbsm):
    for one in (
        bird(1, total_rcs_dbsm=total_dbsm),
        moth(1, total_rcs_dbsm=total_dbsm),
    ):
        around = np.linspace(0, 2 * math.pi, 36, endpoint=False)
        views = [
            one.at(MANY_S + k, 1e5 * np.array([math.cos(a), math.sin(a), 0])).rcs_m2
            for k, a in enumerate(around)
        ]
        total = np.mean([v.sum(axis=1).mean() for v in views])
        # Each part shows a few aspects only: its fluctuation has not averaged out.
        assert 10 * math.log10(total) == pytest.approx(total_dbsm, abs=1.6)


def physical_dbsm(one):
    return 10 * math.log10(one.skin.mean_total_m2(*one.posture(MANY_S)))


def test_physical_totals_are_those_of_birds_and_moths():
    for seed in range(10):
        budgerigar = bird(seed, total_rcs_dbsm="physical")
        pigeon = bird(seed, species="pigeon", total_rcs_dbsm="physical")
        assert -32 < physical_dbsm(budgerigar) < -22
        assert -26 < physical_dbsm(pigeon) < -17
        assert -42 < physical_dbsm(moth(seed)) < -29


def test_close_to_the_antenna_a_moth_is_as_loud_as_a_dog():
    dog_dbsm, dog_range_m = -9.0, 2.0
    loud = 10 ** (dog_dbsm / 10) / dog_range_m**4
    one = moth(3, home_m=(0.0, 0.3, 1.2))
    points = one.at(MANY_S, ANTENNA)
    distance = np.linalg.norm(points.position_m - ANTENNA, axis=-1)
    assert (points.rcs_m2 / distance**4).sum(axis=1).mean() > loud


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"species": "dragon"}, "species"),
        ({"style": "swim"}, "style"),
        ({"mass_kg": 5.0}, "mass_kg"),
        ({"mass_kg": math.nan}, "mass_kg"),
        ({"home_m": (0.0, math.nan, 0.0)}, "home_m"),
        ({"total_rcs_dbsm": 99.0}, "total_rcs_dbsm"),
    ],
)
def test_impossible_birds_are_refused(keys, named):
    with pytest.raises(SceneError, match=named):
        bird(**keys)


@pytest.mark.parametrize("home_m", [(math.inf, 0.0, 0.0), (0.0, 0.0, 1e4)])
def test_impossible_moths_are_refused(home_m):
    with pytest.raises(SceneError, match="home_m"):
        moth(home_m=home_m)


def test_a_wander_keeps_its_limits_and_its_rate():
    limits, rate = np.array([0.3, 1.0, 0.0]), np.array([0.5, 2.0, 0.0])
    one = Wander.draw(np.random.default_rng(0), limits, rate)
    t = np.arange(0, 2000, 0.01)
    values = one.at(t)
    assert (np.abs(values).max(axis=0) <= limits + 1e-12).all()
    assert np.abs(values).max(axis=0) == pytest.approx(limits, rel=0.25)
    rms = np.sqrt((np.gradient(values, 0.01, axis=0) ** 2).mean(axis=0))
    assert rms == pytest.approx(rate, rel=0.03)
