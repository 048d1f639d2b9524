"""The dense tier: every bin of every scatterer, in float64.

It is the plain form of the echo sum. Its cost does not depend on where echoes lie, and its
error is the rounding of the result alone.
"""

import numpy as np

from x2radar.frame import Samples
from x2radar.sim.echo import common
from x2radar.sim.echo.common import Task
from x2radar.sim.points import Array

FINEST_DB = -130.0  # finer is under float32's rounding
_REACH_SIGMA = 7.0  # beyond it an echo is below 2e-11 and is left out as a whole
_BLOCK_SAMPLES = 1 << 17  # exponentials held at a time: 1 MiB, a core's second-level cache


def frames(range_m: Array, amplitude: Array, task: Task, floor: float) -> Samples:
    """Return frames by the echo sum over all bins; arguments as of `echo.frames`.

    ``sum_k a_k g(x - R_k) exp(-j 4 pi R_k / lambda)`` (2.19), or that on its carrier (2.12).
    Error below 1e-7 of the sum of amplitudes, whatever was asked for.
    """
    axis, sigma_m = task.axis, common.echo_sigma_m(task.axis)
    reach_m, (first_m, last_m) = _REACH_SIGMA * sigma_m, axis.range_m[[0, -1]]
    mask = common.counted(range_m, amplitude, first_m - reach_m, last_m + reach_m, floor)
    if not mask.all():
        # Scatterers that never show are left out.
        columns = mask.any(axis=0)
        mask = mask[:, columns]
        range_m = np.where(mask, range_m[:, columns], first_m)
        amplitude = np.where(mask, amplitude[:, columns], 0.0)
    weight = amplitude * np.exp(2j * np.pi * common.carrier_turns(range_m, axis))
    rows = np.stack([weight.real, weight.imag], axis=1)
    out = common.empty(len(range_m), axis)
    wave = np.exp(-2j * np.pi * common.carrier_turns(axis.range_m, axis))  # the carrier
    size = max(1, _BLOCK_SAMPLES // max(1, range_m.shape[1] * axis.n_range))
    for at in range(0, len(range_m), size):
        part = slice(at, at + size)
        since = (axis.range_m - range_m[part, :, None]) / sigma_m
        since *= since
        since *= -0.5
        real, imag = np.moveaxis(rows[part] @ np.exp(since, out=since), 1, 0)
        if axis.kind == "rf":
            out[part] = real * wave.real - imag * wave.imag
        else:
            out[part].real, out[part].imag = real, imag
    return out
