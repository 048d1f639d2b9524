"""RF frames to complex baseband: mixing, matched filter and range decimation in one step.

All (2.18, 2.19) are linear: correlating with the pulse on its carrier, then turning the phase. The
pulse is short, so rows of neighbouring bins are the same, shifted: one dense block serves the
whole frame as a matrix product.
"""

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from radard.errors import FeatureError
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

_REACH_SIGMA = 6.0  # the pulse has decayed to 1.5e-8 there
_FRAMES_AT_ONCE = 16  # their windows stay in the cache


class DownConverter:
    """Turn frames of one stream into matched-filtered complex baseband, on the axis `axis`.

    Baseband frames pass through, decimated only, and conjugated where their phase rises with
    range. Every `range_decimation`-th bin is kept, behind the matched filter, so no noise folds
    in. The output's phase is exp(-j 4 pi R / lambda), so an approaching target has positive
    Doppler; a point echo of RF amplitude a comes out with magnitude a. The frame's mean is taken
    off first: the sampler's idle line would ring at both ends. One converter serves one thread at
    a time. Raises FeatureError if the axis cannot be down-converted (no sampling rate, carrier
    above Nyquist), or the decimation leaves nothing.
    """

    def __init__(self, axis: FastTimeAxis, range_decimation: int = 1) -> None:
        if not 1 <= range_decimation <= axis.n_range:
            msg = f"range_decimation {range_decimation} is not in 1 to {axis.n_range}"
            raise FeatureError(msg)
        self._step = range_decimation
        self._n_range = axis.n_range
        self._rf = axis.kind == "rf"
        self._conjugate = not self._rf and axis.phase_sign > 0
        self.axis = replace(
            axis,
            kind="baseband",
            n_range=-(-axis.n_range // range_decimation),
            bin_length_m=axis.bin_length_m * range_decimation,
            phase_sign=-1,
        )
        if self._rf:
            self._design(axis)

    def _design(self, axis: FastTimeAxis) -> None:
        if not 0 < axis.carrier_hz < axis.sample_rate_hz / 2 or axis.bandwidth_hz <= 0:
            raise FeatureError(
                f"RF frames need a sampling rate above twice the carrier and a bandwidth; got "
                f"{axis.sample_rate_hz:g}, {axis.carrier_hz:g} and {axis.bandwidth_hz:g} Hz"
            )
        kernel = _kernel(axis)
        half = len(kernel) // 2
        # So many bins share a block that its columns overlap by about a half: more would
        # multiply zeros, fewer would copy the frame more often.
        n_bins = -(-2 * half // self._step)
        n_in = (n_bins - 1) * self._step + len(kernel)
        block = np.zeros((n_in, n_bins), np.complex128)
        for j in range(n_bins):
            block[j * self._step : j * self._step + len(kernel), j] = kernel
        self._block = block.view(np.float64).reshape(n_in, 2 * n_bins).astype(np.float32)
        n_out = self.axis.n_range
        n_blocks = -(-n_out // n_bins)
        width = max((n_blocks - 1) * n_bins * self._step + n_in, half + self._n_range)
        padded = np.zeros((_FRAMES_AT_ONCE, width), np.float32)
        self._frames = padded[:, half : half + self._n_range]
        windows = sliding_window_view(padded, n_in, axis=1)
        self._windows = windows[:, :: n_bins * self._step][:, :n_blocks]
        delay_s = 2 * axis.range_offset_m / SPEED_OF_LIGHT_MPS
        n = np.arange(n_out) * self._step
        turns = (axis.carrier_hz * (delay_s + n / axis.sample_rate_hz)) % 1.0
        self._phasor = np.exp(-2j * np.pi * turns).astype(np.complex64)

    def convert(
        self, samples: ArrayLike, out: NDArray[np.complex64] | None = None
    ) -> NDArray[np.complex64]:
        """Return the baseband of one frame or of many, in `out`, rows of bins, where it is given.

        `samples` are frames as they come from the driver, shape (..., n_range): real (rf) or
        complex (baseband), of any width, byte order or strides. The result, shape (..., n_out),
        complex64, is in their unit: error against the definition in float64 below 1e-6 of the
        strongest echo, and not below 1e-45, the smallest float32. Raises FeatureError if frames do
        not have the axis' length, or are complex where RF is due.
        """
        frames = np.asarray(samples)
        if frames.shape[-1:] != (self._n_range,):
            n = frames.shape[-1] if frames.ndim else 0
            raise FeatureError(f"a frame of {n} bins in a stream of {self._n_range}")
        if out is None:
            out = np.empty((*frames.shape[:-1], self.axis.n_range), np.complex64)
        if self._rf:
            if frames.dtype.kind not in "iuf":
                raise FeatureError(f"RF frames are real numbers, not {frames.dtype}")
            self._convert(frames.reshape(-1, self._n_range), out.reshape(-1, self.axis.n_range))
        elif self._conjugate:
            np.conjugate(frames[..., :: self._step], out=out, casting="same_kind")
        else:
            np.copyto(out, frames[..., :: self._step], casting="same_kind")
        return out

    def _convert(self, frames: NDArray[np.generic], out: NDArray[np.complex64]) -> None:
        for first in range(0, len(frames), _FRAMES_AT_ONCE):
            part = frames[first : first + _FRAMES_AT_ONCE]
            n = len(part)
            data = self._frames[:n]
            np.copyto(data, part, casting="same_kind")
            # Twice: the second pass removes the float32 residue of a strong idle line.
            for _ in range(2):
                data -= data.sum(axis=1, keepdims=True) / self._n_range
            mixed = np.ascontiguousarray(self._windows[:n]) @ self._block
            bins = mixed.reshape(n, -1).view(np.complex64)[:, : self.axis.n_range]
            np.multiply(bins, self._phasor, out=out[first : first + n])


def _kernel(axis: FastTimeAxis) -> NDArray[np.complex128]:
    """Return the pulse on its carrier, conjugated, shape (odd,), unit gain for an echo."""
    # Gaussian whose spectrum is -10 dB at half the bandwidth (table B.5 of the thesis).
    sigma = np.sqrt(np.log(10)) / (np.pi * axis.bandwidth_hz) * axis.sample_rate_hz
    half = max(1, int(np.ceil(_REACH_SIGMA * sigma)))
    k = np.arange(-half, half + 1)
    pulse = np.exp(-0.5 * (k / sigma) ** 2)
    turns = (axis.carrier_hz / axis.sample_rate_hz * k) % 1.0
    return np.asarray(pulse * np.exp(-2j * np.pi * turns) * (2 / np.sum(pulse**2)))
