"""The trunk as one surface: people, cats and dogs alike."""

from dataclasses import replace

import numpy as np
import pytest

from x2radar.sim.bodies.person.build import draw_person_build
from x2radar.sim.bodies.person.person import draw_person
from x2radar.sim.bodies.quadruped.pet import draw_pet
from x2radar.sim.bodies.skin.surface import SurfaceSkin
from x2radar.sim.place.antenna import Antenna

HALF_M = np.array([(0.3, 0.12, 0.15), (0.15, 0.11, 0.15), (0.12, 0.1, 0.12), (0.1, 0.05, 0.05)])
N_TRUNK = 3
ANTENNA_M = np.array([0.0, 0.0, 1.2])
T_S = np.arange(200) / 50
BODIES = ["person", "cat", "dog"]


def lying(n, turn_rad):
    """A trunk along the floor 2 m ahead that turns round, and a limb under it."""
    along = np.stack([np.cos(turn_rad), np.sin(turn_rad), 0 * turn_rad], axis=-1)
    left = np.stack([-np.sin(turn_rad), np.cos(turn_rad), 0 * turn_rad], axis=-1)
    middle = np.array([0.0, 2.0, 1.2])
    offset = np.array([0.0, 0.2, -0.2, 0.0])[:n, None]
    centre = middle + offset * along[:, None]
    centre[:, N_TRUNK:, 2] -= 0.3
    return centre, np.repeat(along[:, None], n, axis=1), left[:, None]


def both(seed=0):
    """One body with its trunk as one surface, and the same with parts by themselves."""
    one = SurfaceSkin.draw(np.random.default_rng(seed), HALF_M, n_trunk=N_TRUNK)
    return one, SurfaceSkin.draw(np.random.default_rng(seed), HALF_M)


def drawn(kind, seed):
    rng = np.random.default_rng(seed)
    path = [(-0.3, 4.0), (0.2, 1.5)]
    if kind == "person":
        return draw_person(rng, path=path, speed_mps=0.6)
    return draw_pet(rng, species=kind, style="walk", path=path)


def trunk_fields(kind, seed, wave_m=0.044):
    """Power of the trunk's echo and the sum of its powers, shape (n_slow,)."""
    points = drawn(kind, seed).at(T_S, ANTENNA_M)
    rows = Antenna(height_m=1.2, shape="isotropic").direct(points)
    part = slice(0, N_TRUNK)
    turn = np.exp(4j * np.pi * rows.range_m[:, part] / wave_m)
    field = np.abs((rows.root_rcs_m[:, part] * turn).sum(axis=1)) ** 2
    return field, points.rcs_m2[:, part].sum(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_the_sum_of_cross_sections_is_that_of_the_parts(seed):
    one, apart = both(seed)
    turn = np.linspace(0, 2 * np.pi, 100)
    args = (*lying(4, turn), ANTENNA_M)
    ours, theirs = one.points(*args), apart.points(*args)
    assert ours.rcs_m2.sum(axis=1) == pytest.approx(theirs.rcs_m2.sum(axis=1), rel=1e-12)
    # What is no trunk is left alone.
    assert np.array_equal(ours.rcs_m2[:, 3], theirs.rcs_m2[:, 3])
    assert np.array_equal(ours.position_m[:, 3], theirs.position_m[:, 3])
    assert ours.rcs_m2.min() > 0
    assert (ours.rcs_m2[:, 1:3] <= theirs.rcs_m2[:, 1:3] * (1 + 1e-12)).all()


def test_the_spot_is_where_the_surface_is_nearest():
    one, apart = both()
    turn = np.linspace(0, 2 * np.pi, 721)
    args = (*lying(4, turn), ANTENNA_M)
    seen = Antenna(height_m=1.2, shape="isotropic")
    spot_m = seen.direct(one.points(*args)).range_m[:, 0]
    near_m = seen.direct(apart.points(*args)).range_m[:, :N_TRUNK].min(axis=1)
    assert (spot_m - near_m).min() > -1e-9
    # Where several are about equally near, it is between them: some millimetres.
    assert (spot_m - near_m).max() < 0.02
    # It slides: half a degree moves it no more than the end of the trunk moves.
    assert np.abs(np.diff(spot_m)).max() < 0.4 * np.deg2rad(0.5)


def test_a_glint_does_not_move_the_spot():
    one, _ = both()
    dull = replace(
        one, fluctuation=replace(one.fluctuation, amplitude=0 * one.fluctuation.amplitude)
    )
    turn = np.linspace(0, 0.4, 400)
    glints, plain = (skin.points(*lying(4, turn), ANTENNA_M) for skin in (one, dull))
    share = glints.rcs_m2[:, 0] / plain.rcs_m2[:, 0]
    assert np.ptp(share / share.mean()) > 0.2
    assert np.array_equal(glints.nearer_m[:, 0], plain.nearer_m[:, 0])


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("seed", range(3))
def test_the_spot_of_a_whole_body_is_where_its_trunk_is_nearest(kind, seed):
    body = drawn(kind, seed)
    apart = replace(body, skin=replace(body.skin, n_trunk=1))
    seen = Antenna(height_m=1.2, shape="isotropic")
    ours, theirs = (seen.direct(b.at(T_S, ANTENNA_M)).range_m for b in (body, apart))
    # Breathing swells chest and hips by some millimetres unlike.
    assert np.abs(ours[:, 0] - theirs[:, :N_TRUNK].min(axis=1)).max() < 0.025


@pytest.mark.parametrize("kind", BODIES)
def test_trunks_of_all_kinds_do_not_fade(kind):
    """The field's power stays by the sum of powers; of three equal parts it would not."""
    ratio = np.concatenate([np.divide(*trunk_fields(kind, seed)) for seed in range(12)])
    assert np.quantile(ratio, 0.02) > 0.2
    # Parts by themselves give 4.7 dB or more; all kinds have to be alike here.
    assert 0.5 < (10 * np.log10(ratio)).std() < 3.0


def test_a_person_is_as_much_trunk_as_its_skin_is():
    """36 % of the surface is trunk, 36 % legs, 18 % arms, 9 % head (rule of nines, recalled)."""
    shares = []
    for seed in range(12):
        person = draw_person(np.random.default_rng(seed), total_rcs_dbsm=0)
        centre, axis, side = person.action.posture(np.linspace(1, 5, 6))
        side = np.broadcast_to(side, axis.shape)
        for turn in np.linspace(0, 2 * np.pi, 12, endpoint=False):
            away = np.array([50 * np.cos(turn), 50 * np.sin(turn), 1.2])
            rcs = person.skin.points(centre, axis, side, away).rcs_m2
            shares.append(rcs.mean(axis=0))
    total = np.mean(shares, axis=0)
    part = [total[k].sum() / total.sum() for k in (slice(3), slice(10, 16), slice(4, 10), 3)]
    assert part == pytest.approx([0.36, 0.36, 0.18, 0.09], abs=0.12)


def test_the_trunk_is_as_long_as_its_ends():
    build = draw_person_build(np.random.default_rng(0), height_m=1.75)
    trunk, chest, pelvis = build.half_lengths()[:N_TRUNK]
    assert trunk[0] > chest[0] + pelvis[0]
    assert trunk[1:] == pytest.approx(chest[1:])
