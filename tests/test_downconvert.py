from dataclasses import replace

import numpy as np
import pytest

from radard.dsp.downconvert import DownConverter
from radard.errors import FeatureError
from tests.radar_helpers import BASEBAND, noise
from x2radar.frame import FastTimeAxis
from x2radar.settings import SPEED_OF_LIGHT_MPS, RadarSettings

S = RadarSettings()
RF = FastTimeAxis(
    kind="rf",
    n_range=S.n_range,
    bin_length_m=S.bin_length_m,
    range_offset_m=S.range_offset_m,
    carrier_hz=S.carrier_hz,
    bandwidth_hz=S.bandwidth_hz,
    sample_rate_hz=S.sample_rate_hz,
)
SIGMA_S = np.sqrt(np.log(10)) / (np.pi * S.bandwidth_hz)


def echo(range_m, amplitude=1.0):
    """One RF frame with one point echo, float64."""
    delay_s = 2 * range_m / SPEED_OF_LIGHT_MPS
    t = S.sample_delay_s + np.arange(S.n_range) / S.sample_rate_hz - delay_s
    return amplitude * np.exp(-0.5 * (t / SIGMA_S) ** 2) * np.cos(2 * np.pi * S.carrier_hz * t)


@pytest.mark.parametrize("range_m", [0.9, 1.7, 2.5, 3.2])
@pytest.mark.parametrize("amplitude", [1e-6, 1.0, 1e4])
def test_a_point_keeps_amplitude_range_and_phase(range_m, amplitude):
    out = DownConverter(RF).convert((50 + echo(range_m, amplitude)).astype(np.float32))
    if amplitude < 1e-3:
        return  # drowned by the float32 step of the idle line; only finite is asked for
    k = int(np.abs(out).argmax())
    assert RF.range_m[k] == pytest.approx(range_m, abs=S.bin_length_m)
    assert np.abs(out[k]) == pytest.approx(amplitude, rel=2e-3)
    wanted = np.exp(-4j * np.pi * range_m * S.carrier_hz / SPEED_OF_LIGHT_MPS)
    assert np.angle(out[k] / wanted) == pytest.approx(0, abs=2e-3)


def test_pulse_is_widened_by_root_two():
    out = np.abs(DownConverter(RF).convert(echo(2.0).astype(np.float32)))
    bin_s = 1 / S.sample_rate_hz
    t = (np.arange(S.n_range) - out.argmax()) * bin_s
    width = np.sqrt((out**2 * t**2).sum() / (out**2).sum())
    assert width == pytest.approx(SIGMA_S, rel=0.02)  # of |z|^2: sqrt(2) sigma / sqrt(2)


def test_against_float64_by_definition():
    rng = np.random.default_rng(0)
    x = rng.standard_normal(S.n_range)
    ours = DownConverter(RF).convert(x.astype(np.float32))
    x = x - x.mean()
    half = 60
    k = np.arange(-half, half + 1)
    pulse = np.exp(-0.5 * (k / (SIGMA_S * S.sample_rate_hz)) ** 2)
    t = S.sample_delay_s + np.arange(S.n_range) / S.sample_rate_hz
    mixed = np.pad(x * np.exp(-2j * np.pi * S.carrier_hz * t), half)
    wanted = np.array([np.sum(pulse * mixed[n : n + 2 * half + 1]) for n in range(S.n_range)])
    wanted *= 2 / np.sum(pulse**2)
    assert np.abs(ours - wanted).max() / np.abs(wanted).max() < 3e-6


@pytest.mark.parametrize("step", [2, 8, 16])
def test_decimation_picks_every_so_manieth_bin(step):
    frames = np.random.default_rng(1).standard_normal((3, S.n_range)).astype(np.float32)
    full, less = DownConverter(RF), DownConverter(RF, step)
    assert np.allclose(less.convert(frames), full.convert(frames)[:, ::step])
    assert less.axis.n_range == 768 // step
    assert np.allclose(less.axis.range_m, full.axis.range_m[::step])


def test_out_is_filled_and_input_left_alone():
    frame = np.ones(S.n_range, np.float32)
    frame.flags.writeable = False
    converter = DownConverter(RF)
    out = np.empty(S.n_range, np.complex64)
    assert converter.convert(frame, out) is out


def test_baseband_passes_through():
    frames = noise(4)
    assert np.array_equal(DownConverter(BASEBAND).convert(frames), frames)
    assert np.array_equal(DownConverter(BASEBAND, 4).convert(frames), frames[:, ::4])


def test_what_cannot_be_converted():
    with pytest.raises(FeatureError, match="range_decimation"):
        DownConverter(RF, 0)
    with pytest.raises(FeatureError, match="sampling rate"):
        DownConverter(replace(RF, sample_rate_hz=10e9))
    with pytest.raises(FeatureError, match="bandwidth"):
        DownConverter(replace(RF, bandwidth_hz=0))
    with pytest.raises(FeatureError, match="767 bins"):
        DownConverter(RF).convert(np.zeros(767, np.float32))
