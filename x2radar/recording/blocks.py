"""Blocks of frames: how every file format hands its frames to the rest.

A reader fetches counters, times and samples of frames `first` to `last`; `BlockReader` makes
blocks and frames of them, so that losses, repeats, restarts and the start in the middle mean the
same whatever file they come from. No more than one block of samples is held.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Closing, CounterTracker, FastTimeAxis, Frame, Samples, Step, StreamInfo
from x2radar.recording import about
from x2radar.recording.about import NO_OVERRIDES, SAMPLE_DTYPES, Overrides
from x2radar.recording.faults import refuse, unreadable

Label = tuple[float, float, str]
BLOCK_BYTES = 1 << 21
"""Samples held at a time: less memory than a process of Python takes anyway."""

_MAX_COUNT = 2.0**62
_WRAP = 1 << 32  # the module counts frames in 32 bits

_Stretch = tuple[int, int, NDArray[np.int64], list[tuple[Step, int, int]], NDArray[np.float64]]
"""First and last frame of a block, counters, steps with what is lost and index, and times."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Consecutive frames as arrays: samples, shape (n, n_range), counters and times, (n,)."""

    samples: Samples
    counter: NDArray[np.uint32]
    t_s: NDArray[np.float64]


class BlockReader(Closing):
    """Base of all readers of recordings: made of a path and `Overrides`.

    A file that is missing, damaged or none of its format raises RecordingError. A reader that has
    its frames as arrays sets them; others fetch them in `read_…`.
    """

    path: Path
    """What messages call the recording."""
    stream: StreamInfo
    n_frames: int
    started_utc: str
    """Wall clock of the first frame, ISO 8601; empty when unknown."""
    device: Mapping[str, Any]
    """What the recording says about its module."""
    settings: Mapping[str, Any]
    """The module's settings, as far as the recording holds them."""
    has_decisions: bool = False
    """Whether decisions of a daemon are kept in the file."""
    compression: str = "none"
    """How the samples are packed, for people."""
    paths: Sequence[Path] = ()
    """The parts of a recording in parts."""

    _rows: Any
    _counter: NDArray[Any] | None = None
    _t_s: NDArray[Any] | None = None
    _labels: Any = ()
    _is_rising: bool = False

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = path
        self._overrides = overrides
        self._warnings: list[str] = []

    @property
    def warning(self) -> str | None:
        """What is odd about the recording, for people."""
        return "; ".join(self._warnings) or None

    def _warn(self, text: str) -> None:
        self._warnings.append(f"{self.path}: {text}")

    def _keep(self, frames: about.Row, attributes: Mapping[str, Any], device: str) -> None:
        """Keep what attributes, then overrides, say of frames; `device` is a usual name."""
        path, (kind, n_range) = self.path, frames
        said = {name: about.plain(value) for name, value in attributes.items()}
        numbers = {name: about.number(path, name, said.get(name)) for name in about.NUMBERS}
        if said.get("kind") not in {None, "", kind}:
            raise refuse(path, f"its samples are {kind}, which is no {said['kind']} data")
        # As a number or as text, as other programs save it.
        version = said.get("format_version")
        if version is not None and str(version) not in about.VERSIONS:
            raise refuse(path, f"format_version {version}, this reads {about.VERSION}")
        rate_hz, sign = max(numbers.pop("frame_rate_hz"), 0.0), numbers.pop("phase_sign")
        if sign not in {-1.0, 0.0, 1.0}:
            raise refuse(path, f"'phase_sign' is {sign:g}, not -1 or 1")
        axis = FastTimeAxis(kind=kind, n_range=n_range, **numbers)  # type: ignore[arg-type]
        module = about.mapping(said.get("device"))
        run_id = str(said.get("run_id") or "")[:64]  # twice what a run gets
        name = str(module.get("name", device))
        self.stream = stream = self._overrides.apply(StreamInfo(axis, rate_hz, name, run_id))
        known = {"frame_rate_hz": stream.frame_rate_hz, **asdict(stream.axis)}
        bounds = about.BOUNDS.items()
        if wrong := [name for name, (low, high) in bounds if not low <= known[name] <= high]:
            values = ", ".join(f"'{name}' is {known[name] or '0 or missing'}" for name in wrong)
            options = ", ".join(map(about.option_of, wrong))
            raise refuse(path, f"{values}; convert it with {options}")
        self.started_utc = str(said.get("started_utc") or "")
        self.device = module or {"name": stream.device}
        self.settings = about.mapping(said.get("settings"))
        self._is_rising = kind == "baseband" and sign > 0

    def _keep_lists(self, counter: NDArray[Any] | None, t_s: NDArray[Any] | None) -> None:
        """Keep counters and times from any arrays of a number a frame; None where none are."""
        for name, values in (("counter", counter), ("t_s", t_s)):
            if values is not None and (
                values.size != self.n_frames or values.dtype.kind not in "iuf"
            ):
                raise refuse(self.path, f"{name} is no list of {self.n_frames} numbers")
        self._counter, self._t_s = (x if x is None else x.ravel() for x in (counter, t_s))

    @property
    def labels(self) -> list[Label]:
        """Labelled stretches (t0_s, t1_s, label); empty when there are none."""
        with unreadable(self.path):
            found = [(float(t0), float(t1), str(name)) for t0, t1, name in self.read_labels()]
            if not np.isfinite([label[:2] for label in found]).all():
                raise refuse(self.path, "labels with times that are no numbers")
            return found

    def read_labels(self) -> Iterable[tuple[Any, Any, Any]]:
        """Return the labels as the file has them."""
        labels: Iterable[tuple[Any, Any, Any]] = self._labels
        return labels

    @property
    def run_id(self) -> str:
        """The run that was recorded: as the recording names it, else from its first frame."""
        if self.stream.run_id:
            return self.stream.run_id
        with unreadable(self.path):
            said = (self.started_utc, self.n_frames, *self.read_counters(0, 1).tolist())
            digest = hashlib.blake2b(repr(said).encode(), digest_size=16)
            digest.update(self.read_samples(0, 1).tobytes())
        return digest.hexdigest()

    def root_attributes(self) -> dict[str, Any]:
        """Return what an HDF5 recording of the same would say about itself, JSON as text."""
        return about.root_attributes(self.stream, self.started_utc, self.device, self.settings)

    def close(self) -> None:
        """Let go of the file."""
        self._rows = None

    def blocks(self) -> Iterator[Block]:
        """Yield the recording block by block, repeated frames included; raises RecordingError."""
        for first, last, counter, _, t_s in self._walk():
            with unreadable(self.path):
                samples = self.read_samples(first, last)
            yield Block(samples, counter.astype(np.uint32), t_s)

    def lists(self) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
        """Return the counters and times of all frames; raises as `blocks`."""
        walked = [(counter, t_s) for _, _, counter, _, t_s in self._walk()]
        counters, times = map(np.concatenate, zip(*walked, strict=True))
        return counters.astype(np.uint32), times

    def frames(self, start_s: float = 0.0) -> Iterator[Frame]:
        """Yield the frames in order, from the first at or behind `start_s` seconds of the file.

        `index` counts from the file's first frame, losses included, wherever reading begins;
        repeated counters are skipped, as the driver does. Raises as `blocks`.
        """
        axis = self.stream.axis
        # Times of a file may begin below 0, as before a trigger: without a start, all is read.
        begun = start_s <= 0
        for first, last, counter, steps, t_s in self._walk():
            # What lies before the start is counted too: file time is kept.
            late = np.maximum.accumulate((t_s >= start_s - 1e-9) | begun)
            begun = bool(late[-1])
            wanted = [k for k in np.flatnonzero(late).tolist() if steps[k][0] is not Step.REPEAT]
            if not wanted:
                continue
            with unreadable(self.path):
                samples = self.read_samples(first, last)
            for k in wanted:
                step, lost, index = steps[k]
                restarted = step is Step.RESTART
                yield Frame(samples[k], int(counter[k]), index, lost, restarted, axis)

    def _walk(self) -> Iterator[_Stretch]:
        tracker = CounterTracker()
        for first, last in self.ranges():
            with unreadable(self.path):
                counted = self.read_counters(first, last)
                is_whole = (np.abs(counted) < _MAX_COUNT) & (np.trunc(counted) == counted)
                if counted.dtype.kind == "f" and not is_whole.all():
                    raise refuse(self.path, "counters that are no numbers of frames")
                counter = counted.astype(np.int64) % _WRAP
                steps = [(*tracker.update(n), tracker.index) for n in counter.tolist()]
                goes_on = any(step not in {Step.REPEAT, Step.RESTART} for step, *_ in steps[1:])
                if first == 0 and last > 2 and not goes_on:
                    raise refuse(self.path, "counters that do not count, as if all were the same")
                t_s = None if self._overrides.frame_rate_hz else self.read_times(first, last)
                if t_s is None:
                    t_s = np.array([index for *_, index in steps]) / self.stream.frame_rate_hz
                elif not np.isfinite(t_s).all():
                    raise refuse(self.path, "times of frames that are no numbers")
            yield first, last, counter, steps, t_s

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Yield the borders of the blocks."""
        n_block = self._n_block
        for first in range(0, self.n_frames, n_block):
            yield first, min(first + n_block, self.n_frames)

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """Return the counters of these frames, whole numbers; from 1 on where there are none."""
        if self._counter is None:
            return np.arange(first + 1, last + 1)
        return self._counter[first:last]

    def read_times(self, first: int, last: int) -> NDArray[np.float64] | None:
        """Return the times of these frames in seconds; None to count them with the rate."""
        return None if self._t_s is None else self._t_s[first:last].astype(np.float64)

    def read_samples(self, first: int, last: int) -> Samples:
        """Return these frames, shape (last - first, n_range), read-only."""
        return self._falling(self._rows[first:last])

    @property
    def _n_block(self) -> int:
        """How many frames make a block of about `BLOCK_BYTES`."""
        axis = self.stream.axis
        return max(1, BLOCK_BYTES // (axis.n_range * np.dtype(SAMPLE_DTYPES[axis.kind]).itemsize))

    def _falling(self, rows: NDArray[Any]) -> Samples:
        """Return rows of the file as read-only samples whose phase falls with range."""
        dtype: Any = SAMPLE_DTYPES[self.stream.axis.kind]
        with np.errstate(over="ignore"):
            # What is beyond single precision is infinite: no sample, as the gate judges it.
            samples = np.ascontiguousarray(rows.conj() if self._is_rising else rows, dtype)
        samples.flags.writeable = False
        return samples
