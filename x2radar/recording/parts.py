"""Recordings in parts: written one after another, read as one.

``walk.h5`` becomes ``walk_000.h5``, ``walk_001.h5`` … Every part is a whole recording of its
own, whose t_s begins at 0; the attributes recording_id, part and part_start_s say how the
parts belong together. Losses between two parts show in the counters, as within one.
"""

import contextlib
import re
import uuid
from collections.abc import Iterable, Iterator, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import RecordingError
from x2radar.frame import Closing, Frame, Samples, StreamInfo
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader, Label
from x2radar.recording.faults import refuse
from x2radar.recording.hdf5_reader import RecordingReader
from x2radar.recording.hdf5_writer import RecordingWriter, write_labels
from x2radar.wall_clock import parse_utc, utc_text


def existing_parts(path: Path) -> list[Path]:
    """Return the parts of the recording `path` that are there, in order."""
    name = re.compile(rf"{re.escape(path.stem)}_\d{{3,}}{re.escape(path.suffix or '.h5')}")
    found = [each for each in path.parent.glob("*") if name.fullmatch(each.name)]
    return sorted(found, key=lambda each: (len(each.name), each.name))


class RotatingWriter(Closing):
    """Write frames as `RecordingWriter`, which is told `about`, or into parts of a size."""

    def __init__(
        self,
        path: Path,
        stream: StreamInfo,
        *,
        started_utc: str,
        rotate_bytes: float | None = None,
        rotate_s: float | None = None,
        **about: Any,
    ) -> None:
        self._path = path
        self._stream = stream
        self._started_utc = started_utc
        self._about = about
        self._rotate_bytes = rotate_bytes
        self._max_frames = None if rotate_s is None else max(1, rotate_s * stream.frame_rate_hz)
        self.is_rotating = rotate_bytes is not None or rotate_s is not None
        self._id = str(uuid.uuid4())
        self._seen_bytes = self._grows_by = self._next_index = 0
        self._first_indices: list[int] = []
        self.paths: list[Path] = []
        self._next_part(0)

    @property
    def n_bytes(self) -> int:
        """Size of all parts so far, in bytes."""
        return sum(path.stat().st_size for path in self.paths if path.exists())

    def write(self, frame: Frame) -> None:
        """Keep one frame, in a new part if the old one is full; raises as `RecordingWriter`."""
        if self._writer.n_frames and self._is_full(frame.index):
            self.close()
            self._next_part(frame.index)
        self._writer.write(frame)
        self._next_index = frame.index + 1

    def label(self, labels: Iterable[Label]) -> None:
        """Add labelled stretches to the closed parts; what lies beyond the frames is cut off."""
        rate_hz = self._stream.frame_rate_hz
        bounds = [index / rate_hz for index in (*self._first_indices, self._next_index)]
        for path, begin_s, end_s in zip(self.paths, bounds, bounds[1:], strict=False):
            cut = ((max(t0, begin_s), min(t1, end_s), text) for t0, t1, text in labels)
            own = [(t0 - begin_s, t1 - begin_s, text) for t0, t1, text in cut if t0 < t1]
            write_labels(path, own)

    def close(self) -> None:
        """Write what is left and close the last part; a second call does nothing."""
        self._writer.close()

    def _is_full(self, index: int) -> bool:
        if self._max_frames and index - self._first_indices[-1] >= self._max_frames:
            return True
        if self._rotate_bytes is None or not self.paths[-1].exists():
            return False
        size = self.paths[-1].stat().st_size
        if size != self._seen_bytes:
            # Room for one more chunk like the largest, and for what closing adds.
            self._grows_by = max(self._grows_by, size - self._seen_bytes)
            self._seen_bytes = size
        whole_chunk = self._writer.n_frames % max(1, round(self._stream.frame_rate_hz)) == 0
        return whole_chunk and size + self._grows_by > self._rotate_bytes

    def _next_part(self, index: int) -> None:
        part = len(self.paths)
        start_s = index / self._stream.frame_rate_hz
        started = parse_utc(self._started_utc)
        attributes = {"recording_id": self._id, "part": part, "part_start_s": start_s}
        path = self._path
        if self.is_rotating:
            path = path.with_name(f"{path.stem}_{part:03d}{path.suffix or '.h5'}")
        self._writer = RecordingWriter(
            path,
            self._stream,
            started_utc=utc_text(started + timedelta(seconds=start_s)) if started else "",
            first_index=index,
            attributes=attributes if self.is_rotating else None,
            **self._about,
        )
        self._seen_bytes = 0
        self.paths.append(path)
        self._first_indices.append(index)


def open_hdf5(path: Path, overrides: Overrides = NO_OVERRIDES) -> BlockReader:
    """Return a reader of a file, a folder with parts, or the parts of a name without a file."""
    if path.is_file():
        return RecordingReader(path, overrides)
    is_folder = path.is_dir()
    parts = sorted(path.glob("[!.]*.h5")) if is_folder else existing_parts(path)
    if not parts:
        raise refuse(path, "no .h5 file in it" if is_folder else "no such recording")
    return PartsReader(parts, overrides)


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file, bit by bit; return what was not kept."""
    with RecordingWriter(
        path,
        source.stream,
        started_utc=source.started_utc,
        device=source.device,
        settings=source.settings,
    ) as writer:
        for block in source.blocks():
            writer.write_block(block)
    write_labels(path, source.labels)
    return ["decisions are not copied"] if source.has_decisions else []


class PartsReader(BlockReader):
    """Read the parts of a recording as one, by their numbers, else in the order of `paths`."""

    def __init__(self, paths: Sequence[Path], overrides: Overrides = NO_OVERRIDES) -> None:
        if not paths:
            raise RecordingError("no parts of a recording are named")
        super().__init__(paths[0].parent, overrides)
        faults: list[str] = []
        with contextlib.ExitStack() as opened:
            parts: list[RecordingReader] = []
            for path in paths:
                try:
                    parts.append(opened.enter_context(RecordingReader(path, overrides)))
                except RecordingError as err:
                    # Killed before its first second was over: the other parts are good.
                    faults.append(str(err))
            if not parts:
                raise RecordingError("; ".join(faults))
            self._warnings += [f"left out: {fault}" for fault in faults]
            self._warnings += [part.warning for part in parts if part.warning]
            numbers = [part.attribute("part") for part in parts]
            if None not in numbers:
                parts.sort(key=lambda part: int(part.attribute("part")))
                if sorted(numbers) != list(range(len(numbers))):
                    self._warn("parts are missing")
            kinds = {
                (part.attribute("recording_id"), part.stream.axis, part.stream.frame_rate_hz): part
                for part in parts
            }
            if len(kinds) > 1:
                one, other, *_ = kinds.values()
                why = f"and {other.path.name} are different recordings; name one of them"
                raise refuse(one.path, why)
            self._parts = parts
            opened.pop_all()
        first = parts[0]
        self.paths = [part.path for part in parts]
        self.stream, self.started_utc = first.stream, first.started_utc
        self.device, self.settings = first.device, first.settings
        self.compression = first.compression
        self._first = np.cumsum([0, *(part.n_frames for part in parts)]).tolist()
        self.n_frames = self._first[-1]
        self._find_starts()

    def read_labels(self) -> list[Label]:
        return [
            (t0_s + start_s, t1_s + start_s, label)
            for start_s, part in zip(self._start_s, self._parts, strict=True)
            for t0_s, t1_s, label in part.labels
        ]

    def close(self) -> None:
        for part in self._parts:
            part.close()

    def _find_starts(self) -> None:
        """Find when each part begins, by its own word or by the counters."""
        self._start_s = [part.attribute("part_start_s") for part in self._parts]
        if None in self._start_s or self._overrides.frame_rate_hz:
            self._start_s = [0.0] * len(self._parts)
            rate_hz = self.stream.frame_rate_hz
            begun = [(first, steps[0][2]) for first, _, _, steps, _ in self._walk()]
            self._start_s = [index / rate_hz for first, index in begun if first in self._first]
        self._start_s = [float(start_s - self._start_s[0]) for start_s in self._start_s]

    def ranges(self) -> Iterator[tuple[int, int]]:
        # A block lies in one part.
        for offset, part in zip(self._first, self._parts, strict=False):
            for first, last in part.ranges():
                yield offset + first, offset + last

    def _part(self, first: int) -> tuple[RecordingReader, int, float]:
        k = int(np.searchsorted(self._first, first, side="right")) - 1
        return self._parts[k], self._first[k], self._start_s[k]

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        part, offset, _ = self._part(first)
        return part.read_counters(first - offset, last - offset)

    def read_times(self, first: int, last: int) -> NDArray[np.float64]:
        part, offset, start_s = self._part(first)
        return part.read_times(first - offset, last - offset) + start_s

    def read_samples(self, first: int, last: int) -> Samples:
        part, offset, _ = self._part(first)
        return part.read_samples(first - offset, last - offset)
