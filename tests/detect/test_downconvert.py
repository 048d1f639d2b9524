from dataclasses import replace

import numpy as np
import pytest

from radard.dsp.downconvert import DownConverter
from radard.errors import FeatureError
from tests.radar_helpers import BASEBAND, noise
from tests.sim_helpers import RF, axis_with
from x2radar.frame import SPEED_OF_LIGHT_MPS


def test_baseband_passes_through_and_rising_phase_is_turned_round():
    frames = noise(4)
    assert np.array_equal(DownConverter(BASEBAND).convert(frames), frames)
    assert np.array_equal(DownConverter(BASEBAND, 4).convert(frames), frames[:, ::4])
    frames = noise(4)
    rising = DownConverter(replace(BASEBAND, phase_sign=1), 4)
    assert rising.axis.phase_sign == -1
    assert np.array_equal(rising.convert(frames), frames[:, ::4].conj())
    assert np.array_equal(rising.convert(frames.astype(">c16")), frames[:, ::4].conj())


def test_what_cannot_be_converted():
    for axis, step, words in (
        (RF, 0, "range_decimation"),
        (replace(RF, sample_rate_hz=10e9), 1, "sampling rate"),
        (replace(RF, bandwidth_hz=0), 1, "bandwidth"),
    ):
        with pytest.raises(FeatureError, match=words) as caught:
            DownConverter(axis, step)
        assert caught.value.exit_code == 4  # the stream does not fit
    for frame, words in (
        (np.zeros(767, np.float32), "767 bins"),
        (np.zeros(768, np.complex64), "RF frames are real"),
        (np.float32(3), "0 bins"),
    ):
        with pytest.raises(FeatureError, match=words):
            DownConverter(RF).convert(frame)


def definition(x, axis=RF, step=1):
    """Mixing, then correlating with the pulse, in float64."""
    x = np.asarray(x, np.float64)
    x = x - x.mean()
    sigma = np.sqrt(np.log(10)) / (np.pi * axis.bandwidth_hz) * axis.sample_rate_hz
    half = int(np.ceil(8 * sigma))
    pulse = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    start_s = 2 * axis.range_offset_m / SPEED_OF_LIGHT_MPS
    t = start_s + np.arange(axis.n_range) / axis.sample_rate_hz
    turns = (axis.carrier_hz * t) % 1.0
    mixed = np.pad(x * np.exp(-2j * np.pi * turns), half)
    wanted = np.array([pulse @ mixed[n : n + 2 * half + 1] for n in range(axis.n_range)])
    return wanted[::step] * 2 / np.sum(pulse**2)


P4XX = axis_with("rf", 480, 9.149e-3, 2.62, 4.0e9, 1.7e9, 1 / 61.035e-12)
X4_HZ = {"carrier_hz": 7.29e9, "bandwidth_hz": 1.4e9, "sample_rate_hz": 23.328e9}
X4 = axis_with("rf", 1536, SPEED_OF_LIGHT_MPS / 2 / 23.328e9, **X4_HZ)


@pytest.mark.parametrize("axis", [RF, P4XX, X4, replace(RF, n_range=60), replace(RF, n_range=1)])
@pytest.mark.parametrize("step", [1, 2, 3, 8, 57, 1000])
def test_any_radar_and_decimation_against_float64(axis, step):
    step = min(step, axis.n_range)
    x = np.random.default_rng(0).standard_normal((3, axis.n_range)) + 50
    x = x.astype(np.float32)
    for frame, out in zip(x, DownConverter(axis, step).convert(x), strict=True):
        wanted = definition(frame, axis, step)
        assert np.abs(out - wanted).max() <= 1e-6 * max(np.abs(wanted).max(), 1)


@pytest.mark.parametrize("idle", [0.0, 50.0, 4096.0, 1e5])
def test_the_idle_line_leaves_nothing(idle):
    counts = np.rint(np.random.default_rng(1).standard_normal(768) * 100)
    ours = DownConverter(RF).convert((counts + idle).astype(np.float32))
    wanted = definition(counts)
    assert np.abs(ours - wanted).max() < 1e-6 * np.abs(wanted).max()
    flat = DownConverter(RF).convert(np.full(768, idle, np.float32))
    assert np.abs(flat).max() < 1e-7 * max(idle, 1)


@pytest.mark.parametrize("level", [1e-41, 1e-37, 1e-30, 1e-15, 1.0, 1e15, 1e30, 1e34])
def test_levels(level):
    x = (np.random.default_rng(2).standard_normal(768) * level).astype(np.float32)
    # At the smallest step a hundred products are each rounded to 1.4e-45.
    most = max(1e-6 * np.abs(definition(x)).max(), 2e-43)
    assert np.abs(DownConverter(RF, 4).convert(x) - definition(x)[::4]).max() < most


@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", ">f8", "<f2", "<i2", ">i2", "<u2", "<i4"])
@pytest.mark.parametrize("strided", [False, True])
def test_any_number_format(dtype, strided):
    counts = np.random.default_rng(3).integers(0, 2000, (20, 768))
    frames = counts.astype(dtype)
    if strided:
        frames = frames.repeat(2, axis=0).repeat(3, axis=1)[::2, ::3]
    converter = DownConverter(RF, 8)
    assert np.array_equal(converter.convert(frames), converter.convert(counts.astype(np.float32)))


def test_shapes_of_input_and_output():
    x = np.random.default_rng(4).standard_normal((2, 3, 5, 768)).astype(np.float32)
    converter = DownConverter(RF, 8)
    wanted = np.stack([converter.convert(f) for f in x.reshape(-1, 768)])
    assert np.abs(converter.convert(x) - wanted.reshape(2, 3, 5, 96)).max() < 1e-6
    # A ring's rows, written apart from each other.
    ring = np.zeros((60, 97), np.complex64)
    converter.convert(x.reshape(30, 768), ring[::2, :96])
    assert np.abs(ring[::2, :96] - wanted).max() < 1e-6
    assert not ring[1::2].any()
    assert converter.convert(np.zeros((0, 768), np.float32)).shape == (0, 96)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_frame_that_is_not_finite_leaves_no_trace(bad):
    x = np.random.default_rng(5).standard_normal((20, 768)).astype(np.float32)
    hurt = x.copy()
    hurt[7, 300] = bad
    converter = DownConverter(RF, 8)
    with np.errstate(invalid="ignore"):
        ours = converter.convert(hurt)
    assert not np.isfinite(ours[7]).all()
    others = np.arange(20) != 7
    assert np.abs(ours[others] - converter.convert(x)[others]).max() < 1e-6
    assert np.array_equal(converter.convert(x[3]), DownConverter(RF, 8).convert(x[3]))
