"""Skins: textbook echoes, shadows, one bright spot, and that what stands does not scintillate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.body_helpers import ANTENNA_M
from x2radar.sim.bodies import skins
from x2radar.sim.bodies.skeleton.skeleton import PERSON, PersonBuild
from x2radar.sim.bodies.skins import SHADOW_DB, SKIN_REFLECTION, SKINS, SurfaceSkin
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.points import Pose

X, Y, Z = np.eye(3)
FAR_M = 1e6
HALF_M = PersonBuild(np.random.default_rng(0)).half_lengths()
BALL = (0.05, 0.05, 0.05)
RADAR = Antenna(height_m=1.2, shape="isotropic")


def row(n=4):
    """Sixteen segments on a line in front of the antenna, standing up."""
    k = len(HALF_M)
    centre = np.stack([np.linspace(-0.4, 0.4, k), 0 * np.ones(k) + 2, np.ones(k)], 1)
    return Pose(np.tile(centre, (n, 1, 1)), np.tile(Z, (n, k, 1)), np.tile(X, (n, 1, 1)))


def lone(axis=X, side=Y, place=(0.0, 0.0, 0.0)):
    """One segment."""
    return Pose(*(np.asarray(v, float).reshape(1, 1, 3) for v in (place, axis, side)))


def dull(half_m, seed=0):
    """A skin of ellipsoids without fluctuation."""
    skin = SurfaceSkin(np.random.default_rng(seed), np.array(half_m, float))
    skin.fluctuation.amplitude *= 0
    return skin


def seen(skin, direction, pose=None):
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    return skin.points(pose or lone(), FAR_M * unit).rcs_m2[0]


@pytest.mark.parametrize("name", SKINS)
def test_every_skin_is_constant_for_what_does_not_move_and_leaves_its_arguments_alone(name):
    skin = SKINS[name](np.random.default_rng(3), HALF_M, 3, PERSON.gain)
    pose = row(50)
    kept = [x.copy() for x in (pose.centre_m, pose.axis, pose.side)]
    points = skin.points(pose, ANTENNA_M)
    assert points.rcs_m2.shape == (50, len(skin.names(PERSON.names)))
    assert np.ptp(points.rcs_m2, axis=0).max() == 0.0
    for before, after in zip(kept, (pose.centre_m, pose.axis, pose.side), strict=True):
        assert np.array_equal(before, after)
    # An antenna in a part, and close to one, has every part in front.
    for away_m in (0.0, 1e-6, 0.01, 0.1, 1.0):
        antenna_m = pose.centre_m[0, 4] + away_m * np.array([0.6, 0.0, 0.8])
        close = skin.points(pose, antenna_m)
        assert np.isfinite(close.rcs_m2).all()
        if name in {"surface", "ellipsoids"}:
            distance = np.maximum(np.linalg.norm(close.position_m - antenna_m, axis=-1), 1e-9)
            assert (close.nearer_m >= 0).all()
            assert (close.nearer_m <= distance).all()


@pytest.mark.parametrize("name", SKINS)
@pytest.mark.parametrize("dbsm", [-30.0, -3.0, 5.0])
def test_the_mean_total_is_what_was_asked_for(name, dbsm):
    rng, pose = np.random.default_rng(5), row()
    pose = replace(pose, side=np.broadcast_to(pose.side, pose.axis.shape))
    skin = skins.sized(SKINS[name](rng, HALF_M, 3, PERSON.gain), rng, dbsm, pose)
    assert 10 * np.log10(skin.mean_total_m2(pose)) == pytest.approx(dbsm, abs=0.01)
    # And what antennas all around see.
    turns = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    views = [skin.points(pose, FAR_M * (math.cos(a) * X + math.sin(a) * Y)) for a in turns]
    total = np.mean([points.rcs_m2.sum(axis=1).mean() for points in views])
    assert 10 * np.log10(total) == pytest.approx(dbsm, abs=1.5)


def curvature_rcs(half_m, unit):
    """pi over the Gaussian curvature where an ellipsoid faces `unit`, in another way.

    The point with normal n is A^2 n / |A n|; the curvature there is
    1 / ((a b c)^2 (sum p_i^2 / a_i^4)^2).
    """
    square = np.asarray(half_m) ** 2
    point = square * unit / math.sqrt((square * unit**2).sum())
    curvature = 1 / (square.prod() * (point**2 / square**2).sum() ** 2)
    return SKIN_REFLECTION * math.pi / curvature


@given(
    st.tuples(*[st.floats(0.005, 1.0) for _ in range(3)]),
    st.tuples(*[st.floats(-1, 1) for _ in range(3)]),
    st.integers(0, 2**31),
)
@settings(max_examples=50)
def test_any_ellipsoid_from_anywhere_is_the_curvature_at_its_bright_spot(half, along, seed):
    if np.linalg.norm(along) < 0.01:
        along = (1.0, 0.0, 0.0)
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    unit = np.asarray(along) / np.linalg.norm(along)
    skin = dull([half])
    wanted = max(curvature_rcs(half, unit), skin.floor_m2[0])
    points = skin.points(lone(turn @ X, turn @ Y), FAR_M * turn @ unit)
    assert points.rcs_m2[0] == pytest.approx(wanted, rel=1e-6)
    # And it comes from the surface that faces the antenna.
    assert points.nearer_m[0] == pytest.approx(np.linalg.norm(np.array(half) * unit), rel=1e-4)


def lost_db(place, directions, seed=0):
    """What a ball at a place beside a long level trunk loses, seen along directions."""
    skin = dull([(0.35, 0.12, 0.14), BALL], seed)
    pose = Pose(np.array([[(0.0, 0.0, 0.0), place]]), np.array([[X, X]]), np.array([[Y]]))
    open_m2 = SKIN_REFLECTION * math.pi * BALL[0] ** 2
    lost = [10 * math.log10(open_m2 / seen(skin, d, pose)[1]) for d in directions]
    return np.array(lost), skin.shadow_db


@pytest.mark.parametrize("seed", range(4))
def test_behind_the_trunk_a_limb_loses_six_to_fifteen_decibels_and_the_trunk_nothing(seed):
    lost, depth = lost_db((0, -0.3, 0), [(0, 1, 0)], seed)
    assert SHADOW_DB[0] <= depth[1] <= SHADOW_DB[1]
    assert lost == pytest.approx([depth[1]], abs=1e-6)
    assert depth[0] == 0


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
    assert lost_db(place, [direction])[0] == pytest.approx([0.0], abs=1e-6)


def test_fluctuation_has_the_spread_and_the_mean_it_drew_to_five_digits():
    half = np.full((40, 3), 0.1)
    spread_db = np.random.default_rng(3).uniform(*skins.SPREAD_DB, 40)
    f = skins.AspectFluctuation(np.random.default_rng(4), half, spread_db)
    ways = np.random.default_rng(0).standard_normal((5_000, 1, 3))
    ways = np.repeat(ways / np.linalg.norm(ways, axis=-1, keepdims=True), 40, axis=1)
    power = f.at(*np.moveaxis(ways, -1, 0))
    # One body shows one draw of a random function: its parts scatter about mean and spread.
    assert power.mean() == pytest.approx(1, abs=0.05)
    db = 10 * np.log10(power)
    assert db.std(axis=0) / spread_db == pytest.approx(np.ones(40), abs=0.35)
    assert (db.std(axis=0) / spread_db).mean() == pytest.approx(1, abs=0.05)
    turned = ways[:50] @ f.wave.T / f.turn_rad[:, None] + f.phase_rad.T
    log = f.amplitude * np.cos(turned).sum(axis=-1) - len(f.wave) * np.log(np.i0(f.amplitude))
    assert power[:50] == pytest.approx(np.exp(log), rel=2e-4)


def turning(turn_rad):
    """A trunk of three parts along the floor 2 m ahead that turns round, and a limb under it."""
    along = np.stack([np.cos(turn_rad), np.sin(turn_rad), 0 * turn_rad], axis=-1)
    left = np.stack([-np.sin(turn_rad), np.cos(turn_rad), 0 * turn_rad], axis=-1)
    offset = np.array([0.0, 0.2, -0.2, 0.0])[:, None]
    centre = np.array([0.0, 2.0, 1.2]) + offset * along[:, None]
    centre[:, 3:, 2] -= 0.3
    return Pose(centre, np.repeat(along[:, None], 4, axis=1), left[:, None])


def one_and_apart(seed=0):
    """One body with its trunk as one surface, and the same with parts by themselves."""
    half = np.array([(0.3, 0.12, 0.15), (0.15, 0.11, 0.15), (0.12, 0.1, 0.12), (0.1, 0.05, 0.05)])
    return tuple(SurfaceSkin(np.random.default_rng(seed), half, n) for n in (3, 1))


@pytest.mark.parametrize("seed", range(4))
def test_the_spot_of_a_trunk_is_where_its_surface_is_nearest_and_has_all_its_power(seed):
    pose = turning(np.linspace(0, 2 * np.pi, 721))
    ours, theirs = (skin.points(pose, ANTENNA_M) for skin in one_and_apart(seed))
    assert ours.rcs_m2.sum(axis=1) == pytest.approx(theirs.rcs_m2.sum(axis=1), rel=1e-12)
    # What is no trunk is left alone.
    assert np.array_equal(ours.rcs_m2[:, 3], theirs.rcs_m2[:, 3])
    assert ours.rcs_m2.min() > 0
    assert (ours.rcs_m2[:, 1:3] <= theirs.rcs_m2[:, 1:3] * (1 + 1e-12)).all()
    spot_m = RADAR.direct(ours).range_m[:, 0]
    near_m = RADAR.direct(theirs).range_m[:, :3].min(axis=1)
    # Where several are about equally near, it is between them: some millimetres.
    assert -1e-9 < (spot_m - near_m).min() <= (spot_m - near_m).max() < 0.02
    # It slides: half a degree moves it no more than the end of the trunk moves.
    assert np.abs(np.diff(spot_m)).max() < 0.4 * np.deg2rad(0.5)
