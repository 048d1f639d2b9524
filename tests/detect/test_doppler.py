"""Micro-Doppler by Gram matrices: the definition in float64, at every level, cut and gap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.columns import SharedSteps
from radard.dsp.doppler import (
    StreamingDoppler,
    doppler_hz,
    micro_doppler,
    unambiguous_velocity_mps,
    velocity_mps,
)
from radard.dsp.gram import centring, gaussian_taper, gram, step_operator
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import VelocityTransform
from radard.errors import FeatureError
from tests.dsp_helpers import X2, error, under_clutter
from tests.dsp_reference import micro_doppler_direct
from tests.radar_helpers import noise, walker

LIGHT_MPS = 299_792_458.0


def fed(frames, n_cpi, sizes=None, valid=None, **kwargs):
    """A stream that got all frames, cut as said."""
    stream = StreamingDoppler(n_cpi, **kwargs)
    at = 0
    for n in sizes or [len(frames)]:
        part = slice(at, at + n)
        stream.push(frames[part], None if valid is None else valid[part])
        at += n
    assert at >= len(frames)
    return stream


def test_the_reference_in_extended_precision():
    frames = under_clutter(noise(20, 4), 140)
    y = frames.astype(np.clongdouble)
    columns = []
    for i in range(12):
        z = y[i : i + 9] - y[i : i + 9].mean(axis=0)
        columns.append(np.fft.fftshift((np.abs(np.fft.fft(z, axis=0)) ** 2).sum(axis=1)))
    wanted = np.stack(columns, axis=1).astype(np.float64)
    assert error(micro_doppler_direct(frames, 9, taper=np.ones(9)), wanted) < 1e-12


@settings(deadline=None, derandomize=True, max_examples=60)
@given(data=st.data())
def test_any_cut_gives_the_columns_of_the_definition(data):
    n_cpi = data.draw(st.integers(2, 40))
    n = data.draw(st.integers(n_cpi, 150))
    stride = data.draw(st.integers(1, 7))
    frames = under_clutter(noise(n, 8, seed=n), data.draw(st.sampled_from([0, 60, 100, 140])))
    sizes = data.draw(st.lists(st.sampled_from([1, 1, 1, 2, 5, 33, 64]), min_size=1))
    ours = fed(frames, n_cpi, [*sizes, n], stride=stride)
    wanted = micro_doppler_direct(frames, n_cpi)[:, ::stride]
    assert ours.n_columns == wanted.shape[1]
    assert error(ours.columns(), wanted) < 1e-5
    assert error(ours.columns(), fed(frames, n_cpi, stride=stride).columns()) < 1e-6


@pytest.mark.parametrize("clutter_db", [0, 60, 80, 90, 95, 100, 120, 140])
def test_clutter_does_not_hide_motion_in_wide_frames(clutter_db):
    # At 90 to 100 dB float32 sums of squares of whole quanta would all be rounded one way.
    frames = under_clutter(noise(100, 768, seed=1), clutter_db)
    batch = micro_doppler(frames, 28)
    assert error(batch, micro_doppler_direct(frames, 28)) < 1e-5
    assert error(fed(frames, 28, [60, 1, 39]).columns(), batch) < 1e-6


@pytest.mark.parametrize("clutter_db", [60, 100, 140])
@pytest.mark.parametrize("speed_mps", [0.02, 0.2, 1.2])
def test_clutter_does_not_hide_a_slow_point(clutter_db, speed_mps):
    frames = walker(100, 60, speed_mps=speed_mps, start_m=2, level=1)
    frames = under_clutter(frames, clutter_db)
    assert error(micro_doppler(frames, 28), micro_doppler_direct(frames, 28)) < 1e-5


@pytest.mark.parametrize("n_cpi", [2, 3, 5, 31, 93, 127, 128, 129, 256])
def test_cpi_of_any_length(n_cpi):
    # Beyond 128 frames the map from Gram matrices is made anew, row by row.
    frames = noise(n_cpi + 5, 6)
    assert error(micro_doppler(frames, n_cpi), micro_doppler_direct(frames, n_cpi)) < 1e-5


@settings(deadline=None, derandomize=True, max_examples=30)
@given(exponent=st.integers(-80, 100), seed=st.integers(0, 99))
def test_a_power_of_two_changes_nothing_else(exponent, seed):
    frames = noise(60, 8, seed=seed)
    scaled = np.ldexp(frames.view(np.float32), exponent).view(np.complex64)
    ours = fed(scaled, 20).columns()
    assert error(np.ldexp(ours, -2 * exponent), fed(frames, 20).columns()) < 1e-6


@pytest.mark.parametrize("level", [1e-44, 1e-42, 1e-38, 1e-30, 1e-12, 1e12, 1e19, 1e30, 1e37])
def test_levels_from_denormal_to_the_end(level):
    frames = (noise(60, 8) * level).astype(np.complex64)
    assert error(fed(frames, 20, [40, 20]).columns(), micro_doppler_direct(frames, 20)) < 1e-5


@pytest.mark.parametrize("level", [1e3, 1e8, 1e20, 1e33])
def test_a_spike_frame_leaves_with_its_cpis(level):
    frames = under_clutter(noise(80, 6), 60)
    spiked = frames.copy()
    spiked[40] *= np.float32(level)
    ours, clean = fed(spiked, 16, [30, 50]).columns(), fed(frames, 16).columns()
    away = np.r_[0:25, 41:65]
    assert error(ours[:, away], clean[:, away]) < 1e-6
    assert error(ours, micro_doppler_direct(spiked, 16)) < 1e-5


@pytest.mark.parametrize("lost", range(0, 40, 3))
@pytest.mark.parametrize("n_lost", [1, 3])
@pytest.mark.parametrize("sizes", [[41], [1] * 41, [10, 20, 11]])
def test_a_gap_at_every_place(lost, n_lost, sizes):
    n_cpi = 9
    frames = noise(41, 4)
    valid = np.ones(41, np.bool_)
    valid[lost : lost + n_lost] = False
    holed = frames.copy()
    holed[~valid] = 1e6
    stream = fed(holed, n_cpi, sizes, valid)
    columns, good = stream.columns(), stream.columns_valid()
    assert np.array_equal(good, [valid[i : i + n_cpi].all() for i in range(41 - n_cpi + 1)])
    # What stands in a lost frame's place reaches no column, good or not.
    assert columns.max() < 1e4
    if good.any():
        assert error(columns[:, good], micro_doppler_direct(frames, n_cpi)[:, good]) < 1e-5


@pytest.mark.parametrize("bad", [np.nan, np.inf, complex(1, -np.inf), 1e38])
@pytest.mark.parametrize("sizes", [[80], [1] * 80, [25, 55]])
def test_frames_that_are_not_finite_leave_no_trace(bad, sizes):
    frames = noise(80, 6)
    hurt = frames.copy()
    hurt[40, 3] = bad
    ours, clean = fed(hurt, 16, sizes), fed(frames, 16)
    good = ours.columns_valid()
    assert np.array_equal(np.flatnonzero(~good), np.arange(25, 41))
    assert np.isfinite(ours.columns()).all()
    assert error(ours.columns()[:, good], clean.columns()[:, good]) < 1e-6


def test_still_frames_have_no_power_at_all():
    frames = np.repeat(noise(1, 64, sigma=1e4), 70, axis=0)
    assert not micro_doppler(frames, 28).any()
    frames[50:] += 1
    ours = fed(frames, 28, [1] * 70).columns()
    assert error(ours, micro_doppler_direct(frames, 28)) < 1e-5
    assert not ours[:, :23].any()


def test_the_millionth_column_is_as_exact_as_the_thousandth():
    n_cpi, n_block = 8, 5000
    rng = np.random.default_rng(0)
    stream = StreamingDoppler(n_cpi, n_keep=100)
    found = {}
    clutter = noise(1, 2, sigma=1e4)[0]
    for first in range(0, 1_000_000, n_block):
        t = np.arange(first, first + n_block)
        motion = rng.standard_normal((n_block, 4)).astype(np.float32).view(np.complex64)
        # The room drifts, by ten times the motion an hour.
        frames = motion + clutter * np.exp(2e-7j * t)[:, None].astype(np.complex64)
        stream.push(frames)
        if first in {0, 1_000_000 - n_block}:
            wanted = micro_doppler_direct(frames[-97:], n_cpi)
            found[first] = error(stream.columns(90), wanted)
    first, last = found.values()
    assert first < 1e-6
    assert last < 1.5 * first


@pytest.mark.parametrize("dtype", [">c8", "<c16", ">c16", "<f4", "<f2", ">f2", "<i2", ">i2"])
def test_any_number_format(dtype):
    values = np.random.default_rng(0).integers(-500, 500, (60, 12, 2))
    frames = (values[..., 0] + 1j * values[..., 1]).astype(np.complex64)
    if np.dtype(dtype).kind != "c":
        frames = frames.real
    wanted = micro_doppler_direct(frames, 20)
    wide = np.zeros((120, 36), dtype)
    wide[::2, ::3] = frames
    assert error(micro_doppler(wide[::2, ::3], 20), wanted) < 1e-5
    assert error(micro_doppler(np.asfortranarray(frames.astype(dtype)), 20), wanted) < 1e-5


def test_power_beyond_float32_is_its_largest_number():
    frames = (noise(40, 4) * np.float32(1e25)).astype(np.complex64)
    assert micro_doppler(frames, 28).max() == np.finfo(np.float32).max
    assert not micro_doppler(frames * np.float32(1e-25) * np.float32(1e-30), 28).any()


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    speed=st.floats(-15, 15),
    rate_hz=st.sampled_from([1, 17.06, 30.5, 60, 200, 1000]),
    carrier_hz=st.sampled_from([4.0e9, 6.8e9, 7.29e9]),
    n_cpi=st.integers(16, 60),
)
def test_velocity_axis_up_to_15_mps(speed, rate_hz, carrier_hz, n_cpi):
    t_s = np.arange(n_cpi) / rate_hz
    # One bin, so nothing walks through range: only the phase is looked at.
    frames = np.exp(4j * np.pi * carrier_hz / LIGHT_MPS * speed * t_s)[:, None]
    fold = 2 * unambiguous_velocity_mps(rate_hz, carrier_hz)
    folded = (speed + fold / 2) % fold - fold / 2
    step = fold / n_cpi
    if abs(folded) < 2 * step:
        return  # in the clutter notch
    axis = velocity_mps(n_cpi, rate_hz, carrier_hz)
    found = axis[micro_doppler(frames, n_cpi)[:, 0].argmax()]
    assert abs((found - folded + fold / 2) % fold - fold / 2) < 0.75 * step


@pytest.mark.parametrize("rate_hz", [1.0, 60.0, 1000.0])
@pytest.mark.parametrize("n_cpi", [2, 28, 29])
def test_axes(n_cpi, rate_hz):
    axis = doppler_hz(n_cpi, rate_hz)
    assert (axis.shape, axis[n_cpi // 2]) == ((n_cpi,), 0)
    assert np.all(np.diff(axis) > 0)
    assert abs(velocity_mps(n_cpi, rate_hz, 6.8e9)).max() <= unambiguous_velocity_mps(
        rate_hz, 6.8e9
    ) * (1 + 1e-12)
    assert unambiguous_velocity_mps(60, 6.8e9) == pytest.approx(0.66, abs=0.003)


def test_what_is_kept_what_is_asked_for_and_a_restart():
    frames = noise(40, 6)
    stream = StreamingDoppler(10, n_keep=7)
    assert stream.push(np.zeros((0, 6))) == 0
    assert stream.columns().shape == (10, 0)
    assert [stream.push(f) for f in frames] == [0] * 9 + [1] * 31
    wanted = micro_doppler_direct(frames, 10)
    assert stream.n_columns == 7
    assert error(stream.columns(3), wanted[:, -3:]) < 1e-5
    assert stream.columns_valid(2).tolist() == [True, True]
    mine = stream.columns()
    assert error(mine, wanted[:, -7:]) < 1e-5
    mine[:] = -1
    assert stream.columns().min() >= 0
    for n in (8, -1):
        with pytest.raises(FeatureError, match="columns wanted"):
            stream.columns(n)
    with pytest.raises(FeatureError, match="7 bins in a stream of 6"):
        stream.push(noise(1, 7))
    stream.restart()
    assert (stream.n_columns, stream.columns().shape) == (0, (10, 0))
    assert stream.push(noise(10, 9)) == 1


def test_maps_that_share_their_steps():
    frames = under_clutter(noise(200, X2.n_range), 60)
    frames[77, 3] = np.nan
    valid = np.arange(200) != 120
    apart = [StreamingDoppler(28), VelocityTransform(X2, 60.0), RangeTimeMap(X2, 14)]
    together = [StreamingDoppler(28), VelocityTransform(X2, 60.0), RangeTimeMap(X2, 14)]
    shared = SharedSteps(*together)
    for stream in apart:
        stream.push(frames, valid)
    for first, last in ((0, 1), (1, 2), (2, 63), (63, 200)):
        shared.push(frames[first:last], valid[first:last])
    for a, b in zip(apart, together, strict=True):
        assert np.array_equal(a.columns_valid(), b.columns_valid())
        assert not b.columns_valid().all()
        assert error(b.columns(), a.columns()) < 1e-6
    with pytest.raises(FeatureError, match="97 bins in a stream of 96"):
        shared.push(noise(3, 97))
    shared.restart()
    assert [stream.n_columns for stream in together] == [0, 0, 0]
    shared.push(frames[:28])
    assert [stream.n_columns for stream in together] == [1, 1, 15]


@pytest.mark.parametrize(
    "wrong", [{"n_cpi": 1}, {"n_cpi": 4, "stride": 0}, {"n_cpi": 4, "n_keep": 0}]
)
def test_settings_that_make_no_sense(wrong):
    with pytest.raises(FeatureError):
        StreamingDoppler(**wrong)


@pytest.mark.parametrize("shape", [(5, 4), (27, 8), (28,), (28, 2, 2)])
def test_too_short(shape):
    with pytest.raises(FeatureError, match="cannot fill"):
        micro_doppler(np.zeros(shape, np.complex64), 28)


@pytest.mark.parametrize("level", [1e-44, 1e-25, 1.0, 1e15, 1e37])
def test_gram_of_any_level_spikes_and_zeros(level):
    steps = noise(20, 8) * level
    steps[[0, 5]] = 0
    rows = np.concatenate([steps.real, steps.imag], axis=1).astype(np.float32)
    rows[7] = np.ldexp(rows[7], 60 if level < 1e15 else -60)
    q = gram(rows)
    # Real parts on and below the diagonal, imaginary parts above it.
    even, odd = np.tril(q) + np.tril(q, -1).T, np.triu(q, 1)
    ours = even + 1j * (odd - odd.T)
    wide = rows[:, :8].astype(np.float64) + 1j * rows[:, 8:]
    wanted, others = wide @ wide.conj().T, np.arange(20) != 7
    assert np.isfinite(ours).all()
    assert error(ours, wanted) < 1e-6
    assert error(ours[np.ix_(others, others)], wanted[np.ix_(others, others)]) < 1e-6


@settings(deadline=None, derandomize=True, max_examples=30)
@given(n_cpi=st.integers(2, 40), seed=st.integers(0, 1000))
def test_operators_by_definition(n_cpi, seed):
    frames = noise(n_cpi, 6, seed=seed).astype(np.complex128)
    taper = np.random.default_rng(seed).random(n_cpi) - 0.3
    steps = np.diff(frames, axis=0)
    assert np.allclose(centring(n_cpi) @ steps, frames - frames.mean(axis=0))
    lines = step_operator(taper) @ steps
    wanted = micro_doppler_direct(frames, n_cpi, taper=taper)[:, 0]
    assert np.allclose((np.abs(lines) ** 2).sum(axis=1), wanted)
    taper = gaussian_taper(n_cpi)
    assert taper[[0, -1]] == pytest.approx(0.1, abs=1e-4)
    assert taper.max() <= 1
