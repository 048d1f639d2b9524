import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from x2radar.sim.place.antenna import Antenna
from x2radar.sim.things import THINGS, draw_mount, draw_thing
from x2radar.sim.things.draws import DRAWS as MOUNT_DRAWS

HERE = np.array([0.0, 0.0, 1.5])
PLACE = (0.3, 2.0)
KINDS = sorted(THINGS)


def thing(kind, seed=0, **said):
    return draw_thing(np.random.default_rng(seed), kind, PLACE, said, kind)


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


def mount(seed=0, **said):
    return draw_mount(np.random.default_rng(seed), said)


def test_mount_has_no_state_and_obeys_its_seed():
    t_s = np.random.default_rng(0).uniform(0, 1e4, 100)
    whole = mount(3)(t_s)
    assert mount(3)(t_s[::-1])[::-1] == pytest.approx(whole, abs=1e-15)
    assert not np.array_equal(mount(4)(t_s), whole)
    limit = sum(MOUNT_DRAWS[k].usual[1] for k in ("hum_m", "sway_m", "shock_m", "shock_m"))
    assert np.linalg.norm(whole, axis=1).max() <= limit
    still = mount(hum_m=0, sway_m=0, shock_m=0)(t_s)
    assert not still.any()
