"""Maps of frames for a first look: power by range, by velocity and by frequency.

Plain NumPy, whole arrays at once. `radard.dsp` makes the same step by step for the alarm, with
clutter maps and error bounds; here the mean of each coherent processing interval (CPI) is taken
out, which removes what stands still.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from x2radar.errors import SettingsError
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis, Samples

CPI_S = 28 / 60  # length of a CPI: that of the thesis, which resolves 0.05 m/s at 6.8 GHz
_COLUMN_RATE_HZ, _MAX_MPS = 15.0, 4.0
CELL_M = 0.05  # range cell of `range_time`: half of what 1.75 GHz of bandwidth resolve
_MAX_FREQUENCIES = 64  # the band of an X2 over its swath has 33 independent ones

Reals = NDArray[np.float64]
Map = tuple[Reals, Reals, Reals]


def range_time(samples: Samples, axis: FastTimeAxis, frame_rate_hz: float) -> Map:
    """Return the power of what moves, by range and time, in about 15 columns a second.

    Parameters
    ----------
    samples : ndarray, shape (n, n_range), float32 or complex64
        Frames in order, none missing.
    axis : FastTimeAxis
        Their axis.
    frame_rate_hz : float
        Frames per second.

    Returns
    -------
    power : ndarray, shape (n_cells, n_columns), float64
        Variance within a CPI, in sample units squared; for RF that is half of the envelope's.
    range_m, t_s : ndarray
        Middles of the cells in metres, and of the CPIs in seconds since the first frame.

    Raises
    ------
    SettingsError
        If the frames are fewer than those of a CPI.

    Examples
    --------
    A body at 2 m that oscillates, in bins of 5 cm:

    >>> axis = FastTimeAxis(kind="baseband", n_range=60, bin_length_m=0.05,
    ...                     range_offset_m=0.5, carrier_hz=6.8e9)
    >>> frames = np.zeros((120, 60), np.complex64)
    >>> frames[:, 30] = np.exp(1j * np.arange(120))
    >>> power, range_m, t_s = range_time(frames, axis, 60.0)
    >>> power.shape, float(range_m[power.sum(axis=1).argmax()])
    ((60, 24), 2.0)
    """
    n_cpi, starts, t_s = _columns(len(samples), frame_rate_hz)
    power = np.empty((len(starts), samples.shape[1]))
    wide = np.complex128 if samples.dtype.kind == "c" else np.float64
    for k, first in enumerate(starts.tolist()):
        power[k] = samples[first : first + n_cpi].astype(wide).var(axis=0)
    group = max(1, round(CELL_M / axis.bin_length_m))
    edges = np.arange(0, samples.shape[1], group)
    count = np.diff(np.append(edges, samples.shape[1]))
    cells = np.add.reduceat(power, edges, axis=1) / count
    middle_m = np.add.reduceat(axis.range_m, edges) / count
    return cells.T, middle_m, t_s


def velocity_time(samples: Samples, axis: FastTimeAxis, frame_rate_hz: float) -> Map:
    """Return power by radial velocity, up to 4 m/s, and time; approaching is positive.

    The wide band tells velocities from their aliases: each frequency of the pulse is matched
    with its own Doppler shift, 2 v f / c, and the powers are summed, so that only the true
    velocity adds up in all of them. Aliases, c fp / (2 f) apart, are weaker but not absent.

    Parameters
    ----------
    samples, axis, frame_rate_hz
        As for `range_time`.

    Returns
    -------
    power : ndarray, shape (n_velocities, n_columns), float64
        In sample units squared.
    velocity_mps, t_s : ndarray
        Metres per second; middles of the CPIs in seconds since the first frame.

    Raises
    ------
    SettingsError
        If the frames are fewer than those of a CPI.

    References
    ----------
    R. P. Perry, R. C. DiPietro, R. L. Fante, "SAR imaging of moving targets", IEEE Trans.
    Aerosp. Electron. Syst. 35 (1999): phase by frequency, on which this is built.

    Examples
    --------
    A point that approaches at 1.5 m/s, beyond the 0.66 m/s that 60 frames a second tell apart:

    >>> axis = FastTimeAxis(kind="baseband", n_range=80, bin_length_m=0.04,
    ...                     range_offset_m=0.5, carrier_hz=6.8e9, bandwidth_hz=1.75e9)
    >>> range_m = 3.0 - 1.5 * np.arange(60) / 60
    >>> pulse = np.exp(-(((axis.range_m - range_m[:, None]) / 0.05) ** 2))
    >>> turn = np.exp(-4j * np.pi * 6.8e9 / 299792458.0 * range_m)[:, None]
    >>> power, v_mps, t_s = velocity_time((pulse * turn).astype(np.complex64), axis, 60.0)
    >>> round(float(v_mps[power.sum(axis=1).argmax()]), 1)
    1.5
    """
    n_cpi, starts, t_s = _columns(len(samples), frame_rate_hz)
    step_mps = SPEED_OF_LIGHT_MPS * frame_rate_hz / (2 * axis.carrier_hz * n_cpi)
    n_side = max(1, round(2 * _MAX_MPS / step_mps))
    velocity_mps: Reals = np.arange(-n_side, n_side + 1, dtype=np.float64) * (step_mps / 2)
    lines, frequency_hz = _lines(samples, axis)
    # Those in the pulse's bandwidth, the strongest 10 dB where it is unknown.
    if axis.bandwidth_hz > 0:
        is_in = np.abs(frequency_hz - axis.carrier_hz) <= axis.bandwidth_hz / 2
    else:
        changing = lines.var(axis=0)
        is_in = changing >= 0.1 * changing.max()
    chosen = np.flatnonzero(is_in & (frequency_hz > 0))
    if not chosen.size:
        chosen = np.array([np.abs(frequency_hz - axis.carrier_hz).argmin()])
    chosen = chosen[:: -(-chosen.size // _MAX_FREQUENCIES)]
    lines, frequency_hz = lines[:, chosen], frequency_hz[chosen]
    at_s = np.arange(n_cpi) / frame_rate_hz
    window = np.hanning(n_cpi)
    power = np.zeros((len(velocity_mps), len(starts)))
    for line, f_hz in zip(lines.T, frequency_hz, strict=True):
        cpis = sliding_window_view(line, n_cpi)[starts]
        moving = (cpis - cpis.mean(axis=1, keepdims=True)) * window
        doppler_hz = 2 * velocity_mps * f_hz / SPEED_OF_LIGHT_MPS
        matched = np.exp(-2j * np.pi * doppler_hz[:, None] * at_s)
        power += np.abs(matched @ moving.T) ** 2
    return power / (n_cpi * len(frequency_hz)), velocity_mps, t_s


def spectrum(samples: Samples, axis: FastTimeAxis) -> Map:
    """Return the spectrum of the frames: of all that is in them, and of what changes.

    Parameters
    ----------
    samples, axis
        As for `range_time`.

    Returns
    -------
    total, moving : ndarray, shape (n_frequencies,), float64
        Mean power of the frames, and of the frames without their mean, in sample units squared.
    frequency_hz : ndarray
        Radio frequency, ascending.

    Examples
    --------
    >>> axis = FastTimeAxis(kind="rf", n_range=512, bin_length_m=0.00366, range_offset_m=0.6,
    ...                     carrier_hz=6.8e9)
    >>> wave = np.cos(4 * np.pi * 6.8e9 / 299792458.0 * axis.range_m).astype(np.float32)
    >>> total, moving, frequency_hz = spectrum(np.tile(wave, (10, 1)), axis)
    >>> round(float(frequency_hz[total.argmax()]) / 1e9, 1), bool(moving.max() < 1e-6)
    (6.8, True)
    """
    lines, frequency_hz = _lines(samples, axis)
    order = np.argsort(frequency_hz)
    total = np.mean(np.abs(lines) ** 2, axis=0)
    return total[order], lines.var(axis=0)[order], frequency_hz[order]


def _columns(n_frames: int, frame_rate_hz: float) -> tuple[int, NDArray[np.int64], Reals]:
    """Return the frames of a CPI, where the CPIs begin, and their middles in seconds."""
    n_cpi = max(4, round(CPI_S * frame_rate_hz))
    if n_frames < n_cpi:
        msg = f"{n_frames} frames: at least {n_cpi} are needed, {CPI_S:.2f} s of them"
        raise SettingsError(msg)
    stride = max(1, round(frame_rate_hz / _COLUMN_RATE_HZ))
    starts: NDArray[np.int64] = np.arange(0, n_frames - n_cpi + 1, stride, dtype=np.int64)
    return n_cpi, starts, (starts.astype(np.float64) + n_cpi / 2) / frame_rate_hz


def _lines(samples: Samples, axis: FastTimeAxis) -> tuple[NDArray[np.complex128], Reals]:
    """Return the frames by radio frequency, shape (n, n_frequencies), and the frequencies."""
    is_rf, n_range = axis.kind == "rf", samples.shape[1]
    turns_per_m = (np.fft.rfftfreq if is_rf else np.fft.fftfreq)(n_range, axis.bin_length_m)
    lines = (np.fft.rfft if is_rf else np.fft.fft)(samples, axis=1)
    return lines, (0.0 if is_rf else axis.carrier_hz) + turns_per_m * SPEED_OF_LIGHT_MPS / 2
