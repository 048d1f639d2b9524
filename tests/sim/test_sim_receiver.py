"""The simulated receiver with its effects, and the pulse that it receives."""

import math
from dataclasses import replace

import numpy as np
import pytest

from radard.dsp.doppler import doppler_hz
from radard.dsp.downconvert import DownConverter
from tests.dsp_reference import micro_doppler_direct
from tests.echo_references import baseband_echo, passband
from tests.sim_helpers import BASEBAND, RF, affected, axis_of, room_echo, silence
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.signal import pulse as sent
from x2radar.sim.signal import receiver as signal
from x2radar.sim.signal.pulse import LinkBudget, noise_sigma, pulse_sigma_s
from x2radar.sim.signal.receiver import MIDDLE, FrameDraws, Receiver, ReceiverEffects


def receiver(axis=RF, *, sigma=0.04, seed=0, **settings):
    rng = np.random.default_rng(seed)
    return Receiver(RadarSettings(**settings), axis, LinkBudget(noise_sigma=sigma), rng)


def test_noise_is_white_gaussian_and_has_its_sigma():
    frames = receiver().rf(silence(400)).astype(np.float64) - MIDDLE
    assert frames.std() == pytest.approx(0.04, rel=0.01)
    assert abs(frames.mean()) < 4 * 0.04 / math.sqrt(frames.size)
    z = frames / frames.std()
    assert (z**3).mean() == pytest.approx(0, abs=0.03)
    assert (z**4).mean() == pytest.approx(3, abs=0.05)
    for a, b in ((z[:, :-1], z[:, 1:]), (z[:-1], z[1:])):
        assert abs((a * b).mean()) < 0.01


@pytest.mark.parametrize(
    ("settings", "quantum"),
    [
        ({}, 100 / 8192 * 4 / 256),
        ({"iterations": 1}, 100 / 8192 * 4 / 16),
        ({"dac_step": 64, "iterations": 4, "pulses_per_step": 1}, 100 / 8192 * 64 / 4),
        ({"dac_step": 256, "iterations": 1, "pulses_per_step": 1}, 3.125),
    ],
)
def test_samples_are_whole_quanta(settings, quantum):
    unit = noise_sigma(RadarSettings(**settings), LinkBudget(noise_sigma=1.0))
    frames = receiver(sigma=quantum / unit, **settings).rf(silence(20)).astype(np.float64)
    steps = frames / quantum
    # float32 holds a sample of 50 to 4e-6.
    assert np.abs(steps - np.rint(steps)).max() * quantum < 4e-6
    assert np.unique(np.rint(steps)).size >= 5
    assert np.diff(np.unique(np.rint(steps))).min() == 1


@pytest.mark.parametrize(
    ("settings", "low", "high"),
    [
        ({}, 0.0, 100 * 8191 / 8192),
        ({"dac_min": 3500, "dac_max": 4700}, 100 * 3500 / 8192, 100 * 4700 / 8192),
    ],
)
def test_clipping_at_both_ends(settings, low, high):
    echo = np.zeros((3, 768), np.float32)
    echo[0, 10], echo[1, 20] = 60, -60
    # As much as the largest cross section of a scene gives at the nearest range.
    most = LinkBudget().amplitude(np.array([0.1]), np.array([1e9]), RF)[0]
    echo[2, 30], echo[2, 31] = most, -most
    frames = receiver(sigma=0.1, **settings).rf(echo)
    assert frames.max() == pytest.approx(high, abs=1e-5)
    assert frames.min() == pytest.approx(low, abs=1e-5)
    assert frames[0, 10] == frames[2, 30] == frames.max()
    assert frames[1, 20] == frames[2, 31] == frames.min()
    assert np.isfinite(frames).all()
    assert frames.dtype == np.float32


def colour(x, lag):
    """How alike bins are that are so many apart, complex."""
    return complex((x[:, lag:] * x[:, :-lag].conj()).mean() / (np.abs(x) ** 2).mean())


@pytest.mark.parametrize("generator", [0, 5, 11])
def test_baseband_noise_is_that_of_down_converted_rf(generator):
    """Power within 0.3 dB, colour within 2 %: measured over 300 frames of 768 bins."""
    s = RadarSettings(pulse_generator=generator)
    rf, baseband = axis_of("rf", s), axis_of("baseband", s)
    raw = Receiver(s, rf, LinkBudget(), np.random.default_rng(1)).rf(silence(300, rf))
    # Away from the ends, where the filter runs into the frame's edge.
    mixed = DownConverter(rf).convert(raw)[:, 60:-60]
    quiet = Receiver(s, baseband, LinkBudget(), np.random.default_rng(2))
    ours = quiet.baseband(silence(300, baseband))
    assert ours.dtype == np.complex64
    powers = [(np.abs(x.astype(np.complex128)) ** 2).mean() for x in (ours, mixed)]
    assert abs(10 * math.log10(powers[0] / powers[1])) < 0.3
    sigma = math.sqrt(math.log(10)) / math.pi / s.axis.bandwidth_hz * s.sample_rate_hz
    pulse = np.exp(-0.5 * (np.arange(-60, 61) / sigma) ** 2)
    assert powers[0] == pytest.approx(4 * 0.04**2 / (pulse**2).sum(), rel=0.05)
    for lag in (1, 4, 8, 12):
        # Mixing leaves each bin its own phase; the noise's colour is that of the envelope.
        wanted = math.exp(-0.25 * (lag / sigma) ** 2)
        assert [colour(x, lag) for x in (ours, mixed)] == pytest.approx([wanted] * 2, abs=0.03)


@pytest.mark.parametrize("rate_hz", [60, 100, 200, 400, 1000])
def test_less_integration_costs_signal_to_noise(rate_hz):
    s = RadarSettings.for_frame_rate(rate_hz)
    pulses = s.pulses_per_step * s.iterations
    wanted = 0.04 * math.sqrt(256 / pulses * s.dac_step / 4)
    assert noise_sigma(s, LinkBudget()) == pytest.approx(wanted)
    out = Receiver(s, RF, LinkBudget(), np.random.default_rng(0)).rf(silence(60))
    assert (out - MIDDLE).std() == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize("decimation", [1, 4, 8, 16, 24])
def test_matched_noise_has_the_colour_of_the_pulse_on_any_axis(decimation):
    fine = axis_of("baseband")
    axis = replace(
        fine, n_range=-(-768 // decimation), bin_length_m=decimation * 299_792_458 / 82e9
    )
    x = sent.matched_noise(1500, axis, np.random.default_rng(0)).astype(np.complex128)
    for lag in (1, 2, 5):
        away_s = 2 * lag * axis.bin_length_m / 299_792_458
        wanted = math.exp(-0.25 * (away_s / pulse_sigma_s(axis.bandwidth_hz)) ** 2)
        assert abs(colour(x, lag) - wanted) < 0.025
    assert abs(colour(x, axis.n_range - 1)) < 0.1


@pytest.mark.parametrize("delay_s", [0.2e-12, 2e-12])
@pytest.mark.parametrize("generator", [0, 5, 11])
def test_a_delayed_frame_is_that_of_a_target_further_away(delay_s, generator):
    s = RadarSettings(pulse_generator=generator)
    rf, baseband = axis_of("rf", s), axis_of("baseband", s)
    range_m = np.random.default_rng(0).uniform(1.0, 3.0, (30, 1))
    one = np.ones_like(range_m)
    late = np.linspace(-delay_s, delay_s, 30)
    further = range_m + 299_792_458 * late[:, None] / 2
    ours = signal.delayed_baseband(baseband_echo(range_m, one, baseband), late, baseband)
    wanted = baseband_echo(further, one, baseband)
    assert np.abs(ours - wanted).max() < 1e-4 * delay_s / 2e-12 + 5e-6
    ours = signal.delayed_rf(passband(range_m, one, rf), late, rf)
    assert np.abs(ours - passband(further, one, rf)).max() < 2e-3 * (delay_s / 2e-12) ** 2 + 1e-4


def residue_db(axis, **effects):
    """Power over the noise, in dB, after mean removal: over all bins, and at the strongest."""
    frames = affected(axis, echo=room_echo(axis), **effects)
    if axis.kind == "rf":
        frames = DownConverter(axis).convert(frames.real.astype(np.float32))
    power = (np.abs(frames - frames.mean(axis=0)) ** 2).mean(axis=0)
    over = power / sent.baseband_noise_power(axis, 0.04)
    return 10 * math.log10(over.mean()), 10 * math.log10(over.max())


@pytest.mark.parametrize("axis", [RF, BASEBAND], ids=["rf", "baseband"])
def test_residue_of_strong_clutter(axis):
    """0.2 ps and 0.1 % under 57 dB of clutter leave 7 dB, 17 dB at the strongest bin, as on
    real modules; without them nothing but noise is left."""
    clean, clean_bin = residue_db(axis)
    assert clean == pytest.approx(0, abs=0.1)
    assert clean_bin < 1.5
    mean, strongest = residue_db(axis, jitter_s=0.2e-12, gain_noise=0.001)
    assert mean == pytest.approx(7.5, abs=1)
    assert strongest == pytest.approx(17, abs=1)


@pytest.mark.parametrize("jitter_s", [0.13e-12, 0.23e-12])
def test_jitter_and_gain_noise_have_their_size(jitter_s):
    draws = FrameDraws(ReceiverEffects(jitter_s=jitter_s, gain_noise=0.0012), 5, 60)
    delay, gain = draws.delay_s(0, 20_000), draws.gain(0, 20_000)
    assert delay.std() == pytest.approx(jitter_s, rel=0.02)
    assert gain.std() == pytest.approx(0.0012, rel=0.02)
    assert gain.mean() == pytest.approx(1, abs=5e-5)
    for x in (delay / jitter_s, (gain - 1) / 0.0012):
        assert abs((x[1:] * x[:-1]).mean()) < 0.03
    assert abs(np.corrcoef(delay, gain)[0, 1]) < 0.03


def test_level_of_the_radar_equation_by_hand_and_the_pulse_of_the_thesis():
    # Pt 1 mW, G 2.512, lambda 44.087 mm, 10,000 m^2, R 2.5 m:
    # 1e-3 * 6.3096 * 1.94364e-3 * 1e4 / (1984.40 * 39.0625) = 1.58208e-6 W;
    # noise: 1.380649e-23 * 290 * 19.9526 * 41e9 = 3.27541e-9 W.
    level = LinkBudget().amplitude(np.array([2.5]), np.array([1e4]), RF)[0]
    assert level == pytest.approx(0.04 * math.sqrt(2 * 1.58208e-6 / 3.27541e-9), rel=1e-5)
    assert level == pytest.approx(1.2433, rel=1e-3)
    assert pulse_sigma_s(2.3e9) == pytest.approx(0.21e-9, abs=0.005e-9)


@pytest.mark.parametrize("speed_mps", [-0.5, -0.3, -0.15, 0.15, 0.3, 0.5])
def test_walking_in_is_positive_doppler(speed_mps):
    range_m = 2.0 + speed_mps * np.arange(48)[:, None] / 60
    frames = DownConverter(RF).convert(passband(range_m, np.ones_like(range_m), RF))
    hz, mu = doppler_hz(28, 60), micro_doppler_direct(frames, 28).mean(axis=1)
    wanted = -2 * speed_mps / (299_792_458 / 6.8e9)
    assert abs(hz[mu.argmax()] - wanted) <= 60 / 28  # a Doppler line
    right, wrong = np.sign(hz) == np.sign(wanted), np.sign(hz) == -np.sign(wanted)
    assert mu[right].sum() > 50 * mu[wrong].sum()


EVERYTHING = ReceiverEffects(
    jitter_s=0.2e-12,
    gain_noise=0.001,
    frame_jitter=0.03,
    burst_rate_hz=2,
    spike_share=0.2,
    lost_share=0.1,
)


def table(draws, first, n):
    row, column, counts = draws.spikes(first, n, 768)
    spiked = np.zeros((n, 768))
    spiked[row, column] = counts
    drawn = (draws.delay_s, draws.gain, draws.times_s, draws.noise_gain, draws.lost)
    return np.column_stack([*(each(first, n) for each in drawn), spiked])


def test_draws_belong_to_the_frame_number_and_what_is_off_is_exactly_off():
    whole = table(FrameDraws(EVERYTHING, 1, 60), 0, 700)
    again = FrameDraws(EVERYTHING, 1, 60)
    for first, n in ((690, 10), (0, 1), (255, 2), (256, 256), (100, 500), (699, 1), (3, 0)):
        assert np.array_equal(table(again, first, n), whole[first : first + n])
    assert not np.any(table(FrameDraws(EVERYTHING, 2, 60), 0, 700)[:, 0] == whole[:, 0])
    draws = FrameDraws(ReceiverEffects(), 0, 60)
    assert np.array_equal(draws.times_s(5, 3), np.array([5, 6, 7]) / 60)
    assert not draws.delay_s(0, 9).any()
    assert np.array_equal(draws.gain(0, 9), np.ones(9))
    assert np.array_equal(draws.noise_gain(0, 9), np.ones(9))
    assert not draws.lost(0, 9).any()
    assert all(x.size == 0 for x in draws.spikes(0, 9, 768))


@pytest.mark.parametrize("axis", [RF, BASEBAND], ids=["rf", "baseband"])
def test_all_effects_together_do_not_depend_on_blocks(axis):
    echo = room_echo(axis)[:300]
    kwargs = {k: getattr(EVERYTHING, k) for k in ("jitter_s", "burst_rate_hz", "spike_share")}
    whole = affected(axis, echo=echo, **kwargs)
    for sizes in ([1] * 300, [7, 0, 293], [256, 44]):
        assert np.array_equal(affected(axis, echo=echo, sizes=sizes, **kwargs), whole)


def test_frame_times_stay_in_order_and_within_five_percent():
    for jitter in (0.01, 0.05):
        t_s = FrameDraws(ReceiverEffects(frame_jitter=jitter), 0, 60).times_s(0, 20_000)
        late = t_s * 60 - np.arange(20_000)
        assert np.abs(late).max() <= 0.05 + 1e-9
        assert (np.diff(t_s) > 0.9 / 60 - 1e-12).all()
    assert late.std() > 0.03


def test_bursts_come_last_and_rise_as_asked():
    effects = ReceiverEffects(burst_rate_hz=0.5, burst_s=0.2)
    gain = FrameDraws(effects, 0, 60).noise_gain(0, 200_000)
    rise_db = 20 * np.log10(gain[gain > 1])
    assert rise_db.min() >= 3 - 1e-9
    assert rise_db.max() <= 20 + 1e-9
    # 0.5 bursts a second of 0.2 s (cut at 60 frames, rounded up by half a frame).
    assert (gain > 1).mean() == pytest.approx(1 - math.exp(-0.5 * 0.208), rel=0.08)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], gain > 1, [0]]).astype(int)))
    length = np.diff(ends)[::2]
    assert length.min() >= 1
    assert length.mean() == pytest.approx(0.21 * 60, rel=0.15)


def test_spikes_lie_above_the_converter_and_come_as_often_as_asked():
    frames = affected(n=2000, spike_share=0.05).real + MIDDLE
    counts = frames[frames > 100] / (100 / 8192)
    assert counts.min() >= 8192 - 1e-3
    assert counts.max() < 65536
    spiked = (frames > 100).sum(axis=1)
    assert (spiked > 0).mean() == pytest.approx(0.05, abs=0.015)
    assert set(spiked.tolist()) == {0, 1, 2, 3}


def test_a_baseband_spike_is_that_of_the_rf_frame():
    kwargs = {"spike_share": 0.3, "n": 40, "seed": 6}
    rf = DownConverter(RF).convert(affected(RF, **kwargs).real.astype(np.float32))
    baseband = affected(BASEBAND, **kwargs)
    rows = np.flatnonzero(np.abs(baseband).max(axis=1) > 1)
    assert rows.size > 5
    # The converter takes the frame's mean off, at most 3 spikes of 750 over 768 samples.
    assert np.abs(rf[rows] - baseband[rows])[:, 60:-60].max() < 0.02 * np.abs(baseband[rows]).max()
