"""Maps as networks see them: velocity-time and range-time, on physical axes, in decibels.

What is shown is shape, not strength: every column of time is set against its own maximum, or
against a level under the dwell's maximum where it is weaker than that.
"""

import numpy as np
from numpy.typing import NDArray

WEAKEST_COLUMN_DB = 25.0  # weaker columns stay dark: the maps' own depth

Map = NDArray[np.float32]


def shown(power: NDArray[np.float64], valid: NDArray[np.bool_], depth_db: float) -> Map:
    """Return a map of power as a picture with values from 0 to 1, same shape, float32.

    `power` is linear, shape (n_rows, n_cells); columns that are not `valid` are 0 in the result. 1
    is the reference, 0 `depth_db` under it and less. All zero where there is no power, or none
    that is finite. Error at most 1e-6 against extended precision, for powers from 1e-320 to 1e300.
    """
    out = np.zeros(power.shape, np.float32)
    known = np.where(valid, power, 0.0)
    top = float(known.max(initial=0.0))
    if not 0 < top < np.inf:
        return out
    share = known / top
    column = np.maximum(share.max(axis=0), 10 ** (-WEAKEST_COLUMN_DB / 10))
    level_db = 10 * np.log10(np.maximum(share / column, 1e-12))
    np.clip(1 + level_db / depth_db, 0, 1, out=out, casting="unsafe")
    out[:, ~valid] = 0
    return out


def busiest_rows(power: NDArray[np.float64], n_rows: int) -> NDArray[np.float64]:
    """Return a copy of the `n_rows` neighbouring rows in which most moves, the nearest of equals.

    Every column counts the same: rows are chosen by the mean of each row's share of its
    column, so one strong moment does not decide. A map with fewer rows is filled up with
    empty ones behind its last.
    """
    n_all = len(power)
    if n_all <= n_rows:
        return np.concatenate([power, np.zeros((n_rows - n_all, power.shape[1]))])
    peak = power.max(axis=0, initial=0.0)
    share = np.divide(power, peak, out=np.zeros_like(power), where=peak > 0).mean(axis=1)
    sums = np.concatenate([[0.0], np.cumsum(share)])
    first = int(np.argmax(sums[n_rows:] - sums[:-n_rows]))
    return power[first : first + n_rows].copy()
