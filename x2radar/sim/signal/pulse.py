"""The pulse, how strong an echo is, and how much noise a receiver has, with its colour.

The pulse is the thesis' Gaussian (2.3), ``p(t) = exp(-t^2 / (2 sp^2))`` on a carrier; its centre
defines the delay. Raw samples run from 0 to 100 over the 13-bit threshold sweep.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.points import Array

NEAREST_M = 0.1  # nearer points count as here: the near field has no radar equation
BOLTZMANN = 1.380_649e-23  # J/K, exact (SI 2019)
ROOM_K = 290.0  # standard noise temperature (IEEE)


def pulse_sigma_s(bandwidth_hz: float) -> float:
    """Return the sigma of a Gaussian pulse from its bandwidth at -10 dB, in seconds.

    The spectrum's amplitude is exp(-2 (pi f sp)^2); it is -10 dB at f = bandwidth / 2.
    """
    return float(np.sqrt(np.log(10) / 4) / (np.pi * bandwidth_hz / 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkBudget:
    """What decides the signal-to-noise ratio (the thesis' table B.5)."""

    tx_power_w: float = 1e-3  # peak of the pulse (0 dBm)
    antenna_gain: float = 10**0.4  # gain of either antenna, linear (4 dB)
    noise_figure: float = 10**1.3  # of the receiver, linear (13 dB), referred to its input
    # In the module's unit, 0 to 100 over the threshold sweep; measured on an X2 in open air at 128
    # integrations.
    noise_sigma: float = 0.04

    def amplitude(self, range_m: Array, rcs_m2: Array, axis: FastTimeAxis) -> Array:
        """Return RF peak amplitudes, (..., n_scatterers), in the module's unit (2.11, 2.13)."""
        wavelength_m = SPEED_OF_LIGHT_MPS / axis.carrier_hz
        r = np.maximum(range_m, NEAREST_M)
        sent = self.tx_power_w * self.antenna_gain**2 * wavelength_m**2
        received_w = sent * rcs_m2 / ((4 * np.pi) ** 3 * r**4)
        noise_w = BOLTZMANN * ROOM_K * self.noise_figure * axis.sample_rate_hz
        return np.asarray(self.noise_sigma * np.sqrt(2 * received_w / noise_w))


UNIT_PER_COUNT = 100.0 / 8192.0  # of a 13-bit count, as Radarlib normalises
# The settings for 60 Hz: the level of the link budget is taken to be theirs.
REFERENCE_PULSES = 256
REFERENCE_STEP = 4


def noise_sigma(
    settings: RadarSettings, budget: LinkBudget, noise_figure_db: float = 13.0
) -> float:
    """Return the standard deviation of a raw sample's noise, in the module's unit.

    A swept-threshold receiver counts at every threshold how many of M pulses lie above it; with
    noise of sigma s before the comparator and steps of d, the sum over the thresholds has the
    variance ``d s / (M sqrt(pi))`` (the integral of P (1 - P) over a Gaussian): less integration
    costs the signal-to-noise ratio that it saves in time. The settings for 60 Hz give the budget's
    own level.
    """
    pulses = settings.pulses_per_step * settings.iterations
    power = REFERENCE_PULSES / pulses * settings.dac_step / REFERENCE_STEP
    power *= 10 ** (noise_figure_db / 10) / budget.noise_figure
    return budget.noise_sigma * math.sqrt(power)


def baseband_noise_power(axis: FastTimeAxis, sigma: float) -> float:
    """Return the mean power of a baseband bin when raw samples have noise of `sigma`.

    White real noise of variance s^2, mixed down and filtered with the kernel 2 p / sum p^2,
    has variance 4 s^2 / sum p^2.
    """
    per_bin = pulse_sigma_s(axis.bandwidth_hz) * axis.sample_rate_hz * math.sqrt(math.pi)
    return 4 * sigma**2 / per_bin


def matched_noise(
    n_slow: int, axis: FastTimeAxis, rng: np.random.Generator, sigma: float = 1.0
) -> NDArray[np.complex64]:
    """Return noise as the mixer and the matched filter leave it, shape (n_slow, n_range).

    Circular Gaussian, frame after frame, of `baseband_noise_power` in every bin and with the
    pulse's own autocorrelation over range, for raw samples of standard deviation `sigma`. Only the
    frequencies that the filter passes are drawn (down to -80 dB). The axis is baseband.
    """
    width = 2 * np.pi * pulse_sigma_s(axis.bandwidth_hz) * bins_per_s(axis)
    # So long that the first and last bins of a circular frame do not know each other.
    n_fft = axis.n_range + 2 * math.ceil(5 * width / (2 * np.pi))
    while 30 ** n_fft.bit_length() % n_fft:
        n_fft += 1  # an FFT is quick without prime factors over 5
    reach = math.sqrt(2 * math.log(1e4)) / width
    if reach >= 0.5:
        n_fft |= 1  # every frequency has its negative, none is left out
    n_half = min(math.ceil(reach * n_fft), (n_fft - 1) // 2)
    cycles = np.fft.ifftshift(np.arange(-n_half, n_half + 1)) / n_fft
    # Where bins are far apart (decimated frames) the filter's skirts fold in.
    folds = np.arange(-3, 4)[:, None]
    passes = np.sqrt(np.exp(-((width * (cycles + folds)) ** 2)).sum(axis=0))
    power = baseband_noise_power(axis, sigma)
    passes *= n_fft * math.sqrt(power / 2 / np.sum(passes**2))
    white = rng.standard_normal((n_slow, cycles.size, 2), np.float32)
    drawn = white.view(np.complex64)[..., 0] * passes.astype(np.float32)
    spectrum = np.zeros((n_slow, n_fft), np.complex64)
    spectrum[:, : n_half + 1] = drawn[:, : n_half + 1]
    spectrum[:, n_fft - n_half :] = drawn[:, n_half + 1 :]
    noise = np.fft.ifft(spectrum, axis=1)
    return np.ascontiguousarray(noise[:, : axis.n_range], np.complex64)


def bins_per_s(axis: FastTimeAxis) -> float:
    """Return the range bins that an echo moves for a delay of one second."""
    return SPEED_OF_LIGHT_MPS / (2 * axis.bin_length_m)
