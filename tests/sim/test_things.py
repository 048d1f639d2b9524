import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim_helpers import axis_of
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.things import THINGS, draw_mount, draw_thing
from x2radar.sim.things.draws import DRAWS as MOUNT_DRAWS
from x2radar.sim.things.machines import drum

HERE = np.array([0.0, 0.0, 1.5])
PLACE = (0.3, 2.0)
BASEBAND = axis_of("baseband")
KINDS = sorted(THINGS)


def thing(kind, seed=0, **said):
    return draw_thing(np.random.default_rng(seed), kind, PLACE, said, kind)


def ways(kind, t_s, seed=0, **said):
    """Positions relative to the place, (n_slow, n_points, 3)."""
    return thing(kind, seed, **said).at(t_s, HERE).position_m - [*PLACE, 0]


# ---------------------------------------------------------------- what holds for all


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(5))
def test_every_thing_is_a_mover(kind, seed):
    t_s = np.arange(300) / 60
    ours = thing(kind, seed)
    p = ours.at(t_s, HERE)
    assert ours.label == "other"
    assert len(set(ours.names)) == len(ours.names) == p.rcs_m2.shape[1]
    assert p.position_m.shape == (*p.rcs_m2.shape, 3)
    assert p.position_m.dtype == p.rcs_m2.dtype == np.float64
    assert np.isfinite(p.position_m).all()
    assert (p.rcs_m2 >= 0).all()
    assert p.rcs_m2.any()
    assert p.position_m[..., 2].min() > -0.05
    assert p.position_m.flags.writeable
    assert p.rcs_m2.flags.writeable


@pytest.mark.parametrize("kind", KINDS)
def test_any_times_in_any_order_give_the_same(kind):
    rng = np.random.default_rng(3)
    t_s = rng.uniform(-100, 5000, 200)
    ours = thing(kind)
    whole = ours.at(t_s, HERE)
    assert np.array_equal(thing(kind).at(t_s, HERE).position_m, whole.position_m)
    for at in ([5], [199, 5, 0], rng.permutation(200)):
        part = ours.at(t_s[at], HERE)
        assert part.position_m == pytest.approx(whole.position_m[at], abs=1e-9)
        assert part.rcs_m2 == pytest.approx(whole.rcs_m2[at], rel=1e-9, abs=1e-15)
    none = ours.at(np.zeros(0), HERE)
    assert none.position_m.shape == (0, len(ours.names), 3)


@pytest.mark.parametrize("kind", KINDS)
def test_both_ends_of_every_number_work(kind):
    for end in ("low", "high"):
        said = {name: getattr(d, end) for name, d in THINGS[kind].draws.items()}
        p = thing(kind, **said).at(np.linspace(0, 20, 40), HERE)
        assert np.isfinite(p.position_m).all()
        assert np.isfinite(p.rcs_m2).all()
        assert (p.rcs_m2 >= 0).all()


@settings(max_examples=40)
@given(st.sampled_from(KINDS), st.integers(0, 2**32), st.floats(0, 1e6))
def test_nothing_jumps(kind, seed, begin_s):
    """Half a millisecond moves no point further than the fastest blade."""
    ours = thing(kind, seed)
    t_s = begin_s + np.arange(100) * 5e-4
    step_m = np.linalg.norm(np.diff(ours.at(t_s, HERE).position_m, axis=0), axis=-1)
    seen = ours.at(t_s, HERE).rcs_m2
    step_m = step_m[(seen[1:] > 0) & (seen[:-1] > 0)]
    fastest_mps = 2 * np.pi * 25 * 0.25 if kind == "fan" else 3.0
    assert step_m.max(initial=0.0) < fastest_mps * 5e-4 * 1.05


# ---------------------------------------------------------------- each by its physics


def main_line_hz(x, rate_hz):
    x = (x - x.mean(axis=0)) * np.hanning(len(x)).reshape(-1, *[1] * (x.ndim - 1))
    power = np.abs(np.fft.rfft(x, axis=0)) ** 2
    power = power.reshape(len(power), -1).sum(axis=1)
    return np.fft.rfftfreq(len(x), 1 / rate_hz)[power.argmax()]


@pytest.mark.parametrize("hz", [0.2, 1.1])
def test_curtain_sways_at_its_rate_within_its_swing(hz):
    t_s = np.arange(0, 120, 0.05)
    rest = ways("curtain", t_s, frequency_hz=hz, amplitude_m=0.0)
    moved = ways("curtain", t_s, frequency_hz=hz, amplitude_m=0.06) - rest
    size = np.linalg.norm(moved, axis=-1)
    assert size.max() <= 0.06
    assert size.max() > 0.02
    # The hem swings most, the rod hardly.
    top, hem = size[:, -7:].max(), size[:, :7].max()
    assert hem > 4 * top
    line_hz = main_line_hz(moved[:, 0], 20)
    assert 0.55 * hz < line_hz < 1.45 * hz


def test_fan_blades_turn_on_circles_and_make_a_comb():
    t_s = np.arange(0, 4, 1 / 400)
    said = {"rotation_hz": 5.0, "n_blades": 3, "radius_m": 0.2, "swing_deg": 0}
    p = thing("fan", heading_deg=120, **said).at(t_s, HERE)
    hub, tip = p.position_m[:, 0], p.position_m[:, 2 + 2]
    assert np.linalg.norm(tip - hub, axis=1) == pytest.approx(np.full(t_s.size, 0.2))
    assert np.ptp(hub, axis=0).max() == 0
    rows = Antenna(shape="isotropic").direct(p)
    track = (rows.root_rcs_m * np.exp(-2j * np.pi * 2 * rows.range_m / 0.0441)).sum(axis=1)
    power = np.abs(np.fft.fft((track - track.mean()) * np.hanning(t_s.size))) ** 2
    hz = np.fft.fftfreq(t_s.size, 1 / 400)
    on_comb = np.abs((np.abs(hz) + 2.5) % 5 - 2.5) < 0.6
    assert power[on_comb].sum() > 0.95 * power.sum()
    assert np.count_nonzero(power[on_comb] > power.max() / 100) > 10


def test_vacuum_keeps_its_speed_and_its_square():
    t_s = np.arange(0, 1300, 0.1)
    top = ways("robot_vacuum", t_s, area_m=2.0, speed_mps=0.3, bump_m=0)[:, 0]
    assert np.abs(top[:, :2]).max() <= 1.0 + 1e-9
    speed = np.linalg.norm(np.diff(top, axis=0), axis=1) / 0.1
    assert speed.max() <= 0.3 + 1e-6
    assert 0.3 < np.mean(np.abs(speed - 0.3) < 1e-3) < 0.95
    # It stands while it turns.
    assert 0.05 < np.mean(speed < 1e-6) < 0.6
    assert np.ptp(top[:, 2]) == 0
    # The whole square, not a corner of it.
    assert (np.ptp(top[:, :2], axis=0) > 1.9).all()


def test_washing_machine_shakes_by_millimetres_and_runs_up():
    t_s = np.arange(0, 120, 1 / 200)
    hz, turns = drum(t_s, 15)
    assert (hz.min(), hz.max()) == pytest.approx((0.8, 15), abs=0.01)
    assert np.diff(turns) * 200 == pytest.approx((hz[1:] + hz[:-1]) / 2, abs=0.02)
    moved = ways("washing_machine", t_s, spin_hz=15, amplitude_m=0.002, resonance_hz=5)
    size_m = np.linalg.norm(moved - moved.mean(axis=0), axis=-1).max(axis=1).reshape(-1, 400)
    assert 0.0005 < size_m.max() < 0.006
    # At its resonance it shakes most, while it tumbles hardly.
    assert size_m.max() > 4 * size_m.max(axis=1).min()
    lines_hz = [main_line_hz(part[:, -1], 200) for part in np.split(moved, 30)]
    assert max(lines_hz) == pytest.approx(15, abs=0.3)


def test_door_swings_on_its_hinge_and_rests():
    t_s = np.arange(0, 60, 0.02)
    said = {"swing_deg": 80, "move_s": 2, "rest_s": 3, "sway_deg": 0, "width_m": 0.8}
    ours = thing("door", heading_deg=180, **said)
    out = ours.at(t_s, HERE).position_m - [*PLACE, 0]
    reach = np.linalg.norm(out[..., :2], axis=-1)
    assert np.ptp(reach, axis=0).max() < 1e-9
    assert reach.max() < 0.8
    turn = np.unwrap(np.arctan2(out[:, 0, 0], out[:, 0, 1]))
    assert np.rad2deg(np.ptp(turn)) == pytest.approx(80)
    speed = np.abs(np.gradient(turn, 0.02))
    # Half a cosine: its steepest is pi / 2 times the mean.
    assert speed.max() < np.deg2rad(80) / (2 * 0.5) * np.pi / 2 * 1.01
    assert 0.4 < np.mean(speed < 1e-6) < 0.8


@pytest.mark.parametrize("string_m", [0.3, 1.0])
def test_plant_swings_with_the_period_of_its_string(string_m):
    t_s = np.arange(0, 200, 0.05)
    said = {"string_m": string_m, "amplitude_m": 0.08, "height_m": 1.5, "flutter_m": 0.0}
    pot = ways("plant", t_s, **said)[:, 0]
    wanted_hz = math.sqrt(9.81 / string_m) / (2 * math.pi)
    assert main_line_hz(pot[:, :2], 20) == pytest.approx(wanted_hz, rel=0.08)
    assert np.linalg.norm(pot[:, :2], axis=1).max() <= 0.08 + 1e-9
    hook = np.array([0, 0, 1.5 + string_m])
    assert np.linalg.norm(pot - hook, axis=1) == pytest.approx(np.full(t_s.size, string_m))


def test_rain_only_runs_down_and_within_the_pane():
    t_s = np.arange(0, 200, 0.05)
    said = {"heading_deg": 180, "width_m": 1.0, "height_m": 1.2, "sill_m": 0.9, "n_drops": 20}
    ours = thing("rain", **said)
    p = ours.at(t_s, HERE)
    drop = p.position_m - [*PLACE, 0]
    assert len(ours.names) == 20
    assert np.abs(drop[..., 0]).max() <= 0.5
    assert np.abs(drop[..., 1]).max() < 1e-12
    assert 0.9 - 1e-9 <= drop[..., 2].min() < drop[..., 2].max() <= 2.1 + 1e-9
    is_same = (np.diff(drop[..., 0], axis=0) == 0) & (p.rcs_m2[1:] > 0) & (p.rcs_m2[:-1] > 0)
    assert np.diff(drop[..., 2], axis=0)[is_same].max() <= 1e-9
    # New drops fall elsewhere.
    assert np.unique(drop[:, 0, 0].round(6)).size > 3


# ---------------------------------------------------------------- the mount


def mount(seed=0, **said):
    return draw_mount(np.random.default_rng(seed), said)


def test_mount_hums_at_its_rate_within_its_swings():
    said = {"hum_hz": 12.0, "hum_m": 2e-4, "shock_m": 0.0, "sway_m": 0.0}
    t_s = np.arange(0, 60, 1 / 200)
    offset_m = mount(**said).offset_m(t_s)
    assert offset_m.shape == (t_s.size, 3)
    assert 0.5e-4 < np.linalg.norm(offset_m, axis=1).max() <= 2e-4
    assert main_line_hz(offset_m, 200) == pytest.approx(12, abs=0.6)


def test_mount_shocks_come_once_an_interval_and_die_away():
    t_s = np.arange(0, 400, 0.01)
    said = {"hum_m": 0, "sway_m": 0, "shock_m": 1e-3, "shock_s": 20.0, "hum_hz": 15.0}
    size = np.linalg.norm(mount(**said).offset_m(t_s), axis=1).reshape(20, -1)
    assert (size.max(axis=1) > 3e-4).sum() >= 19
    assert size.max() <= 1e-3
    assert np.mean(size > 1e-5) < 0.1


def test_mount_has_no_state_and_obeys_its_seed():
    t_s = np.random.default_rng(0).uniform(0, 1e4, 100)
    whole = mount(3).offset_m(t_s)
    assert mount(3).offset_m(t_s[::-1])[::-1] == pytest.approx(whole, abs=1e-15)
    assert not np.array_equal(mount(4).offset_m(t_s), whole)
    limit = sum(MOUNT_DRAWS[k].usual[1] for k in ("hum_m", "sway_m", "shock_m", "shock_m"))
    assert np.linalg.norm(whole, axis=1).max() <= limit
    still = mount(hum_m=0, sway_m=0, shock_m=0).offset_m(t_s)
    assert not still.any()
