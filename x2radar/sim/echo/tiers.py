"""The three tiers: dense and local make the bins themselves, gridded goes by a coarse grid.

Every tier takes the same arguments. An echo that cannot reach a bin of the axis, or whose
amplitude is not above the floor, is left out before anything is computed for it; a
scatterer that never counts costs one comparison a frame.

The dense tier is the plain form of the echo sum: every bin of every scatterer, in float64. The
local tier makes only the bins that an echo touches, to where it has fallen to the error asked for:
the cheapest for decimated baseband and few scatterers. It adds Gaussians to a regular grid, as
does the gridded tier. Their weights follow from two exponentials by a recurrence, for
exp(-b (d + j)^2 / 2) is a geometric sequence with a geometric correction (Greengard & Lee 2004:
fast Gaussian gridding; recalled). Only arrays of one number an echo are held, to stay in a cache.

The gridded tier splits a Gaussian into the convolution of two narrower ones. Echoes are spread
with the first on a grid as coarse as the band allows, about 0.8 sigma instead of 12 bins a sigma;
the second is a matrix, the same for every block of bins. So an echo touches 9 points instead of 90
bins, and the bins cost a product that runs at the speed of BLAS (the split of the fast Gauss
transform and of Gaussian-gridding non-uniform FFTs: Dutt & Rokhlin 1993, Greengard & Lee 2004;
recalled). The matrix is not the analytic second Gaussian but the least-squares one, which makes up
for the cut-off of the first. Shapes are tried from the cheapest on; each measures its own worst
error over every position of an echo, and the first that is good enough is taken.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis, Samples
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
_SHARES = (0.5, 0.6, 0.7, 0.76)  # of the variance that the first Gaussian takes
_PACKED_POINTS = 1 << 15  # 256 KiB: a share of a core's second-level cache
# The best matrix may do this much better than the estimate of what it cannot do.
_HOPE_DB = 4.0
_FINEST_SPACING = 0.4  # sigmas; the errors asked for need no finer
# Nanoseconds of the product: a row, a point of its window times a bin, a bin; and a bin
# that must be copied because the blocks do not end where the swath does. Measured.
_ROW_NS, _PRODUCT_NS, _BIN_NS, _COPY_NS = 6.0, 0.04, 0.06, 0.2
_TOUCH_NS = 1.5  # an echo at a point
_USUAL_POINTS = 20  # of a body


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


def counted(
    range_m: Array, amplitude: Array, near_m: float, far_m: float, floor: float
) -> NDArray[np.bool_]:
    """Tell which echoes lie between two ranges and are stronger than the floor."""
    mask = range_m > near_m
    mask &= range_m < far_m
    mask &= np.abs(amplitude) > max(floor, _FAINTEST)
    return mask


def blocks(n_slow: int, n_points: int, touched: int = 1) -> list[slice]:
    """Cut slow time into pieces that a core's cache holds, where echoes touch so many bins."""
    n_echoes = max(1, n_points * max(1, touched // 12))
    size = max(1, min(_BLOCK_FRAMES, _BLOCK_ECHOES // n_echoes))
    return [slice(at, min(at + size, n_slow)) for at in range(0, n_slow, size)]


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
    return np.empty(shape, np.float32) if axis.kind == "rf" else np.empty(shape, np.complex64)


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
    for part in blocks(len(range_m), range_m.shape[1], grid.n_touched):
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


def gridded_frames(range_m: Array, amplitude: Array, task: Task, floor: float) -> Samples:
    """Return frames by way of a coarse grid; arguments as of `echo.frames`.

    The error is over the sum of the amplitudes of the echoes near the bin; further than about 18
    sigma from an echo it is zero. Bins must be shorter than a third of sigma.
    """
    axis = task.axis
    design = design_for(axis, task.error_db)
    out = empty(len(range_m), axis)
    for part in blocks(*range_m.shape):
        echo = spread(range_m[part], amplitude[part], axis, design.grid, floor)
        design.write(echo, out[part])
    return out


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Grid and interpolation matrix for the axis of one radar."""

    grid: SpreadGrid
    matrix: NDArray[np.float32]
    n_block: int
    n_blocks: int
    n_step: int
    n_window: int
    turn: Baseband | None

    def write(self, echo: Baseband, out: Samples) -> None:
        """Write the bins of an echo on the grid into `out`, shape (n_slow, n_range)."""
        row, point = echo.strides
        shape = (len(echo), self.n_blocks, self.n_window)
        windows = as_strided(echo, shape, (row, self.n_step * point, point), writeable=False)
        n_bins = self.n_blocks * self.n_block
        # Windows overlap, so they are copied: some frames at a time, to stay in the cache.
        size = max(1, min(len(echo), _PACKED_POINTS // (self.n_blocks * self.n_window)))
        packed = np.empty((size, *shape[1:]), np.complex64)
        for at in range(0, len(echo), size):
            rows = out[at : at + size]
            part = packed[: len(rows)]
            if self.turn is None:
                part[...] = windows[at : at + size]
            else:
                np.multiply(windows[at : at + size], self.turn, out=part)
            flat = part.view(np.float32).reshape(-1, 2 * self.n_window)
            whole = rows if rows.shape[1] == n_bins else np.empty((len(rows), n_bins), out.dtype)
            np.matmul(flat, self.matrix, out=whole.view(np.float32).reshape(len(flat), -1))
            if whole is not rows:
                rows[...] = whole[:, : rows.shape[1]]


def suits(axis: FastTimeAxis) -> bool:
    """Tell whether the axis' bins are short enough for a grid that is coarser."""
    return echo_sigma_m(axis) > 3 * axis.bin_length_m and axis.n_range >= 2


@lru_cache(maxsize=16)
def design_for(axis: FastTimeAxis, error_db: float) -> Design:
    """Return the design for an axis that `suits`, made once."""
    sigma_m = echo_sigma_m(axis)
    shape, matrix = _cheapest(axis.n_range, axis.bin_length_m / sigma_m, error_db)
    n_block, n_step, halo, touched, share = shape
    spacing = n_block * axis.bin_length_m / sigma_m / n_step
    n_blocks = -(-axis.n_range // n_block)
    n_window = n_step + halo
    grid = SpreadGrid(
        origin_m=axis.range_offset_m - (halo // 2) * spacing * sigma_m,
        spacing_m=spacing * sigma_m,
        n_grid=(n_blocks - 1) * n_step + n_window,
        sigma_m=math.sqrt(share) * sigma_m,
        n_touched=touched,
    )
    turn: Baseband | None = None
    if axis.kind == "rf":
        # Real samples on the carrier, from a block's beginning.
        wave_m = SPEED_OF_LIGHT_MPS / (2 * axis.carrier_hz)
        angle = 2 * np.pi * (-axis.phase_sign * axis.bin_length_m / wave_m * np.arange(n_block))
        parts = np.stack([matrix * np.cos(angle), -matrix * np.sin(angle)], axis=1)
        bins = parts.reshape(-1, n_block).astype(np.float32)
        turn = carrier_wave(axis)[::n_block][:, None].copy()
    else:
        # Real and imaginary parts in turn, on both sides.
        bins = np.kron(matrix, np.eye(2)).astype(np.float32)
    return Design(grid, bins, n_block, n_blocks, n_step, n_window, turn)


class _Shape(NamedTuple):
    n_block: int
    n_step: int
    halo: int
    touched: int
    share: float


def _cheapest(n_range: int, bin_sigma: float, error_db: float) -> tuple[_Shape, Array]:
    """Return the first of all shapes, by estimated time, whose error is small enough."""
    found = []
    longest = max(128, int(4 / bin_sigma))
    for n_block in range(8, longest + 1, 4 * (longest // 128)):
        n_blocks = -(-n_range // n_block)
        copy_ns = 0 if n_blocks * n_block == n_range else _COPY_NS * n_range
        for n_step in range(2, int(n_block * bin_sigma / _FINEST_SPACING) + 1):
            spacing = n_block * bin_sigma / n_step
            # What lies beyond half the grid's sampling rate, no matrix brings back.
            alias = 20 * math.log10(math.e) * (0.5 * np.pi**2 / spacing**2)
            if 20 * math.log10(2) - alias > error_db + _HOPE_DB:
                continue
            for share in _SHARES:
                touched = math.ceil(2 * _reach(share, error_db) / spacing)
                halo = max(0, math.ceil(2 * _reach(1 - share, error_db) / spacing) - 2)
                for more, wider in product(range(3), range(4)):
                    shape = _Shape(n_block, n_step, halo + wider, touched + more, share)
                    cost = frame_ns(n_blocks, n_block, n_step + shape.halo) + copy_ns
                    found.append((cost + _USUAL_POINTS * _TOUCH_NS * shape.touched, shape))
    found.sort()
    for _, shape in found:
        matrix, worst = _fit(shape, bin_sigma)
        if 20 * math.log10(worst) <= error_db:
            return shape, matrix
    raise SceneError(f"error_db {error_db:g}: no grid reaches it on this axis")


def _reach(share: float, db: float) -> float:
    """Return where a Gaussian of a share of the variance has fallen to `db`, in sigmas."""
    return math.sqrt(-2 * share * math.log(10 ** (db / 20)))


def frame_ns(n_blocks: int, n_block: int, n_window: int) -> float:
    """Estimate the matrix product's time for one frame."""
    return n_blocks * (_ROW_NS + n_block * (_BIN_NS + n_window * _PRODUCT_NS))


def _fit(shape: _Shape, bin_sigma: float) -> tuple[Array, float]:
    """Return the least-squares matrix (n_window, n_block) and its worst error, in sigmas."""
    n_block, n_step, halo, touched, share = shape
    spacing = n_block * bin_sigma / n_step
    n_window = n_step + halo
    left = halo // 2
    bins = np.arange(n_block) * bin_sigma
    margin = _REACH_SIGMA + touched * spacing
    echo = np.arange(-margin, n_step * spacing + margin, spacing / 12)
    first = np.ceil(echo / spacing - touched / 2).astype(np.int64)
    weights = np.zeros((echo.size, n_window))
    for j in range(touched):
        at = first + j + left
        inside = (at >= 0) & (at < n_window)
        since = (first + j) * spacing - echo
        weights[inside, at[inside]] = np.exp(-0.5 * since[inside] ** 2 / share)
    wanted = np.exp(-0.5 * (bins - echo[:, None]) ** 2)
    matrix = np.asarray(np.linalg.lstsq(weights, wanted, rcond=1e-10)[0], np.float64)
    worst = float(np.abs(weights @ matrix - wanted).max())
    return matrix, worst
