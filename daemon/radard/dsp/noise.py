"""The receiver's noise, from the frames alone, with or without a target in them.

Second differences along slow time leave noise (six times its power) and little of anything
slow: static clutter and its drift are gone exactly or nearly.
"""

import numpy as np
from numpy.typing import NDArray

from radard.dsp.clutter import Flags

_LOW_QUANTILE = 0.1  # a target fills far less than nine tenths of the cells
# An exponential variable's quantile q lies at -ln(1 - q) of its mean.
_TO_MEAN = -1 / np.log1p(-_LOW_QUANTILE)
_SECOND_DIFFERENCE_GAIN = 6.0  # 1 + 4 + 1, of the power of white noise


def second_differences(rows: NDArray[np.complex64], usable: Flags) -> NDArray[np.float32]:
    """Return |y[t+1] - 2 y[t] + y[t-1]|^2 / 6 of `sound_rows`, float32, (n_triples, n_range)."""
    good = usable[2:] & usable[1:-1] & usable[:-2]
    step = rows[1:] - rows[:-1]
    second = step[1:] - step[:-1]
    if not good.all():
        second = second[good]
    parts = second.view(np.float32)
    parts *= np.float32(_SECOND_DIFFERENCE_GAIN**-0.5)
    np.square(parts, out=parts)
    return np.asarray(parts[:, ::2] + parts[:, 1::2])


def noise_of(cells: NDArray[np.float32]) -> float:
    """Return the noise power per live bin and frame of cells from `second_differences`.

    The low quantile of all cells is hardly moved by a target, which fills few of them; for
    noise alone it is unbiased. NaN without cells, 0 where nothing changes at all.
    """
    if len(cells) == 0:
        return float("nan")
    live = cells.any(axis=0)
    if not live.all():
        cells = cells[:, live]
    if cells.size == 0:
        return 0.0
    flat = cells.ravel()
    k = int(_LOW_QUANTILE * (flat.size - 1))
    return float(np.partition(flat, k)[k] * _TO_MEAN)


def noise_profile(cells: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the noise power of every bin by itself, from cells of `second_differences`.

    Shape (n_range,), float64; NaN when there are no cells. It is the median over time, scaled to
    the mean of noise: a target that stays less than half of the time in a bin hardly moves it.
    About 15 % of scatter for two seconds at 60 Hz.
    """
    if len(cells) == 0:
        return np.full(cells.shape[1], np.nan)
    k = (len(cells) - 1) // 2
    # Bins in rows: along the first axis it takes twice as long.
    middle = np.partition(np.ascontiguousarray(cells.T), k, axis=1)[:, k]
    return np.asarray(middle / np.log(2), np.float64)
