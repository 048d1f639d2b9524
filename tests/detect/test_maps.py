"""Maps of streams: shapes and axes; their definition in float64, at any level, cut and gap."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.columns import SharedSteps
from radard.dsp.doppler import StreamingDoppler, gaussian_taper
from radard.dsp.range_time import RangeTimeMap, time_cells
from radard.dsp.velocity import VelocityTransform, range_dft
from radard.errors import FeatureError
from radard.judge.features import FeatureSettings, extract
from radard.judge.velocity_map import WEAKEST_COLUMN_DB, shown
from tests import dsp_reference
from tests.dsp_reference import X2, error, point, under_clutter
from tests.radar_helpers import BASEBAND, dwell_of, noise


def by_definition(power, valid, depth_db):
    """In extended precision, cell by cell."""
    p = power.astype(np.longdouble)
    weakest = p[:, valid].max() * np.longdouble(10) ** (-WEAKEST_COLUMN_DB / 10)
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
    for name, made in extract(dwell_of(noise(147)), SETTINGS, tuple(GRIDS)).items():
        assert made.shape == GRIDS[name].shape
        assert made.any(axis=0).all()


@pytest.mark.parametrize("carrier_hz", [3.9e9, 6.8e9, 8.7e9])
@pytest.mark.parametrize("rate_hz", [15.0, 30.5, 60.0, 200.0])
def test_a_cpi_never_takes_more_than_three_quarters_of_a_dwell(carrier_hz, rate_hz):
    n_slow = round(2.0 * rate_hz) + round(28 / 60 * rate_hz) - 1
    dwell = dwell_of(noise(n_slow), rate_hz, axis=replace(BASEBAND, carrier_hz=carrier_hz))
    asked = replace(SETTINGS, velocity_cpi_carrier_hz=7e9)
    for name, grid in asked.velocity_grids().items():
        transform = grid.transform(dwell)
        assert transform.n_cpi <= max(0.75 * n_slow + 1, 6)
        wanted_s = max(grid.cpi_s * 7e9 / carrier_hz, 6 / rate_hz)
        if wanted_s < 0.75 * n_slow / rate_hz:
            assert transform.n_cpi == pytest.approx(wanted_s * rate_hz, abs=0.51)
        # What no whole CPI ends in stays empty; the newest cell is always there.
        assert extract(dwell, asked, (name,))[name][:, -1].any()


SMALL = replace(X2, n_range=24)


def ranged(frames, axis, n_cpi, **kwargs):
    stream = RangeTimeMap(axis, n_cpi, **kwargs)
    stream.push(frames)
    return stream


def test_cells_are_of_the_columns_that_are_kept_and_noise_has_its_own_power():
    # Eight columns at 60 Hz are 0.13 s: of two cells of 0.1 s one is whole, one a third.
    stream = ranged(noise(50, 24), SMALL, 12, n_keep=8)
    power, good = stream.cells(60.0, cell_s=0.1, n_cells=2)
    assert good.tolist() == [False, True]
    assert error(power[:, 1], stream.columns()[:, 2:].mean(axis=1)) < 1e-6
    stream = RangeTimeMap(SMALL, 12)
    power, good = stream.cells(60.0, cell_s=0.1, n_cells=5)
    assert power.shape == (len(stream.range_m), 5)
    assert not good.any()
    ours = ranged(noise(4000, 96, sigma=3.0), X2, 28, n_keep=4000).columns()
    assert ours.mean() == pytest.approx(9.0, rel=0.01)


@pytest.mark.parametrize("axis", [X2, dsp_reference.P4XX, dsp_reference.X4])
@pytest.mark.parametrize("near_m", [None, 0.0, 1.03])
def test_one_grid_for_all_radars(axis, near_m):
    far_m = None if near_m is None else near_m + 6.0
    rate_hz = 60.0
    middle_m = float(axis.range_m[axis.n_range // 2])
    frames = point(axis, rate_hz, 60, velocity_mps=0.8, middle_m=middle_m)
    ours = ranged(frames, axis, 28, near_m=near_m, far_m=far_m)
    if near_m is not None:
        assert np.allclose(ours.range_m, near_m + 0.05 + 0.1 * np.arange(60))
    half_m = axis.bin_length_m / 2
    near_end, far_end = axis.range_m[0] - half_m, axis.range_m[-1] + half_m
    seen = (ours.range_m > near_end) & (ours.range_m < far_end)
    noisy = ranged(noise(60, axis.n_range), axis, 28, near_m=near_m, far_m=far_m)
    assert np.array_equal(noisy.columns().any(axis=1), seen)
    t_s = (np.arange(33) + 14 - 29.5) / rate_hz
    assert centre_m(ours.columns(), ours.range_m) == pytest.approx(middle_m - 0.8 * t_s, abs=0.06)


def test_bin_length_does_not_matter():
    fine = replace(X2, n_range=768, bin_length_m=0.003656)
    coarse = replace(X2, range_offset_m=fine.range_m[3] + 0.003656 / 2)
    frames = point(fine, 60.0, 50, velocity_mps=1.0, middle_m=2.0)
    grid = {"near_m": 0.7, "far_m": 3.3}
    ours = ranged(frames[:, 4::8], coarse, 28, **grid).columns()
    assert error(ours, ranged(frames, fine, 28, **grid).columns()) < 0.05


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
        cells, known = time_cells(columns, np.ones(n, np.bool_), rate_hz, cell_s=0.05, n_cells=40)
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


def doppler(n_cpi=16, stride=1, axis=SMALL, n_keep=512):
    return StreamingDoppler(n_cpi, stride=stride, n_keep=n_keep)


def velocity(n_cpi=16, stride=1, axis=SMALL, n_keep=512):
    grid = {"step_mps": 0.5, "max_mps": 3.0, "column_rate_hz": 60 / stride}
    return VelocityTransform(axis, 60.0, cpi_s=n_cpi / 60, n_keep=n_keep, **grid)


def ranges(n_cpi=16, stride=1, axis=SMALL, n_keep=512):
    assert stride == 1
    return RangeTimeMap(axis, n_cpi, n_keep=n_keep)


def doppler_direct(frames, _stream, n_cpi=16, stride=1, axis=SMALL):
    return dsp_reference.micro_doppler_direct(frames, n_cpi)[:, ::stride]


def velocity_direct(frames, stream, n_cpi=16, stride=1, axis=SMALL):
    """The definition, of frames whose clutter is taken off in float64 first."""
    y = frames.astype(np.complex128)
    return dsp_reference.velocity_transform_direct(
        (y - y[0]) @ range_dft(axis, stream.frequency_hz, 1.5),
        stream.frequency_hz,
        60.0,
        velocity_mps=stream.velocity_mps,
        taper=gaussian_taper(n_cpi),
        stride=stride,
    )


def ranges_direct(frames, stream, n_cpi=16, stride=1, axis=SMALL):
    """Centre frames less their CPI's mean, power averaged over cells."""
    y = frames.astype(np.complex128)
    begin_m = axis.range_m - axis.bin_length_m / 2
    edges_m = begin_m[0] + 0.1 * np.arange(len(stream.range_m) + 1)
    columns = []
    for i in range(len(y) - n_cpi + 1):
        cpi = y[i : i + n_cpi] - y[i]
        power = np.abs(cpi[n_cpi // 2] - cpi.mean(axis=0)) ** 2 * n_cpi / (n_cpi - 1)
        column = []
        for low, high in pairwise(edges_m):
            inside = np.minimum(begin_m + axis.bin_length_m, high) - np.maximum(begin_m, low)
            share = np.maximum(inside, 0)
            column.append(share @ power / share.sum())
        columns.append(column)
    return np.array(columns).T


DIRECT = {doppler: doppler_direct, velocity: velocity_direct, ranges: ranges_direct}
each = pytest.mark.parametrize("make", [doppler, velocity, ranges])


def fed(make, frames, sizes=None, valid=None, **setting):
    """A stream that got all frames, cut as said."""
    stream = make(**setting)
    at = 0
    for n in sizes or [len(frames)]:
        part = slice(at, at + n)
        stream.push(frames[part], None if valid is None else valid[part])
        at += n
    assert at >= len(frames)
    return stream


def off(make, frames, stream, **setting):
    """How far a stream's columns are from the definition."""
    return error(stream.columns(), DIRECT[make](frames, stream, **setting))


@each
@settings(deadline=None, derandomize=True, max_examples=25)
@given(data=st.data())
def test_any_cut_gives_the_columns_of_the_definition(make, data):
    n_cpi = data.draw(st.integers(4, 40))
    stride = 1 if make is ranges else data.draw(st.integers(1, 7))
    n = data.draw(st.integers(n_cpi, 110))
    setting = {"n_cpi": n_cpi, "stride": stride}
    frames = under_clutter(noise(n, 24, seed=n), data.draw(st.sampled_from([0, 60, 100, 140])))
    sizes = data.draw(st.lists(st.sampled_from([1, 1, 1, 2, 5, 33, 64]), min_size=1, max_size=9))
    ours = fed(make, frames, [*sizes, n], **setting)
    assert ours.n_columns == (n - n_cpi) // stride + 1
    assert off(make, frames, ours, **setting) < 1e-5
    assert error(ours.columns(), fed(make, frames, **setting).columns()) < 1e-6


@each
@pytest.mark.parametrize("clutter_db", [0, 60, 80, 95, 100, 120, 140])
def test_clutter_does_not_hide_a_walker(make, clutter_db):
    frames = under_clutter(point(X2, 60.0, 60, velocity_mps=1.2, middle_m=2.0), clutter_db)
    setting = {"n_cpi": 28, "axis": X2}
    assert off(make, frames, fed(make, frames, **setting), **setting) < 1e-5


@each
@pytest.mark.parametrize("n_cpi", [4, 5, 27, 93, 127, 128, 129, 256])
def test_cpi_of_any_length(make, n_cpi):
    frames = noise(n_cpi + 6, 24)
    assert off(make, frames, fed(make, frames, n_cpi=n_cpi), n_cpi=n_cpi) < 1e-5


@each
@pytest.mark.parametrize("level", [1e-36, 1e-30, 1e-25, 1e-12, 1e10, 1e19, 1e30, 1e33])
def test_levels(make, level):
    frames = (noise(40, 24) * level).astype(np.complex64)
    assert off(make, frames, fed(make, frames, [25, 15])) < 1e-5


@each
@pytest.mark.parametrize("level", [1e8, 1e30])
def test_a_spike_frame_leaves_with_its_cpis(make, level):
    frames = under_clutter(noise(80, 24), 60)
    spiked = frames.copy()
    spiked[40] *= np.float32(level)
    ours, clean = (fed(make, f, [30, 50]).columns() for f in (spiked, frames))
    away = np.r_[0:25, 41:65]
    assert np.isfinite(ours).all()
    assert error(ours[:, away], clean[:, away]) < 1e-6


@each
@pytest.mark.parametrize("lost", [0, 1, 8, 17, 29, 40, 43])
@pytest.mark.parametrize("sizes", [[1] * 45, [10, 20, 15]])
@pytest.mark.parametrize("bad", [np.nan, -np.inf, complex(0, np.nan), 2e38, 1e6])
def test_a_gap_at_every_place(make, lost, sizes, bad):
    frames = noise(45, 24)
    valid = np.ones(45, np.bool_)
    valid[lost : lost + 2] = False
    holed = np.where(valid[:, None], frames, np.complex64(bad))
    # Frames that are not finite, or too large to be subtracted, count as lost, said or not.
    ours = fed(make, holed, sizes, valid if bad == 1e6 else None, n_cpi=12)
    good = ours.columns_valid()
    assert np.array_equal(good, [valid[i : i + 12].all() for i in range(34)])
    # What stands in a lost frame's place reaches no column, good or not.
    clean = fed(make, frames, n_cpi=12).columns()
    assert ours.columns().max() < 100 * clean.max()
    assert error(ours.columns()[:, good], clean[:, good]) < 1e-6


@each
def test_still_frames_have_no_power_at_all(make):
    frames = np.repeat(noise(1, 24, sigma=1e7), 60, axis=0)
    assert not fed(make, frames, [1] * 20 + [40]).columns().any()


@each
def test_the_last_of_many_frames_is_as_exact_as_the_first(make):
    setting = {"n_cpi": 28, "axis": replace(X2, n_range=6)}
    # Columns need be made of the last frames alone.
    stride = {} if make is ranges else {"stride": 1000}
    frames = under_clutter(noise(50_000, 6), 80)
    stream, found = make(n_keep=60, **setting, **stride), []
    tail = frames[-87:] if make is ranges else frames[-2000:]
    wanted = DIRECT[make](tail, stream, **setting, **stride)
    for _ in range(5):
        stream.push(frames)
        found.append(error(stream.columns(wanted.shape[1]), wanted))
    assert found[0] < 1e-5
    assert found[-1] <= 1.1 * found[0]


@each
def test_what_is_kept_and_what_is_asked_for(make):
    frames = noise(60, 24)
    stream = make(n_keep=7)
    rows = stream.columns().shape[0]
    assert stream.push(frames[:0]) == 0
    assert [stream.push(f) for f in frames] == [0] * 15 + [1] * 45
    wanted = fed(make, frames).columns()
    assert stream.n_columns == 7
    assert error(stream.columns(3), wanted[:, -3:]) < 1e-6
    assert stream.columns_valid(2).tolist() == [True, True]
    mine = stream.columns()
    assert error(mine, wanted[:, -7:]) < 1e-6
    mine[:] = -1
    assert stream.columns().min() >= 0
    for n in (8, -1):
        with pytest.raises(FeatureError, match="columns wanted"):
            stream.columns(n)
    empty = make()
    assert (empty.n_columns, empty.columns().shape) == (0, (rows, 0))


def test_maps_that_share_their_steps():
    frames = under_clutter(noise(200, 24), 60)
    frames[77, 3] = np.nan
    valid = np.arange(200) != 120
    apart, together = ([doppler(28), velocity(28), ranges(14)] for _ in range(2))
    shared = SharedSteps(*together)
    for stream in apart:
        stream.push(frames, valid)
    for first, last in ((0, 1), (1, 2), (2, 63), (63, 200)):
        shared.push(frames[first:last], valid[first:last])
    for a, b in zip(apart, together, strict=True):
        assert np.array_equal(a.columns_valid(), b.columns_valid())
        assert not b.columns_valid().all()
        assert error(b.columns(), a.columns()) < 1e-6
    with pytest.raises(FeatureError, match="25 bins in a stream of 24"):
        shared.push(noise(3, 25))


WRONG = [("step_mps", 0.0), ("step_mps", 6.0), ("max_mps", np.inf), ("cpi_s", -1.0)]
WRONG += [("column_rate_hz", np.nan)]


@pytest.mark.parametrize(
    "make",
    [
        *(partial(StreamingDoppler, 1), partial(StreamingDoppler, 4, stride=0)),
        *(partial(RangeTimeMap, X2, 1), partial(RangeTimeMap, X2, 28, cell_m=0.0)),
        partial(RangeTimeMap, X2, 28, near_m=9.0, far_m=8.0),
        *(partial(VelocityTransform, X2, 60.0, **{name: value}) for name, value in WRONG),
        partial(VelocityTransform, X2, 0.0),
    ],
)
def test_settings_that_make_no_sense(make):
    with pytest.raises(FeatureError):
        make()
