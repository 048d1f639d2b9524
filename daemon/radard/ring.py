"""FrameRing: frames in, dwells out, without copying; gaps are marked, never stitched.

The only object that the reader thread and the worker share. Every row is written twice, a
capacity apart, so that any dwell is one contiguous view. The writer waits before it would
overwrite a row that a waiting dwell still needs.
"""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis, Frame

Convert = Callable[[NDArray[np.float32] | NDArray[np.complex64], NDArray[np.complex64]], object]

MOST_LOST = 0.02
LONGEST_GAP_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellShape:
    """How dwells are cut from the stream.

    Attributes
    ----------
    n_slow : int
        Frames in a dwell: columns of the spectrogram + frames of a CPI - 1.
    hop_s : float
        Stream time from one dwell to the next, in seconds.
    frame_rate_hz : float
        Frames per second of stream time.
    """

    n_slow: int
    hop_s: float
    frame_rate_hz: float

    @classmethod
    def of(cls, *, dwell_s: float, hop_s: float, frame_rate_hz: float, n_cpi: int) -> "DwellShape":
        """Return the shape whose spectrogram has `dwell_s` of columns, CPIs of `n_cpi`."""
        n_columns = max(2, round(dwell_s * frame_rate_hz))
        return cls(n_slow=n_columns + n_cpi - 1, hop_s=hop_s, frame_rate_hz=frame_rate_hz)


@dataclass(frozen=True, slots=True, eq=False)
class Dwell:
    """The block of frames that is judged together.

    Attributes
    ----------
    frames : ndarray, shape (n_slow, n_range), complex64
        Baseband, oldest first; a view that is good until the next `FrameRing.take`. A lost
        frame's row repeats the one before it.
    valid : ndarray, shape (n_slow,), bool
        False for frames that were lost or unusable.
    axis : FastTimeAxis
        Axis of the rows.
    frame_rate_hz : float
        Frames per second.
    t_s : float
        Stream time at the end of the dwell, in seconds.
    n_lost : int
        Rows that are not valid.
    longest_gap_s : float
        Longest run of them, in seconds.
    t_mono_s : float
        When the last frame arrived, on the host's monotonic clock; 0 in recordings.
    end_frame : int
        Frames that the ring had taken when this dwell ended: the difference of two dwells'
        numbers is how many frames are new in the later one. 0 for a dwell of its own.
    """

    frames: NDArray[np.complex64]
    valid: NDArray[np.bool_]
    axis: FastTimeAxis
    frame_rate_hz: float
    t_s: float
    n_lost: int = 0
    longest_gap_s: float = 0.0
    t_mono_s: float = 0.0
    end_frame: int = 0

    @property
    def is_whole(self) -> bool:
        """Whether so little is missing that the dwell may be judged (at most 2 %, 50 ms)."""
        return (
            self.n_lost <= MOST_LOST * len(self.valid)
            and self.longest_gap_s <= LONGEST_GAP_S + 1e-9
        )


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that happened to the stream between two dwells.

    Attributes
    ----------
    kind : {'restart', 'lost', 'found'}
        The counter or device started anew; the device is away; it is back.
    reason : str
        For people.
    t_s : float
        Stream time, in seconds.
    """

    kind: str
    reason: str
    t_s: float


class FrameRing:
    """Collect converted frames; hand out a dwell every hop.

    Parameters
    ----------
    axis : FastTimeAxis
        Axis of the converted rows.
    convert : callable
        ``convert(samples, out)`` writes one frame's baseband into a row.
    shape : DwellShape
        Length of the dwells and the hop.
    """

    def __init__(self, axis: FastTimeAxis, convert: Convert, shape: DwellShape) -> None:
        self._axis = axis
        self._convert = convert
        self._shape = shape
        self._capacity = shape.n_slow + 2 * max(1, round(shape.hop_s * shape.frame_rate_hz)) + 8
        self._rows = np.zeros((2 * self._capacity, axis.n_range), np.complex64)
        self._valid = np.zeros(2 * self._capacity, np.bool_)
        self._changed = threading.Condition()
        self._queue: deque[tuple[int, Dwell] | Notice] = deque()
        self._held_from: int | None = None
        self._ended = False
        self._stopped = False
        self._written = 0
        self._index = -1
        self._base = 0
        self._due = 0
        self._hops = 0
        self.n_unusable = 0
        self._schedule(0)

    def push(self, frame: Frame) -> bool:
        """Add a frame; wait while the worker is too far behind.

        Parameters
        ----------
        frame : Frame
            The next frame of the stream. Frames lost before it become invalid rows; a
            restart empties the ring. A frame that is not finite counts as lost.

        Returns
        -------
        bool
            False once the worker has stopped: no further frame is wanted.
        """
        if frame.restarted or self._written == 0:
            self._restart(frame)
        else:
            for _ in range(frame.lost):
                self._index += 1
                if not self._add(None, 0.0):
                    return False
        self._index = frame.index
        finite = bool(np.isfinite(frame.samples).all())
        self.n_unusable += not finite
        return self._add(frame if finite else None, frame.t_mono_s)

    def post(self, kind: str, reason: str) -> None:
        """Queue a notice for the worker."""
        with self._changed:
            self._queue.append(Notice(kind, reason, (self._index + 1) / self._shape.frame_rate_hz))
            self._changed.notify_all()

    def end(self) -> None:
        """Tell the worker that nothing more will come."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def stop(self) -> None:
        """Tell the reader that nothing more is wanted, and free it if it waits."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def take(self, timeout_s: float | None = None) -> Dwell | Notice | None:
        """Return the next dwell or notice; None at the end of the stream.

        The dwell taken before is given back by this call, and its frames may be
        overwritten from here on.

        Raises
        ------
        TimeoutError
            If nothing came within `timeout_s`.
        """
        with self._changed:
            self._held_from = None
            self._changed.notify_all()
            if not self._changed.wait_for(lambda: self._queue or self._ended, timeout_s):
                raise TimeoutError
            if not self._queue:
                return None
            item = self._queue.popleft()
            if isinstance(item, Notice):
                return item
            self._held_from, dwell = item
            return dwell

    def _restart(self, frame: Frame) -> None:
        if self._written:
            self.post("restart", f"the frame counter jumped to {frame.counter}")
        # Rows that waiting dwells still need stay where they are: only the schedule starts anew.
        self._base = self._written
        self._hops = 0
        self._schedule(0)

    def _schedule(self, hop: int) -> None:
        ahead = round(hop * self._shape.hop_s * self._shape.frame_rate_hz)
        self._due = self._base + self._shape.n_slow + ahead

    def _add(self, frame: Frame | None, t_mono_s: float) -> bool:
        at = self._written % self._capacity
        with self._changed:
            self._changed.wait_for(self._may_write)
            if self._stopped:
                return False
        row = self._rows[at]
        if frame is not None:
            self._convert(frame.samples, row)
        elif self._written:
            row[:] = self._rows[(self._written - 1) % self._capacity]
        self._rows[at + self._capacity] = row
        self._valid[at] = self._valid[at + self._capacity] = frame is not None
        self._written += 1
        if self._written == self._due:
            self._emit(t_mono_s)
        return True

    def _may_write(self) -> bool:
        if self._stopped:
            return True
        needed = self._held_from
        if needed is None:
            needed = next((q[0] for q in self._queue if isinstance(q, tuple)), None)
        return needed is None or self._written < needed + self._capacity

    def _emit(self, t_mono_s: float) -> None:
        first = self._written - self._shape.n_slow
        at = first % self._capacity
        rows = self._rows[at : at + self._shape.n_slow]
        valid = self._valid[at : at + self._shape.n_slow].copy()
        rate_hz = self._shape.frame_rate_hz
        dwell = Dwell(
            rows,
            valid,
            self._axis,
            rate_hz,
            (self._index + 1) / rate_hz,
            int(np.count_nonzero(~valid)),
            _longest_run(~valid) / rate_hz,
            t_mono_s,
            self._written,
        )
        self._hops += 1
        self._schedule(self._hops)
        with self._changed:
            self._queue.append((first, dwell))
            self._changed.notify_all()


def _longest_run(flags: NDArray[np.bool_]) -> int:
    if not flags.any():
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max())
