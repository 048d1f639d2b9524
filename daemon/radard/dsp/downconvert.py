"""RF frames to complex baseband: mixing, matched filter and range decimation in one step.

The steps (2.18, 2.19) are linear, so they are one transfer function: correlating with the
pulse on its carrier and then turning the phase is the same as mixing first and correlating
with the envelope. One real FFT, one product, one inverse FFT per frame.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from radard.errors import FeatureError
from x2radar.frame import FastTimeAxis

_REACH_SIGMA = 5.0


class DownConverter:
    """Turn frames of one stream into matched-filtered complex baseband.

    Baseband frames pass through, decimated only.

    Parameters
    ----------
    axis : FastTimeAxis
        Axis of the frames that will come.
    range_decimation : int
        Keep every so many range bins; the matched filter comes first, so no noise folds in.

    Raises
    ------
    FeatureError
        If the axis cannot be down-converted (no sampling rate, carrier above Nyquist), or
        the decimation leaves nothing.

    Notes
    -----
    The output's phase is exp(-j 4 pi R / lambda): it falls with range, so an approaching
    target has positive Doppler. A point echo of RF amplitude a comes out with magnitude a.
    The frame's mean is taken off first: the sampler's idle line would ring at both ends.
    """

    def __init__(self, axis: FastTimeAxis, range_decimation: int = 1) -> None:
        if not 1 <= range_decimation <= axis.n_range:
            msg = f"range_decimation {range_decimation} is not in 1 to {axis.n_range}"
            raise FeatureError(msg)
        self._step = range_decimation
        self._n_range = axis.n_range
        self._rf = axis.kind == "rf"
        self.axis = replace(
            axis,
            kind="baseband",
            n_range=-(-axis.n_range // range_decimation),
            bin_length_m=axis.bin_length_m * range_decimation,
        )
        if self._rf:
            self._design(axis)

    def _design(self, axis: FastTimeAxis) -> None:
        if not 0 < axis.carrier_hz < axis.sample_rate_hz / 2 or axis.bandwidth_hz <= 0:
            msg = (
                f"RF frames need a sampling rate above twice the carrier and a bandwidth; got "
                f"{axis.sample_rate_hz:g}, {axis.carrier_hz:g} and {axis.bandwidth_hz:g} Hz"
            )
            raise FeatureError(msg)
        # Gaussian whose spectrum is -10 dB at half the bandwidth (digest of the seed, 8.1).
        sigma = np.sqrt(np.log(10)) / (np.pi * axis.bandwidth_hz) * axis.sample_rate_hz
        half = int(np.ceil(_REACH_SIGMA * sigma))
        k = np.arange(-half, half + 1)
        pulse = np.exp(-0.5 * (k / sigma) ** 2)
        turns = (axis.carrier_hz / axis.sample_rate_hz * k) % 1.0
        kernel = pulse * np.exp(-2j * np.pi * turns) * (2 / np.sum(pulse**2))
        self._n_fft = 1 << int(np.ceil(np.log2(axis.n_range + 2 * half)))
        circular = np.zeros(self._n_fft, np.complex128)
        circular[(-k) % self._n_fft] = kernel
        # A real frame's negative frequencies lie 2 fc outside the pulse's band: zero.
        response = np.fft.fft(circular)
        response[self._n_fft // 2 + 1 :] = 0
        self._response = response[: self._n_fft // 2 + 1].astype(np.complex64)
        delay_s = 2 * axis.range_offset_m / 299_792_458.0
        n = np.arange(axis.n_range)
        turns = (axis.carrier_hz * (delay_s + n / axis.sample_rate_hz)) % 1.0
        self._phasor = np.exp(-2j * np.pi * turns)[:: self._step].astype(np.complex64)

    def convert(
        self,
        samples: NDArray[np.float32] | NDArray[np.complex64],
        out: NDArray[np.complex64] | None = None,
    ) -> NDArray[np.complex64]:
        """Return the baseband of one frame or of many.

        Parameters
        ----------
        samples : ndarray, shape (..., n_range)
            Frames as they come from the driver.
        out : ndarray, shape (..., n_out), complex64, optional
            Where to put the result.

        Returns
        -------
        ndarray, shape (..., n_out), complex64
            Baseband in the unit of the samples; error below 1e-6 of the strongest echo.

        Raises
        ------
        FeatureError
            If the frames do not have the length that the axis promised.
        """
        if samples.shape[-1] != self._n_range:
            msg = f"a frame of {samples.shape[-1]} bins in a stream of {self._n_range}"
            raise FeatureError(msg)
        if out is None:
            out = np.empty((*samples.shape[:-1], self.axis.n_range), np.complex64)
        if not self._rf:
            out[...] = samples[..., :: self._step]
            return out
        real = np.asarray(samples, np.float32)
        real = real - real.mean(axis=-1, keepdims=True)
        spectrum = np.fft.rfft(real, self._n_fft)
        spectrum *= self._response
        full = np.zeros((*spectrum.shape[:-1], self._n_fft), np.complex64)
        full[..., : spectrum.shape[-1]] = spectrum
        baseband = np.fft.ifft(full)
        np.multiply(baseband[..., : self._n_range : self._step], self._phasor, out=out)
        return out
