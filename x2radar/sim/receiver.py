"""What the receiver adds: thermal noise and the swept-threshold converter.

Owns the module's unit. Raw samples run from 0 to 100 over the 13-bit threshold sweep, as
Radarlib normalises them; the idle line sits in the middle.
"""

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.settings import RadarSettings
from x2radar.sim.pulse import LinkBudget, pulse_sigma_s

MIDDLE = 50.0
_UNIT_PER_COUNT = 100.0 / 8192.0


class Receiver:
    """Turn echoes into what the module would send.

    Parameters
    ----------
    settings : RadarSettings
        Sweep and integration decide the quantum and the clipping.
    axis : FastTimeAxis
        Axis of the frames.
    budget : LinkBudget
        Holds the noise level.
    rng : numpy.random.Generator
        Source of the noise; consumed frame by frame, so blocks of any size give the same.
    """

    def __init__(
        self,
        settings: RadarSettings,
        axis: FastTimeAxis,
        budget: LinkBudget,
        rng: np.random.Generator,
    ) -> None:
        self._axis = axis
        self._sigma = np.float32(budget.noise_sigma)
        self._rng = rng
        pulses = settings.pulses_per_step * settings.iterations
        self._quantum = np.float32(_UNIT_PER_COUNT * settings.dac_step / pulses)
        self._low = np.float32(_UNIT_PER_COUNT * settings.dac_min)
        self._high = np.float32(_UNIT_PER_COUNT * settings.dac_max)
        self._baseband_filter = _baseband_noise_filter(axis) if axis.kind == "baseband" else None

    def rf(self, echo: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return raw frames, shape (n_slow, n_range), float32, from noise-free echoes."""
        noise = self._rng.standard_normal(echo.shape, np.float32)
        noise *= self._sigma
        noise += echo
        noise += np.float32(MIDDLE)
        noise /= self._quantum
        np.rint(noise, out=noise)
        noise *= self._quantum
        return np.clip(noise, self._low, self._high, out=noise)

    def baseband(self, echo: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return baseband frames, shape (n_slow, n_range), complex64, with filtered noise.

        Quantisation is left out: with the settings for 60 Hz it lies 57 dB under the noise,
        with those for 1000 Hz still 33 dB.
        """
        assert self._baseband_filter is not None  # noqa: S101 - set for this kind of axis
        n_fft = self._baseband_filter.size
        white = self._rng.standard_normal((len(echo), n_fft, 2), np.float32)
        spectrum = np.fft.fft(white.view(np.complex64)[..., 0], axis=1)
        noise = np.fft.ifft(spectrum * self._baseband_filter, axis=1)[:, : self._axis.n_range]
        return (echo + self._sigma * noise).astype(np.complex64)


def _baseband_noise_filter(axis: FastTimeAxis) -> NDArray[np.complex64]:
    """Return the matched filter's transfer function on a circular frame.

    White real noise of variance s^2, mixed down and filtered with the kernel 2 p / sum p^2,
    has variance 4 s^2 / sum p^2 and the colour of the pulse.
    """
    bin_s = 1.0 / axis.sample_rate_hz
    sigma = pulse_sigma_s(axis.bandwidth_hz) / bin_s
    half = int(np.ceil(5 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    n_fft = axis.n_range + 2 * half
    # Per real and imaginary part: variance 2 s^2 / sum p^2.
    scaled = kernel * np.sqrt(2.0) / np.sum(kernel**2)
    return np.fft.fft(scaled, n_fft).astype(np.complex64)
