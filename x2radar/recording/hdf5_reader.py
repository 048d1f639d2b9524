"""HDF5 recordings: read them from this or any other program; `RecordingWriter` writes them.

Layout (format 1)::

    attributes       format "x2radar-recording", format_version 1, kind "baseband" | "rf",
                     frame_rate_hz, carrier_hz, sample_rate_hz, bin_length_m,
                     range_offset_m, started_utc, device and settings (JSON),
                     optional phase_sign (-1), bandwidth_hz (0: unknown)
    /frames/samples  (n, n_range) complex64 or float32
    /frames/counter  (n,) uint32
    /frames/t_s      (n,) float64
    /labels          optional: t0_s, t1_s, label

Written in SWMR mode, a chunk a second, shuffled and gzipped: after a kill every whole chunk
is readable. `frame_rate_hz` is the rate that decisions run on, so that a replay decides as
the live run did. Parts of one recording (`x2radar.recording.rotating`) carry the attributes
recording_id, part and part_start_s as well.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis, Samples, StreamInfo
from x2radar.recording.blocks import (
    BLOCK_BYTES,
    NO_OVERRIDES,
    SAMPLE_DTYPES,
    BlockReader,
    Label,
    Overrides,
    as_samples,
    refuse,
    rows_per_block,
)
from x2radar.recording.hdf5_writer import FORMAT, VERSION, RecordingWriter, reason

__all__ = ["FORMAT", "VERSION", "RecordingReader", "RecordingWriter"]

_NUMBERS = ("frame_rate_hz", "carrier_hz", "sample_rate_hz", "bin_length_m", "range_offset_m")
_TEXTS = ("started_utc", "device", "settings")
_MOST_BLOCK_BYTES = 1 << 26
"""Largest chunk that is read as a whole. Chosen: other programs may write a file in one chunk."""


class RecordingReader(BlockReader):
    """Read a recording, which may still be written to.

    `axis.phase_sign` is always -1: a recording with +1 is conjugated.
    """

    def __init__(self, path: Path | str, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = Path(path)
        self._overrides = overrides
        if not self.path.is_file():
            raise refuse(path, "no such recording")
        try:
            self._file = h5py.File(self.path, "r", swmr=True)
        except OSError as err:
            raise refuse(path, f"not an HDF5 file, or damaged ({reason(err)})") from err
        try:
            self._check()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def labels(self) -> list[Label]:
        """Labelled stretches (t0_s, t1_s, label); empty when there are none."""
        group = self._file.get("labels")
        if not isinstance(group, h5py.Group):
            return []
        rows = zip(group["t0_s"][()], group["t1_s"][()], group["label"][()], strict=True)
        return [(float(t0), float(t1), _text(label)) for t0, t1, label in rows]

    @property
    def attributes(self) -> dict[str, Any]:
        """The root attributes, texts as str."""
        return {
            name: _text(value) if isinstance(value, bytes | str) else value
            for name, value in self._file.attrs.items()
        }

    @property
    def has_decisions(self) -> bool:
        """Whether decisions of a daemon are kept in the file."""
        return "decisions" in self._file

    @property
    def compression(self) -> str:
        """How the samples are packed, for people."""
        samples = self._file["frames/samples"]
        packed = samples.compression or "none"
        return f"shuffle+{packed}" if samples.shuffle else str(packed)

    def ranges(self) -> Iterator[tuple[int, int]]:
        """See `BlockReader`."""
        # Whole chunks: every one is unpacked once.
        n_block = rows_per_block(self.stream.axis)
        chunks = self._file["frames/samples"].chunks
        if chunks and chunks[0] * BLOCK_BYTES < n_block * _MOST_BLOCK_BYTES:
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
            return np.asarray(self._file["frames"][name][first:last])
        except (OSError, KeyError, RuntimeError) as err:
            raise refuse(
                self.path, f"frames {first} to {last} cannot be read ({reason(err)})"
            ) from err

    def _check(self) -> None:
        attrs = self._file.attrs
        if _text(attrs.get("format", "")) != FORMAT:
            raise refuse(self.path, f"no recording (attribute 'format' is not '{FORMAT}')")
        if int(attrs.get("format_version", 0)) != VERSION:
            raise refuse(
                self.path, f"format_version {attrs.get('format_version')}, this reads {VERSION}"
            )
        for name in ("kind", *_NUMBERS, *_TEXTS):
            if name not in attrs:
                raise refuse(self.path, f"attribute '{name}' is missing")
        kind = _text(attrs["kind"])
        if kind not in SAMPLE_DTYPES:
            raise refuse(self.path, f"kind '{kind}' is neither rf nor baseband")
        numbers = {name: self._number(name) for name in _NUMBERS}
        for name in ("frame_rate_hz", "bin_length_m", "carrier_hz"):
            if numbers[name] <= 0:
                raise refuse(
                    self.path, f"attribute '{name}' is {numbers[name]:g}, must be above 0"
                )
        n_range = self._check_sets(kind)
        self.started_utc = _text(attrs["started_utc"])
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
        stream = StreamInfo(axis, numbers["frame_rate_hz"], self._name())
        self.stream = self._overrides.apply(stream)

    def _check_sets(self, kind: str) -> int:
        sets = {}
        for name in ("samples", "counter", "t_s"):
            try:
                item = self._file[f"frames/{name}"]
            except (KeyError, OSError):
                item = None
            if not isinstance(item, h5py.Dataset):
                raise refuse(self.path, f"data set '/frames/{name}' is missing")
            sets[name] = item
        shape, dtype = sets["samples"].shape, sets["samples"].dtype
        if len(shape) != 2 or shape[1] == 0:
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
        if len(set(lengths.values())) > 1:
            self.warning = (
                f"{self.path}: the recording was cut off; {self.n_frames} whole frames are read"
            )
        return int(shape[1])

    def _name(self) -> str:
        try:
            raw = json.loads(_text(self._file.attrs["device"]))
        except ValueError:
            return self.path.name
        return str(raw.get("name", self.path.name)) if isinstance(raw, dict) else str(raw)

    def _json(self, name: str) -> Mapping[str, Any]:
        try:
            value = json.loads(_text(self._file.attrs[name]))
        except ValueError:
            return {}
        return value if isinstance(value, dict) else {}

    def _number(self, name: str, default: float = 0.0) -> float:
        value = self._file.attrs.get(name, default)
        try:
            number = float(np.asarray(value).item())
        except (TypeError, ValueError):
            number = float("nan")
        if not np.isfinite(number):
            raise refuse(self.path, f"attribute '{name}' is {value!r}, not a number")
        return number


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value)
