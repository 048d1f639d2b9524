"""The local tier: only the bins that an echo touches.

How far a pulse is followed depends on the error asked for: to where it has fallen to that
error. The tier is the cheapest where a bin is not much shorter than the pulse (decimated
baseband) and where there are few scatterers.
"""

import math
from collections.abc import Iterator

import numpy as np

from x2radar.sim.echo.common import (
    Amplitude,
    Array,
    Frames,
    Task,
    blocks,
    empty,
    on_carrier,
)
from x2radar.sim.echo.spread import SpreadGrid, spread


def frames(range_m: Array, amplitude: Amplitude, task: Task, floor: float) -> Frames:
    """Return frames from the bins that echoes touch; arguments as of `choose.frames`.

    The error is over the sum of the amplitudes of the echoes that reach the bin; a bin that
    none reaches is exactly zero.
    """
    axis, pulse = task.axis, task.pulse
    sigma_m = pulse.sigma_m(axis.kind)
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
        out[part] = on_carrier(echo, axis) if axis.kind == "rf" else echo
    return out


def n_touched(sigma_bins: float, error_db: float) -> int:
    """Return how many bins an echo touches before it has fallen to `error_db`."""
    reach = sigma_bins * math.sqrt(-2 * math.log(10 ** (error_db / 20)))
    return max(2, int(np.ceil(2 * reach)))


def pieces(n_slow: int, n_points: int, touched: int) -> Iterator[slice]:
    """Cut slow time as `blocks` does, shorter where a wide pulse touches many bins."""
    return blocks(n_slow, n_points * max(1, touched // 12))
