"""The frequencies on which the spectral tier writes echoes: few, and without a wrap.

A Gaussian's tails bound the error on either side: lines beyond the band and range beyond
the period each get half of it.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.sim.echo.common import Array, Pulse
from x2radar.sim.signal.noise import fast_length


@dataclass(frozen=True, slots=True, eq=False)
class SpectralGrid:
    """Frequencies on which an axis' echoes are written."""

    # (n_freq,): the pulse's Fourier coefficients on the period, ascending, half of them below 0.
    weight: NDArray[np.float32]
    # The spectrum repeats in range after this: swath and a pulse's reach on both sides, so that no
    # echo that shows at one end wraps into the other.
    period_m: float
    reference_m: float  # the middle of the swath: every line has the carrier's phase there
    reach_m: float  # how far outside the swath an echo still shows
    n_fft: int  # bins on the period
    n_fold: int  # how much finer the transform must be to hold the band
    n_slow_power: int  # Q of the factorisation
    n_fast_power: int  # r of it; their product is n_freq

    @property
    def n_freq(self) -> int:
        """How many frequencies."""
        return self.weight.size


@lru_cache(maxsize=16)
def grid_for(axis: FastTimeAxis, pulse: Pulse, error_db: float) -> SpectralGrid:
    """Return the frequencies that hold an axis' echoes to within `error_db`."""
    sigma_m = pulse.sigma_m(axis.kind)
    # Half the error to the pulse's tails in range, half to those in frequency.
    tail = math.sqrt(-2 * math.log(10 ** (error_db / 20) / 2))
    reach_m = tail * sigma_m
    n_fft = fast_length(axis.n_range + 2 * math.ceil(reach_m / axis.bin_length_m))
    period_m = n_fft * axis.bin_length_m
    line = 2 * np.pi * sigma_m / period_m  # width of the spectrum: one sigma in 1 / line lines
    n_half = math.ceil(tail / line)
    n_fast = max(1, round(math.sqrt(2 * n_half)))
    n_slow = -(-(2 * n_half + 1) // n_fast)
    i: Array = np.arange(n_slow * n_fast, dtype=np.float64) - n_slow * n_fast // 2
    weight = line / math.sqrt(2 * np.pi) * np.exp(-0.5 * (line * i) ** 2)
    grid = SpectralGrid(
        weight=weight.astype(np.float32),
        period_m=period_m,
        reference_m=axis.range_offset_m + (axis.n_range - 1) / 2 * axis.bin_length_m,
        reach_m=reach_m,
        n_fft=n_fft,
        n_fold=-(-i.size // n_fft),
        n_slow_power=n_slow,
        n_fast_power=n_fast,
    )
    grid.weight.flags.writeable = False
    return grid
