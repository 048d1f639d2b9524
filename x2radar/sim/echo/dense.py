"""The dense tier: every bin of every scatterer, in float64.

It is the plain form of the echo sum. Its cost does not depend on where echoes lie, and its
error is the rounding of the result alone.
"""

import numpy as np

from x2radar.frame import FastTimeAxis
from x2radar.sim.echo import common
from x2radar.sim.echo.common import Amplitude, Frames, Task
from x2radar.sim.points import Array

FINEST_DB = -130.0  # finer is under float32's rounding
_REACH_SIGMA = 7.0  # beyond it an echo is below 2e-11 and is left out as a whole
_BLOCK_SAMPLES = 1 << 17  # exponentials held at a time: 1 MiB, a core's second-level cache


def frames(range_m: Array, amplitude: Amplitude, task: Task, floor: float) -> Frames:
    """Return frames by the echo sum over all bins; arguments as of `echo.frames`.

    ``sum_k a_k g(x - R_k) exp(-j 4 pi R_k / lambda)`` (2.19), or that on its carrier (2.12).
    Error below 1e-7 of the sum of amplitudes, whatever was asked for.
    """
    axis, sigma_m = task.axis, common.echo_sigma_m(task.axis)
    r, a = _kept(range_m, amplitude, axis, reach_m=_REACH_SIGMA * sigma_m, floor=floor)
    weight = a * np.exp(2j * np.pi * common.carrier_turns(r, axis))
    rows = np.stack([weight.real, weight.imag], axis=1)
    out = common.empty(len(r), axis)
    # The carrier at every bin.
    wave = (
        np.exp(-2j * np.pi * common.carrier_turns(axis.range_m, axis))
        if axis.kind == "rf"
        else None
    )
    size = max(1, _BLOCK_SAMPLES // max(1, r.shape[1] * axis.n_range))
    for at in range(0, len(r), size):
        part = slice(at, at + size)
        since = (axis.range_m - r[part, :, None]) / sigma_m
        since *= since
        since *= -0.5
        real, imag = np.moveaxis(rows[part] @ np.exp(since, out=since), 1, 0)
        if wave is None:
            out[part].real = real
            out[part].imag = imag
        else:
            out[part] = real * wave.real - imag * wave.imag
    return out


def _kept(
    range_m: Array, amplitude: Amplitude, axis: FastTimeAxis, *, reach_m: float, floor: float
) -> tuple[Array, Amplitude]:
    """Return ranges and amplitudes without scatterers that never show."""
    first_m = axis.range_offset_m
    last_m = first_m + (axis.n_range - 1) * axis.bin_length_m
    mask = common.counted(range_m, amplitude, first_m - reach_m, last_m + reach_m, floor)
    if mask.all():
        return range_m, amplitude
    columns = mask.any(axis=0)
    mask = mask[:, columns]
    return (
        np.where(mask, range_m[:, columns], first_m),
        np.where(mask, amplitude[:, columns], 0.0),
    )
