"""The gridded tier: echoes on a coarse grid, then one matrix product to the bins.

A Gaussian is the convolution of two narrower ones. Echoes are spread with the first on a grid as
coarse as the band allows, about 0.8 sigma instead of 12 bins a sigma; the second is a matrix, the
same for every block of bins. So an echo touches 9 points instead of 90 bins, and the bins cost a
product that runs at the speed of BLAS (the split of the fast Gauss transform and of
Gaussian-gridding non-uniform FFTs: Dutt & Rokhlin 1993, Greengard & Lee 2004; recalled).

The matrix is not the analytic second Gaussian but the least-squares one, which makes up for the
cut-off of the first. Shapes are tried from the cheapest on; each measures its own worst error over
every position of an echo, and the first that is good enough is taken.
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
from x2radar.frame import FastTimeAxis, Samples
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.sim.echo import direct
from x2radar.sim.echo.direct import FINEST_DB, Baseband, SpreadGrid, Task, spread
from x2radar.sim.points import Array

_SHARES = (0.5, 0.6, 0.7, 0.76)  # of the variance that the first Gaussian takes
_FAR_SIGMA = 7.0  # a Gaussian has fallen to 2e-11
_PACKED_POINTS = 1 << 15  # 256 KiB: a share of a core's second-level cache
# The best matrix may do this much better than the estimate of what it cannot do.
_HOPE_DB = 4.0
_FINEST_SPACING = 0.4  # sigmas; the errors asked for need no finer
# Nanoseconds of the product: a row, a point of its window times a bin, a bin; and a bin
# that must be copied because the blocks do not end where the swath does. Measured.
_ROW_NS, _PRODUCT_NS, _BIN_NS, _COPY_NS = 6.0, 0.04, 0.06, 0.2
_TOUCH_NS = 1.5  # an echo at a point
_USUAL_POINTS = 20  # of a body


def frames(range_m: Array, amplitude: Array, task: Task, floor: float) -> Samples:
    """Return frames by way of a coarse grid; arguments as of `echo.frames`.

    The error is over the sum of the amplitudes of the echoes near the bin; further than about 18
    sigma from an echo it is zero. Raises SceneError, too, where bins are longer than a third of
    sigma.
    """
    axis = task.axis
    design = design_for(axis, task.error_db)
    out = direct.empty(len(range_m), axis)
    for part in direct.blocks(*range_m.shape):
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
    return direct.echo_sigma_m(axis) > 3 * axis.bin_length_m and axis.n_range >= 2


@lru_cache(maxsize=16)
def design_for(axis: FastTimeAxis, error_db: float) -> Design:
    """Return the design for an axis, made once; SceneError if none reaches the error."""
    if not suits(axis) or error_db < FINEST_DB:
        raise SceneError(
            f"no coarse grid gives {error_db:g} dB on bins of {axis.bin_length_m:g} m: the "
            f"bins must be shorter than a third of a sigma, the error at least {FINEST_DB:g}"
        )
    sigma_m = direct.echo_sigma_m(axis)
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
    is_rf = axis.kind == "rf"
    # Without a carrier, real and imaginary parts in turn, on both sides.
    bins = _rf_matrix(matrix, axis) if is_rf else np.kron(matrix, np.eye(2)).astype(np.float32)
    return Design(
        grid=grid,
        matrix=bins,
        n_block=n_block,
        n_blocks=n_blocks,
        n_step=n_step,
        n_window=n_window,
        turn=direct.carrier_wave(axis)[::n_block][:, None].copy() if is_rf else None,
    )


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
            if _alias_db(spacing) > error_db + _HOPE_DB:
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


def _alias_db(spacing: float) -> float:
    """Return what lies beyond half the grid's sampling rate, which no matrix brings back."""
    return 20 * math.log10(2) - 20 * math.log10(math.e) * (0.5 * np.pi**2 / spacing**2)


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
    margin = _FAR_SIGMA + touched * spacing
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


def _rf_matrix(matrix: Array, axis: FastTimeAxis) -> NDArray[np.float32]:
    """Return the matrix that ends in real samples on the carrier, from a block's beginning."""
    wave_m = SPEED_OF_LIGHT_MPS / (2 * axis.carrier_hz)
    turns = -axis.phase_sign * axis.bin_length_m / wave_m * np.arange(matrix.shape[1])
    angle = 2 * np.pi * turns
    parts = np.stack([matrix * np.cos(angle), -matrix * np.sin(angle)], axis=1)
    return parts.reshape(-1, matrix.shape[1]).astype(np.float32)
