"""The fast median of small arrays: numpy's own costs 50 us a call and 50 ms at the first one."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Real = TypeVar("Real", np.float32, np.float64)


def median(values: NDArray[Real]) -> NDArray[Real]:
    """Return the median along the last axis, as `numpy.median` gives it to the bit; no NaN."""
    n = values.shape[-1]
    if n % 2:
        return np.asarray(np.partition(values, n // 2, axis=-1)[..., n // 2])
    middle = np.partition(values, (n // 2 - 1, n // 2), axis=-1)[..., n // 2 - 1 : n // 2 + 1]
    return np.asarray(middle.mean(axis=-1))
