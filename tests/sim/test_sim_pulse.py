import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.dsp.doppler import doppler_hz
from radard.dsp.downconvert import DownConverter
from tests.dsp_reference import micro_doppler_direct
from tests.echo_references import passband
from tests.sim_helpers import axis_of
from x2radar.modules.x2 import PULSE_GENERATORS, RadarSettings
from x2radar.sim.signal.pulse import LinkBudget, pulse_sigma_s

C = 299_792_458.0
LAMBDA_M = C / 6.8e9


RF, BASEBAND = axis_of("rf"), axis_of("baseband")
PULSE_M = pulse_sigma_s(RF.bandwidth_hz) * C / 2


def one(range_m):
    """Ranges (n, 1) and unit amplitudes."""
    range_m = np.atleast_1d(np.asarray(range_m, np.float64))[:, None]
    return range_m, np.ones_like(range_m)


# ---------------------------------------------------------------- radar equation


def test_level_of_the_radar_equation_by_hand():
    # Pt 1 mW, G 2.512, lambda 44.087 mm, 10,000 m^2, R 2.5 m:
    # 1e-3 * 6.3096 * 1.94364e-3 * 1e4 / (1984.40 * 39.0625) = 1.58208e-6 W;
    # noise: 1.380649e-23 * 290 * 19.9526 * 41e9 = 3.27541e-9 W.
    level = LinkBudget().amplitude(np.array([2.5]), np.array([1e4]), RF)[0]
    assert level == pytest.approx(0.04 * math.sqrt(2 * 1.58208e-6 / 3.27541e-9), rel=1e-5)
    assert level == pytest.approx(1.2433, rel=1e-3)


@given(st.floats(0.11, 99), st.floats(1e-3, 1e6))
def test_forty_decibels_a_decade_and_root_of_the_cross_section(range_m, rcs_m2):
    b = LinkBudget()
    near = b.amplitude(np.array([range_m]), np.array([rcs_m2]), RF)[0]
    far = b.amplitude(np.array([10 * range_m]), np.array([rcs_m2]), RF)[0]
    big = b.amplitude(np.array([range_m]), np.array([4 * rcs_m2]), RF)[0]
    assert 20 * math.log10(near / far) == pytest.approx(40)
    assert big / near == pytest.approx(2)


# ---------------------------------------------------------------- the pulse


def test_sigma_is_the_thesis():
    assert pulse_sigma_s(2.3e9) == pytest.approx(0.21e-9, abs=0.005e-9)


@pytest.mark.parametrize("generator", range(len(PULSE_GENERATORS)))
def test_bandwidth_at_minus_ten_decibels(generator):
    s = RadarSettings(pulse_generator=generator, frame_stitch=1)
    rf = axis_of("rf", s)
    frame = passband(*one(rf.range_m[128]), rf)[0].astype(np.float64)
    n_fft = 1 << 16
    power = np.abs(np.fft.rfft(frame, n_fft)) ** 2
    hz = np.fft.rfftfreq(n_fft, 1 / s.sample_rate_hz)
    band = hz[power > power.max() / 10]
    assert band[-1] - band[0] == pytest.approx(s.bandwidth_hz, rel=0.01)
    assert (band[-1] + band[0]) / 2 == pytest.approx(s.carrier_hz, rel=0.01)


# ---------------------------------------------------------------- local against dense


# ---------------------------------------------------------------- phase


# ---------------------------------------------------------------- both kinds agree


# ---------------------------------------------------------------- motion becomes Doppler


def spectrum_of(speed_mps, rate_hz=60.0, n_cpi=28, start_m=2.0):
    """mu, averaged over one column a frame, of a point with constant radial velocity."""
    t_s = np.arange(n_cpi + 20) / rate_hz
    frames = DownConverter(RF).convert(passband(*one(start_m + speed_mps * t_s), RF))
    return doppler_hz(n_cpi, rate_hz), micro_doppler_direct(frames, n_cpi).mean(axis=1)


@pytest.mark.parametrize("speed_mps", [-0.5, -0.3, -0.15, 0.15, 0.3, 0.5])
def test_walking_in_is_positive_doppler(speed_mps):
    hz, mu = spectrum_of(speed_mps)
    wanted = -2 * speed_mps / LAMBDA_M
    assert abs(hz[mu.argmax()] - wanted) <= 60 / 28  # a Doppler line
    right, wrong = np.sign(hz) == np.sign(wanted), np.sign(hz) == -np.sign(wanted)
    assert mu[right].sum() > 50 * mu[wrong].sum()


@pytest.mark.parametrize("rate_hz", [60.0, 200.0])
@pytest.mark.parametrize("sign", [-1, 1])
def test_blind_speed_falls_on_zero_doppler(rate_hz, sign):
    blind = LAMBDA_M * rate_hz / 2
    hz, mu = spectrum_of(sign * blind, rate_hz, n_cpi=12, start_m=2.0 - sign * 0.2)
    line = rate_hz / 12
    assert abs(hz[mu.argmax()]) <= line
    assert mu[np.abs(hz) <= 2.5 * line].sum() > 0.99 * mu.sum()
    # At half of it nothing is nearer to zero than any other speed could be.
    hz, mu = spectrum_of(sign * blind / 2, rate_hz, n_cpi=12, start_m=2.0 - sign * 0.2)
    assert abs(abs(hz[mu.argmax()]) - rate_hz / 2) <= line
