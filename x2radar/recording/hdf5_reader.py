"""HDF5 recordings: read them from this or any other program; `RecordingWriter` writes them.

Layout (format 1)::

    attributes       format "x2radar-recording", format_version 1, kind "baseband" | "rf",
                     frame_rate_hz, carrier_hz, sample_rate_hz, bin_length_m,
                     range_offset_m, started_utc, device and settings (JSON),
                     optional phase_sign (-1), bandwidth_hz (0: unknown), run_id
    /frames/samples  (n, n_range) complex64 or float32
    /frames/counter  (n,) uint32
    /frames/t_s      (n,) float64
    /labels          optional: t0_s, t1_s, label

Written in SWMR mode, a chunk a second, shuffled and gzipped: after a kill every whole chunk
is readable. Opened and looked into by `x2radar.recording.hdf5_file`, which trusts no file.
`frame_rate_hz` is the rate that decisions run on, so that a replay decides as the live run did.
Parts of one recording (`x2radar.recording.rotating`) carry the attributes recording_id, part
and part_start_s as well.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Kind, Samples
from x2radar.recording.about import (
    FORMAT,
    NO_OVERRIDES,
    NUMBERS,
    SAMPLE_DTYPES,
    TEXTS,
    VERSION,
    Overrides,
    kind_of,
    plain,
    read_about,
)
from x2radar.recording.blocks import BLOCK_BYTES, BlockReader, Label, rows_per_block
from x2radar.recording.faults import refuse, unreadable
from x2radar.recording.hdf5_file import MAX_CHUNK_BYTES, Hdf5File
from x2radar.recording.hdf5_writer import reason

_OPTIONAL = ("bandwidth_hz", "phase_sign", "run_id")
_MAX_LABELS = 10_000
"""A label every few seconds for a night."""
_MAX_LABEL_CHARACTERS = 1 << 22
"""Of all labels together, some hundred each."""


class RecordingReader(BlockReader):
    """Read a recording, which may still be written to.

    `axis.phase_sign` is always -1: a recording with +1 is conjugated.
    """

    def __init__(self, path: Path | str, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(Path(path), overrides)
        if not self.path.is_file():
            raise refuse(path, "no such recording")
        self._file = Hdf5File(self.path)
        try:
            with unreadable(path):
                self._check()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read_labels(self) -> Iterator[Label]:
        """Yield the labels one by one."""
        if "labels" not in self._file.file:
            return
        found = [self._file.data_set(f"labels/{name}") for name in ("t0_s", "t1_s", "label")]
        sets = [item for item in found if item is not None and item.ndim == 1]
        n = min(map(len, sets), default=0)
        if len(sets) < len(found) or n < max(map(len, sets)):
            raise refuse(self.path, "/labels lacks t0_s, t1_s or label, or they differ in length")
        if n > _MAX_LABELS:
            raise refuse(self.path, f"{n} labels, at most {_MAX_LABELS} are read")
        n_left = _MAX_LABEL_CHARACTERS
        for k in range(n):
            # One by one: many labels of a hostile file may share one long text.
            t0_s, t1_s, label = (plain(self._file.read(item, slice(k, k + 1))) for item in sets)
            text = str(label)
            n_left -= len(text)
            if n_left < 0:
                raise refuse(self.path, "labels of more text than those of any recording")
            yield t0_s, t1_s, text

    def attribute(self, name: str) -> Any:
        """Return a root attribute, text or a number; None if there is none."""
        with unreadable(self.path):
            return self._file.attribute(name)

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Yield the borders of the blocks."""
        # Whole chunks: every one is unpacked once.
        n_block = rows_per_block(self.stream.axis)
        chunks = self._sets["samples"].chunks
        if chunks and chunks[0] * BLOCK_BYTES < n_block * MAX_CHUNK_BYTES:
            n_block = max(1, n_block // chunks[0]) * chunks[0]
        for first in range(0, self.n_frames, n_block):
            yield first, min(first + n_block, self.n_frames)

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """Return the counters of these frames, whole numbers."""
        return self._column("counter", first, last)

    def read_times(self, first: int, last: int) -> NDArray[np.float64]:
        """Return the times of these frames in seconds."""
        return self._column("t_s", first, last).astype(np.float64, copy=False)

    def read_samples(self, first: int, last: int) -> Samples:
        """Return these frames, shape (last - first, n_range), read-only."""
        return self._falling(self._read("samples", slice(first, last)))

    def _column(self, name: str, first: int, last: int) -> NDArray[Any]:
        """Return numbers of a list, which may be a column or a row of a matrix."""
        rows = slice(first, last)
        is_row = self._sets[name].ndim == 2 and len(self._sets[name]) == 1
        return self._read(name, (0, rows) if is_row else rows).ravel()

    def _read(self, name: str, at: Any) -> NDArray[Any]:
        try:
            return self._file.read(self._sets[name], at)
        except (OSError, KeyError, RuntimeError) as err:
            raise refuse(self.path, f"/frames/{name} cannot be read ({reason(err)})") from err

    def _check(self) -> None:
        said = {
            name: self._file.attribute(name)
            for name in ("format", "format_version", *NUMBERS, *TEXTS)
        }
        if said["format"] != FORMAT:
            raise refuse(self.path, f"no recording (attribute 'format' is not '{FORMAT}')")
        if str(version := said["format_version"]) not in {str(VERSION), f"{VERSION}.0"}:
            raise refuse(self.path, f"format_version {version}, this reads {VERSION}")
        for name, value in said.items():
            if value is None and name not in _OPTIONAL:
                raise refuse(self.path, f"attribute '{name}' is missing")
        if (kind := said["kind"]) not in SAMPLE_DTYPES:
            raise refuse(self.path, f"kind '{kind}' is neither rf nor baseband")
        frames = self._check_sets()
        if frames[0] != kind:
            raise refuse(self.path, f"/frames/samples is {frames[0]}, which is no {kind} data")
        self._keep(read_about(self.path, frames, said, self._overrides, self.path.name))
        samples = self._sets["samples"]
        packed = samples.compression or "none"
        self.compression = f"shuffle+{packed}" if samples.shuffle else str(packed)
        self.has_decisions = "decisions" in self._file.file

    def _check_sets(self) -> tuple[Kind, int]:
        """Find the data sets and how long they are; return kind and bins of the samples."""
        sets: dict[str, Any] = {}
        for name in ("samples", "counter", "t_s"):
            item = self._file.data_set(f"frames/{name}")
            if item is None:
                raise refuse(self.path, f"data set '/frames/{name}' is missing")
            sets[name] = item
        samples = sets.pop("samples")
        frames = kind_of(self.path, samples.shape, samples.dtype)
        for name, item in sets.items():
            is_list = item.size == max(item.shape, default=0) and item.ndim <= 2
            if not is_list or item.dtype.kind not in "iuf":
                raise refuse(self.path, f"/frames/{name} is no list of numbers")
        lengths = {len(samples), *(item.size for item in sets.values())}
        self._sets = {"samples": samples, **sets}
        self.n_frames = min(lengths)
        if self.n_frames == 0:
            raise refuse(self.path, "no frames in it")
        if self._file.is_unclosed or len(lengths) > 1:
            still = "is being written, or " if self._file.is_unclosed else ""
            self.warning = (
                f"{self.path}: the recording {still}was cut off; "
                f"{self.n_frames} whole frames are read"
            )
        return frames
