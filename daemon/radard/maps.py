"""Maps as networks see them: velocity-time and range-time, on physical axes, in decibels.

Axes are metres, metres per second and seconds, the same for every frame rate and bin length.
What is shown is shape, not strength: every column of time is set against its own maximum, or
against a level under the dwell's maximum where the column is weaker than that, so that
neither a body's cross section nor its range decides.
"""

import numpy as np
from numpy.typing import NDArray

WEAKEST_COLUMN_DB = 25.0

Map = NDArray[np.float32]


def shown(power: NDArray[np.float64], valid: NDArray[np.bool_], depth_db: float) -> Map:
    """Return a map of power as a picture with values from 0 to 1.

    Parameters
    ----------
    power : ndarray, shape (n_rows, n_cells), float64
        Linear power by time cell, not negative.
    valid : ndarray, shape (n_cells,), bool
        Columns that are known; the others are 0 in the result.
    depth_db : float
        1 is the reference, 0 so many decibels under it and less.

    Returns
    -------
    ndarray, same shape, float32
        All zero where there is no power. Finite for any finite power.
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
