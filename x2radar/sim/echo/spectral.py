"""The spectral tier: the spectrum of each echo on some 70 frequencies of the pulse's band.

A delay is a phase ramp over frequency, and a ramp is a geometric sequence: with
z = exp(-j 2 pi (R - R0) / P) the echo's line i is z**i. Splitting i = r q + s makes the sum
over scatterers one small matrix product per frame, of Q + r powers instead of Q r. The
inverse transform gives the bins.
"""

import numpy as np

from x2radar.frame import FastTimeAxis
from x2radar.sim.echo.common import (
    Amplitude,
    Array,
    Baseband,
    Frames,
    Pulse,
    blocks,
    carrier_turns,
    check,
    empty,
    kept,
    on_carrier,
    phasor,
)
from x2radar.sim.echo.spectral_grid import SpectralGrid, grid_for

_FFT_ROWS = 64
"""Frames transformed at a time: their buffers stay in a core's cache."""


def frames(
    range_m: Array,
    amplitude: Amplitude,
    axis: FastTimeAxis,
    pulse: Pulse | None = None,
    *,
    error_db: float = -60.0,
    floor: float = 0.0,
) -> Frames:
    """Return frames from the echoes' spectra; see `choose.FramesOf`.

    Rounding is spread over the whole range, so the error is over the sum of all amplitudes of
    the frame, wherever they lie.
    """
    check(range_m, amplitude)
    grid = grid_for(axis, pulse or Pulse.of(axis), error_db)
    reach_m = grid.reach_m
    r, a = kept(range_m, amplitude, axis, reach_m=reach_m, floor=floor)
    out = empty(len(r), axis)
    for part in blocks(*r.shape):
        _write_bins(_lines(r[part], a[part], axis, grid), axis, grid, out[part])
    return out


def _lines(
    range_m: Array, amplitude: Amplitude, axis: FastTimeAxis, grid: SpectralGrid
) -> Baseband:
    """Return the lines of some frames, shape (n_slow, n_freq)."""
    n_slow, n_points = range_m.shape
    if n_points == 0:
        return np.zeros((n_slow, grid.n_freq), np.complex64)
    ramp = (range_m - grid.reference_m) * (-1 / grid.period_m)  # turns from line to line
    turns = carrier_turns(range_m, axis)
    turns -= (grid.n_freq // 2) * ramp
    turns -= np.rint(turns)
    one = np.ones(())
    slow = _powers(phasor(turns, amplitude), _unit(ramp * grid.n_fast_power), grid.n_slow_power)
    fast = _powers(phasor(np.zeros_like(ramp), one), _unit(ramp), grid.n_fast_power)
    lines = slow.transpose(1, 0, 2) @ fast.transpose(1, 2, 0)
    return np.asarray(lines.reshape(n_slow, -1) * grid.weight)


def _unit(turns: Array) -> Baseband:
    return phasor(turns - np.rint(turns), np.ones(()))


def _powers(first: Baseband, ratio: Baseband, n: int) -> Baseband:
    """Return a geometric sequence, shape (n, n_slow, n_points)."""
    out = np.empty((n, *first.shape), np.complex64)
    out[0] = first
    for k in range(1, n):
        np.multiply(out[k - 1], ratio, out=out[k])
    return out


def _write_bins(lines: Baseband, axis: FastTimeAxis, grid: SpectralGrid, out: Frames) -> None:
    """Write the bins of some frames, shape (n_slow, n_range)."""
    n, below = grid.n_fft * grid.n_fold, grid.n_freq // 2
    # R0 is the middle of the swath; bin 0 lies half a swath before it. The factor n undoes
    # ifft's own scaling (its norm="forward" would leave single precision).
    line: Array = np.arange(grid.n_freq, dtype=np.float64) - below
    shift = _unit(line * (-(axis.n_range - 1) / 2 / grid.n_fft)) * np.float32(n)
    # A few frames at a time, in buffers that stay in the cache.
    full = np.zeros((min(len(lines), _FFT_ROWS), n), np.complex64)
    bins = np.empty_like(full)
    for at in range(0, len(lines), _FFT_ROWS):
        rows = np.multiply(lines[at : at + _FFT_ROWS], shift)
        full[: len(rows), : grid.n_freq - below] = rows[:, below:]
        full[: len(rows), n - below :] = rows[:, :below]
        # NumPy's stub knows no single precision here; the function does.
        np.fft.ifft(full[: len(rows)], axis=1, out=bins[: len(rows)])  # type: ignore[arg-type]
        echo = bins[: len(rows), : axis.n_range * grid.n_fold : grid.n_fold]
        out[at : at + len(rows)] = on_carrier(echo, axis) if axis.kind == "rf" else echo
