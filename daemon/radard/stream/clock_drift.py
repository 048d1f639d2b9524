"""ClockDrift: how much faster than the host's clock the module's runs, and how sure that is.

The least delay of each stretch of time moves along a line whose slope is the drift (the lower
envelope, as NTP's clock filter takes it, RFC 5905, section 10). The interval does not hold the
host's own error.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

_BLOCK_S = 10.0  # ten dwells, of which one is hardly ever late
_MAX_BLOCKS = 360  # an hour: a crystal follows the room's temperature more slowly
_MIN_BLOCKS = 10  # before that, the interval is wider than any crystal's error
_T = 2.31  # Student's t, 95 %, eight degrees of freedom; more have less
_STAMP_S = 1e-3  # that a block's stamps may share: USB polls once a ms (USB 2.0, 5.11)


@dataclass(frozen=True, slots=True)
class Drift:
    """Seconds of the module per second of the host, less one: positive when the module is fast."""

    ratio: float
    uncertainty: float  # half of the 95 % interval, by the delays' scatter about a line


class ClockDrift:
    """Estimates the drift of the stream's clock against the host's, until a gap."""

    def __init__(self) -> None:
        self.estimate: Drift | None = None  # once there are enough arrivals; for any thread
        self._points: deque[tuple[float, float]] = deque(maxlen=_MAX_BLOCKS)
        self._block = -1
        self._least: tuple[float, float] | None = None

    def reset(self) -> None:
        """Begin again: the stream was interrupted, nobody knows for how long."""
        self.estimate, self._least, self._block = None, None, -1
        self._points.clear()

    def note(self, t_s: float, t_mono_s: float) -> None:
        """Take when a dwell's last frame, at stream time `t_s`, arrived; 0 is not known."""
        if not t_mono_s:
            return
        block, point = int(t_s // _BLOCK_S), (t_s, t_mono_s - t_s)
        if block != self._block:
            if self._least is not None:
                self._points.append(self._least)
                self.estimate = self._fit()
            self._block, self._least = block, point
        elif self._least is None or point[1] < self._least[1]:
            self._least = point

    def _fit(self) -> Drift | None:
        if len(self._points) < _MIN_BLOCKS:
            return None
        t_s, lag_s = np.array(self._points).T
        t_s, lag_s = t_s - t_s.mean(), lag_s - lag_s.mean()
        spread = float(t_s @ t_s)
        slope = float(t_s @ lag_s) / spread
        rest = lag_s - slope * t_s
        scatter = float(np.sqrt((rest @ rest) / (len(rest) - 2) / spread))
        shared = _STAMP_S / float(t_s[-1] - t_s[0])
        return Drift(1.0 / (1.0 + slope) - 1.0, _T * scatter + shared)
