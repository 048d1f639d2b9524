import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.columns import SharedSteps
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.streaming import StreamingDoppler
from radard.dsp.velocity import VelocityTransform
from radard.errors import FeatureError
from tests.dsp_helpers import X2, error, under_clutter
from tests.dsp_reference import micro_doppler_direct
from tests.radar_helpers import noise


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


@settings(deadline=None, derandomize=True, max_examples=50)
@given(data=st.data())
def test_any_cut_gives_the_same_columns(data):
    n_cpi = data.draw(st.integers(2, 40))
    n = data.draw(st.integers(n_cpi, 150))
    stride = data.draw(st.integers(1, 7))
    frames = under_clutter(noise(n, 8, seed=n), data.draw(st.sampled_from([0, 60, 100, 140])))
    sizes = data.draw(st.lists(st.sampled_from([1, 1, 1, 2, 5, 33, 64]), min_size=1))
    sizes += [n]
    ours = fed(frames, n_cpi, sizes, stride=stride)
    wanted = micro_doppler_direct(frames, n_cpi)[:, ::stride]
    assert ours.n_columns == wanted.shape[1]
    assert error(ours.columns(), wanted) < 1e-5
    assert error(ours.columns(), fed(frames, n_cpi, stride=stride).columns()) < 1e-6


@pytest.mark.parametrize("clutter_db", [0, 60, 80, 95, 100, 120, 140])
def test_live_and_batch_agree_in_wide_frames(clutter_db):
    frames = under_clutter(noise(150, 768), clutter_db)
    batch = fed(frames, 28).columns()
    assert error(fed(frames, 28, [1] * 150).columns(), batch) < 1e-6
    assert error(fed(frames, 28, [60, 60, 30]).columns(), batch) < 1e-6


@settings(deadline=None, derandomize=True, max_examples=30)
@given(exponent=st.integers(-80, 100), seed=st.integers(0, 99))
def test_a_power_of_two_changes_nothing_else(exponent, seed):
    frames = noise(60, 8, seed=seed)
    scaled = np.ldexp(frames.view(np.float32), exponent).view(np.complex64)
    ours = fed(scaled, 20).columns()
    assert error(np.ldexp(ours, -2 * exponent), fed(frames, 20).columns()) < 1e-6


@pytest.mark.parametrize("level", [1e-44, 1e-42, 1e-38, 1e-30, 1e-12, 1e12, 1e19, 1e30, 1e37])
@pytest.mark.parametrize("one_by_one", [False, True])
def test_levels_from_denormal_to_the_end(level, one_by_one):
    frames = (noise(60, 8) * level).astype(np.complex64)
    ours = fed(frames, 20, [1] * 60 if one_by_one else None).columns()
    assert error(ours, micro_doppler_direct(frames, 20)) < 1e-5


@pytest.mark.parametrize("lost", range(40))
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
    wanted = [valid[i : i + n_cpi].all() for i in range(41 - n_cpi + 1)]
    assert np.array_equal(good, wanted)
    assert np.isfinite(columns).all()
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
    ours, clean = fed(hurt, 16, sizes), fed(frames, 16, sizes)
    good = ours.columns_valid()
    assert np.array_equal(np.flatnonzero(~good), np.arange(25, 41))
    assert np.isfinite(ours.columns()).all()
    assert error(ours.columns()[:, good], clean.columns()[:, good]) < 1e-6


@pytest.mark.parametrize("level", [1e3, 1e8, 1e20, 1e33])
@pytest.mark.parametrize("sizes", [[80], [1] * 80])
def test_a_spike_frame_leaves_with_its_cpis(level, sizes):
    frames = under_clutter(noise(80, 6), 60)
    spiked = frames.copy()
    spiked[40] *= np.float32(level)
    ours, clean = fed(spiked, 16, sizes).columns(), fed(frames, 16, sizes).columns()
    away = np.r_[0:25, 41:65]
    assert error(ours[:, away], clean[:, away]) < 1e-6
    assert error(ours, micro_doppler_direct(spiked, 16)) < 1e-5


def test_clipped_frames():
    frames = under_clutter(noise(60, 8), 40)
    limit = np.float32(np.abs(frames.real).max() / 2)
    clipped = np.clip(frames.real, -limit, limit) + 1j * np.clip(frames.imag, -limit, limit)
    wanted = micro_doppler_direct(clipped, 16)
    assert error(fed(clipped.astype(np.complex64), 16).columns(), wanted) < 1e-5


@pytest.mark.parametrize("sizes", [[70], [1] * 70])
def test_still_frames_and_zero_power(sizes):
    frames = np.repeat(noise(1, 5, sigma=1e3), 70, axis=0)
    assert not fed(frames, 28, sizes).columns().any()
    frames[50:] += 1
    ours = fed(frames, 28, sizes).columns()
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
        if first:
            stream.push(frames)
        else:
            stream.push(frames[:1000])
            found[1000] = error(stream.columns(90), micro_doppler_direct(frames[903:1000], 8))
            stream.push(frames[1000:])
    found[1_000_000] = error(stream.columns(90), micro_doppler_direct(frames[-97:], n_cpi))
    assert found[1000] < 1e-6
    assert found[1_000_000] < 1.5 * found[1000]


@pytest.mark.parametrize("sizes", [[50], [1] * 50, [13] * 4])
def test_restart(sizes):
    frames = noise(100, 6)
    stream = fed(frames[:50], 12, sizes)
    stream.restart()
    assert stream.n_columns == 0
    assert stream.columns().shape == (12, 0)
    assert stream.push(frames[50:61]) == 0
    assert stream.push(frames[61:]) == 39
    assert error(stream.columns(), fed(frames[50:], 12).columns()) < 1e-6
    stream.restart()
    stream.push(noise(12, 9))
    assert stream.n_columns == 1


def test_a_frame_alone_and_columns_that_are_kept():
    frames = noise(40, 6)
    stream = StreamingDoppler(10, n_keep=7)
    assert [stream.push(f) for f in frames] == [0] * 9 + [1] * 31
    wanted = micro_doppler_direct(frames, 10)
    assert stream.n_columns == 7
    assert error(stream.columns(), wanted[:, -7:]) < 1e-5
    assert error(stream.columns(3), wanted[:, -3:]) < 1e-5
    assert stream.columns(0).shape == (10, 0)
    assert stream.columns_valid(2).tolist() == [True, True]
    mine = stream.columns()
    mine[:] = -1
    assert stream.columns().min() >= 0
    for n in (8, -1):
        with pytest.raises(FeatureError, match="columns wanted"):
            stream.columns(n)


@settings(deadline=None, derandomize=True, max_examples=25)
@given(seed=st.integers(0, 1000), stride=st.integers(1, 9), n_cpi=st.integers(2, 20))
def test_bands_tapers_and_strides(seed, stride, n_cpi):
    rng = np.random.default_rng(seed)
    frames = noise(n_cpi + 30, 24, seed=seed)
    taper = rng.random(n_cpi)
    cut = int(rng.integers(1, 24))
    bands = [(0, cut), (cut, 24), (0, 24), (cut - 1, cut)]
    ours = fed(frames, n_cpi, taper=taper, bands=bands, stride=stride).columns()
    for mu, (first, stop) in zip(ours, bands, strict=True):
        wanted = micro_doppler_direct(frames[:, first:stop], n_cpi, taper=taper)[:, ::stride]
        assert error(mu, wanted) < 1e-5
    assert error(ours[0] + ours[1], ours[2]) < 2e-6


@pytest.mark.parametrize(
    ("settings_", "says"),
    [
        ({"stride": 0}, "stride 0"),
        ({"taper": np.ones(3)}, "taper"),
        ({"bands": []}, "range bands"),
        ({"bands": [(0, 9)]}, "range bands"),
        ({"bands": [(3, 3)]}, "range bands"),
        ({"bands": [(-1, 3)]}, "range bands"),
    ],
)
def test_each_setting_is_named(settings_, says):
    with pytest.raises(FeatureError, match=says):
        fed(noise(20, 8), 10, **settings_)


@pytest.mark.parametrize("sizes", [[60], [1] * 60])
def test_bands_one_by_one(sizes):
    frames = noise(60, 20)
    bands = [(0, 7), (5, 20)]
    ours = fed(frames, 12, sizes, bands=bands).columns()
    assert ours.shape == (2, 12, 49)
    for mu, (first, stop) in zip(ours, bands, strict=True):
        assert error(mu, micro_doppler_direct(frames[:, first:stop], 12)) < 1e-5


def test_the_stream_keeps_its_width():
    stream = fed(noise(5, 6), 4)
    with pytest.raises(FeatureError, match="7 bins in a stream of 6"):
        stream.push(noise(1, 7))


def test_no_frames_make_no_columns():
    stream = StreamingDoppler(4)
    assert stream.push(np.zeros((0, 6))) == 0
    assert stream.columns().shape == (4, 0)
    assert stream.columns_valid().shape == (0,)


@pytest.mark.parametrize(
    "wrong", [{"n_cpi": 1}, {"n_cpi": 4, "stride": 0}, {"n_cpi": 4, "n_keep": 0}]
)
def test_settings_that_make_no_sense(wrong):
    with pytest.raises(FeatureError):
        StreamingDoppler(**wrong)


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
