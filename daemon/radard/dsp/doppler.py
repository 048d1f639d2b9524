"""Micro-Doppler spectrogram mu: axes, batch form, and one CPI's range-Doppler map.

mu[k, i] is the power at Doppler line k, summed over range, in the CPI of M frames that
begins at frame i, after the CPI's mean was taken off and a taper was put on (2.29-2.38).
`micro_doppler` and `StreamingDoppler` compute it from the Gram matrix of steps (see
`radard.dsp.gram`).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radard.dsp.gram import gaussian_taper, step_operator
from radard.dsp.steps import StepBuffer, blocks
from radard.dsp.streaming import StreamingDoppler
from radard.errors import FeatureError
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS


def doppler_hz(n_cpi: int, frame_rate_hz: float) -> NDArray[np.float64]:
    """Return the Doppler axis, shape (n_cpi,), ascending, zero at n_cpi // 2, in hertz."""
    return np.asarray(np.fft.fftshift(np.fft.fftfreq(n_cpi, 1 / frame_rate_hz)))


def velocity_mps(n_cpi: int, frame_rate_hz: float, carrier_hz: float) -> NDArray[np.float64]:
    """Return the radial velocity of every Doppler line, approaching positive (2.25).

    Shape (n_cpi,), ascending, zero at n_cpi // 2. Faster motion folds back by whole multiples
    of twice `unambiguous_velocity_mps`.
    """
    return doppler_hz(n_cpi, frame_rate_hz) * (SPEED_OF_LIGHT_MPS / (2 * carrier_hz))


def unambiguous_velocity_mps(frame_rate_hz: float, carrier_hz: float) -> float:
    """Return the speed from which Doppler folds, lambda fp / 4, in metres per second."""
    return SPEED_OF_LIGHT_MPS / carrier_hz * frame_rate_hz / 4


def micro_doppler(frames: ArrayLike, n_cpi: int) -> NDArray[np.float32]:
    """Return mu of a whole record: `StreamingDoppler` fed once.

    Parameters
    ----------
    frames : array_like, shape (n_slow, n_range), complex
        Baseband frames, slow time first. A frame that is not finite counts as a repeat of
        the one before it; `StreamingDoppler` tells which columns it touches.
    n_cpi : int
        Frames in one CPI, at least 2.

    Returns
    -------
    ndarray, shape (n_cpi, n_slow - n_cpi + 1), float32
        Linear power, zero Doppler in row n_cpi // 2, approaching above it. Relative error
        (norm) as `StreamingDoppler`'s, at most 1e-5. Power that float32 cannot hold becomes
        its largest number or zero: `StreamingDoppler` gives float64.

    Raises
    ------
    FeatureError
        If `frames` is not 2-D or shorter than a CPI.
    """
    rows = np.asarray(frames)
    _check(rows, n_cpi)
    stream = StreamingDoppler(n_cpi, n_keep=len(rows) - n_cpi + 1)
    stream.push(rows)
    return np.minimum(stream.columns(), np.finfo(np.float32).max).astype(np.float32)


def range_doppler(cpi: ArrayLike) -> NDArray[np.float64]:
    """Return the range-Doppler map G of one CPI (2.34), to look at.

    Parameters
    ----------
    cpi : array_like, shape (n_cpi, n_range), complex
        The frames of one CPI, all of them good.

    Returns
    -------
    ndarray, shape (n_cpi, n_range), float64
        Power by Doppler line and range bin; the sum over range is that CPI's column of mu,
        with the same error.

    Raises
    ------
    FeatureError
        If `cpi` is no record of at least two frames.
    """
    rows = np.asarray(cpi)
    _check(rows, len(rows) if rows.ndim == 2 else 0)
    operator = step_operator(gaussian_taper(len(rows)))
    buffer = StepBuffer(0, len(rows))
    for part, flags in blocks(rows, None, len(rows)):
        buffer.push(part, flags)
    # Float64 throughout: seldom wanted, never in a hurry, and no level is too strong for it.
    steps = buffer.rows(len(rows) - 1).astype(np.float64)
    lines = operator @ (steps[:, : buffer.n_range] + 1j * steps[:, buffer.n_range :])
    return np.asarray(lines.real**2 + lines.imag**2)


def _check(frames: NDArray[np.generic], n_cpi: int) -> None:
    if frames.ndim != 2 or n_cpi < 2 or len(frames) < n_cpi:
        msg = f"frames of shape {frames.shape} cannot fill a CPI of {n_cpi} frames"
        raise FeatureError(msg)
