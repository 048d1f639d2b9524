import math

import numpy as np
import pytest

from radard.dsp.downconvert import DownConverter
from tests.sim_helpers import axis_of
from x2radar.settings import RadarSettings
from x2radar.sim.pulse import LinkBudget
from x2radar.sim.receiver import MIDDLE, Receiver

RF, BASEBAND = axis_of("rf"), axis_of("baseband")


def receiver(axis=RF, *, sigma=0.04, seed=0, **settings):
    rng = np.random.default_rng(seed)
    return Receiver(RadarSettings(**settings), axis, LinkBudget(noise_sigma=sigma), rng)


def silence(n, axis=RF):
    return np.zeros((n, axis.n_range), np.float32 if axis.kind == "rf" else np.complex64)


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
    frames = receiver(sigma=quantum, **settings).rf(silence(20)).astype(np.float64)
    steps = frames / quantum
    # float32 holds a sample of 50 to 4e-6.
    assert np.abs(steps - np.rint(steps)).max() * quantum < 4e-6
    assert np.unique(np.rint(steps)).size >= 5
    assert np.diff(np.unique(np.rint(steps))).min() == 1


def test_quantisation_rounds_to_the_nearest():
    echo = np.linspace(-1, 1, 768, dtype=np.float32)[None]
    quantum = 100 / 8192 * 4 / 16
    out = receiver(sigma=0.0, iterations=1).rf(echo)[0].astype(np.float64)
    assert np.abs(out - MIDDLE - echo[0]).max() <= quantum / 2 + 4e-6


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


@pytest.mark.parametrize("kind", ["rf", "baseband"])
def test_blocks_of_any_size_give_the_same_stream(kind):
    axis = RF if kind == "rf" else BASEBAND
    rng = np.random.default_rng(5)
    echo = rng.standard_normal((40, 768)).astype(np.float32)
    if kind == "baseband":
        echo = (echo * (1 + 0.5j)).astype(np.complex64)
    streams = []
    for sizes in ([40], [1] * 40, [16, 16, 8], [3, 0, 7, 30]):
        ours, at, parts = receiver(axis), 0, []
        for n in sizes:
            parts.append(getattr(ours, kind)(echo[at : at + n]))
            at += n
        streams.append(np.concatenate(parts))
    for other in streams[1:]:
        assert np.array_equal(streams[0], other)


def test_seed_decides_the_noise():
    a, b, c = (receiver(seed=k).rf(silence(2)) for k in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_echo_is_left_alone():
    echo = silence(2)
    echo.flags.writeable = False
    receiver().rf(echo)
    assert not echo.any()


@pytest.mark.parametrize("generator", [0, 5, 11])
def test_baseband_noise_is_that_of_down_converted_rf(generator):
    """Power within 0.3 dB, colour within 2 %: measured over 300 frames of 768 bins."""
    s = RadarSettings(pulse_generator=generator)
    rf, baseband = axis_of("rf", s), axis_of("baseband", s)
    raw = Receiver(s, rf, LinkBudget(), np.random.default_rng(1)).rf(silence(300, rf))
    # Away from the ends, where the filter runs into the frame's edge.
    mixed = DownConverter(rf).convert(raw)[:, 60:-60]
    ours = Receiver(s, baseband, LinkBudget(), np.random.default_rng(2)).baseband(
        silence(300, baseband)
    )
    assert ours.dtype == np.complex64
    powers = [(np.abs(x.astype(np.complex128)) ** 2).mean() for x in (ours, mixed)]
    assert abs(10 * math.log10(powers[0] / powers[1])) < 0.3
    k = np.arange(-60, 61)
    pulse = np.exp(
        -0.5 * (k / s.sample_rate_hz / (math.sqrt(math.log(10)) / math.pi) * s.bandwidth_hz) ** 2
    )
    assert powers[0] == pytest.approx(4 * 0.04**2 / (pulse**2).sum(), rel=0.05)
    for lag in (1, 4, 8, 12):
        colours = []
        for x in (ours, mixed):
            # Mixing leaves each bin its own phase; the noise's colour is that of the envelope.
            product = (x[:, lag:] * x[:, :-lag].conj()).mean() / (np.abs(x) ** 2).mean()
            colours.append(complex(product))
        wanted = math.exp(
            -0.25
            * (lag / s.sample_rate_hz * s.bandwidth_hz * math.pi / math.sqrt(math.log(10))) ** 2
        )
        assert abs(colours[0]) == pytest.approx(wanted, abs=0.02)
        assert abs(colours[0] - colours[1]) < 0.03


def test_baseband_noise_is_the_same_at_every_bin_and_has_no_preferred_phase():
    frames = receiver(BASEBAND).baseband(silence(600, BASEBAND)).astype(np.complex128)
    power = (np.abs(frames) ** 2).mean(axis=0)
    blocks = power.reshape(12, 64).mean(axis=1)
    assert np.abs(10 * np.log10(blocks / power.mean())).max() < 0.5
    assert abs((frames**2).mean()) < 0.05 * power.mean()
    assert abs(frames.mean()) < 0.05 * math.sqrt(power.mean())


def test_baseband_echo_is_added_to_the_noise():
    echo = silence(3, BASEBAND)
    echo[:, 100] = 5 - 2j
    difference = receiver(BASEBAND).baseband(echo) - receiver(BASEBAND).baseband(
        silence(3, BASEBAND)
    )
    assert np.abs(difference - echo).max() < 1e-6
