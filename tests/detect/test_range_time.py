from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.range_time import RangeTimeMap, overlap, time_cells
from tests.dsp_helpers import P4XX, X2, X4, error, point
from tests.radar_helpers import noise

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


def test_overlap_and_cells_that_keep_energy():
    # At 30.5 Hz a cell holds one and a half columns; the mean is the same still.
    for n, rate_hz in ((120, 60.0), (61, 30.5)):
        columns = np.random.default_rng(1).random((4, n))
        flags = np.ones(n, np.bool_)
        cells, known = time_cells(columns, flags, rate_hz, cell_s=0.05, n_cells=40)
        assert known.all()
        assert np.allclose(cells.mean(axis=1), columns.mean(axis=1))
        if rate_hz == 60:
            assert np.allclose(cells[:, -1], columns[:, -3:].mean(axis=1))
    share = overlap(np.array([0, 1, 2, 3.0]), np.array([0.5, 1.5, 5.5]))
    assert np.allclose(share, [[0.5, 0], [0.5, 0.125], [0, 0.25]])


def centre_m(power, range_m):
    """Where the strongest target is: the centre of what is within 12 dB and 0.8 m of its peak."""
    peak = power.max(axis=0)
    near = np.abs(range_m[:, None] - range_m[power.argmax(axis=0)]) <= 0.8
    weight = np.where(near & (power >= peak * 10**-1.2), power, 0)
    return range_m @ weight / weight.sum(axis=0)
