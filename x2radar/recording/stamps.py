"""From time stamps to frame counters, for formats that do not count frames."""

import numpy as np
from numpy.typing import NDArray


def count_by_stamps(stamp_s: NDArray[np.float64]) -> tuple[NDArray[np.uint32], float]:
    """Return counters, from 1, with the losses that stamps show, (n,), n >= 2, and the period."""
    stamp = stamp_s - stamp_s[0]
    gaps = np.diff(stamp)
    period_s = float(np.median(gaps))
    if not (np.isfinite(stamp).all() and period_s > 0 and stamp[-1] > 0):
        return np.arange(1, stamp.size + 1, dtype=np.uint32), float("nan")
    # First guess, stamp by stamp: a wrong period does not add up over the recording.
    room = np.concatenate([[0], np.cumsum(np.rint(gaps / period_s))]) - np.arange(stamp.size)
    index = _with_losses(room)
    for _ in range(3):
        period_s = float(np.polyfit(index, stamp, 1)[0])
        if not period_s > 0:
            return np.arange(1, stamp.size + 1, dtype=np.uint32), float("nan")
        index = _with_losses(np.rint(stamp / period_s) - np.arange(stamp.size))
    return (index + 1).astype(np.uint32), period_s


def _with_losses(room: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return frame numbers, from 0, for the room that each stamp leaves before it."""
    lost = np.minimum.accumulate(room[::-1])[::-1]
    index: NDArray[np.int64] = np.arange(room.size) + np.maximum(lost - lost[0], 0).astype(
        np.int64
    )
    return index
