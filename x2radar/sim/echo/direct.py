"""Tiers that make the bins themselves, dense and local, and what all tiers share.

Every tier takes the same arguments. An echo that cannot reach a bin of the axis, or whose
amplitude is not above the floor, is left out before anything is computed for it; a
scatterer that never counts costs one comparison a frame.

The dense tier is the plain form of the echo sum: every bin of every scatterer, in float64. The
local tier makes only the bins that an echo touches, to where it has fallen to the error asked for:
the cheapest for decimated baseband and few scatterers. It adds Gaussians to a regular grid, as
does the gridded tier. Their weights follow from two exponentials by a recurrence, for
exp(-b (d + j)^2 / 2) is a geometric sequence with a geometric correction (Greengard & Lee 2004:
fast Gaussian gridding; recalled). Only arrays of one number an echo are held, to stay in a cache.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.frame import FastTimeAxis, Samples
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.sim.points import Array
from x2radar.sim.signal.pulse import pulse_sigma_s

Baseband = NDArray[np.complex64]

_FAINTEST = float(np.finfo(np.float32).tiny)  # below it, amplitudes are taken for zero

FINEST_DB = -100.0  # of the fast tiers; their rounding is -107 to -130 dB

# Echoes worked on at a time: their kernels then stay in a core's second-level cache (measured).
_BLOCK_ECHOES = 8192
_BLOCK_FRAMES = 1024
DENSE_FINEST_DB = -130.0  # finer is under float32's rounding
_REACH_SIGMA = 7.0  # beyond it an echo is below 2e-11 and is left out as a whole
_BLOCK_SAMPLES = 1 << 17  # exponentials held at a time: 1 MiB, a core's second-level cache
# With more than this share of the echoes in view, picking them out costs more than it saves.
_WORTH_PICKING = 0.8  # measured


def echo_sigma_m(axis: FastTimeAxis, kind: str | None = None) -> float:
    """Return the standard deviation of an echo in range; SceneError without a bandwidth."""
    if not axis.bandwidth_hz > 0:
        msg = f"bandwidth_hz {axis.bandwidth_hz:g}: echoes need a pulse with a bandwidth"
        raise SceneError(msg)
    widening = math.sqrt(2) if (kind or axis.kind) == "baseband" else 1.0
    return widening * pulse_sigma_s(axis.bandwidth_hz) * SPEED_OF_LIGHT_MPS / 2


@dataclass(frozen=True, slots=True)
class Task:
    """Size, axis and allowed error of a block of frames that is to be computed."""

    n_slow: int
    n_points: int
    axis: FastTimeAxis
    error_db: float  # largest allowed

    @property
    def n_echoes(self) -> int:
        """Number of echoes: frames times scatterers."""
        return self.n_slow * self.n_points


def counted(
    range_m: Array, amplitude: Array, near_m: float, far_m: float, floor: float
) -> NDArray[np.bool_]:
    """Tell which echoes lie between two ranges and are stronger than the floor."""
    mask = range_m > near_m
    mask &= range_m < far_m
    mask &= np.abs(amplitude) > max(floor, _FAINTEST)
    return mask


def blocks(n_slow: int, n_points: int) -> Iterator[slice]:
    """Cut slow time into pieces that a core's cache holds."""
    size = max(1, min(_BLOCK_FRAMES, _BLOCK_ECHOES // max(1, n_points)))
    for first in range(0, n_slow, size):
        yield slice(first, min(first + size, n_slow))


def carrier_turns(range_m: Array, axis: FastTimeAxis) -> Array:
    """Return the carrier phase, sign * 2 R / lambda, in turns of -0.5 to 0.5, float64.

    The whole turns are taken off in float64: the error is 1e-16 of the number of wavelengths.
    """
    turns = range_m * (axis.phase_sign * 2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS)
    turns -= np.rint(turns)
    return turns


def phasor(turns: Array, amplitude: Array) -> Baseband:
    """Return ``amplitude * exp(2j pi turns)`` in complex64, turns already reduced."""
    angle = turns.astype(np.float32)
    angle *= np.float32(2 * np.pi)
    out = np.empty(turns.shape, np.complex64)
    level = amplitude.astype(np.float32)
    np.multiply(np.cos(angle), level, out=out.real)
    np.multiply(np.sin(angle), level, out=out.imag)
    return out


@lru_cache(maxsize=16)
def carrier_wave(axis: FastTimeAxis) -> Baseband:
    """Return the carrier at every bin, shape (n_range,), that turns baseband into RF."""
    turns = -carrier_turns(axis.range_m, axis)
    wave = phasor(turns, np.ones_like(turns))
    wave.flags.writeable = False
    return wave


def empty(n_slow: int, axis: FastTimeAxis) -> Samples:
    """Return frames to be filled, in the axis' type."""
    shape = (n_slow, axis.n_range)
    if axis.kind == "rf":
        return np.empty(shape, np.float32)
    return np.empty(shape, np.complex64)


def dense_frames(range_m: Array, amplitude: Array, task: Task, floor: float) -> Samples:
    """Return frames by the echo sum over all bins; arguments as of `echo.frames`.

    ``sum_k a_k g(x - R_k) exp(-j 4 pi R_k / lambda)`` (2.19), or that on its carrier (2.12).
    Error below 1e-7 of the sum of amplitudes, whatever was asked for.
    """
    axis, sigma_m = task.axis, echo_sigma_m(task.axis)
    reach_m, (first_m, last_m) = _REACH_SIGMA * sigma_m, axis.range_m[[0, -1]]
    mask = counted(range_m, amplitude, first_m - reach_m, last_m + reach_m, floor)
    if not mask.all():
        # Scatterers that never show are left out.
        columns = mask.any(axis=0)
        mask = mask[:, columns]
        range_m = np.where(mask, range_m[:, columns], first_m)
        amplitude = np.where(mask, amplitude[:, columns], 0.0)
    weight = amplitude * np.exp(2j * np.pi * carrier_turns(range_m, axis))
    rows = np.stack([weight.real, weight.imag], axis=1)
    out = empty(len(range_m), axis)
    wave = np.exp(-2j * np.pi * carrier_turns(axis.range_m, axis)) if axis.kind == "rf" else None
    size = max(1, _BLOCK_SAMPLES // max(1, range_m.shape[1] * axis.n_range))
    for at in range(0, len(range_m), size):
        part = slice(at, at + size)
        since = (axis.range_m - range_m[part, :, None]) / sigma_m
        since *= since
        since *= -0.5
        real, imag = np.moveaxis(rows[part] @ np.exp(since, out=since), 1, 0)
        if wave is None:
            out[part].real, out[part].imag = real, imag
        else:
            out[part] = real * wave.real - imag * wave.imag
    return out


@dataclass(frozen=True, slots=True)
class SpreadGrid:
    """A regular grid in range and the Gaussian that is put on it."""

    origin_m: float  # range of point 0
    spacing_m: float
    n_grid: int  # points
    sigma_m: float  # of the Gaussian
    n_touched: int  # points that an echo is added to: those within half as many spacings


def spread(
    range_m: Array, amplitude: Array, axis: FastTimeAxis, grid: SpreadGrid, floor: float
) -> Baseband:
    """Return all echoes on the grid, shape (n_slow, n_grid); any distance is allowed.

    ``sum_k a_k exp(-(x - R_k)^2 / 2 s^2) exp(-j 4 pi R_k / lambda)``, cut off n_touched / 2
    spacings from the echo; relative rounding error below 3e-6. May be a view of something
    larger.
    """
    n_slow, n_points = range_m.shape
    touched = grid.n_touched
    half_m = grid.spacing_m * touched / 2
    last_m = grid.origin_m + grid.spacing_m * (grid.n_grid - 1)
    mask = counted(range_m, amplitude, grid.origin_m - half_m, last_m + half_m, floor)
    row = np.arange(n_slow, dtype=np.float64)[:, None]
    n_seen = np.count_nonzero(mask)
    if n_seen < _WORTH_PICKING * mask.size:
        flat = np.flatnonzero(mask)
        range_m, amplitude = range_m.ravel()[flat], amplitude.ravel()[flat]
        row = (flat // n_points).astype(np.float64)
    elif n_seen < mask.size:
        range_m = np.where(mask, range_m, grid.origin_m)
        amplitude = np.where(mask, amplitude, 0.0)
    # Margins on both sides take what falls outside the grid.
    width = grid.n_grid + 2 * touched
    low = (range_m - grid.origin_m) * (1 / grid.spacing_m)
    low += touched / 2
    first = np.ceil(low)
    ahead = (first - low).astype(np.float32).ravel()  # from half the reach before the echo, 0 to 1
    first += row * width
    at = first.astype(np.intp).ravel()
    padded = np.zeros(n_slow * width, np.complex64)
    curvature, half = (grid.spacing_m / grid.sigma_m) ** 2, touched / 2
    envelope = ahead - np.float32(half)
    envelope *= envelope
    envelope *= np.float32(-0.5 * curvature)
    np.exp(envelope, out=envelope)
    value = phasor(carrier_turns(range_m, axis), amplitude).ravel() * envelope
    ratio = np.exp(ahead * np.float32(-curvature)).astype(np.complex64)
    step = np.empty_like(ratio)
    # One point of all echoes at a time.
    for j in range(touched):
        # With flat indices of the native kind this is a tight loop; duplicates add up.
        np.add.at(padded[j:], at, value)
        np.multiply(ratio, np.float32(np.exp(-curvature * (j + 0.5 - half))), out=step)
        value *= step
    return padded.reshape(n_slow, width)[:, touched:-touched]


def local_frames(range_m: Array, amplitude: Array, task: Task, floor: float) -> Samples:
    """Return frames from the bins that echoes touch; arguments as of `echo.frames`.

    The error is over the sum of the amplitudes of the echoes that reach the bin; a bin that
    none reaches is exactly zero.
    """
    axis, sigma_m = task.axis, echo_sigma_m(task.axis)
    grid = SpreadGrid(
        origin_m=axis.range_offset_m,
        spacing_m=axis.bin_length_m,
        n_grid=axis.n_range,
        sigma_m=sigma_m,
        n_touched=n_touched(sigma_m / axis.bin_length_m, task.error_db),
    )
    out = empty(len(range_m), axis)
    for part in pieces(len(range_m), range_m.shape[1], grid.n_touched):
        echo = spread(range_m[part], amplitude[part], axis, grid, floor)
        if axis.kind == "rf":
            wave = carrier_wave(axis)
            out[part] = echo.real * wave.real - echo.imag * wave.imag
        else:
            out[part] = echo
    return out


def n_touched(sigma_bins: float, error_db: float) -> int:
    """Return how many bins an echo touches before it has fallen to `error_db`."""
    reach = sigma_bins * math.sqrt(-2 * math.log(10 ** (error_db / 20)))
    return max(2, int(np.ceil(2 * reach)))


def pieces(n_slow: int, n_points: int, touched: int) -> Iterator[slice]:
    """Cut slow time as `blocks` does, shorter where a wide pulse touches many bins."""
    return blocks(n_slow, n_points * max(1, touched // 12))
