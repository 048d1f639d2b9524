import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.dsp.doppler import doppler_hz
from radard.dsp.downconvert import DownConverter
from tests.dsp_reference import micro_doppler_direct
from tests.echo_references import baseband_echo
from tests.sim_helpers import axis_of
from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import PULSE_GENERATORS, RadarSettings
from x2radar.sim.signal.pulse import LinkBudget, pulse_sigma_s, rf_echo

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


def test_nothing_is_nearer_than_the_clamp():
    b, rcs = LinkBudget(), np.array([100.0])
    at_clamp = b.amplitude(np.array([0.1]), rcs, RF)
    for r in (0.0, 1e-300, 0.05, 0.1):
        assert np.array_equal(b.amplitude(np.array([r]), rcs, RF), at_clamp)
    assert np.isfinite(at_clamp).all()
    assert b.amplitude(np.array([0.11]), rcs, RF) < at_clamp
    assert b.amplitude(np.array([1.0]), np.array([0.0]), RF) == 0


# ---------------------------------------------------------------- the pulse


def test_sigma_is_the_thesis():
    assert pulse_sigma_s(2.3e9) == pytest.approx(0.21e-9, abs=0.005e-9)


@pytest.mark.parametrize("generator", range(len(PULSE_GENERATORS)))
def test_bandwidth_at_minus_ten_decibels(generator):
    s = RadarSettings(pulse_generator=generator, frame_stitch=1)
    rf = axis_of("rf", s)
    frame = rf_echo(*one(rf.range_m[128]), rf)[0].astype(np.float64)
    n_fft = 1 << 16
    power = np.abs(np.fft.rfft(frame, n_fft)) ** 2
    hz = np.fft.rfftfreq(n_fft, 1 / s.sample_rate_hz)
    band = hz[power > power.max() / 10]
    assert band[-1] - band[0] == pytest.approx(s.bandwidth_hz, rel=0.01)
    assert (band[-1] + band[0]) / 2 == pytest.approx(s.carrier_hz, rel=0.01)


@given(st.floats(0.7, 3.3))
def test_echo_lies_where_the_range_axis_says(range_m):
    for kind, axis, make in (("rf", RF, rf_echo), ("bb", BASEBAND, baseband_echo)):
        frame = make(*one(range_m), axis)[0]
        if kind == "rf":
            # The carrier's phase at the samples moves the largest one about; the energy stays.
            power = frame.astype(np.float64) ** 2
            at = (power * axis.range_m).sum() / power.sum()
        else:
            at = axis.range_m[np.abs(frame).argmax()]
        assert abs(at - range_m) <= axis.bin_length_m * 0.5001
        assert np.abs(frame).max() <= 1 + 1e-6


# ---------------------------------------------------------------- local against dense


def test_a_far_echo_does_not_disturb_a_near_one():
    near = one(1.5)
    both = np.array([[1.5, 1e6]])
    assert np.array_equal(rf_echo(both, np.ones((1, 2)), RF), rf_echo(*near, RF))


# ---------------------------------------------------------------- phase


@pytest.mark.parametrize("away_m", [0.0, 29.0, 1e3, 1e5])
def test_phase_stays_exact_at_long_ranges(away_m):
    """Against exact whole-number arithmetic: below 1e-5 of a turn at 100 km."""
    s = RadarSettings()
    offset = s.range_offset_m + away_m
    axes = {
        kind: FastTimeAxis(
            kind=kind,
            n_range=768,
            bin_length_m=s.bin_length_m,
            range_offset_m=offset,
            carrier_hz=s.carrier_hz,
            bandwidth_hz=s.bandwidth_hz,
            sample_rate_hz=s.sample_rate_hz,
        )
        for kind in ("rf", "baseband")
    }
    range_m = offset + np.linspace(0.5, 2.3, 50)
    phasor = np.array([_exact_phasor(r) for r in range_m.tolist()])
    frames = baseband_echo(*one(range_m), axes["baseband"])
    peak = frames[np.arange(50), np.abs(frames).argmax(axis=1)]
    assert np.abs(np.angle(peak / phasor)).max() / (2 * np.pi) < 1e-7 * max(1, away_m / 1e3)
    # RF: the position on the axis is a float64, so is the carrier's phase in it.
    t = (2 / C) * ((offset - range_m)[:, None] + s.bin_length_m * np.arange(768))
    wanted = np.exp(-0.5 * (t / pulse_sigma_s(s.bandwidth_hz)) ** 2)
    wanted *= np.cos(2 * np.pi * s.carrier_hz * t)
    error = np.abs(rf_echo(*one(range_m), axes["rf"]) - wanted).max()
    assert error < 5e-6 * max(1, away_m / 1e3)


def _exact_phasor(range_m):
    top, bottom = range_m.as_integer_ratio()
    turns = (2 * top * 6_800_000_000) % (bottom * 299_792_458)
    return np.exp(-2j * np.pi * (turns / (bottom * 299_792_458)))


# ---------------------------------------------------------------- both kinds agree


@pytest.mark.parametrize("generator", [0, 3, 5, 8, 11])
@pytest.mark.parametrize("delay_s", [0.0, 4e-9, 150e-9])
def test_down_converted_rf_equals_baseband(generator, delay_s):
    """Echoes that lie in the swath as a whole; measured: 3e-6 of the peak."""
    s = RadarSettings(pulse_generator=generator, sample_delay_s=delay_s)
    rf, baseband = axis_of("rf", s), axis_of("baseband", s)
    guard = 8 * pulse_sigma_s(s.bandwidth_hz) * C / 2
    rng = np.random.default_rng(0)
    r, a = one(rng.uniform(rf.range_m[0] + guard, rf.range_m[-1] - guard, 60))
    ours = DownConverter(rf).convert(rf_echo(r, a, rf))
    wanted = baseband_echo(r, a, baseband)
    assert np.abs(ours - wanted).max() < 1e-5
    peak = np.abs(wanted).argmax(axis=1)
    ratio = ours[np.arange(60), peak] / wanted[np.arange(60), peak]
    assert np.abs(np.abs(ratio) - 1).max() < 1e-6
    assert np.abs(np.angle(ratio)).max() < 1e-6


def test_at_the_ends_of_the_swath_the_kinds_differ_by_what_is_cut_off():
    """RF frames are cut before the filter; away from the ends both agree again."""
    ends = [RF.range_m[0] - PULSE_M, RF.range_m[0], RF.range_m[-1], RF.range_m[-1] + PULSE_M]
    r, a = one(ends)
    ours = DownConverter(RF).convert(rf_echo(r, a, RF))
    wanted = baseband_echo(r, a, BASEBAND)
    guard = math.ceil(8 * PULSE_M / RF.bin_length_m)
    assert np.abs(ours - wanted)[:, guard:-guard].max() < 1e-4
    assert (np.abs(ours) < np.abs(wanted).max() + 1e-3).all()


# ---------------------------------------------------------------- motion becomes Doppler


def spectrum_of(speed_mps, rate_hz=60.0, n_cpi=28, start_m=2.0):
    """mu, averaged over one column a frame, of a point with constant radial velocity."""
    t_s = np.arange(n_cpi + 20) / rate_hz
    frames = DownConverter(RF).convert(rf_echo(*one(start_m + speed_mps * t_s), RF))
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
