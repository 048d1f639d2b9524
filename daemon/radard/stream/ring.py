"""FrameRing: frames in, dwells out, without copying; gaps are marked, never stitched.

The only object that the reader thread and the worker share. Frames are converted a few at a
time, since a call costs more than a frame; the last frame of a dwell never waits for others.
Every row is written twice, a capacity apart, so that any dwell is one contiguous view. The
writer waits before it would overwrite a row that a waiting dwell still needs.
"""

import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis, Frame

Convert = Callable[[NDArray[np.float32] | NDArray[np.complex64], NDArray[np.complex64]], object]

# What may be missing in a dwell: less than moves a map by what noise does.
MAX_LOST = 0.02
MAX_GAP_S = 0.05
_FRAMES_AT_ONCE = 64  # a hop at 60 Hz
# Since somebody looked on, who asks again soon: frames are converted that late, for so long.
_LATE_S = 0.05
_WATCHED_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellShape:
    """Length and hop of the dwells that are cut from the stream."""

    n_slow: int  # frames in a dwell: columns of the spectrogram + frames of a CPI - 1
    hop_s: float  # stream time from one dwell to the next
    frame_rate_hz: float  # of stream time


@dataclass(frozen=True, slots=True, eq=False)
class Dwell:
    """Frames that are judged together, in a view, good until the next `FrameRing.next_item`."""

    frames: NDArray[np.complex64]  # (n_slow, n_range), oldest first; lost rows repeat the last
    valid: NDArray[np.bool_]  # (n_slow,), False for frames that were lost or unusable
    axis: FastTimeAxis  # of the rows
    frame_rate_hz: float
    t_s: float  # stream time at the end of the dwell
    n_lost: int = 0  # rows that are not valid
    longest_gap_s: float = 0.0  # longest run of them
    t_mono_s: float = 0.0  # when the last frame arrived, on the host's clock; 0 in recordings
    end_frame: int = 0  # frames that the ring had taken at its end; 0 for a dwell of its own

    @property
    def is_whole(self) -> bool:
        """Whether so little is missing that the dwell may be judged (at most 2 %, 50 ms)."""
        return self.n_lost <= MAX_LOST * len(self.valid) and self.longest_gap_s <= MAX_GAP_S + 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Recent:
    """Rows that a ring has taken lately, for those who only look on."""

    frames: NDArray[np.complex64]  # (n, n_range), oldest first; a copy
    valid: NDArray[np.bool_]  # (n,), False for frames that were lost or unusable
    end_frame: int  # frames that the ring had taken when these ended
    begun_at: int  # `end_frame` when the stream last began again
    t_s: float  # stream time at the end


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that happened to the stream between two dwells, or that is asked of the worker.

    'restart': counter or device started again; 'lost' and 'found': the device is away, is back;
    'paused', 'moved': a replay stands still, goes on elsewhere; 'silent': nothing comes. What is
    asked of the worker is a `call`, which is given the stream time.
    """

    kind: str
    reason: str  # for people
    t_s: float  # stream time
    call: Callable[[float], object] | None = None


class FrameRing:
    """Collect converted frames; hand out a dwell every hop, behind a gap the first whole one.

    ``convert(samples, out)`` writes the baseband of frames, shape (n, n_samples), into as many
    rows, whose axis is `axis`; each frame's must not depend on those beside it.
    """

    def __init__(self, axis: FastTimeAxis, convert: Convert, shape: DwellShape) -> None:
        self.axis = axis  # of the converted rows
        self.frame_rate_hz = shape.frame_rate_hz  # frames per second of stream time
        self._convert = convert
        self._shape = shape
        self._capacity = shape.n_slow + 2 * max(1, round(shape.hop_s * shape.frame_rate_hz)) + 8
        self._rows = np.zeros((2 * self._capacity, axis.n_range), np.complex64)
        self._valid = np.zeros(2 * self._capacity, np.bool_)
        self._changed = threading.Condition()
        self._queue: deque[Dwell | Notice] = deque()
        self._held_from: int | None = None
        self._ended = self._stopped = False
        self._samples: NDArray[np.float32] | NDArray[np.complex64] = np.zeros((0, 0), np.float32)
        self._is_here = np.zeros(_FRAMES_AT_ONCE, np.bool_)
        self._index = -1
        self._converted = (0, -1)
        self._max_watched = min(_FRAMES_AT_ONCE, max(1, round(_LATE_S * shape.frame_rate_hz)))
        # The first frame is a restart: it sets when a dwell is due.
        self._taken = self._n_waiting = self._watched_to = 0
        self._base = self._origin = self._due = self._hops = 0
        self.on_item: Callable[[], object] = lambda: None
        """Called when there is something to take, also the end; from any thread."""
        # Arrival of frame 0 by the least delayed one, of this hop and of the one before.
        self._lead_s = self._before_s = math.inf

    def due_s(self) -> float:
        """Return when the next dwell's last frame should arrive; infinite while that is not known.

        Frames come late or in time, never early: they wait in buffers for their reader. So the
        least delayed frame of the last two hops says where in time the stream stands; two hops,
        because the module's clock and the host's do not run alike.
        """
        return min(self._lead_s, self._before_s) + self._due / self.frame_rate_hz

    @property
    def n_left(self) -> int:
        """Frames until the next dwell is whole; 1 while somebody looks on, who waits for each."""
        return max(1, self._due - self._taken) if self._taken >= self._watched_to else 1

    def recent(self, after: int = 0, *, is_live: bool = True) -> Recent:
        """Return the rows behind number `after` that are still there; for any thread, no lock."""
        # Frames then wait for few others.
        if is_live:
            self._watched_to = self._taken + round(_WATCHED_S * self.frame_rate_hz)
        begun_at, (end, index) = self._base, self._converted
        first = min(max(after, begun_at, end - self._capacity), end)
        at = first % self._capacity
        rows = self._rows[at : at + end - first].copy()
        valid = self._valid[at : at + end - first].copy()
        torn = max(0, self._taken - self._capacity - first)
        t_s = (index + 1) / self.frame_rate_hz
        return Recent(rows[torn:], valid[torn:], end, begun_at, t_s)

    def push(self, frame: Frame) -> bool:
        """Add the next frame; wait while the worker is behind. False once none is wanted."""
        return all(self._steps(frame))

    def items(self, frame: Frame) -> Iterator[Dwell | Notice]:
        """Push a frame and yield what it completes, where reader and worker are one thread."""
        for _ in self._steps(frame):
            while self._queue:
                if (item := self.next_item()) is not None:
                    yield item

    def dwells(self, frames: Iterable[Frame]) -> Iterator[Dwell]:
        """Push frames and yield the dwells that they complete, as `items`."""
        for frame in frames:
            yield from (item for item in self.items(frame) if isinstance(item, Dwell))

    def _steps(self, frame: Frame) -> Iterator[bool]:
        """Add the frames lost before one and itself; yield for each whether more are wanted."""
        if frame.restarted or self._taken == 0:
            if self._taken:
                self.post("restart", f"the frame counter jumped to {frame.counter}")
            self._convert_waiting()
            # Rows that waiting dwells still need stay where they are: the schedule starts again.
            self._base = self._origin = self._taken
            self._lead_s = self._before_s = math.inf
            self._hops = 0
            self._due = self._origin + self._shape.n_slow
        else:
            for _ in range(frame.lost):
                self._index += 1
                yield self._add(None, 0.0)
        self._index = frame.index
        if frame.t_mono_s:
            begun_s = frame.t_mono_s - (self._taken + 1) / self.frame_rate_hz
            self._lead_s = min(self._lead_s, begun_s)
        yield self._add(frame.samples, frame.t_mono_s)

    def post(
        self, kind: str, reason: str = "", call: Callable[[float], object] | None = None
    ) -> None:
        """Queue a notice for the worker."""
        t_s = (self._index + 1) / self.frame_rate_hz
        self._put(Notice(kind, reason, t_s, call))

    def end(self) -> None:
        """Tell the worker that nothing more will come."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self.on_item()

    def _put(self, item: Dwell | Notice) -> None:
        with self._changed:
            self._queue.append(item)
            self._changed.notify_all()
        self.on_item()

    def stop(self) -> None:
        """Tell the reader that nothing more is wanted, and free it if it waits."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def next_item(self, timeout_s: float | None = None) -> Dwell | Notice | None:
        """Return the next dwell or notice; None at the end of the stream.

        The dwell taken before is given back by this call, and its frames may be overwritten from
        here on. Raises TimeoutError if nothing came within `timeout_s`.
        """
        with self._changed:
            self._held_from = None
            self._changed.notify_all()
            if not self._changed.wait_for(lambda: self._queue or self._ended, timeout_s):
                raise TimeoutError
            if not self._queue:
                return None
            item = self._queue.popleft()
            if isinstance(item, Dwell):
                self._held_from = item.end_frame - self._shape.n_slow
            return item

    def _add(
        self, samples: NDArray[np.float32] | NDArray[np.complex64] | None, t_mono_s: float
    ) -> bool:
        if self._stopped:
            return False
        if samples is not None:
            like = self._samples
            if samples.shape != like.shape[1:] or samples.dtype != like.dtype:
                if not self._convert_waiting():
                    return False
                self._samples = np.zeros((_FRAMES_AT_ONCE, *samples.shape), samples.dtype)
            self._samples[self._n_waiting] = samples
        self._is_here[self._n_waiting] = samples is not None
        self._n_waiting += 1
        self._taken += 1
        is_due = self._taken == self._due
        at_once = self._max_watched if self._taken < self._watched_to else _FRAMES_AT_ONCE
        is_full = self._n_waiting >= at_once or self._taken % self._capacity == 0
        if (is_due or is_full) and not self._convert_waiting():
            return False
        if is_due:
            self._emit(t_mono_s)
        return True

    def _convert_waiting(self) -> bool:
        """Write the rows of the frames that wait; return False once the worker has stopped."""
        n, self._n_waiting = self._n_waiting, 0
        if n == 0:
            return True
        with self._changed:
            self._changed.wait_for(self._may_write)
            if self._stopped:
                return False
        first = self._taken - n
        at = first % self._capacity
        rows, good = self._rows[at : at + n], self._is_here[:n].copy()
        if good.any():
            samples = self._samples[:n]
            good &= np.isfinite(samples).all(axis=1)
            if not good.all():
                samples[~good] = 0
            self._convert(samples, rows)
        for k in np.flatnonzero(~good).tolist():
            rows[k] = self._rows[(first + k - 1) % self._capacity] if first + k else 0
        copies = slice(at + self._capacity, at + self._capacity + n)
        self._rows[copies] = rows
        self._valid[at : at + n] = self._valid[copies] = good
        self._converted = (self._taken, self._index)
        return True

    def _may_write(self) -> bool:
        needed = self._held_from
        if needed is None:
            ends = (item.end_frame for item in self._queue if isinstance(item, Dwell))
            needed = next((end - self._shape.n_slow for end in ends), None)
        return self._stopped or needed is None or self._taken <= needed + self._capacity

    def _emit(self, t_mono_s: float) -> None:
        rate_hz, end = self.frame_rate_hz, self._taken
        first = end - self._shape.n_slow
        at = first % self._capacity
        rows = self._rows[at : at + self._shape.n_slow]
        valid = self._valid[at : at + self._shape.n_slow].copy()
        gaps = [len(list(run)) for is_here, run in groupby(valid.tolist()) if not is_here]
        t_s, gap_s = (self._index + 1) / rate_hz, max(gaps, default=0) / rate_hz
        dwell = Dwell(rows, valid, self.axis, rate_hz, t_s, sum(gaps), gap_s, t_mono_s, end)
        self._before_s, self._lead_s = self._lead_s, math.inf
        # The next dwell is due a hop later, or is the first whole one behind a gap.
        self._hops += 1
        if not dwell.is_whole:
            behind = first + int(np.flatnonzero(~valid)[-1]) + 1
            if behind - first < round(self._shape.hop_s * self.frame_rate_hz):
                self._origin, self._hops = behind, 0
        ahead = round(self._hops * self._shape.hop_s * self.frame_rate_hz)
        self._due = self._origin + self._shape.n_slow + ahead
        self._put(dwell)
