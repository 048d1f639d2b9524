"""Skins: totals, aspects, shadows, and that what does not move does not scintillate."""

import numpy as np
import pytest

from x2radar.errors import SceneError
from x2radar.sim.bodies.person.build import NAMES, TRUNK, draw_person_build
from x2radar.sim.bodies.person.person import draw_person
from x2radar.sim.bodies.quadruped.pet import draw_pet
from x2radar.sim.bodies.skin.base import SKIN_REFLECTION, Loudness, sized
from x2radar.sim.bodies.skin.capsules import CapsuleSkin
from x2radar.sim.bodies.skin.draw import SKINS, draw_skin
from x2radar.sim.bodies.skin.ellipsoids import EllipsoidSkin

ANTENNA = np.array([0.0, 0.0, 1.1])
HALF = draw_person_build(np.random.default_rng(0)).half_lengths()


def posture(n=4, turn_rad=0.0):
    """Sixteen segments on a line in front of the antenna, standing up, turned about z."""
    k = len(HALF)
    centre = np.zeros((n, k, 3))
    centre[..., 1] = 2.0
    centre[..., 0] = np.linspace(-0.4, 0.4, k)
    centre[..., 2] = 1.0
    axis = np.broadcast_to([0.0, 0.0, 1.0], (n, k, 3)).copy()
    side = np.broadcast_to([np.cos(turn_rad), np.sin(turn_rad), 0.0], (n, 1, 3)).copy()
    return centre, axis, side


@pytest.mark.parametrize("name", SKINS)
def test_every_skin_keeps_the_contract(name):
    skin = draw_skin(np.random.default_rng(3), name, HALF, TRUNK)
    points = skin.points(*posture(), ANTENNA)
    n = len(skin.names(NAMES))
    assert points.position_m.shape == (4, n, 3)
    assert points.rcs_m2.shape == (4, n)
    assert (points.rcs_m2 >= 0).all()
    assert np.isfinite(points.rcs_m2).all()
    assert points.nearer_m is None or points.nearer_m.shape == (4, n)


@pytest.mark.parametrize("name", SKINS)
def test_what_does_not_move_does_not_scintillate(name):
    skin = draw_skin(np.random.default_rng(4), name, HALF, TRUNK)
    rcs = skin.points(*posture(50), ANTENNA).rcs_m2
    assert np.ptp(rcs, axis=0).max() == 0.0


@pytest.mark.parametrize("name", SKINS)
@pytest.mark.parametrize("dbsm", [-30.0, -3.0, 5.0])
def test_the_total_is_what_was_asked_for(name, dbsm):
    rng = np.random.default_rng(5)
    centre, axis, side = posture()
    skin = sized(draw_skin(rng, name, HALF, TRUNK), rng, dbsm, (centre, axis, side))
    side = np.broadcast_to(side, axis.shape)
    assert 10 * np.log10(skin.mean_total_m2(centre, axis, side)) == pytest.approx(dbsm, abs=0.01)


@pytest.mark.parametrize("name", SKINS)
def test_a_persons_physical_total_is_of_the_published_order(name):
    # 0.4 to 1.5 m2 at 5 to 9 GHz (Schultz 1958); models spread about it by a factor of four.
    totals = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        person = draw_person(rng, skin=name, total_rcs_dbsm="physical", height_m=1.75)
        t_s = np.linspace(1, 6, 40)
        totals.append(person.at(t_s, np.array([0.0, -20.0, 1.0])).rcs_m2.sum(axis=1).mean())
    assert 0.1 < np.median(totals) < 4.0


def test_an_ellipsoid_has_the_cross_section_of_the_handbook():
    skin = EllipsoidSkin.draw(np.random.default_rng(0), np.array([[0.3, 0.05, 0.05]]))
    still = skin.points(
        np.array([[[0.0, 2.0, 1.1]]]),
        np.array([[[0, 0, 1.0]]]),
        np.array([[[1.0, 0, 0]]]),
        ANTENNA,
    )
    factor = skin.fluctuation.at(np.array([[[0.0, 0.0, 1.0]]]))
    a, b, c = 0.3, 0.05, 0.05
    expected = SKIN_REFLECTION * np.pi * (a * b * c) ** 2 / c**4
    broadside = still.rcs_m2[0, 0] / skin.fluctuation.at(np.array([[[0.0, 0.0, -1.0]]]))
    assert broadside[0, 0] == pytest.approx(expected, rel=1e-6)
    assert factor > 0


def test_a_sphere_of_a_capsule_echoes_alike_from_everywhere():
    skin = CapsuleSkin.draw(np.random.default_rng(1), np.array([[0.1, 0.1, 0.1]]))
    around = np.linspace(0, 2 * np.pi, 9)
    seen = [
        skin.points(
            np.array([[[0.0, 0.0, 1.1]]]),
            np.array([[[0, 0, 1.0]]]),
            np.array([[[1.0, 0, 0]]]),
            np.array([3 * np.cos(a), 3 * np.sin(a), 1.1]),
        ).rcs_m2.sum()
        for a in around
    ]
    assert np.ptp(seen) < 1e-12


def test_a_part_behind_another_is_in_its_shadow():
    half = np.array([[0.4, 0.15, 0.15], [0.1, 0.03, 0.03]])
    skin = CapsuleSkin.draw(np.random.default_rng(2), half)
    axis = np.broadcast_to([0.0, 0.0, 1.0], (3, 2, 3)).copy()
    centre = np.zeros((3, 2, 3))
    centre[:, :, 2] = 1.1
    centre[:, 0, 1] = 2.0
    centre[:, 1] = [[0.0, 2.5, 1.1], [0.0, 1.5, 1.1], [0.6, 2.5, 1.1]]  # behind, before, beside
    lit = skin._lit(centre, axis, ANTENNA)
    assert 10 * np.log10(lit[0, 1]) == pytest.approx(-skin.shadow_db, abs=0.2)
    assert lit[1, 1] == lit[2, 1] == 1.0
    assert lit[0, 0] == 1.0


@pytest.mark.parametrize("draw", [draw_person, draw_pet])
@pytest.mark.parametrize("skin", SKINS)
@pytest.mark.parametrize("motion", ["gait", "footfalls", "angles"])
def test_any_motion_goes_with_any_skin(draw, skin, motion):
    kwargs = {"species": "dog"} if draw is draw_pet else {}
    style = "walk"
    body = draw(np.random.default_rng(7), style=style, motion=motion, skin=skin, **kwargs)
    again = draw(np.random.default_rng(7), style=style, motion=motion, skin=skin, **kwargs)
    t_s = np.linspace(0, 8, 50)
    points = body.at(t_s, ANTENNA)
    assert points.rcs_m2.shape == (50, len(body.names))
    assert np.isfinite(points.position_m).all()
    assert np.isfinite(points.rcs_m2).all()
    assert np.array_equal(points.position_m, again.at(t_s, ANTENNA).position_m)
    # No state: any times in any order.
    backwards = body.at(t_s[::-1], ANTENNA)
    assert np.allclose(points.rcs_m2, backwards.rcs_m2[::-1], rtol=1e-9)


def test_an_unknown_skin_is_refused():
    with pytest.raises(SceneError, match="skin: no skin 'fur'; known are surface, points"):
        draw_skin(np.random.default_rng(0), "fur", HALF)
    with pytest.raises(SceneError, match="at most 1 m"):
        draw_skin(np.random.default_rng(0), "points", [[2.0, 0.1, 0.1]])


def share_db(body, low_mps, high_mps):
    """Power of a body's echo between two speeds over all of it, by its phase alone."""
    rate_hz, wave_m = 60, 0.044
    t_s = np.arange(34 * rate_hz) / rate_hz
    points = body.at(t_s, ANTENNA)
    range_m = np.linalg.norm(points.position_m - ANTENNA, axis=-1)
    if points.nearer_m is not None:
        range_m = range_m - points.nearer_m
    echo = (np.sqrt(points.rcs_m2) * np.exp(-4j * np.pi * range_m / wave_m)).sum(axis=1)
    power = np.abs(np.fft.fft(echo * np.hanning(len(echo)))) ** 2
    speed = np.abs(np.fft.fftfreq(len(echo), 1 / rate_hz)) * wave_m / 2
    band = (speed > low_mps) & (speed < high_mps)
    return 10 * np.log10(power[band].sum() / power.sum())


@pytest.mark.parametrize("skin", SKINS)
@pytest.mark.parametrize("seed", range(3))
def test_who_stands_still_has_no_echo_of_somebody_who_goes(skin, seed):
    person = draw_person(
        np.random.default_rng(seed), style="stand", path=[(0.0, 2.5), (0.0, 1.0)], skin=skin
    )
    assert share_db(person, 0.03, 0.1) > -60  # it sways and breathes
    assert share_db(person, 0.1, 0.3) < -50


@pytest.mark.parametrize("name", ["points", "ellipsoids", "capsules"])
def test_groups_of_parts_lose_what_their_loudness_says(name):
    trunk = tuple(range(TRUNK))
    quieter = Loudness(losses=((trunk, 10.0),))
    shares = []
    for loudness in (Loudness(), quieter):
        found = []
        for seed in range(40):
            skin = draw_skin(np.random.default_rng(seed), name, HALF, TRUNK, loudness)
            rcs = skin.points(*posture(1), ANTENNA).rcs_m2[0]
            names = np.array(skin.names(NAMES))
            of_trunk = np.char.startswith(names, "trunk")
            of_trunk |= np.char.startswith(names, "chest") | np.char.startswith(names, "pelvis")
            found.append(rcs[of_trunk].sum() / rcs[~of_trunk].sum())
        shares.append(10 * np.log10(np.array(found)))
    assert 3.0 < (shares[0] - shares[1]).mean() < 7.0


def test_a_dogs_paws_are_quieter_than_theory_has_them():
    ends, thighs = [], []
    for seed in range(40):
        dog = draw_pet(np.random.default_rng(seed), species="dog", style="walk", skin="ellipsoids")
        names = np.array(dog.names)
        gain = dog.skin.gain
        ends.append(gain[np.char.endswith(names, "paw")].mean())
        thighs.append(gain[np.char.endswith(names, "upper leg")].mean())
    assert 3.0 < 10 * np.log10(np.median(thighs) / np.median(ends)) < 7.0
