"""Cadence velocity diagram D, and the thesis' two feature vectors made of it."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from radard.dsp.doppler import gaussian_taper
from radard.errors import FeatureError

_LOW, _HIGH = 1e-15, 1e15  # squares of numbers between fit float32 and lose no digits
_ALPHA = 0.2  # the thesis'
_MIN_SAR = 15.0  # the thesis leaves it open; noise alone stays below in 768 bins of an X2


def cadence_velocity_diagram(spectrogram: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return |DFT of every Doppler row along slow time| (2.40), shape and unit of the spectrogram.

    `spectrogram` is linear power of one dwell, shape (n_doppler, n_seg), float32. Column 0 is the
    sum over the dwell. Relative error (norm) at most 1e-6, for powers whose sum fits float32.
    """
    return np.abs(np.fft.fft(spectrogram, axis=1)).astype(np.float32)


def type1_vector(diagram: NDArray[np.float32], n_cadence: int) -> NDArray[np.float32]:
    """Return the thesis' type 1 vector (3.11-3.15), shape (n_doppler * n_cadence,), float32.

    The first `n_cadence` columns of the `cadence_velocity_diagram`, one behind the other, divided
    by the Frobenius norm of the whole diagram; zero where that norm is zero. Relative error (norm)
    against float64 at most 1e-6 from 1e-35 up. Raises FeatureError if there are fewer columns.
    """
    if not 1 <= n_cadence <= diagram.shape[1]:
        raise FeatureError(f"n_cadence {n_cadence} is not in 1 to {diagram.shape[1]}")
    scale = float(np.max(diagram, initial=0))
    if scale == 0 or not np.isfinite(scale):
        return np.zeros(diagram.shape[0] * n_cadence, np.float32)
    # Scaled to at most one first, so that no square leaves float32.
    scaled = diagram / scale
    norm = np.sqrt(np.sum(scaled.astype(np.float64) ** 2))
    return np.asarray(scaled[:, :n_cadence].T.ravel() / norm, np.float32)


def extent_profile(
    frames: NDArray[np.complex64], n_cpi: int, n_profile: int
) -> NDArray[np.float32]:
    """Return the range profile of the moment at which the target spans most range.

    For every CPI the centre frame after clutter removal and taper, z, is looked at: the target
    reaches from the first to the last bin with |z|^2 over Pavg (1 + `_ALPHA` (SAR - 1)), SAR =
    max |z|^2 / Pavg (3.16-3.21). Frames with a SAR below `_MIN_SAR` hold no target.

    Shape (n_profile,), float32: |z| over its maximum, cut off or filled up with zeros; all zero
    when no frame holds a target. `frames` is complex64, shape (n_slow, n_range). The same at any
    level of the frames, from denormal to 1e37; error at most 1e-5 of the maximum with static
    clutter up to 60 dB over the target.
    """
    n_columns = len(frames) - n_cpi + 1
    rest = frames - frames[n_cpi // 2]
    parts = rest.view(np.float32)
    top = float(max(parts.max(initial=0), -parts.min(initial=0)))
    if not _LOW < top < _HIGH:
        np.ldexp(parts, -np.frexp(top)[1], out=parts)
    total = rest.astype(np.complex128)
    # Row by row: numpy's cumsum along the first axis takes ten times as long.
    for before, row in pairwise(total):
        np.add(before, row, out=row)
    total[n_cpi:] = total[n_cpi:] - total[:-n_cpi]
    mean = (total[n_cpi - 1 :] / n_cpi).astype(np.complex64)
    z = rest[n_cpi // 2 : n_cpi // 2 + n_columns] - mean
    z *= np.float32(gaussian_taper(n_cpi)[n_cpi // 2])
    magnitude = np.abs(z)
    peak = magnitude.max(axis=1)
    # Relative to each frame's peak, so that no level over- or underflows.
    power = (magnitude / np.maximum(peak, np.finfo(np.float32).tiny)[:, None]) ** 2
    average = power.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sar = np.where(average > 0, 1 / average, 0.0)
    over = power > (average * (1 + _ALPHA * (sar - 1)))[:, None]
    first = over.argmax(axis=1)
    last = power.shape[1] - 1 - over[:, ::-1].argmax(axis=1)
    extent = np.where((sar >= _MIN_SAR) & over.any(axis=1), last - first + 1, 0)
    profile = np.zeros(n_profile, np.float32)
    widest = int(extent.argmax())
    n = min(int(extent[widest]), n_profile)
    if n:
        start = int(first[widest])
        profile[:n] = magnitude[widest, start : start + n] / peak[widest]
    return profile
