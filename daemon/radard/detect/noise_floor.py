"""NoiseFloor: the receiver's noise per range bin, learned from a stream with people in it.

The common level is the least of the dwells in memory, since a target can only add to it. The shape
over range is learned only from bins that hold stationary white noise, as the median over a quarter
of the swath, which no body fills.
"""

from collections import deque
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radard.dsp.clutter import noise_of, noise_profile

_GAIN = 0.2  # of a step towards what a dwell shows: five dwells' memory
_SIGMAS = 4.0  # of a CPI's power, within which a bin counts as noise
_SPAN_DB = (-10.0, 20.0)  # of the shape: wider than any receiver's
_MAX_MEMBERS = 24  # of a median: more cost time and tell little


class NoiseFloor:
    """Follow one stream's noise, in bounded dB, by the least level of `n_memory` dwells."""

    def __init__(self, n_memory: int, most_db_per_dwell: float) -> None:
        self._levels: deque[float] = deque(maxlen=n_memory)
        self._most_db = most_db_per_dwell
        self._shape_db: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Forget all levels and the shape over range, as for a new stream."""
        self._levels.clear()
        self._shape_db = None

    def update(
        self, cells: NDArray[np.float32], cpi_power: NDArray[np.float64], n_cpi: int, unit: float
    ) -> tuple[float, NDArray[np.float64]]:
        """Learn from one dwell; return the common level and every bin's noise, shape (n_range,).

        Of `second_differences`, and the residual power of the same rows, shape (n_cpis, n_range);
        `unit` is sample units squared for one unit of the two. Noise is in sample units squared,
        zero in bins that do not change at all.
        """
        here = noise_of(cells)
        if np.isfinite(here):
            self._levels.append(here * unit)
        level = min(self._levels, default=0.0)
        live = cells.any(axis=0)
        first = self._shape_db is None
        shape_db = np.zeros(cells.shape[1]) if self._shape_db is None else self._shape_db
        if here > 0 and len(cpi_power):
            own = np.maximum(noise_profile(cells), np.finfo(np.float32).tiny)
            most = 1 + _SIGMAS / np.sqrt(n_cpi - 1)
            is_noise = (cpi_power < most * own).all(axis=0) & (cpi_power > own / most).all(axis=0)
            own_db = 10 * np.log10(own / here)
            step_db = _rolling_median(np.where(is_noise, own_db, shape_db)) - shape_db
            if not first:
                step_db = np.clip(_GAIN * step_db, -self._most_db, self._most_db)
            shape_db = np.clip(shape_db + step_db, *_SPAN_DB)
            self._shape_db = shape_db
        return level, level * 10 ** (shape_db / 10) * live


def _rolling_median(shape_db: NDArray[np.float64]) -> NDArray[np.float64]:
    windows = _windows(len(shape_db))
    k = (windows.shape[1] - 1) // 2
    return np.asarray(np.partition(shape_db[windows], k, axis=1)[:, k])


@lru_cache(maxsize=8)
def _windows(n_range: int) -> NDArray[np.intp]:
    """Return at most `_MAX_MEMBERS` bins about every bin, shape (n_range, odd)."""
    half = n_range // 8
    step = max(1, -(-2 * half // _MAX_MEMBERS))
    reach = half // step
    offsets = np.arange(-reach, reach + 1) * step
    bins = np.arange(n_range)[:, None] + offsets
    # Mirrored at the ends, so that every window has as many members.
    bins = np.abs(bins)
    bins = np.asarray(np.where(bins > n_range - 1, 2 * (n_range - 1) - bins, bins))
    bins.flags.writeable = False
    return bins
