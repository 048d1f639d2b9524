import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.errors import SettingsError
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.place.multipath import DiffuseTail, Surface, TailSettings, image_rows
from x2radar.sim.points import Points

ALL_ROUND = Antenna(height_m=1.5, shape="isotropic")
FLOOR = Surface()
METRES = st.floats(-3, 3)
# Against the body's peak, at 0.5, 1, ... 3 m behind it, in two recorded walks.
RECORDED_DB = np.array([-14, -13, -18, -21, -24, -25])


def one(*position_m, rcs_m2=1.0):
    return Points(np.array(position_m, np.float64)[None, None], np.full((1, 1), rcs_m2))


def bounce_m(here, there, axis, at_m):
    """Length of the way by a plane: the shortest of all ways that touch it."""
    near, far = abs(here[axis] - at_m), abs(there[axis] - at_m)
    level = np.delete(np.subtract(there, here), axis)
    return math.hypot(*level, near + far)


@given(METRES, st.floats(0.3, 5), st.floats(0.05, 2.5))
def test_lengths_are_those_of_the_shortest_bounce(x, y, z):
    here = ALL_ROUND.position_m
    straight = math.dist(here, (x, y, z))
    for surface, axis in (
        (FLOOR, 2),
        (Surface(axis="z", at_m=2.7), 2),
        (Surface(axis="x", at_m=-3.5), 0),
        (Surface(axis="y", at_m=6), 1),
    ):
        once, twice = image_rows(one(x, y, z), ALL_ROUND, surface).range_m[0]
        by = bounce_m(here, (x, y, z), axis, surface.at_m)
        assert twice == pytest.approx(by)
        assert once == pytest.approx((straight + by) / 2)
        assert straight <= once <= twice


@pytest.mark.parametrize("at_m", [-1.0, 3.0])
def test_behind_a_wall_there_is_nothing(at_m):
    rows = image_rows(one(0, 4, 1), ALL_ROUND, Surface(axis="y", at_m=3.0))
    assert not rows.root_rcs_m.any()
    side = image_rows(one(-2, 1, 1), ALL_ROUND, Surface(axis="x", at_m=at_m))
    assert rows.range_m.shape == (1, 2)
    assert bool(side.root_rcs_m.any()) == (at_m > 0)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_reflection_follows_fresnel(axis):
    s = Surface(axis=axis, permittivity=4.0)
    cos = np.linspace(0, 1, 200)
    r = s.reflection(cos)
    assert np.abs(r).max() <= 1
    assert r[0] == pytest.approx(-1)
    # Straight on: (n - 1) / (n + 1) with n = 2.
    assert abs(r[-1]) == pytest.approx(1 / 3)
    crosses = (np.diff(np.sign(r)) != 0).any()
    # Field in the plane of incidence: a Brewster angle, at tan = n.
    assert crosses == (axis == "z")
    if crosses:
        assert s.reflection(np.cos(np.arctan([2.0])))[0] == pytest.approx(0, abs=1e-12)


def test_levels_of_a_perfect_mirror():
    """Of a mirror both single ways come in together: twice the amplitude, over R R'."""
    mirror = Surface(axis="x", at_m=1.0, permittivity=100, smoothness=1.0)
    rows = image_rows(one(0, 2, 1.5, rcs_m2=0.25), ALL_ROUND, mirror)
    by = math.hypot(2, 2)
    gamma = float(mirror.reflection(np.array([2 / by]))[0])
    assert gamma < -0.8
    received = rows.root_rcs_m[0] / rows.range_m[0] ** 2
    assert received == pytest.approx([2 * gamma * 0.5 / (2 * by), gamma**2 * 0.5 / by**2])


def walk(range_m, *, rcs_m2=1.0, height_m=1.5):
    """One point that stands straight ahead at each of some ranges."""
    y = np.atleast_1d(np.asarray(range_m, np.float64))
    position_m = np.stack([0 * y, y, 0 * y + height_m], axis=1)[:, None]
    return Points(position_m, np.full((y.size, 1), rcs_m2))


def tail(seed=0, antenna=ALL_ROUND, **settings):
    return DiffuseTail(np.random.default_rng(seed), TailSettings(**settings), antenna)


def energy(rows, range_m):
    """Energy of each row against the body's own, shape (n_slow, n_rows)."""
    return (rows.root_rcs_m / rows.range_m**2 * np.asarray(range_m)[:, None] ** 2) ** 2


@pytest.mark.parametrize("energy_db", [-10.0, -5.0])
@pytest.mark.parametrize("antenna", [ALL_ROUND, Antenna(height_m=1.5)], ids=["all", "beam"])
def test_tail_energy_is_as_asked(energy_db, antenna):
    got = []
    for seed in range(20):
        rows = tail(seed, antenna, energy_db=energy_db).rows(walk(1.7))
        behind = rows.range_m[0] - 1.7
        got.append(energy(rows, [1.7])[0, (behind > 0.4) & (behind < 3)].sum())
    # A way's view of a body of one point spreads log-normally.
    assert 10 * math.log10(np.mean(got)) == pytest.approx(energy_db, abs=1.2)


def profile_db(range_m, antenna=ALL_ROUND, n_rooms=60):
    """Mean power behind a body against its peak, for cells of 8 cm: at steps of half a metre."""
    edges = np.arange(0.25, 3.3, 0.5)
    total = np.zeros(edges.size - 1)
    for seed in range(n_rooms):
        rows = tail(seed, antenna).rows(walk(range_m))
        power = energy(rows, [range_m])[0]
        total += np.histogram(rows.range_m[0] - range_m, edges, weights=power)[0]
    return 10 * np.log10(total / n_rooms * 0.08 / 0.5)


def test_level_behind_the_body_is_that_of_the_recordings():
    """Within 4 dB from +0.5 to +3 m, 1.5 dB on average."""
    # A real body is no point: its energy is that of its peak over 2.3 cells (3.7 dB), in both
    # recordings.
    off = profile_db(1.7) + 3.7 - RECORDED_DB
    assert np.abs(off).max() < 4
    assert abs(off.mean()) < 1.5


def test_doppler_of_the_tail_is_a_part_of_the_bodys():
    """Mean range rate over the body's: a half to three quarters was measured."""
    shares = []
    for seed in range(40):
        rows = tail(seed).rows(walk([1.7, 1.701]))
        behind = rows.range_m[0] - 1.7
        power = energy(rows, [1.7, 1.701])[0]
        rate = (rows.range_m[1] - rows.range_m[0]) / 0.001
        assert rate.min() > -1e-6
        assert rate.max() < 1 + 1e-6
        chosen = (behind > 0.5) & (behind < 2)
        shares.append([(power * rate)[chosen].sum(), power[chosen].sum()])
    moved, all_of_it = np.sum(shares, axis=0)
    assert 0.5 < moved / all_of_it < 0.75


def test_a_free_floor_makes_the_tail_begin_later_at_the_same_energy():
    """Nothing within 0.9 m of the antenna: ways just behind the body are rarer and weaker."""
    near, late = [], []
    for free_m in (0.0, 0.9):
        power = np.zeros(2)
        for seed in range(40):
            rows = tail(seed, free_m=free_m, energy_db=-5.0).rows(walk(1.7))
            behind = rows.range_m[0] - 1.7
            gains = energy(rows, [1.7])[0]
            power += gains[behind < 0.4].sum(), gains[(behind > 0.4) & (behind < 3)].sum()
        near.append(power[0])
        late.append(power[1])
    assert near[1] < 0.7 * near[0]
    assert late[1] == pytest.approx(late[0], rel=0.15)
    with pytest.raises(SettingsError, match="free_m: 4 leaves nothing within reach_m, 4"):
        tail(free_m=4.0)


@pytest.mark.parametrize(
    "points",
    [
        walk(1.7, rcs_m2=0.0),
        Points(np.zeros((2, 0, 3)), np.zeros((2, 0))),
        Points(np.zeros((0, 3, 3)), np.zeros((0, 3))),
        Points(np.zeros((2, 200, 3)), np.ones((2, 200))),
        Points(np.full((1, 1, 3), 1e6), np.ones((1, 1))),
        Points(np.array([[[0.0, 0.0, 1.5]]]), np.ones((1, 1))),
    ],
)
def test_extremes_stay_finite(points):
    for rows in (tail(n_paths=16).rows(points), image_rows(points, Antenna(), FLOOR)):
        assert np.isfinite(rows.range_m).all()
        assert np.isfinite(rows.root_rcs_m).all()
        if not points.rcs_m2.any():
            assert not rows.root_rcs_m.any()
