"""Every echo tier against the pass-band reference, at ordinary and at extreme inputs."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.downconvert import DownConverter
from tests.echo_references import passband
from tests.sim_helpers import axis_of, axis_with
from x2radar.errors import SceneError
from x2radar.sim.echo import echo_sigma_m, frames
from x2radar.sim.echo.tiers import suits

X2, X2_RF = axis_of("baseband"), axis_of("rf")
DECIMATED = replace(X2, n_range=96, bin_length_m=8 * X2.bin_length_m)
X4 = axis_with("baseband", 150, 0.0514, 0.4, 8.748e9, 1.5e9, 23.328e9)
P4XX = axis_with("baseband", 300, 0.00915, 0.0, 4.0e9, 1.7e9, 16.39e9)
AXES = {
    "x2": X2,
    "x2 rf": X2_RF,
    "x2 decimated": DECIMATED,
    "x2 rising phase": replace(X2, phase_sign=1),
    "x4": X4,
    "p4xx": P4XX,
    "p4xx rf": replace(P4XX, kind="rf"),
}
COARSE = (-40.0, -60.0, -80.0, -100.0)
ERRORS_DB = {"dense": (-120.0,), "local": COARSE, "gridded": COARSE}
FAST = tuple(ERRORS_DB)


def made_by(tier, range_m, amplitude, axis, **how):
    return frames(range_m, amplitude, axis, tier=tier, **how)


def pairs(tiers, names):
    """Tiers with the axes that they can serve."""
    found = product(tiers, names)
    return [(tier, name) for tier, name in found if tier != "gridded" or suits(AXES[name])]


CASES = [
    *((*pair, error_db) for pair in pairs(FAST, AXES) for error_db in ERRORS_DB[pair[0]]),
    *product((None,), AXES, (-20.0, -60.0, -80.0, -100.0, -110.0, -130.0)),
]


def scene(axis, n_slow=30, n_points=6, seed=0, beyond=0.2):
    """Echoes in the swath and a little outside, amplitudes over 60 dB, of both signs."""
    rng = np.random.default_rng(seed)
    low, high = axis.range_m[[0, -1]]
    span = high - low
    range_m = rng.uniform(low - beyond * span, high + beyond * span, (n_slow, n_points))
    amplitude = 10 ** rng.uniform(-3, 0, range_m.shape)
    return range_m, amplitude * rng.choice([-1, 1], range_m.shape)


def worst_db(ours, wanted, amplitude):
    """Largest error of a bin over the sum of its frame's amplitudes, in dB."""
    level = np.abs(amplitude).sum(axis=1, keepdims=True)
    error = np.abs(ours - wanted.astype(np.complex128)) / np.where(level > 0, level, 1)
    return 20 * math.log10(max(error.max(), 1e-20))


@pytest.fixture(scope="module")
def references():
    return {name: passband(*scene(axis), axis) for name, axis in AXES.items()}


@pytest.mark.parametrize(("tier", "name", "error_db"), CASES)
def test_error_against_the_reference(tier, name, error_db, references):
    axis = AXES[name]
    range_m, amplitude = scene(axis)
    ours = made_by(tier, range_m, amplitude, axis, error_db=error_db)
    assert ours.dtype == (np.float32 if axis.kind == "rf" else np.complex64)
    assert ours.shape == (30, axis.n_range)
    # Rounding to float32 comes on top of the designed error.
    allowed = 10 ** (error_db / 20) + 3e-7
    assert worst_db(ours, references[name], amplitude) <= 20 * math.log10(allowed)


@pytest.mark.parametrize("tier", FAST)
def test_worst_position_of_an_echo(tier):
    """A thousand positions across a grid spacing: no corner is worse than stated."""
    at = X2.range_m[300] + np.linspace(0, 60, 1000) * X2.bin_length_m
    range_m, amplitude = at[:, None], np.ones((1000, 1))
    wanted = made_by("dense", range_m, amplitude, X2, error_db=-120)
    ours = made_by(tier, range_m, amplitude, X2, error_db=-60)
    assert worst_db(ours, wanted, amplitude) <= -60.0


@pytest.mark.parametrize(("tier", "step"), [*((t, 1) for t in FAST), ("dense", 8), ("local", 8)])
def test_equals_the_daemons_down_conversion(tier, step):
    """RF frames, mixed, filtered and decimated by the daemon, against baseband frames."""
    converter = DownConverter(X2_RF, step)
    axis = converter.axis
    low, high = X2_RF.range_m[[0, -1]]
    guard = 8 * echo_sigma_m(axis, "rf")
    rng = np.random.default_rng(1)
    range_m = rng.uniform(low + guard, high - guard, (40, 5))
    amplitude = rng.uniform(0.1, 1, range_m.shape)
    rf = passband(range_m, amplitude, X2_RF)
    ours = made_by(tier, range_m, amplitude, axis, error_db=-60)
    assert worst_db(ours, converter.convert(rf), amplitude) < -60
    finest = min(ERRORS_DB[tier])
    ours = made_by(tier, range_m, amplitude, axis, error_db=finest)
    assert worst_db(ours, converter.convert(rf), amplitude) < max(finest, -100) + 3


@pytest.mark.parametrize(("tier", "name"), pairs(FAST, ["x2", "x2 rf", "x4"]))
def test_few_or_no_echoes(tier, name):
    axis = AXES[name]
    for shape in ((0, 3), (4, 0), (0, 0), (1, 1), (1, 20)):
        range_m, amplitude = scene(axis, *shape)
        ours = made_by(tier, range_m, amplitude, axis, error_db=-60)
        assert ours.shape == (shape[0], axis.n_range)
        wanted = made_by("dense", range_m, amplitude, axis, error_db=-120)
        assert not ours.size or worst_db(ours, wanted, amplitude) <= -60


@pytest.mark.parametrize("tier", FAST)
@pytest.mark.parametrize("name", ["x2", "x2 rf"])
def test_nothing_from_outside_wraps_in(tier, name):
    """Echoes one reach beyond either end, and much further, leave every bin at zero."""
    axis = AXES[name]
    low, high = axis.range_m[[0, -1]]
    reach = 12 * echo_sigma_m(axis)
    away = [low - reach, high + reach, 0.0, -1e-300, -3.0, 1e3, 1e6, 1e300, np.inf, -np.inf]
    range_m = np.array(away)[:, None]
    assert not made_by(tier, range_m, np.ones_like(range_m), axis, error_db=-60).any()


@pytest.mark.parametrize("tier", FAST)
@pytest.mark.parametrize("away_m", [1e3, 1e5])
def test_phase_at_long_ranges(tier, away_m):
    """A swath 100 km out: the reference is whole-number arithmetic."""
    axis = replace(X2, range_offset_m=away_m)
    bins = np.arange(100, 700, 13)
    range_m = axis.range_m[bins][:, None]
    ours = made_by(tier, range_m, np.ones_like(range_m), axis, error_db=-80)
    for row, r in enumerate(range_m[:, 0].tolist()):
        top, bottom = r.as_integer_ratio()
        turns = (2 * top * 6_800_000_000) % (bottom * 299_792_458) / (bottom * 299_792_458)
        assert ours[row, bins[row]] == pytest.approx(np.exp(-2j * np.pi * turns), abs=3e-4)


@pytest.mark.parametrize("tier", ["local", "gridded", "dense"])
def test_140_db_between_two_echoes(tier):
    """A weak echo 1.5 m from a strong one keeps the relative error of a lone echo."""
    range_m = np.array([[1.0, 2.5]])
    amplitude = np.array([[1.0, 1e-7]])
    both = made_by(tier, range_m, amplitude, X2, error_db=-60)
    weak = passband(range_m[:, 1:], amplitude[:, 1:], X2)
    assert np.abs(both - weak)[:, 450:620].max() < 1.1e-3 * 1e-7


@pytest.mark.parametrize("tier", FAST)
@pytest.mark.parametrize("level", [0.0, 5e-324, 1e-310, 1e-40, 1e-30, 1e30])
def test_tiny_and_huge_amplitudes(tier, level):
    range_m, amplitude = scene(X2, 3, 4)
    ours = made_by(tier, range_m, level * np.ones_like(amplitude), X2, error_db=-60)
    if level < 1e-38:
        assert not ours.any()
        return
    wanted = level * made_by("dense", range_m, np.ones_like(amplitude), X2, error_db=-120)
    assert np.isfinite(ours).all()
    assert np.abs(ours - wanted.astype(np.complex128)).max() <= 4e-3 * level


@pytest.mark.parametrize("tier", FAST)
def test_the_floor_leaves_out_what_is_under_it(tier):
    range_m, amplitude = scene(X2, 20, 8)
    floor = 0.05
    quiet = made_by(tier, range_m, amplitude, X2, error_db=-60, floor=floor)
    cut = np.where(np.abs(amplitude) > floor, amplitude, 0.0)
    assert np.array_equal(quiet, made_by(tier, range_m, cut, X2, error_db=-60))
    assert not made_by(tier, range_m, amplitude, X2, error_db=-60, floor=1.0).any()


@pytest.mark.parametrize("tier", FAST)
def test_a_pulse_without_bandwidth_is_named(tier):
    with pytest.raises(SceneError, match="bandwidth_hz"):
        made_by(tier, *np.ones((2, 1, 1)), replace(X2, bandwidth_hz=0.0), error_db=-60)


@pytest.mark.parametrize("tier", FAST)
def test_frames_do_not_depend_on_their_neighbours(tier):
    """Blocks, gaps in view and single frames give one answer to the last bits."""
    range_m, amplitude = scene(X2, 1100, 9, beyond=0.5)
    amplitude[::7] = 0.0
    together = made_by(tier, range_m, amplitude, X2, error_db=-60)
    for row in [0, 1, 6, 7, 500, 908, 909, 910, 911, 1023, 1024, 1099]:
        part = slice(row, row + 1)
        alone = made_by(tier, range_m[part], amplitude[part], X2, error_db=-60)
        assert np.abs(alone - together[part]).max() <= 2e-6 * np.abs(amplitude[part]).sum()


POINTS = st.tuples(st.floats(-1e7, 1e7) | st.floats(0.3, 3.8), st.floats(0, 1e6))


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(["local", "gridded"]), st.lists(POINTS, min_size=1, max_size=8))
def test_any_echoes_are_a_sum(tier, points):
    """Additive over scatterers, finite, bounded by the sum of the amplitudes."""
    range_m, amplitude = np.array(points).T[:, None, :]
    whole = made_by(tier, range_m, amplitude, X2, error_db=-60)
    total = amplitude.sum()
    assert np.isfinite(whole).all()
    assert np.abs(whole).max() <= 1.002 * total
    parts = [
        made_by(tier, range_m[:, k, None], amplitude[:, k, None], X2, error_db=-60).astype(complex)
        for k in range(len(points))
    ]
    assert np.abs(whole - sum(parts)).max() <= 3e-6 * total
