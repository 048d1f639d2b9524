"""Maps of range, Doppler and velocity: shapes, axes, CPIs of several lengths."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.range_time import RangeTimeMap, time_cells
from radard.judge.features import FeatureSettings, extract
from radard.judge.velocity_map import WEAKEST_COLUMN_DB, shown
from tests.dsp_reference import P4XX, X2, X4, error, point
from tests.radar_helpers import BASEBAND, dwell_of, noise


def by_definition(power, valid, depth_db):
    """In extended precision, cell by cell."""
    p = power.astype(np.longdouble)
    top = p[:, valid].max()
    weakest = top * np.longdouble(10) ** (-WEAKEST_COLUMN_DB / 10)
    out = np.zeros(p.shape)
    for j in np.flatnonzero(valid):
        column = max(p[:, j].max(), weakest)
        for i in range(len(p)):
            if p[i, j] > 0:
                out[i, j] = np.clip(1 + 10 * np.log10(p[i, j] / column) / depth_db, 0, 1)
    return out


def exponential(seed=0, shape=(30, 12)):
    return np.random.default_rng(seed).exponential(size=shape) ** 3


@pytest.mark.parametrize("level", [1e-300, 1e-80, 1e-30, 1.0, 1e30, 1e80, 1e300])
@pytest.mark.parametrize("depth_db", [10.0, 25.0, 60.0])
def test_against_extended_precision_at_any_level(level, depth_db):
    power = exponential() * level
    valid = np.arange(12) % 5 != 3
    away = shown(power, valid, depth_db) - by_definition(power, valid, depth_db)
    assert np.abs(away).max() < 1e-6


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_stands_in_unknown_columns_does_not_matter(bad):
    power = exponential()
    valid = np.ones(12, np.bool_)
    valid[4] = False
    wanted = shown(power, valid, 25.0)
    power[:, 4] = bad
    assert np.array_equal(shown(power, valid, 25.0), wanted)
    assert not wanted[:, 4].any()


@pytest.mark.parametrize("power", [np.zeros((3, 4)), np.full((3, 4), np.inf), np.zeros((3, 0))])
def test_no_power_and_no_finite_power_show_nothing(power):
    picture = shown(power, np.ones(power.shape[1], np.bool_), 25.0)
    assert picture.shape == power.shape
    assert not picture.any()


SETTINGS = FeatureSettings(velocity_cpi_s=0.2, velocity_cpi_frames=6)
GRIDS = SETTINGS.velocity_grids()


def test_shapes_hold_the_columns_of_a_dwell_and_no_more():
    assert [GRIDS[name].shape for name in GRIDS] == [(101, 40), (61, 24), (81, 9)]
    dwell = dwell_of(noise(147))
    for name, made in extract(dwell, SETTINGS, tuple(GRIDS)).items():
        assert made.shape == GRIDS[name].shape
        assert made.any(axis=0).all()


@pytest.mark.parametrize("carrier_hz", [3.9e9, 6.8e9, 8.7e9])
@pytest.mark.parametrize("rate_hz", [15.0, 30.5, 60.0, 200.0])
def test_a_cpi_never_takes_more_than_three_quarters_of_a_dwell(carrier_hz, rate_hz):
    n_slow = round(2.0 * rate_hz) + round(28 / 60 * rate_hz) - 1
    axis = replace(BASEBAND, carrier_hz=carrier_hz)
    dwell = dwell_of(noise(n_slow), rate_hz, axis=axis)
    asked = replace(SETTINGS, velocity_cpi_carrier_hz=7e9)
    for name, grid in asked.velocity_grids().items():
        transform = grid.transform(dwell)
        assert transform.n_cpi <= max(0.75 * n_slow + 1, 6)
        wanted_s = max(grid.cpi_s * 7e9 / carrier_hz, 6 / rate_hz)
        if wanted_s < 0.75 * n_slow / rate_hz:
            assert transform.n_cpi == pytest.approx(wanted_s * rate_hz, abs=0.51)
        shown = extract(dwell, asked, (name,))[name]
        # What no whole CPI ends in stays empty; the newest cell is always there.
        assert shown[:, -1].any()


SMALL = replace(X2, n_range=24)


def fed(frames, axis, n_cpi, **kwargs):
    stream = RangeTimeMap(axis, n_cpi, **kwargs)
    stream.push(frames)
    return stream


def test_cells_are_of_the_columns_that_are_kept_and_noise_has_its_own_power():
    # Eight columns at 60 Hz are 0.13 s: of two cells of 0.1 s one is whole, one a third.
    stream = fed(noise(50, 24), SMALL, 12, n_keep=8)
    power, good = stream.cells(60.0, cell_s=0.1, n_cells=2)
    assert good.tolist() == [False, True]
    assert error(power[:, 1], stream.columns()[:, 2:].mean(axis=1)) < 1e-6
    stream.restart()
    power, good = stream.cells(60.0, cell_s=0.1, n_cells=5)
    assert power.shape == (len(stream.range_m), 5)
    assert not good.any()
    ours = fed(noise(4000, 96, sigma=3.0), X2, 28, n_keep=4000).columns()
    assert ours.mean() == pytest.approx(9.0, rel=0.01)


@pytest.mark.parametrize("axis", [X2, P4XX, X4])
@pytest.mark.parametrize("near_m", [None, 0.0, 1.03])
def test_one_grid_for_all_radars(axis, near_m):
    far_m = None if near_m is None else near_m + 6.0
    rate_hz = 60.0
    middle_m = float(axis.range_m[axis.n_range // 2])
    frames = point(axis, rate_hz, 60, velocity_mps=0.8, middle_m=middle_m)
    ours = fed(frames, axis, 28, near_m=near_m, far_m=far_m)
    if near_m is not None:
        assert np.allclose(ours.range_m, near_m + 0.05 + 0.1 * np.arange(60))
    half_m = axis.bin_length_m / 2
    near_end, far_end = axis.range_m[0] - half_m, axis.range_m[-1] + half_m
    seen = (ours.range_m > near_end) & (ours.range_m < far_end)
    assert np.array_equal(ours.is_covered, seen)
    assert not ours.columns()[~ours.is_covered].any()
    t_s = (np.arange(33) + 14 - 29.5) / rate_hz
    assert centre_m(ours.columns(), ours.range_m) == pytest.approx(middle_m - 0.8 * t_s, abs=0.06)


def test_bin_length_does_not_matter():
    fine = replace(X2, n_range=768, bin_length_m=0.003656)
    coarse = replace(X2, range_offset_m=fine.range_m[3] + 0.003656 / 2)
    frames = point(fine, 60.0, 50, velocity_mps=1.0, middle_m=2.0)
    grid = {"near_m": 0.7, "far_m": 3.3}
    ours = fed(frames[:, 4::8], coarse, 28, **grid).columns()
    assert error(ours, fed(frames, fine, 28, **grid).columns()) < 0.05


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    n=st.integers(1, 60),
    rate_hz=st.floats(1, 1000),
    cell_s=st.floats(0.01, 1.0),
    n_cells=st.integers(1, 50),
    seed=st.integers(0, 99),
    level=st.sampled_from([1e-290, 1e-30, 1.0, 1e30, 1e290]),
)
def test_time_cells_against_extended_precision(n, rate_hz, *, cell_s, n_cells, seed, level):
    rng = np.random.default_rng(seed)
    valid, columns = rng.random(n) < 0.8, rng.random((3, n)) * level
    given = np.where(valid, columns, np.nan)
    cells, known = time_cells(given, valid, rate_hz, cell_s=cell_s, n_cells=n_cells)
    assert cells.shape == (3, n_cells)
    assert np.isfinite(cells).all()
    ends_s, cell_s = np.arange(-n, 1) / np.longdouble(rate_hz), np.longdouble(cell_s)
    for k in np.flatnonzero(known):
        low, high = (k - n_cells) * cell_s, (k - n_cells + 1) * cell_s
        inside = np.minimum(ends_s[1:], high) - np.maximum(ends_s[:-1], low)
        share = np.where(valid, np.maximum(inside, 0), 0)
        if share.sum() > 1e-9:
            wanted = (columns.astype(np.longdouble) @ share) / share.sum()
            assert error(cells[:, k], wanted.astype(np.float64)) < 1e-6


def test_cells_keep_energy():
    # At 30.5 Hz a cell holds one and a half columns; the mean is the same still.
    for n, rate_hz in ((120, 60.0), (61, 30.5)):
        columns = np.random.default_rng(1).random((4, n))
        flags = np.ones(n, np.bool_)
        cells, known = time_cells(columns, flags, rate_hz, cell_s=0.05, n_cells=40)
        assert known.all()
        assert np.allclose(cells.mean(axis=1), columns.mean(axis=1))
        if rate_hz == 60:
            assert np.allclose(cells[:, -1], columns[:, -3:].mean(axis=1))


def centre_m(power, range_m):
    """Where the strongest target is: the centre of what is within 12 dB and 0.8 m of its peak."""
    peak = power.max(axis=0)
    near = np.abs(range_m[:, None] - range_m[power.argmax(axis=0)]) <= 0.8
    weight = np.where(near & (power >= peak * 10**-1.2), power, 0)
    return range_m @ weight / weight.sum(axis=0)
