"""Means of frames in a row, made from their steps, for streams faster than needed.

Slow motion needs few frames a second. A mean of n frames before every n-th is left keeps the
noise down as all frames would, and what is too fast for the lower rate is weaker before it
folds (the sinc of the mean; at half the lower rate 3 to 4 dB).
"""

import numpy as np
from numpy.typing import NDArray

from radard.dsp.steps import Flags

Steps = NDArray[np.complex64]


class FrameMeans:
    """Steps of a stream in, steps between the means of `n_mean` frames out; 1 changes nothing.

    With s_m the step from frame m - 1 to m, and y_k the mean of the frames from k n on::

        y_k - y_(k-1) = (1 / n) sum_i (n - |i|) s_(k n + i),   |i| < n
    """

    def __init__(self, n_mean: int) -> None:
        self._n_mean = n_mean
        self._weights = ((n_mean - np.abs(np.arange(1 - n_mean, n_mean))) / n_mean).astype("f4")
        self.restart()

    def restart(self) -> None:
        """Forget all frames."""
        self._steps: Steps | None = None
        self._flags = np.ones(self._n_mean - 1, np.bool_)

    def add(self, steps: Steps, flags: Flags) -> tuple[Steps, Flags]:
        """Take steps, shape (n, n_freq), and flags of the frames that they lead to.

        Return the steps that are whole by now, and False for means with a bad frame; the rest
        waits for the next call.
        """
        n = self._n_mean
        if n == 1:
            return steps, flags
        if self._steps is None:
            # Nothing moved before the first frame.
            self._steps = np.zeros((n - 1, steps.shape[1]), np.complex64)
        waiting = np.concatenate([self._steps, steps])
        good = np.concatenate([self._flags, flags])
        n_out = max(0, (len(waiting) - n + 1) // n)
        out = np.zeros((n_out, steps.shape[1]), np.complex64)
        for i, weight in enumerate(self._weights):
            out += weight * waiting[i : i + n_out * n : n]
        means = np.asarray(good[n - 1 : n - 1 + n_out * n].reshape(n_out, n).all(axis=1), np.bool_)
        self._steps, self._flags = waiting[n_out * n :], good[n_out * n :]
        return out, means
