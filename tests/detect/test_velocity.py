from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.gram import gaussian_taper
from radard.dsp.velocity import VelocityTransform
from radard.dsp.wideband import range_dft, range_frequencies
from radard.errors import FeatureError
from tests.dsp_helpers import P4XX, X2, X4, error, point, under_clutter
from tests.dsp_reference import velocity_transform_direct
from tests.radar_helpers import noise

LIGHT_MPS = 299_792_458.0
SMALL = replace(X2, n_range=24)


def direct(frames, stream, axis, rate_hz):
    """The definition, of frames whose clutter is taken off in float64 first."""
    y = frames.astype(np.complex128)
    x = (y - y[0]) @ range_dft(axis, stream.frequency_hz, 1.5)
    return velocity_transform_direct(
        x,
        stream.frequency_hz,
        rate_hz,
        velocity_mps=stream.velocity_mps,
        taper=gaussian_taper(stream.n_cpi),
        stride=stream.stride,
    )


def fed(frames, axis, rate_hz, sizes=None, valid=None, **kwargs):
    stream = VelocityTransform(axis, rate_hz, **kwargs)
    at = 0
    for n in sizes or [len(frames)]:
        part = slice(at, at + n)
        stream.push(frames[part], None if valid is None else valid[part])
        at += n
    return stream


def passing(axis, rate_hz, speed_mps, **kwargs):
    """Mean column of a point that passes the middle of the swath."""
    stream = VelocityTransform(axis, rate_hz, step_mps=0.02, column_rate_hz=1e9, **kwargs)
    middle_m = float(axis.range_m[axis.n_range // 2])
    frames = point(axis, rate_hz, stream.n_cpi + 6, velocity_mps=speed_mps, middle_m=middle_m)
    stream.push(frames)
    return stream.velocity_mps, stream.columns().mean(axis=1)


RADARS = [
    (X2, 30.0, 2.5),
    (X2, 60.0, 5.0),
    (X2, 200.0, 8.0),
    (P4XX, 30.5, 3.5),
    (X4, 17.06, 0.5),
    (X4, 50.0, 3.0),
    (X4, 200.0, 6.0),
]


@pytest.mark.parametrize(("axis", "rate_hz", "least_db"), RADARS)
@pytest.mark.parametrize("speed_mps", [0.6, 1.2, 2.0, 3.6, -1.2, -3.6])
def test_true_velocity_and_suppressed_aliases(axis, rate_hz, least_db, speed_mps):
    grid, power = passing(axis, rate_hz, speed_mps)
    assert grid[power.argmax()] == pytest.approx(speed_mps, abs=0.03)
    alias_mps = LIGHT_MPS / axis.carrier_hz * rate_hz / 2
    elsewhere = np.abs(grid - speed_mps) > alias_mps / 2
    assert 10 * np.log10(power.max() / power[elsewhere].max()) > least_db


@pytest.mark.parametrize("speed_mps", [7.0, -11.0, 15.0])
def test_velocities_to_15_mps(speed_mps):
    # At 15 m/s the point crosses a swath of 7 m in 0.47 s: the swath of an X4.
    axis = replace(X4, n_range=182)
    grid, power = passing(axis, 200.0, speed_mps, max_mps=16.0)
    assert grid[power.argmax()] == pytest.approx(speed_mps, abs=0.05)


def test_resolution_does_not_depend_on_speed():
    widths = []
    for speed_mps in (0.6, 1.2, 2.0, 3.6):
        grid, power = passing(X2, 60.0, speed_mps)
        near = np.abs(grid - speed_mps) < 0.3
        widths.append(np.count_nonzero(power[near] > power.max() / 2) * 0.02)
    assert max(widths) < 0.09
    assert np.ptp(widths) <= 0.0201


def test_flattening_trades_noise_for_aliases():
    ratios = []
    for flatten in (0.0, 1.0, 1.5, 2.0):
        grid, power = passing(X2, 60.0, 2.0, flatten=flatten)
        ratios.append(power.max() / power[np.abs(grid - 2.0) > 0.66].max())
    assert np.all(np.diff(ratios) > 0)


@settings(deadline=None, derandomize=True, max_examples=15)
@given(
    seed=st.integers(0, 999),
    rate_hz=st.sampled_from([10.0, 30.5, 60.0]),
    column_rate_hz=st.sampled_from([5.0, 16.0, 60.0]),
    clutter_db=st.sampled_from([0, 60, 100, 140]),
    sizes=st.lists(st.sampled_from([1, 2, 7, 40]), min_size=1, max_size=6),
)
def test_definition_and_any_cut(seed, rate_hz, column_rate_hz, clutter_db, sizes):
    frames = under_clutter(noise(70, 24, seed=seed), clutter_db)
    kwargs = {"step_mps": 0.5, "max_mps": 3.0, "column_rate_hz": column_rate_hz}
    ours = fed(frames, SMALL, rate_hz, [*sizes, 70], **kwargs)
    wanted = direct(frames, ours, SMALL, rate_hz)
    assert ours.columns().shape == wanted.shape
    assert error(ours.columns(), wanted) < 1e-5
    assert error(ours.columns(), fed(frames, SMALL, rate_hz, **kwargs).columns()) < 1e-6


@pytest.mark.parametrize("clutter_db", [0, 40, 80, 100, 120, 140])
def test_clutter_does_not_hide_a_walker(clutter_db):
    walk = point(X2, 60.0, 60, velocity_mps=1.2, middle_m=2.0)
    frames = under_clutter(walk, clutter_db)
    ours = fed(frames, X2, 60.0)
    assert error(ours.columns(), direct(frames, ours, X2, 60.0)) < 1e-5
    grid = ours.velocity_mps
    assert grid[ours.columns().sum(axis=1).argmax()] == pytest.approx(1.2, abs=0.1)


def test_static_clutter_is_zero():
    frames = np.repeat(noise(1, 96, sigma=1e7), 60, axis=0)
    assert not fed(frames, X2, 60.0).columns().any()


@pytest.mark.parametrize("level", [1e-36, 1e-30, 1e-20, 1e-10, 1e10, 1e20, 1e30, 1e33])
def test_levels(level):
    frames = (noise(40, 24) * level).astype(np.complex64)
    ours = fed(frames, SMALL, 60.0, step_mps=0.5)
    assert error(ours.columns(), direct(frames, ours, SMALL, 60.0)) < 1e-5


@pytest.mark.parametrize("stride", [1, 2, 5])
def test_a_spike_leaves_with_its_cpis(stride):
    frames = noise(100, 24)
    spiked = frames.copy()
    spiked[50] *= np.float32(1e30)
    ours = fed(spiked, SMALL, 60.0, column_rate_hz=60 / stride, step_mps=0.5).columns()
    clean = fed(frames, SMALL, 60.0, column_rate_hz=60 / stride, step_mps=0.5).columns()
    first = np.arange(0, 73, stride)
    away = (first + 27 < 50) | (first > 50)
    assert error(ours[:, away], clean[:, away]) < 1e-6
    assert np.isfinite(ours).all()


@pytest.mark.parametrize("lost", range(0, 44, 3))
@pytest.mark.parametrize("sizes", [[45], [1] * 45])
def test_a_gap_at_every_place(lost, sizes):
    frames = noise(45, 24)
    valid = np.ones(45, np.bool_)
    valid[lost : lost + 2] = False
    holed = frames.copy()
    holed[~valid] = np.nan
    kwargs = {"step_mps": 1.0, "column_rate_hz": 30.0, "cpi_s": 0.2}
    ours = fed(holed, SMALL, 60.0, sizes, valid, **kwargs)
    good = ours.columns_valid()
    wanted = [valid[i : i + 12].all() for i in range(0, 45 - 11, 2)]
    assert np.array_equal(good, wanted)
    assert np.isfinite(ours.columns()).all()
    clean = fed(frames, SMALL, 60.0, **kwargs).columns()
    assert error(ours.columns()[:, good], clean[:, good]) < 1e-6


def test_sum_over_the_whole_band_is_the_power_of_the_bins():
    axis = replace(SMALL, bandwidth_hz=0.0)
    delay_s = 2 * axis.bin_length_m / LIGHT_MPS
    every = axis.carrier_hz + np.arange(24) / (24 * delay_s)
    frames = noise(5, 24)
    spectra = frames @ range_dft(axis, every, 1.5)
    assert np.allclose((np.abs(spectra) ** 2).sum(axis=1), (np.abs(frames) ** 2).sum(axis=1))


@pytest.mark.parametrize("step", [2, 4])
def test_decimated_bins_give_the_same_map(step):
    fine = replace(X2, n_range=384, bin_length_m=X2.bin_length_m / 4)
    frames = point(fine, 60.0, 40, velocity_mps=1.0, middle_m=2.0)
    coarse = replace(fine, n_range=384 // step, bin_length_m=fine.bin_length_m * step)
    ours = fed(frames[:, ::step], coarse, 60.0).columns() * step
    assert error(ours, fed(frames, fine, 60.0).columns()) < 1e-3


def test_frequencies():
    f = range_frequencies(replace(X2, n_range=768, bin_length_m=0.003656))
    assert len(f) == 49
    assert f[24] == 6.8e9
    assert f[-1] - 6.8e9 == pytest.approx(1.28e9, abs=0.03e9)
    assert len(range_frequencies(X4)) == 49
    assert len(range_frequencies(P4XX)) == 57
    few = range_frequencies(P4XX, 20)
    assert 10 <= len(few) <= 20
    assert len(range_frequencies(X2, 1)) == 1
    unknown = range_frequencies(replace(X2, bandwidth_hz=0.0))
    assert unknown[0] > 5.8e9
    for wrong in (replace(X2, carrier_hz=0.0), replace(X2, bin_length_m=0.0)):
        with pytest.raises(FeatureError, match="no frequencies"):
            range_frequencies(wrong)


@pytest.mark.parametrize("rate_hz", [1.0, 17.06, 60.0, 200.0, 1000.0])
def test_frame_rates(rate_hz):
    stream = VelocityTransform(SMALL, rate_hz, step_mps=1.0)
    assert stream.n_cpi == max(4, round(28 / 60 * rate_hz))
    assert stream.stride == max(1, round(rate_hz / 30))
    frames = noise(stream.n_cpi + stream.stride, 24)
    assert stream.push(frames) == 2
    assert error(stream.columns(), direct(frames, stream, SMALL, rate_hz)) < 1e-5


def test_the_grid_is_a_setting():
    stream = VelocityTransform(X2, 60.0, max_mps=4.0, step_mps=0.25)
    assert stream.velocity_mps[0] == -4
    assert stream.velocity_mps[16] == 0
    assert len(stream.velocity_mps) == 33
    frames = noise(30, 96)
    stream.push(frames)
    assert error(stream.columns(), direct(frames, stream, X2, 60.0)) < 1e-5


def test_restart():
    frames = noise(100, 24)
    stream = fed(frames[:50], SMALL, 60.0)
    stream.restart()
    assert stream.n_columns == 0
    assert stream.columns().shape == (101, 0)
    stream.push(frames[50:])
    assert error(stream.columns(), fed(frames[50:], SMALL, 60.0).columns()) < 1e-6


@pytest.mark.parametrize(
    "wrong",
    [
        {"frame_rate_hz": 0.0},
        {"step_mps": 0.0},
        {"step_mps": 6.0},
        {"max_mps": np.inf},
        {"cpi_s": -1.0},
        {"column_rate_hz": np.nan},
        {"n_keep": 0},
        {"n_frequencies": 0},
    ],
)
def test_settings_that_make_no_sense(wrong):
    with pytest.raises(FeatureError):
        VelocityTransform(**{"axis": X2, "frame_rate_hz": 60.0, **wrong})


def test_frames_that_do_not_fit():
    with pytest.raises(FeatureError, match="95 bins in a stream of 96"):
        VelocityTransform(X2, 60.0).push(np.zeros((3, 95)))
    assert VelocityTransform(X2, 60.0).push(noise(27, 96)) == 0


def test_the_millionth_frame_is_as_exact_as_the_thousandth():
    axis = replace(X2, n_range=8)
    frames = under_clutter(noise(50_000, 8), 80)
    kwargs = {"column_rate_hz": 0.06, "n_frequencies": 5, "step_mps": 1.0, "n_keep": 60}
    stream = VelocityTransform(axis, 60.0, **kwargs)
    found = {}
    for n_seen in range(50_000, 1_000_001, 50_000):
        stream.push(frames)
        if n_seen in {50_000, 1_000_000}:
            # Columns begin at whole multiples of 1000 frames, which 50 000 is as well.
            wanted = direct(frames[-2000:], stream, axis, 60.0)
            found[n_seen] = error(stream.columns(2), wanted)
    assert found[50_000] < 1e-5
    assert found[1_000_000] <= found[50_000]


@pytest.mark.parametrize("live", [0, 50, 95])
def test_one_live_bin(live):
    frames = np.zeros((60, 96), np.complex64)
    frames[:, live] = noise(60, 1)[:, 0]
    stream = fed(frames, X2, 60.0)
    assert error(stream.columns(), direct(frames, stream, X2, 60.0)) < 1e-5


@pytest.mark.parametrize("dtype", [">c8", "<c16", ">c16"])
@pytest.mark.parametrize("strided", [False, True])
def test_any_number_format(dtype, strided):
    frames = noise(50, 24)
    wanted = fed(frames, SMALL, 60.0).columns()
    same = frames.astype(dtype)
    if strided:
        same = np.repeat(same, 2, axis=1)[:, ::2]
    assert np.array_equal(fed(same, SMALL, 60.0).columns(), wanted)


@pytest.mark.parametrize("n_cpi", [4, 5, 27, 28, 93, 255, 256])
def test_cpi_of_any_length(n_cpi):
    frames = noise(n_cpi + 6, 24)
    stream = fed(frames, SMALL, 60.0, cpi_s=n_cpi / 60)
    assert stream.n_cpi == n_cpi
    assert error(stream.columns(), direct(frames, stream, SMALL, 60.0)) < 1e-5
