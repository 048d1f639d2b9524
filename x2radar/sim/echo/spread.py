"""Adding narrow Gaussians to a regular grid: what the gridded tier needs, and the local tier.

The local tier makes only the bins that an echo touches, to where it has fallen to the error asked
for: the cheapest for decimated baseband and few scatterers.

Each echo touches `n_touched` grid points. Their weights follow from two exponentials by a
recurrence, exp(-b (d + j)^2 / 2) being a geometric sequence with a geometric correction (Greengard
& Lee 2004: fast Gaussian gridding; recalled). Only arrays of one number an echo are held, so that
they stay in the cache.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis, Samples
from x2radar.sim.echo import common
from x2radar.sim.echo.common import Baseband, Task
from x2radar.sim.points import Array

# With more than this share of the echoes in view, picking them out costs more than it saves.
_WORTH_PICKING = 0.8  # measured


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
    mask = common.counted(range_m, amplitude, grid.origin_m - half_m, last_m + half_m, floor)
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
    ahead = (first - low).astype(np.float32)  # from half the reach before the echo, 0 to 1
    first += row * width
    padded = np.zeros(n_slow * width, np.complex64)
    weight = common.phasor(common.carrier_turns(range_m, axis), amplitude)
    _add(padded, first.astype(np.intp).ravel(), weight.ravel(), ahead.ravel(), grid)
    return padded.reshape(n_slow, width)[:, touched:-touched]


def _add(
    padded: Baseband,
    first: NDArray[np.intp],
    weight: Baseband,
    ahead: NDArray[np.float32],
    grid: SpreadGrid,
) -> None:
    """Add every echo to the points from `first` on, one point of all echoes at a time."""
    curvature = (grid.spacing_m / grid.sigma_m) ** 2
    half = grid.n_touched / 2
    envelope = ahead - np.float32(half)
    envelope *= envelope
    envelope *= np.float32(-0.5 * curvature)
    np.exp(envelope, out=envelope)
    value = weight * envelope
    ratio = np.exp(ahead * np.float32(-curvature)).astype(np.complex64)
    step = np.empty_like(ratio)
    for j in range(grid.n_touched):
        # With flat indices of the native kind this is a tight loop; duplicates add up.
        np.add.at(padded[j:], first, value)
        np.multiply(ratio, np.float32(np.exp(-curvature * (j + 0.5 - half))), out=step)
        value *= step


def frames(range_m: Array, amplitude: Array, task: Task, floor: float) -> Samples:
    """Return frames from the bins that echoes touch; arguments as of `echo.frames`.

    The error is over the sum of the amplitudes of the echoes that reach the bin; a bin that
    none reaches is exactly zero.
    """
    axis, sigma_m = task.axis, common.echo_sigma_m(task.axis)
    grid = SpreadGrid(
        origin_m=axis.range_offset_m,
        spacing_m=axis.bin_length_m,
        n_grid=axis.n_range,
        sigma_m=sigma_m,
        n_touched=n_touched(sigma_m / axis.bin_length_m, task.error_db),
    )
    out = common.empty(len(range_m), axis)
    for part in pieces(len(range_m), range_m.shape[1], grid.n_touched):
        echo = spread(range_m[part], amplitude[part], axis, grid, floor)
        if axis.kind == "rf":
            wave = common.carrier_wave(axis)
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
    return common.blocks(n_slow, n_points * max(1, touched // 12))
