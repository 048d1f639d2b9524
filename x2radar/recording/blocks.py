"""Blocks of frames: how every file format hands its frames to the rest.

A reader knows how to fetch counters, times and samples of frames `first` to `last`;
`BlockReader` makes blocks and `Frame` objects of that, so that losses, repeats, restarts
and the start in the middle mean the same whatever file they come from. At no time more
than one block of samples is held.
"""

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.closing import Closing
from x2radar.errors import RecordingError, X2RadarError
from x2radar.frame import LONGEST_GAP, FastTimeAxis, Frame, Samples, StreamInfo, read_only
from x2radar.modules.modules import pulse_bandwidth_hz
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

Label = tuple[float, float, str]
SAMPLE_DTYPES: dict[str, type[np.float32 | np.complex64]] = {
    "rf": np.float32,
    "baseband": np.complex64,
}
BLOCK_BYTES = 1 << 21
"""Samples held at a time. Chosen: a block costs no more memory than a process of Python anyway."""

MOST_BINS = 1 << 14
"""Above these a file is damaged. Chosen: ten times the bins of any module, 150 m of a P4xx."""
_LONGEST_MESSAGE = 1000
"""Characters of why a file is refused. Chosen: what a file says may be of any length."""
_WRAP = 1 << 32
"""The module counts frames in 32 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Consecutive frames as arrays.

    Attributes
    ----------
    samples : ndarray, shape (n, n_range), float32 (rf) or complex64 (baseband)
        The frames.
    counter : ndarray, shape (n,), uint32
        As the module counted them.
    t_s : ndarray, shape (n,), float64
        Time since the recording's first frame, in seconds.
    """

    samples: Samples
    counter: NDArray[np.uint32]
    t_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """What `unwrap` found, each of shape (n,)."""

    index: NDArray[np.int64]
    lost: NDArray[np.int64]
    restarted: NDArray[np.bool_]
    repeated: NDArray[np.bool_]


def unwrap(counter: NDArray[Any], last: int | None = None, index: int = -1) -> Steps:
    """Unwrap many 32-bit counters at once, as `x2radar.frame.CounterTracker` does one by one.

    `counter`, shape (n,), are whole numbers from 0 to 2**32 - 1; `last` is the one before, None
    at the beginning of a stream, and `index` its unwrapped number.
    """
    now = np.asarray(counter).astype(np.int64)
    before = np.empty_like(now)
    before[1:] = now[:-1]
    if now.size:
        before[0] = now[0] - 1 if last is None else last
    ahead = (now - before) % _WRAP
    repeated = ahead == 0
    restarted = ahead - 1 > LONGEST_GAP
    lost = np.where(repeated | restarted, 0, ahead - 1)
    stride = np.where(restarted, 1, ahead)
    return Steps(index + np.cumsum(stride), lost, restarted, repeated)


@dataclass(frozen=True, slots=True, kw_only=True)
class Overrides:
    """What the user knows better than the file; None leaves the file's value.

    Names as in `FastTimeAxis` and `StreamInfo`. A sample rate alone also sets the bin length of
    RF frames, c / (2 fs).
    """

    frame_rate_hz: float | None = None
    bin_length_m: float | None = None
    range_offset_m: float | None = None
    carrier_hz: float | None = None
    bandwidth_hz: float | None = None
    sample_rate_hz: float | None = None

    def apply(self, stream: StreamInfo) -> StreamInfo:
        """Return `stream` with what is set here.

        A bandwidth that nobody states is that of the module with this sampler and carrier.
        """
        changes: dict[str, Any] = {}
        for name in FastTimeAxis.__dataclass_fields__:
            value = getattr(self, name, None)
            if value is not None:
                changes[name] = value
        by_rate = self.sample_rate_hz is not None and self.bin_length_m is None
        if by_rate and self.sample_rate_hz and stream.axis.kind == "rf":
            changes["bin_length_m"] = SPEED_OF_LIGHT_MPS / (2 * self.sample_rate_hz)
        axis = replace(stream.axis, **changes)
        if not axis.bandwidth_hz:
            band_hz = pulse_bandwidth_hz(axis.sample_rate_hz, axis.carrier_hz)
            axis = replace(axis, bandwidth_hz=band_hz)
        return replace(
            stream,
            axis=axis,
            frame_rate_hz=self.frame_rate_hz or stream.frame_rate_hz,
        )


NO_OVERRIDES = Overrides()


class BlockReader(Closing):
    """Base of all readers of recordings: made of a path and `Overrides`.

    A file that is missing, damaged or none of its format raises RecordingError, one line that
    says what.
    """

    path: Path
    """What messages call the recording."""
    stream: StreamInfo
    n_frames: int
    started_utc: str = ""
    """Wall clock of the first frame, ISO 8601; empty when unknown."""
    warning: str | None = None
    """What is odd about the recording, for people."""
    _overrides: Overrides = NO_OVERRIDES
    _device: Mapping[str, Any] | None = None
    _settings: Mapping[str, Any] = MappingProxyType({})

    @property
    def device(self) -> Mapping[str, Any]:
        """What the recording says about its module; may be empty."""
        return {"name": self.stream.device} if self._device is None else self._device

    @property
    def settings(self) -> Mapping[str, Any]:
        """The module's settings, as far as the recording holds them."""
        return self._settings

    @property
    def labels(self) -> list[Label]:
        """Labelled stretches (t0_s, t1_s, label); empty when there are none."""
        with unreadable(self.path):
            return [(float(t0), float(t1), str(text)) for t0, t1, text in self.read_labels()]

    def read_labels(self) -> Iterable[tuple[Any, Any, Any]]:
        """Return the labels as the file has them."""
        return ()

    @property
    def run_id(self) -> str:
        """The run that was recorded: as the recording names it, else from its first frame."""
        if self.stream.run_id:
            return self.stream.run_id
        with unreadable(self.path):
            about = (self.started_utc, self.n_frames, *self.read_counters(0, 1).tolist())
            digest = hashlib.blake2b(repr(about).encode(), digest_size=16)
            digest.update(self.read_samples(0, 1).tobytes())
        return digest.hexdigest()

    def close(self) -> None:
        """Let go of the file."""

    def blocks(self, *, samples: bool = True) -> Iterator[Block]:
        """Yield the recording block by block, repeated frames included.

        `samples` False leaves the samples out, shape (n, 0), for a look at the counters. Raises
        RecordingError if a part of the file cannot be read.
        """
        for first, last, counter, _, t_s in self._walk():
            with unreadable(self.path):
                rows = (
                    self.read_samples(first, last) if samples else self._no_samples(last - first)
                )
            yield Block(rows, counter.astype(np.uint32), t_s)

    def frames(self, start_s: float = 0.0) -> Iterator[Frame]:
        """Yield the frames in order, from the first at or behind `start_s` seconds of the file.

        `index` counts from the file's first frame, losses included, wherever reading begins;
        repeated counters are skipped, as the driver does. Raises as `blocks`.
        """
        axis = self.stream.axis
        begun = False
        for first, last, counter, steps, t_s in self._walk():
            # What lies before the start is counted too: file time is kept.
            skip = 0
            if not begun:
                late = t_s >= start_s - 1e-9
                if not late.any():
                    continue
                begun = True
                skip = int(late.argmax())
            with unreadable(self.path):
                samples = self.read_samples(first, last)
            rows = zip(
                counter.tolist(),
                steps.index.tolist(),
                steps.lost.tolist(),
                steps.restarted.tolist(),
                steps.repeated.tolist(),
                strict=True,
            )
            for k, (number, index, lost, restarted, repeated) in enumerate(rows):
                if k >= skip and not repeated:
                    yield Frame(samples[k], number, index, lost, restarted, axis)

    def _walk(
        self,
    ) -> Iterator[tuple[int, int, NDArray[np.int64], Steps, NDArray[np.float64]]]:
        before: int | None = None
        index = -1
        for first, last in self.ranges():
            with unreadable(self.path):
                counter = self.read_counters(first, last).astype(np.int64) % _WRAP
                steps = unwrap(counter, before, index)
                before, index = int(counter[-1]), int(steps.index[-1])
                t_s = None if self._overrides.frame_rate_hz else self.read_times(first, last)
                if t_s is None:
                    t_s = steps.index / self.stream.frame_rate_hz
            yield first, last, counter, steps, t_s

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Yield the borders of the blocks."""
        n_block = rows_per_block(self.stream.axis)
        for first in range(0, self.n_frames, n_block):
            yield first, min(first + n_block, self.n_frames)

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """Return the counters of these frames, whole numbers."""
        raise NotImplementedError

    def read_times(self, first: int, last: int) -> NDArray[np.float64] | None:  # noqa: ARG002
        """Return the times of these frames in seconds; None to count them with the rate."""
        return None

    def read_samples(self, first: int, last: int) -> Samples:
        """Return these frames, shape (last - first, n_range), read-only."""
        raise NotImplementedError

    def _no_samples(self, n: int) -> Samples:
        return as_samples(np.empty((n, 0)), self.stream.axis.kind)


def rows_per_block(axis: FastTimeAxis, block_bytes: int = BLOCK_BYTES) -> int:
    """Return how many frames make a block of about `block_bytes`."""
    row_bytes = axis.n_range * np.dtype(SAMPLE_DTYPES[axis.kind]).itemsize
    return max(1, block_bytes // row_bytes)


def as_samples(array: NDArray[Any], kind: str) -> Samples:
    """Return `array` as contiguous, read-only samples of this kind; a copy if need be."""
    samples: Any = np.ascontiguousarray(np.asarray(array), SAMPLE_DTYPES[kind])
    if samples.flags.writeable:
        read_only(samples)
    out: Samples = samples
    return out


def refuse(path: object, why: str) -> RecordingError:
    """Return the error that says in one line, of bounded length, what is wrong with a file."""
    rest = " …" if len(why) > _LONGEST_MESSAGE else ""
    return RecordingError(f"{path}: {why[:_LONGEST_MESSAGE]}{rest}")


@contextlib.contextmanager
def unreadable(path: object) -> Iterator[None]:
    """Turn what a damaged or hostile file makes of a reader into RecordingError, one line.

    This is the one seam where files meet the readers: behind it lie libraries (HDF5, zlib, JSON,
    numpy) that answer bad bytes with almost any exception.
    """
    try:
        yield
    except (X2RadarError, NameError, AssertionError):
        raise
    except OSError as err:
        raise refuse(path, f"cannot be read: {err.strerror or one_line(err)}") from err
    except MemoryError as err:
        raise refuse(path, "asks for more memory than there is") from err
    except Exception as err:
        raise refuse(path, f"damaged ({type(err).__name__}: {one_line(err)})") from err


def one_line(err: BaseException) -> str:
    """Return what an error says, on one line of at most 200 characters."""
    return " ".join(str(err).split())[:200]
