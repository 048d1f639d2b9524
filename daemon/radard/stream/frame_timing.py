"""FrameTiming: when a frame will arrive, from when others did; RateWatch: whether they keep time.

Frames come late or in time, never early: they wait in buffers for their reader. So the least
delayed frame of the last two hops, each by its number, says where in time the stream stands;
two hops, because the module's clock and the host's do not run alike.
"""

import math
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


class ClockDrift:
    """Estimates the drift of the stream's clock against the host's, until a gap.

    The least delay of each stretch of time moves along a line whose slope is the drift (the lower
    envelope, as NTP's clock filter takes it, RFC 5905, section 10). The interval does not hold the
    host's own error.
    """

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


class FrameTiming:
    """Say when a frame is due, by its number."""

    def __init__(self, frame_rate_hz: float) -> None:
        self._rate_hz = frame_rate_hz
        self._lead_s = self._before_s = math.inf

    def note(self, number: int, t_mono_s: float) -> None:
        """Note when a frame arrived, on the host's monotonic clock; 0 is not known."""
        if t_mono_s:
            self._lead_s = min(self._lead_s, t_mono_s - number / self._rate_hz)

    def next_hop(self) -> None:
        """Forget the hop before the last one."""
        self._before_s, self._lead_s = self._lead_s, math.inf

    def reset(self) -> None:
        """Forget everything: the stream has restarted."""
        self._lead_s = self._before_s = math.inf

    def arrival_s(self, number: int) -> float:
        """Return when a frame should arrive, in seconds; infinite while nothing is known."""
        return min(self._lead_s, self._before_s) + number / self._rate_hz


class RateWatch:
    """Compare the frames' rate with the stream's: two stretches in a row must be off alike."""

    def __init__(self, frame_rate_hz: float) -> None:
        self.clock = ClockDrift()  # by how little the two differ where nothing is wrong
        self._rate_hz = frame_rate_hz
        self._points: deque[tuple[float, float]] = deque(maxlen=2 * _STRETCH + 1)

    def reset(self) -> None:
        """Begin again: the stream was interrupted."""
        self._points.clear()
        self.clock.reset()

    def note(self, t_s: float, t_mono_s: float) -> str:
        """Take a dwell's last frame, stream and monotonic seconds; return what is wrong."""
        self.clock.note(t_s, t_mono_s)
        points = self._points
        points.append((t_s, t_mono_s))
        if not t_mono_s or len(points) <= 2 * _STRETCH:
            return ""
        first, middle, last = points[0], points[_STRETCH], points[-1]
        before, after = _pace(first, middle), _pace(middle, last)
        if max(before, after) >= 1 - _MAX_OFF and min(before, after) <= 1 + _MAX_OFF:
            return ""
        rate_hz = _pace(first, last) * self._rate_hz
        return f"frames come at {rate_hz:.3g} Hz, not at {self._rate_hz:g} Hz: speeds are wrong"


def _pace(a: tuple[float, float], b: tuple[float, float]) -> float:
    return (b[0] - a[0]) / max(1e-9, b[1] - a[1])
