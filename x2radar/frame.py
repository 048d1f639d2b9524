"""Frame: one fast-time record with its axes, and the counter that orders frames.

Owns the unwrapping of the module's frame counter. A lost, repeated or restarted count is
stated, never hidden: `CounterTracker` says for every frame how many are missing before it.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

Kind = Literal["rf", "baseband"]
Samples = NDArray[np.float32] | NDArray[np.complex64]
"""Of frames: RF, or complex baseband."""

SPEED_OF_LIGHT_MPS = 299_792_458.0
LONGEST_GAP = 36_000
"""More missing frames than this are a restart of the module: ten minutes at 60 Hz."""

_WRAP = 1 << 32  # the module counts in 32 bits


@dataclass(frozen=True, slots=True, kw_only=True)
class FastTimeAxis:
    """Ranges of a frame's samples, and the radar's carrier, bandwidth and rate."""

    kind: Kind
    """Real samples at the RF sampling rate, or complex baseband."""
    n_range: int
    """Range bins in a frame."""
    bin_length_m: float
    """Range of one bin, in metres."""
    range_offset_m: float
    """Range of bin 0, in metres."""
    carrier_hz: float
    """Centre frequency of the pulse, in hertz."""
    bandwidth_hz: float = 0.0
    """Bandwidth of the pulse at -10 dB, in hertz; 0 when unknown."""
    sample_rate_hz: float = 0.0
    """Rate of the RF sampler, in hertz; 0 when unknown."""
    phase_sign: int = -1
    """-1 when the baseband phase falls with range, exp(-j 4 pi R / lambda); +1 otherwise."""

    @property
    def range_m(self) -> NDArray[np.float64]:
        """Range of every bin, in metres: ndarray, shape (n_range,), float64, read-only."""
        bins = np.arange(self.n_range, dtype=np.float64)
        axis: NDArray[np.float64] = self.range_offset_m + self.bin_length_m * bins
        axis.flags.writeable = False
        return axis


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One fast-time record from the module."""

    samples: Samples
    """The echo per range bin, shape (n_range,), in the module's own unit; read-only."""
    counter: int
    """Frame number as the module counts it."""
    index: int
    """Unwrapped number since the stream's first frame, lost frames included; from 0."""
    lost: int
    """Frames missing directly before this one."""
    restarted: bool
    """The counter jumped in a way that no loss explains: how much time passed is unknown."""
    axis: FastTimeAxis
    t_mono_s: float = 0.0
    """Host's monotonic clock when the frame was complete, in seconds; 0 in recordings."""


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """What holds for every frame of a stream."""

    axis: FastTimeAxis
    frame_rate_hz: float
    """Frames per second of stream time."""
    device: str
    """What sends the frames, for people."""
    run_id: str = ""
    """What tells this run of the module from all others; recordings keep it. Empty: unknown."""


class Step(Enum):
    """How a frame's counter follows the one before."""

    FIRST = "first"
    NEXT = "next"
    GAP = "gap"
    REPEAT = "repeat"
    RESTART = "restart"


class CounterTracker:
    """Unwrap a 32-bit frame counter and name every irregularity; None as `last` is a new start."""

    def __init__(self) -> None:
        self.last: int | None = None
        self.index = -1

    def update(self, counter: int) -> tuple[Step, int]:
        """Take a frame's counter; return how it follows, and how many are missing (`Step.GAP`)."""
        last, self.last = self.last, counter
        if last is None:
            self.index += 1
            return Step.RESTART if self.index else Step.FIRST, 0
        ahead = (counter - last) % _WRAP
        if ahead == 0:
            return Step.REPEAT, 0
        if ahead - 1 > LONGEST_GAP:
            self.index += 1
            return Step.RESTART, 0
        self.index += ahead
        return (Step.NEXT, 0) if ahead == 1 else (Step.GAP, ahead - 1)


@dataclass(slots=True)
class FrameCounts:
    """Frames by their counters: how many, and what is missing between them."""

    n_frames: int = 0
    lost: int = 0
    gaps: int = 0
    longest_gap: int = 0
    restarts: int = 0
    repeats: int = 0
    tracker: CounterTracker = field(default_factory=CounterTracker)

    def add(self, counter: int) -> None:
        """Count the frame just received."""
        step, lost = self.tracker.update(counter)
        self.n_frames += 1
        self.lost, self.longest_gap = self.lost + lost, max(self.longest_gap, lost)
        self.gaps += step is Step.GAP
        self.restarts += step is Step.RESTART
        self.repeats += step is Step.REPEAT

    def __str__(self) -> str:
        return (
            f"{self.lost} lost in {self.gaps} gaps, longest {self.longest_gap}; "
            f"{self.restarts} restarts, {self.repeats} repeats"
        )


class Closing:
    """Base of what frames come from or go to: closed at the end of its `with` block."""

    def __enter__(self) -> Self:
        """Return the object itself, for `with ... as`."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it, whatever happened in the block."""
        self.close()

    def close(self) -> None:
        """Let go of what is held; a second call does nothing."""
        raise NotImplementedError


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
    index = np.arange(room.size, dtype=np.int64)
    index += np.maximum(lost - lost[0], 0).astype(np.int64)
    return index
