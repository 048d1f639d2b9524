"""Micro-Doppler spectrogram mu, by its definition and by the slow-time Gram matrix.

mu[k, i] is the power at Doppler line k, summed over range, in the CPI of M frames that
begins at frame i, after the CPI's mean was taken off and a Gaussian taper was put on
(2.29-2.38).

The fast form rests on two facts. mu_k = sum_n |sum_m A[k, m] y[n, m]|^2 with
A = DFT diag(taper) (I - 11^T / M) is a quadratic form in y, so it only needs the slow-time
Gram matrix over range, C = Y^H Y; and since A takes constants away, C may be built from
frame-to-frame differences, in which static clutter has cancelled before anything is
squared. That is both 10 to 20 times faster and more exact than a transform per column.
"""

from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from radard.errors import FeatureError

_BLOCK = 32
_TAPER_WIDTH = 2 / 4.29193


def gaussian_taper(n_cpi: int) -> NDArray[np.float64]:
    """Return the seed's taper, shape (n_cpi,): Gaussian, one tenth at both ends (2.31)."""
    centre = (n_cpi - 1) / 2
    if centre == 0:
        return np.ones(1)
    x = (np.arange(n_cpi) - centre) / (_TAPER_WIDTH * centre)
    return np.asarray(np.exp(-0.5 * x**2))


def doppler_hz(n_cpi: int, frame_rate_hz: float) -> NDArray[np.float64]:
    """Return the Doppler axis, shape (n_cpi,), ascending, zero at n_cpi // 2, in hertz."""
    return np.asarray(np.fft.fftshift(np.fft.fftfreq(n_cpi, 1 / frame_rate_hz)))


def micro_doppler_direct(frames: NDArray[np.complexfloating], n_cpi: int) -> NDArray[np.float64]:
    """Return mu by its definition, in float64: the reference for `micro_doppler`.

    Parameters
    ----------
    frames : ndarray, shape (n_slow, n_range), complex
        Baseband frames, slow time first.
    n_cpi : int
        Frames in one CPI.

    Returns
    -------
    ndarray, shape (n_cpi, n_slow - n_cpi + 1), float64
        Linear power, zero Doppler in row n_cpi // 2, approaching above it.
    """
    _check(frames, n_cpi)
    taper = gaussian_taper(n_cpi)[:, None]
    y = np.asarray(frames, np.complex128)
    columns = []
    for i in range(len(y) - n_cpi + 1):
        cpi = y[i : i + n_cpi]
        g = np.fft.fft(taper * (cpi - cpi.mean(axis=0)), axis=0)
        columns.append(np.fft.fftshift((np.abs(g) ** 2).sum(axis=1)))
    return np.stack(columns, axis=1)


def micro_doppler(frames: NDArray[np.complex64], n_cpi: int) -> NDArray[np.float32]:
    """Return mu by the Gram matrix of frame differences.

    Parameters
    ----------
    frames : ndarray, shape (n_slow, n_range), complex64
        Baseband frames, slow time first.
    n_cpi : int
        Frames in one CPI, at least 2.

    Returns
    -------
    ndarray, shape (n_cpi, n_slow - n_cpi + 1), float32
        Linear power, zero Doppler in row n_cpi // 2, approaching above it. Relative error
        (norm) against `micro_doppler_direct` of the same input at most 1e-5, whatever
        static clutter lies under the motion.

    Raises
    ------
    FeatureError
        If `frames` is not 2-D or shorter than a CPI.
    """
    _check(frames, n_cpi)
    steps = np.diff(frames, axis=0)
    operator = _operator(n_cpi)
    n_columns = len(frames) - n_cpi + 1
    width = n_cpi - 1
    mu = np.empty((n_cpi, n_columns), np.float32)
    for first in range(0, n_columns, _BLOCK):
        n = min(_BLOCK, n_columns - first)
        rows = steps[first : first + n + width - 1]
        gram = rows @ rows.conj().T
        s0, s1 = gram.strides
        windows = as_strided(gram, (n, width, width), (s0 + s1, s0, s1), writeable=False)
        half = operator @ windows
        np.sum((half * operator.conj()).real, axis=-1, out=mu[:, first : first + n].T)
    return np.maximum(mu, 0, out=mu)


@lru_cache(maxsize=8)
def _operator(n_cpi: int) -> NDArray[np.complex64]:
    """Return A times the summation that leads from differences back to frames."""
    k = np.arange(n_cpi)
    dft = np.exp(-2j * np.pi * ((np.outer(k, k) % n_cpi) / n_cpi))
    centred = np.eye(n_cpi) - 1 / n_cpi
    summation = np.tri(n_cpi, n_cpi - 1, -1)
    full = (dft * gaussian_taper(n_cpi)) @ centred @ summation
    operator = np.fft.fftshift(full, axes=0).astype(np.complex64)
    operator.flags.writeable = False
    return operator


def _check(frames: NDArray[np.complexfloating], n_cpi: int) -> None:
    if frames.ndim != 2 or n_cpi < 2 or len(frames) < n_cpi:
        msg = f"frames of shape {frames.shape} cannot fill a CPI of {n_cpi} frames"
        raise FeatureError(msg)
