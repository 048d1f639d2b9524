"""Whether frames keep time: at the rate that was set, and by how little the clocks differ."""

from collections import deque
from dataclasses import dataclass

import numpy as np

_BLOCK_S = 10.0  # ten dwells, of which one is hardly ever late
_MAX_BLOCKS = 360  # an hour: a crystal follows the room's temperature more slowly
_MIN_BLOCKS = 10  # before that, the interval is wider than any crystal's error
_T = 2.31  # Student's t, 95 %, eight degrees of freedom; more have less
_STAMP_S = 1e-3  # that a block's stamps may share: USB polls once a ms (USB 2.0, 5.11)
_STRETCH = 5  # dwells, of a second each: a fault is announced after ten seconds
_MAX_OFF = 0.1  # clocks differ by 1e-4, and speeds by this much do no harm


@dataclass(frozen=True, slots=True)
class Drift:
    """Seconds of the module per second of the host, less one: positive when the module is fast."""

    ratio: float
    uncertainty: float  # half of the 95 % interval, by the delays' scatter about a line


class RateWatch:
    """Compare the frames' clock with the host's, until a gap: how fast it is, and its drift.

    The rate is wrong once two stretches in a row are off alike. The least delay of each block of
    time moves along a line whose slope is the drift (the lower envelope, as NTP's clock filter
    takes it, RFC 5905, section 10); its interval does not hold the host's own error.
    """

    def __init__(self, frame_rate_hz: float | None) -> None:
        self._rate_hz = frame_rate_hz  # None: frames come at any rate, and nothing is compared
        self.reset()

    def reset(self) -> None:
        """Begin again: the stream was interrupted, nobody knows for how long."""
        self.drift: Drift | None = None  # once there are enough arrivals; for any thread
        self._arrivals: deque[tuple[float, float]] = deque(maxlen=2 * _STRETCH + 1)
        self._points: deque[tuple[float, float]] = deque(maxlen=_MAX_BLOCKS)
        self._block = -1
        self._least: tuple[float, float] | None = None

    def note(self, t_s: float, t_mono_s: float) -> str:
        """Take a dwell's end, stream and monotonic seconds (0: unknown); return what is wrong."""
        arrivals = self._arrivals
        arrivals.append((t_s, t_mono_s))
        if not (t_mono_s and self._rate_hz):
            return ""
        self._follow(t_s, t_mono_s - t_s)
        if len(arrivals) <= 2 * _STRETCH:
            return ""
        first, middle, last = arrivals[0], arrivals[_STRETCH], arrivals[-1]
        before, after = _pace(first, middle), _pace(middle, last)
        if max(before, after) >= 1 - _MAX_OFF and min(before, after) <= 1 + _MAX_OFF:
            return ""
        rate_hz = _pace(first, last) * self._rate_hz
        return f"frames come at {rate_hz:.3g} Hz, not at {self._rate_hz:g} Hz: speeds are wrong"

    def _follow(self, t_s: float, late_s: float) -> None:
        block = int(t_s // _BLOCK_S)
        if block != self._block:
            if self._least is not None:
                self._points.append(self._least)
                self.drift = self._fit()
            self._block, self._least = block, (t_s, late_s)
        elif self._least is None or late_s < self._least[1]:
            self._least = t_s, late_s

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


def _pace(a: tuple[float, float], b: tuple[float, float]) -> float:
    return (b[0] - a[0]) / max(1e-9, b[1] - a[1])
