import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from x2radar.sim.bodies.skin.aspect import AspectFluctuation
from x2radar.sim.bodies.skin.base import SKIN_REFLECTION, WAVELENGTH_M, draw_total_m2, sized
from x2radar.sim.bodies.skin.surface import FLOOR, SHADOW_DB, SPREAD_DB, SurfaceSkin
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.points import Points

X, Y, Z = np.eye(3)
FAR = 1e6


def steady(rcs):
    """Cross sections of a body whose fluctuation is switched off."""
    still = replace(rcs.fluctuation, amplitude=0 * rcs.fluctuation.amplitude)
    return replace(rcs, fluctuation=still)


def one(half_m, seed=0):
    return steady(SurfaceSkin.draw(np.random.default_rng(seed), np.array([half_m])))


def echo(rcs, *args):
    """Cross sections alone."""
    return rcs.points(*args).rcs_m2


def seen(rcs, direction, *, axis=X, side=Y):
    """Cross section of a lone segment at the origin, seen from far along `direction`."""
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    args = (np.zeros((1, 1, 3)), axis.reshape(1, 1, 3), side.reshape(1, 1, 3))
    return rcs.points(*args, FAR * unit).rcs_m2[0, 0]


def curvature_rcs(half_m, unit):
    """pi over the Gaussian curvature where an ellipsoid faces `unit`, in another way.

    The point with normal n is A^2 n / |A n|; the curvature there is
    1 / ((a b c)^2 (sum p_i^2 / a_i^4)^2).
    """
    square = np.asarray(half_m) ** 2
    point = square * unit / math.sqrt((square * unit**2).sum())
    curvature = 1 / (square.prod() * (point**2 / square**2).sum() ** 2)
    return SKIN_REFLECTION * math.pi / curvature


@pytest.mark.parametrize("half_m", [(0.1, 0.1, 0.1), (0.3, 0.15, 0.1), (0.2, 0.02, 0.02)])
def test_along_its_axes_an_ellipsoid_has_the_textbook_echo(half_m):
    a, b, c = half_m
    rcs = one(half_m)
    gain = SKIN_REFLECTION * math.pi
    for unit, radius in ((X, b * c / a), (Y, a * c / b), (Z, a * b / c)):
        wanted = max(gain * radius**2, rcs.floor_m2[0])
        assert seen(rcs, unit) == pytest.approx(wanted, rel=1e-9)
        assert seen(rcs, -unit) == pytest.approx(wanted, rel=1e-9)


def test_a_sphere_is_the_same_from_everywhere():
    rng = np.random.default_rng(1)
    for direction in rng.standard_normal((20, 3)):
        wanted = SKIN_REFLECTION * math.pi * 0.07**2
        assert seen(one((0.07, 0.07, 0.07)), direction) == pytest.approx(wanted, rel=1e-9)


@given(
    st.tuples(*[st.floats(0.005, 1.0) for _ in range(3)]),
    st.tuples(*[st.floats(-1, 1) for _ in range(3)]),
    st.integers(0, 2**31),
)
@settings(max_examples=200)
def test_any_ellipsoid_from_anywhere_is_the_curvature_at_its_bright_spot(half, along, seed):
    if np.linalg.norm(along) < 0.01:
        along = (1.0, 0.0, 0.0)
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    unit = np.asarray(along) / np.linalg.norm(along)
    rcs = one(half)
    wanted = max(curvature_rcs(half, unit), rcs.floor_m2[0])
    ours = seen(rcs, turn @ unit, axis=turn @ X, side=turn @ Y)
    assert ours == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("half_m", [(0.25, 0.02, 0.02), (0.3, 0.15, 0.1), (0.01, 0.2, 0.3)])
def test_no_view_is_below_the_floor(half_m):
    rng = np.random.default_rng(2)
    directions = np.concatenate([np.eye(3), rng.standard_normal((300, 3))])
    for seed in range(5):
        rcs = one(half_m, seed)
        views = [seen(rcs, d) for d in directions]
        assert FLOOR[0] <= rcs.floor_m2[0] / max(views) <= FLOOR[1]
        assert min(views) >= rcs.floor_m2[0]
        assert min(views) == pytest.approx(rcs.floor_m2[0])


def limb_beside_trunk(place):
    """A long level trunk along x and a small ball at `place`."""
    centre = np.array([[[0, 0, 0], place]], float)
    axis = np.array([[X, X]])
    return centre, axis, np.array([[Y]])


BALL = (0.05, 0.05, 0.05)
OPEN_M2 = SKIN_REFLECTION * math.pi * 0.05**2


def lost_db(place, direction, seed=0):
    rcs = steady(SurfaceSkin.draw(np.random.default_rng(seed), [(0.35, 0.12, 0.14), BALL]))
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    ours = rcs.points(*limb_beside_trunk(place), FAR * unit).rcs_m2[0, 1]
    return 10 * math.log10(OPEN_M2 / ours), rcs.shadow_db[1]


@pytest.mark.parametrize("seed", range(8))
def test_behind_the_trunk_a_limb_loses_six_to_fifteen_decibels(seed):
    lost, depth = lost_db((0, -0.3, 0), (0, 1, 0), seed)
    assert SHADOW_DB[0] <= depth <= SHADOW_DB[1]
    assert lost == pytest.approx(depth, abs=1e-6)


@pytest.mark.parametrize(
    ("place", "direction"),
    [
        ((0, 0.3, 0), (0, 1, 0)),  # on the near side
        ((0, -0.3, -0.4), (0, 1, 0)),  # behind but below: a lower leg
        ((0.7, -0.3, 0), (0, 1, 0)),  # behind but past the end
        ((0, -0.3, 0), (1, 0, 0)),  # beside it
        ((0, 0.05, 0), (0, 1, 0)),  # inside, towards the antenna
    ],
)
def test_a_limb_in_the_open_loses_nothing(place, direction):
    assert lost_db(place, direction)[0] == pytest.approx(0, abs=1e-6)


def test_the_shadow_is_smooth_and_bounded_all_around():
    places = [(0.25, -0.15, -0.1), (-0.3, 0.14, -0.05), (0, -0.3, 0.02), (0.2, 0.1, -0.3)]
    turns = np.linspace(0, 2 * math.pi, 1441)
    for place in places:
        lost = []
        for turn in turns:
            db, depth = lost_db(place, (math.cos(turn), math.sin(turn), 0.2))
            lost.append(db)
        assert -1e-9 <= min(lost) <= max(lost) <= depth + 1e-9
        # Quarter degree steps.
        assert np.abs(np.diff(lost)).max() < 0.15 * depth
    assert lost_db((0, -0.3, 0), (0, 1, 0.2))[0] > 1


def test_the_trunk_does_not_shadow_itself():
    rcs = SurfaceSkin.draw(np.random.default_rng(0), [BALL, (0.3, 0.1, 0.1), BALL], trunk=1)
    assert rcs.shadow_db[1] == 0
    assert (rcs.shadow_db[[0, 2]] > 0).all()


def directions(n, seed=0):
    """Unit vectors evenly over the sphere, shape (n, 1, 3)."""
    u = np.random.default_rng(seed).standard_normal((n, 1, 3))
    return u / np.linalg.norm(u, axis=-1, keepdims=True)


def test_fluctuation_has_the_spread_and_the_mean_it_drew():
    half = np.full((40, 3), 0.1)
    spread_db = np.random.default_rng(3).uniform(*SPREAD_DB, 40)
    f = AspectFluctuation.draw(np.random.default_rng(4), half, spread_db)
    power = f.at(np.repeat(directions(20_000), 40, axis=1))
    # One body shows one draw of a random function: its parts scatter about mean and spread.
    assert power.mean() == pytest.approx(1, abs=0.05)
    db = 10 * np.log10(power)
    assert db.std(axis=0) / spread_db == pytest.approx(np.ones(40), abs=0.35)
    assert (db.std(axis=0) / spread_db).mean() == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("half_m", [0.06, 0.15, 0.3])
def test_fluctuation_forgets_when_the_part_turns_by_its_width(half_m):
    turn = WAVELENGTH_M / (4 * half_m)
    angles = np.arange(0, 2 * math.pi, turn / 8)
    around = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)[:, None]
    kept = {1: [], 8: [], 24: []}
    for seed in range(60):
        f = AspectFluctuation.draw(
            np.random.default_rng(seed), np.array([[half_m, 0.02, 0.02]]), np.array([3.0])
        )
        db = 10 * np.log10(f.at(around))[:, 0]
        z = (db - db.mean()) / db.std()
        for lag, found in kept.items():
            found.append((z[lag:] * z[:-lag]).mean())
    assert np.mean(kept[1]) > 0.95
    assert 0.4 < np.mean(kept[8]) < 0.75  # exp(-1/2)
    assert abs(np.mean(kept[24])) < 0.1


def test_a_part_that_does_not_turn_does_not_scintillate():
    f = AspectFluctuation.draw(np.random.default_rng(5), np.full((5, 3), 0.2), np.full(5, 4.0))
    power = f.at(np.repeat(directions(5)[None, :, 0], 300, axis=0))
    assert np.ptp(power, axis=0).max() == 0


def test_fluctuation_equals_double_precision():
    f = AspectFluctuation.draw(np.random.default_rng(6), np.full((4, 3), 0.3), np.full(4, 4.0))
    seen = np.repeat(directions(50), 4, axis=1)
    turned = seen @ f.wave.T / f.turn_rad[:, None] + f.phase_rad.T
    wanted = np.exp(
        f.amplitude * np.cos(turned).sum(axis=-1) - len(f.wave) * np.log(np.i0(f.amplitude))
    )
    assert f.at(seen) == pytest.approx(wanted, rel=2e-4)


def body(n=15, n_slow=60, seed=0):
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.02, 0.2, (n, 3))
    centre = rng.uniform(-0.5, 0.5, (n_slow, n, 3))
    frame = np.linalg.qr(rng.standard_normal((n_slow, n, 3, 3)))[0]
    return half, centre, frame[..., 0], frame[..., 1]


def test_total_is_what_it_was_scaled_to():
    half, centre, axis, side = body()
    rng = np.random.default_rng(7)
    rcs = sized(SurfaceSkin.draw(rng, half), rng, 10 * math.log10(0.3), (centre, axis, side))
    assert rcs.mean_total_m2(centre, axis, side) == pytest.approx(0.3, rel=1e-12)
    # And what antennas all around see.
    around = np.linspace(0, 2 * math.pi, 90, endpoint=False)
    views = [
        echo(rcs, centre, axis, side, FAR * np.array([math.cos(a), math.sin(a), 0]))
        for a in around
    ]
    total = np.mean(views, axis=0).sum(axis=1).mean()
    assert 10 * math.log10(total / 0.3) == pytest.approx(0, abs=0.3)


def test_a_man_of_ellipsoids_is_as_large_as_measured():
    # Standing, arms hanging: trunk, head, arms in two parts, legs in three.
    sizes = [
        ((0, 0, 1.20), Z, (0.32, 0.17, 0.12)),
        ((0, 0, 1.65), Z, (0.12, 0.08, 0.09)),
        *[((0, y, z), Z, half) for y, z, half in (
            (0.22, 1.28, (0.16, 0.045, 0.045)), (0.24, 0.98, (0.14, 0.035, 0.035)),
            (0.09, 0.70, (0.22, 0.075, 0.075)), (0.09, 0.28, (0.21, 0.05, 0.05)))],
        *[((0, -y, z), Z, half) for y, z, half in (
            (0.22, 1.28, (0.16, 0.045, 0.045)), (0.24, 0.98, (0.14, 0.035, 0.035)),
            (0.09, 0.70, (0.22, 0.075, 0.075)), (0.09, 0.28, (0.21, 0.05, 0.05)))],
        ((0.08, 0.09, 0.04), X, (0.13, 0.04, 0.04)),
        ((0.08, -0.09, 0.04), X, (0.13, 0.04, 0.04)),
    ]  # fmt: skip
    centre, axis = (np.array([[row[k] for row in sizes]], float) for k in (0, 1))
    side = np.array([[Y]])
    for seed in range(10):
        rcs = SurfaceSkin.draw(np.random.default_rng(seed), [row[2] for row in sizes])
        assert 0.4 < rcs.mean_total_m2(centre, axis, side) < 1.5


def test_totals_are_drawn_whatever_the_body():
    rng = np.random.default_rng(8)
    dbsm = 10 * np.log10([draw_total_m2(rng) for _ in range(4000)])
    assert -15 <= dbsm.min() < -14.9
    assert 2.9 < dbsm.max() <= 3
    assert dbsm.mean() == pytest.approx(-6, abs=0.3)
    assert 10 * math.log10(draw_total_m2(rng, (-1, -1))) == pytest.approx(-1)


def test_one_seed_one_echo_and_no_state():
    half, centre, axis, side = body()
    antenna = np.array([0.3, -2.0, 1.2])
    first, second = (SurfaceSkin.draw(np.random.default_rng(10), half) for _ in range(2))
    whole = echo(first, centre, axis, side, antenna)
    assert np.array_equal(whole, echo(second, centre, axis, side, antenna))
    order = np.random.default_rng(11).permutation(60)
    mixed = echo(first, centre[order], axis[order], side[order], antenna)
    # Six digits is what the fluctuation is good to.
    assert mixed == pytest.approx(whole[order], rel=2e-6)
    for k in (0, 17, 59):
        cut = slice(k, k + 1)
        alone = echo(first, centre[cut], axis[cut], side[cut], antenna)
        assert alone == pytest.approx(whole[cut], rel=2e-6)
    other = SurfaceSkin.draw(np.random.default_rng(12), half)
    assert not np.allclose(echo(other, centre, axis, side, antenna), whole)


def test_arguments_stay_as_they_were_and_one_side_serves_all():
    half, centre, axis, _ = body()
    half[:, 2] = half[:, 1]
    side = np.broadcast_to(Y, (60, 1, 3))
    kept = centre.copy(), axis.copy()
    rcs = SurfaceSkin.draw(np.random.default_rng(13), half)
    out = echo(rcs, centre, axis, side, np.array([0, 0, 1.0]))
    assert out.shape == (60, 15)
    assert out.dtype == np.float64
    assert np.array_equal(centre, kept[0])
    assert np.array_equal(axis, kept[1])


def test_no_time_and_an_antenna_inside_a_part():
    half, centre, axis, side = body(n_slow=3)
    rcs = SurfaceSkin.draw(np.random.default_rng(14), half)
    none = echo(rcs, centre[:0], axis[:0], side[:0], np.zeros(3))
    assert none.shape == (0, 15)
    inside = echo(rcs, centre, axis, side, centre[1, 4])
    assert np.isfinite(inside).all()
    assert (inside > 0).all()
    nearer = rcs.points(centre, axis, side, centre[1, 4]).nearer_m
    assert np.isfinite(nearer).all()


# ---------------------------------------------------------------- where echoes come from


@pytest.mark.parametrize("seed", range(6))
def test_an_echo_comes_from_the_surface_that_faces_the_antenna(seed):
    rng = np.random.default_rng(seed)
    half, unit = rng.uniform(0.03, 0.4, 3), rng.standard_normal(3)
    unit /= np.linalg.norm(unit)
    args = (np.zeros((1, 1, 3)), X.reshape(1, 1, 3), Y.reshape(1, 1, 3))
    points = one(half).points(*args, FAR * unit)
    # The farthest point of the ellipsoid along the line of sight, found by trying.
    sphere = rng.standard_normal((200_000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    farthest_m = ((sphere * half) @ unit).max()
    assert points.nearer_m == pytest.approx(np.array([[farthest_m]]), rel=1e-3)
    # And there the radar finds it.
    radar = Antenna(height_m=1.0, shape="isotropic")
    here = Points(
        radar.position_m + FAR * unit + points.position_m, points.rcs_m2, points.nearer_m
    )
    assert radar.direct(here).range_m == pytest.approx(FAR - farthest_m, abs=1e-3)


def test_an_antenna_close_by_has_every_part_in_front():
    half, centre, axis, side = body(n_slow=3)
    rcs = SurfaceSkin.draw(np.random.default_rng(15), half)
    for away in (1e-6, 0.01, 0.1, 1.0):
        antenna = centre[1, 4] + away * np.array([0.6, 0.0, 0.8])
        nearer = rcs.points(centre, axis, side, antenna).nearer_m
        assert (nearer > 0).all()
        assert (nearer <= 0.7 * np.linalg.norm(centre - antenna, axis=-1)).all()
