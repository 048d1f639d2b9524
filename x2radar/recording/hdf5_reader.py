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

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis, Samples, StreamInfo
from x2radar.recording.blocks import (
    BLOCK_BYTES,
    MOST_BINS,
    NO_OVERRIDES,
    SAMPLE_DTYPES,
    BlockReader,
    Label,
    Overrides,
    as_samples,
    refuse,
    rows_per_block,
    unreadable,
)
from x2radar.recording.hdf5_file import MOST_CHUNK_BYTES, Hdf5File
from x2radar.recording.hdf5_writer import FORMAT, VERSION, RecordingWriter, reason

__all__ = ["FORMAT", "VERSION", "RecordingReader", "RecordingWriter"]

_NUMBERS = ("frame_rate_hz", "carrier_hz", "sample_rate_hz", "bin_length_m", "range_offset_m")
_TEXTS = ("started_utc", "device", "settings")
_SETS = ("samples", "counter", "t_s")
_MOST_LABELS = 10_000
"""Chosen: a label every few seconds for a night."""
_MOST_LABEL_CHARACTERS = 1 << 22
"""Of all labels together. Chosen: some hundred each."""

_MOST_RUN_ID = 64
"""Letters of a run's id that are read. Chosen: twice what a run gets."""


class RecordingReader(BlockReader):
    """Read a recording, which may still be written to.

    `axis.phase_sign` is always -1: a recording with +1 is conjugated.
    """

    def __init__(self, path: Path | str, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = Path(path)
        self._overrides = overrides
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
        """See `BlockReader`."""
        if "labels" not in self._file.file:
            return
        found = [self._file.data_set(f"labels/{name}") for name in ("t0_s", "t1_s", "label")]
        sets = [item for item in found if item is not None and item.ndim == 1]
        n = min(map(len, sets), default=0)
        if len(sets) < len(found) or n < max(map(len, sets)):
            raise refuse(self.path, "/labels lacks t0_s, t1_s or label, or they differ in length")
        if n > _MOST_LABELS:
            raise refuse(self.path, f"{n} labels, at most {_MOST_LABELS} are read")
        n_left = _MOST_LABEL_CHARACTERS
        for k in range(n):
            # One by one: many labels of a hostile file may share one long text.
            t0_s, t1_s, label = (self._file.read(item, k, k + 1).item() for item in sets)
            text = _text(label)
            n_left -= len(text)
            if n_left < 0:
                raise refuse(self.path, "labels of more text than those of any recording")
            yield t0_s, t1_s, text

    def attribute(self, name: str) -> Any:
        """Return a root attribute, text or a number; None if there is none."""
        with unreadable(self.path):
            return self._file.attribute(name)

    @property
    def has_decisions(self) -> bool:
        """Whether decisions of a daemon are kept in the file."""
        with unreadable(self.path):
            return "decisions" in self._file.file

    @property
    def compression(self) -> str:
        """How the samples are packed, for people."""
        samples = self._sets["samples"]
        packed = samples.compression or "none"
        return f"shuffle+{packed}" if samples.shuffle else str(packed)

    def ranges(self) -> Iterator[tuple[int, int]]:
        """See `BlockReader`."""
        # Whole chunks: every one is unpacked once.
        n_block = rows_per_block(self.stream.axis)
        chunks = self._sets["samples"].chunks
        if chunks and chunks[0] * BLOCK_BYTES < n_block * MOST_CHUNK_BYTES:
            n_block = max(1, n_block // chunks[0]) * chunks[0]
        for first in range(0, self.n_frames, n_block):
            yield first, min(first + n_block, self.n_frames)

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        return self._read("counter", first, last)

    def read_times(self, first: int, last: int) -> NDArray[np.float64]:
        """See `BlockReader`."""
        return self._read("t_s", first, last).astype(np.float64, copy=False)

    def read_samples(self, first: int, last: int) -> Samples:
        """See `BlockReader`."""
        samples = self._read("samples", first, last)
        return as_samples(samples.conj() if self._conjugate else samples, self.stream.axis.kind)

    def _read(self, name: str, first: int, last: int) -> NDArray[Any]:
        try:
            return self._file.read(self._sets[name], first, last)
        except (OSError, KeyError, RuntimeError) as err:
            raise refuse(
                self.path, f"frames {first} to {last} cannot be read ({reason(err)})"
            ) from err

    def _check(self) -> None:
        said = self._file.attribute
        if said("format") != FORMAT:
            raise refuse(self.path, f"no recording (attribute 'format' is not '{FORMAT}')")
        if (version := said("format_version")) != VERSION:
            raise refuse(self.path, f"format_version {version}, this reads {VERSION}")
        for name in ("kind", *_NUMBERS, *_TEXTS):
            if said(name) is None:
                raise refuse(self.path, f"attribute '{name}' is missing")
        kind = str(said("kind"))
        if kind not in SAMPLE_DTYPES:
            raise refuse(self.path, f"kind '{kind}' is neither rf nor baseband")
        numbers = {name: self._number(name) for name in _NUMBERS}
        for name in ("frame_rate_hz", "bin_length_m", "carrier_hz"):
            if numbers[name] <= 0:
                raise refuse(
                    self.path, f"attribute '{name}' is {numbers[name]:g}, must be above 0"
                )
        n_range = self._check_sets(kind)
        self.started_utc = str(said("started_utc"))
        self._conjugate = kind == "baseband" and self._number("phase_sign", -1) > 0
        axis = FastTimeAxis(
            kind="rf" if kind == "rf" else "baseband",
            n_range=n_range,
            bin_length_m=numbers["bin_length_m"],
            range_offset_m=numbers["range_offset_m"],
            carrier_hz=numbers["carrier_hz"],
            bandwidth_hz=self._number("bandwidth_hz", 0.0),
            sample_rate_hz=numbers["sample_rate_hz"],
        )
        self._device, self._settings = self._json("device") or None, self._json("settings")
        run_id = str(said("run_id") or "")[:_MOST_RUN_ID]
        stream = StreamInfo(axis, numbers["frame_rate_hz"], self._name(), run_id)
        self.stream = self._overrides.apply(stream)

    def _check_sets(self, kind: str) -> int:
        sets: dict[str, Any] = {}
        for name in _SETS:
            item = self._file.data_set(f"frames/{name}")
            if item is None:
                raise refuse(self.path, f"data set '/frames/{name}' is missing")
            sets[name] = item
        self._sets = sets
        shape, dtype = sets["samples"].shape, sets["samples"].dtype
        if len(shape) != 2 or not 0 < shape[1] <= MOST_BINS:
            raise refuse(self.path, f"/frames/samples has the shape {shape}, not (n, n_range)")
        if dtype.kind != ("c" if kind == "baseband" else "f"):
            raise refuse(self.path, f"/frames/samples is {dtype}, which is no {kind} data")
        for name in ("counter", "t_s"):
            if sets[name].ndim != 1 or sets[name].dtype.kind not in "iuf":
                raise refuse(self.path, f"/frames/{name} is no list of numbers")
        lengths = {name: len(item) for name, item in sets.items()}
        self.n_frames = min(lengths.values())
        if self.n_frames == 0:
            raise refuse(self.path, "no frames in it")
        if self._file.is_unclosed or len(set(lengths.values())) > 1:
            still = "is being written, or " if self._file.is_unclosed else ""
            self.warning = (
                f"{self.path}: the recording {still}was cut off; "
                f"{self.n_frames} whole frames are read"
            )
        return int(shape[1])

    def _name(self) -> str:
        try:
            raw = json.loads(str(self._file.attribute("device")))
        except ValueError:
            return self.path.name
        return str(raw.get("name", self.path.name)) if isinstance(raw, dict) else str(raw)

    def _json(self, name: str) -> Mapping[str, Any]:
        try:
            value = json.loads(str(self._file.attribute(name)))
        except ValueError:
            return {}
        return value if isinstance(value, dict) else {}

    def _number(self, name: str, default: float = 0.0) -> float:
        value = self._file.attribute(name)
        value = default if value is None else value
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = float("nan")
        if not np.isfinite(number):
            raise refuse(self.path, f"attribute '{name}' is {value!r}, not a number")
        return number


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value)
