"""Where the radar is: its antenna, the room that stands still, and ways that are not straight."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.dsp.downconvert import DownConverter
from tests.sim_helpers import axis_of
from x2radar.errors import SettingsError
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.place import antenna as place
from x2radar.sim.place.antenna import Antenna, Surface, image_rows
from x2radar.sim.place.room import Room, RoomSettings
from x2radar.sim.points import Points
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power

RF, BASEBAND = axis_of("rf"), axis_of("baseband")
NOISE = baseband_noise_power(BASEBAND, 0.04)
LAMBDA_M = 299_792_458 / 6.8e9
FULL = RoomSettings(
    objects_db=53, diffuse_db=34, leakage_db=60, leakage_m=0.7, drift_m=5e-5, drift_gain=0.005
)


def room(settings=FULL, axis=BASEBAND, seed=0):
    return Room(np.random.default_rng(seed), settings, axis)


def over_noise_db(frames):
    return 10 * np.log10(np.abs(frames) ** 2 / NOISE + 1e-30)


@pytest.mark.parametrize("level_db", [49.0, 57.0])
def test_the_strongest_object_has_its_level(level_db):
    """Alone it is exact; objects that fall together change it by a little."""
    one = room(RoomSettings(objects_db=level_db, n_objects=1)).still
    # A bin is at most 2 mm from the echo's middle.
    assert over_noise_db(one).max() == pytest.approx(level_db, abs=0.01)
    settings = RoomSettings(objects_db=level_db)
    peaks = [over_noise_db(room(settings, seed=k).still).max() for k in range(30)]
    assert np.median(peaks) == pytest.approx(level_db, abs=1.0)
    assert np.ptp(peaks) < 6


def mean_profile_db(settings, n_rooms=200):
    power = sum(np.abs(room(settings, seed=k).still) ** 2 for k in range(n_rooms)) / n_rooms
    return 10 * np.log10(power / NOISE)


@pytest.mark.parametrize(
    "settings",
    [
        RoomSettings(diffuse_db=34.0, decay_db_per_m=1.5),
        RoomSettings(diffuse_db=20.0, profile="power", exponent=4.0),
    ],
)
def test_distributed_clutter_falls_as_its_profile_says(settings):
    range_m = BASEBAND.range_m
    if settings.profile == "power":
        wanted = settings.diffuse_db - 10 * settings.exponent * np.log10(range_m)
    else:
        wanted = settings.diffuse_db - settings.decay_db_per_m * (range_m - 1)
    off = mean_profile_db(settings) - wanted
    assert np.abs(off.reshape(12, 64).mean(axis=1)).max() < 0.6


@pytest.mark.parametrize("ringing_db_per_m", [60.0, 300.0])
def test_leakage_rings_down_behind_its_peak(ringing_db_per_m):
    axis = axis_of("baseband", RadarSettings(sample_delay_s=0.0))
    leak = RoomSettings(leakage_db=70.0, leakage_m=0.1, ringing_db_per_m=ringing_db_per_m)
    level = over_noise_db(room(leak, axis).still)
    range_m = axis.range_m
    assert 0.09 < range_m[level.argmax()] < (0.25 if ringing_db_per_m == 60 else 0.12)
    assert 66 < level.max() < 76
    # Within the ringing's reach its level falls as said, on average; behind it is nothing.
    ringing = (range_m > 0.2) & (range_m < 0.5)
    if ringing_db_per_m == 60:
        assert np.polyfit(range_m[ringing], level[ringing], 1)[0] == pytest.approx(-60, rel=0.6)
    assert level[range_m > 1.5].max() < -100


@pytest.mark.parametrize("axis", [RF, BASEBAND], ids=["rf", "baseband"])
def test_frames_have_no_state(axis):
    ours, rng = room(FULL, axis), np.random.default_rng(1)
    t_s = rng.uniform(0, 1e5, 60)
    offset_m = rng.normal(0, 1e-4, (60, 3))
    whole = ours.echo(t_s, offset_m)
    for at in ([3], [59, 0], list(range(10, 40))):
        part = ours.echo(t_s[at], offset_m[at])
        # The matrix product may sum in another order.
        assert np.abs(part - whole[at]).max() < 1e-6 * np.abs(whole).max()
    assert np.array_equal(room(FULL, axis).echo(t_s, offset_m), whole)
    assert not np.array_equal(room(FULL, axis, seed=1).still, ours.still)


def test_drift_is_slow_and_of_its_size():
    """An object's phase turns by 4 pi d / lambda; over 7 s by milliradians, as measured."""
    settings = RoomSettings(objects_db=53, n_objects=1, drift_m=5e-5, drift_gain=0.01)
    t_s = np.arange(0, 3000, 0.5)
    turns, gains, in_seven_s = [], [], []
    for seed in range(10):
        frames = room(settings, seed=seed).echo(t_s)
        track = frames[:, np.abs(frames[0]).argmax()].astype(np.complex128)
        track /= track.mean()
        turns.append(np.angle(track))
        gains.append(np.abs(track))
        in_seven_s.append(np.angle(track).reshape(-1, 15).std(axis=1).mean())
    assert np.std(turns) == pytest.approx(4 * np.pi * 5e-5 / LAMBDA_M, rel=0.1)
    assert np.std(gains) == pytest.approx(0.01, rel=0.15)
    # Measured on strong bins of two recordings, scaled to this carrier: 1 to 5 mrad.
    assert 1e-3 < np.mean(in_seven_s) < 5e-3
    assert np.abs(np.diff(turns, axis=1)).max() < 0.02


def test_the_mount_turns_each_object_by_its_direction():
    """Against the echo of the moved object itself; no object turns by more than the mount."""
    ours = room(RoomSettings(objects_db=53, n_objects=1, drift_m=0.0))
    moved_m = np.linspace(-2e-3, 2e-3, 41)
    peak = np.abs(ours.still).argmax()
    for axis in np.eye(3):
        frames = ours.echo(np.zeros(41), moved_m[:, None] * axis)
        turn = np.unwrap(np.angle(frames[:, peak] / ours.still[peak]))
        slope = np.polyfit(moved_m, turn, 1)[0] * LAMBDA_M / (4 * np.pi)
        assert abs(slope) <= 1 + 1e-3
        assert np.abs(turn - slope * moved_m * 4 * np.pi / LAMBDA_M).max() < 1e-3
        if axis[1]:
            # Everything lies ahead: towards it the phase rises.
            assert slope > 0.4


@pytest.mark.parametrize("generator", [0, 5, 11])
def test_rf_and_baseband_are_the_same_room(generator):
    s = RadarSettings(pulse_generator=generator)
    rf, baseband = axis_of("rf", s), axis_of("baseband", s)
    t_s, offset_m = np.array([0.0, 100.0, 5000.0]), np.full((3, 3), 1e-3)
    mixed = DownConverter(rf).convert(room(FULL, rf).echo(t_s, offset_m))
    ours = room(FULL, baseband).echo(t_s, offset_m)
    # Away from the ends, where the RF frame is cut before the filter.
    assert np.abs(mixed - ours)[:, 80:-80].max() < 1e-4 * np.abs(ours).max()


def towards(azimuth_deg, elevation_deg, length=1.0):
    a, e = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    return length * np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])


def points(*position_m, rcs_m2=1.0):
    position_m = np.array(position_m, np.float64)[None]
    return Points(position_m, np.full(position_m.shape[:2], rcs_m2))


@pytest.mark.parametrize(("azimuth", "elevation"), [(65, 65), (30, 120), (170, 10)])
def test_half_power_lies_at_half_the_width(azimuth, elevation):
    a = Antenna(azimuth_width_deg=azimuth, elevation_width_deg=elevation, floor_db=-60)
    assert a.gain(towards(0, 0)) == pytest.approx(1)
    for side in (-1, 1):
        assert a.gain(towards(side * azimuth / 2, 0)) == pytest.approx(0.5)
        assert a.gain(towards(0, side * elevation / 2)) == pytest.approx(0.5)


@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(1e-3, 1e3))
def test_gain_is_bounded_and_does_not_depend_on_distance(azimuth, elevation, length):
    for shape in ("gaussian", "isotropic"):
        a = Antenna(shape=shape, floor_db=-25)
        gain = a.gain(towards(azimuth, elevation, length))
        assert 10**-2.5 * (1 - 1e-12) <= gain <= 1
        assert gain == pytest.approx(a.gain(towards(azimuth, elevation)), rel=1e-6)
        # Right and left, up and down are alike.
        assert gain == pytest.approx(a.gain(towards(-azimuth, -elevation, length)), rel=1e-9)


@pytest.mark.parametrize(
    ("pan", "tilt"), [(0, 0), (30, 0), (-90, 0), (0, 25), (0, -90), (110, 40)]
)
def test_pan_and_tilt_turn_the_pattern(pan, tilt):
    """Pan goes to the right, tilt down."""
    a = Antenna(pan_deg=pan, tilt_deg=tilt, floor_db=-60)
    assert a.axis == pytest.approx(towards(pan, -tilt), abs=1e-12)
    assert a.gain(a.axis) == pytest.approx(1)
    if abs(tilt) < 90:
        assert a.gain(towards(pan, -tilt - 32.5)) == pytest.approx(0.5)
        assert a.gain(towards(pan, -tilt + 32.5)) == pytest.approx(0.5)
    if tilt == 0:
        assert a.gain(towards(pan + 32.5, 0)) == pytest.approx(0.5)


def test_direct_echoes_are_the_radar_equations_and_the_pattern_counts_out_and_back():
    a = Antenna(height_m=1.2)
    rows = a.direct(points((0, 2, 1.2), rcs_m2=0.7))
    assert rows.range_m[0, 0] == pytest.approx(2)
    ours = rows.amplitude(LinkBudget(), BASEBAND)
    wanted = LinkBudget().amplitude(np.array([2.0]), np.array([0.7]), BASEBAND)
    assert ours[0] == pytest.approx(wanted)
    a = Antenna(height_m=0.5)
    axis, off = a.direct(points((0, 2, 0.5))), a.direct(points(towards(32.5, 0) * 2 + [0, 0, 0.5]))
    ratio = off.amplitude(LinkBudget(), BASEBAND) / axis.amplitude(LinkBudget(), BASEBAND)
    assert 20 * math.log10(ratio[0, 0]) == pytest.approx(-6.02, abs=0.01)


def test_points_are_left_alone_and_nothing_is_nearer_than_the_clamp():
    p = points((0, 0, 1.5), (0, 0.05, 1.5))
    before = p.rcs_m2.copy()
    rows = Antenna().direct(p)
    assert np.array_equal(p.rcs_m2, before)
    assert rows.range_m.tolist() == [[0.1, 0.1]]
    assert place.length_m(np.zeros((4, 3))).tolist() == [0.1] * 4


ALL_ROUND = Antenna(height_m=1.5, shape="isotropic")
FLOOR = Surface()


def bounce_m(here, there, axis, at_m):
    """Length of the way by a plane: the shortest of all ways that touch it."""
    near, far = abs(here[axis] - at_m), abs(there[axis] - at_m)
    level = np.delete(np.subtract(there, here), axis)
    return math.hypot(*level, near + far)


@given(st.floats(-3, 3), st.floats(0.3, 5), st.floats(0.05, 2.5))
def test_lengths_are_those_of_the_shortest_bounce(x, y, z):
    here = ALL_ROUND.position_m
    straight = math.dist(here, (x, y, z))
    for surface, axis in (
        (FLOOR, 2),
        (Surface(axis="z", at_m=2.7), 2),
        (Surface(axis="x", at_m=-3.5), 0),
        (Surface(axis="y", at_m=6), 1),
    ):
        once, twice = image_rows(points((x, y, z)), ALL_ROUND, surface).range_m[0]
        by = bounce_m(here, (x, y, z), axis, surface.at_m)
        assert twice == pytest.approx(by)
        assert once == pytest.approx((straight + by) / 2)
        assert straight <= once <= twice


@pytest.mark.parametrize("at_m", [-1.0, 3.0])
def test_behind_a_wall_there_is_nothing(at_m):
    rows = image_rows(points((0, 4, 1)), ALL_ROUND, Surface(axis="y", at_m=3.0))
    assert not rows.root_rcs_m.any()
    side = image_rows(points((-2, 1, 1)), ALL_ROUND, Surface(axis="x", at_m=at_m))
    assert rows.range_m.shape == (1, 2)
    assert bool(side.root_rcs_m.any()) == (at_m > 0)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_reflection_follows_fresnel(axis):
    s = Surface(axis=axis, permittivity=4.0)
    r = s.reflection(np.linspace(0, 1, 200))
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
    rows = image_rows(points((0, 2, 1.5), rcs_m2=0.25), ALL_ROUND, mirror)
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
    return place.DiffuseTail(np.random.default_rng(seed), place.TailSettings(**settings), antenna)


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
    # Against the body's peak, at 0.5, 1, ... 3 m behind it, in two recorded walks.
    off = profile_db(1.7) + 3.7 - np.array([-14, -13, -18, -21, -24, -25])
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
