"""NumPy archives: ``numpy.load(FILE)`` gives samples, counter, t_s and the attributes.

Everything is kept bit by bit. Arrays: samples (n, n_range) float32 or complex64, counter (n,)
uint32, t_s (n,) float64, the attributes of an HDF5 recording as arrays without dimensions,
and labels_t0_s, labels_t1_s, labels_label where there are labels. Foreign archives need
samples only: counters then run from 1, and what the axis lacks must be given.

Nothing in an archive is unpickled, and arrays that it does not name above are not read.
"""

import contextlib
import io
import json
import math
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording.blocks import (
    MOST_BINS,
    NO_OVERRIDES,
    SAMPLE_DTYPES,
    BlockReader,
    Label,
    Overrides,
    as_samples,
    refuse,
)
from x2radar.recording.formats.axis import stream_from
from x2radar.recording.hdf5_writer import root_attributes

_SAMPLES = "samples.npy"
_LABELS = ("labels_t0_s", "labels_t1_s", "labels_label")
_ROOT = (
    *("frame_rate_hz", "carrier_hz", "sample_rate_hz", "bin_length_m", "range_offset_m"),
    *("bandwidth_hz", "phase_sign", "started_utc", "device", "settings", "run_id"),
)
_MOST_SMALL_BYTES = 1 << 22
"""Of an attribute or of the labels. Chosen: device and settings are some kB of JSON."""
_MOST_HEADER_BYTES = 10_000
"""As in numpy."""
_MOST_PACKED = 1100
"""Bytes that one byte of an archive unpacks to; deflate reaches 1032 at most."""


class NpzReader(BlockReader):
    """Read a NumPy archive; samples are streamed, not loaded."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = path
        self._overrides = overrides
        with contextlib.ExitStack() as opened:
            self._look_into(opened)
            self._opened = opened.pop_all()

    def _look_into(self, opened: contextlib.ExitStack) -> None:
        path = self.path
        try:
            self._zip = opened.enter_context(zipfile.ZipFile(path))
            self._rows = opened.enter_context(self._open(_SAMPLES, None))
            shape, fortran, self._dtype = _read_header(self._rows)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as err:
            raise refuse(path, f"not a NumPy archive of frames ({err})") from err
        if fortran or self._dtype.kind not in "cf":
            order = " in Fortran order" if fortran else ""
            raise refuse(path, f"no frames: samples are {self._dtype}{order}")
        if len(shape) != 2 or 0 in shape or shape[1] > MOST_BINS:
            raise refuse(path, f"samples have the shape {shape}, not (n, n_range)")
        if math.prod(shape) * self._dtype.itemsize > self._zip.getinfo(_SAMPLES).file_size:
            raise refuse(path, "samples are cut off")
        self._begin = self._rows.tell()
        self.n_frames, n_range = shape
        self._small = {n: self._load(n, _MOST_SMALL_BYTES) for n in (*_ROOT, *_LABELS)}
        kind = "baseband" if self._dtype.kind == "c" else "rf"
        self._device, self._settings = self._json("device") or None, self._json("settings")
        name = str((self._device or {}).get("name", path.name))
        self.stream = stream_from(path, (kind, n_range), self._small, self._overrides, name)
        self._counter = self._column("counter")
        self._t_s = self._column("t_s")
        self.started_utc = str(self._known("started_utc", ""))
        self._conjugate = kind == "baseband" and float(self._known("phase_sign", -1)) > 0

    def read_labels(self) -> Iterable[Label]:
        """Return what the archive says."""
        columns = [c.tolist() for name in _LABELS if (c := self._small[name]) is not None]
        return zip(*columns, strict=False) if len(columns) == len(_LABELS) else ()

    def close(self) -> None:
        """Close the archive."""
        self._opened.close()

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        if self._counter is None:
            return np.arange(first + 1, last + 1)
        return self._counter[first:last]

    def read_times(self, first: int, last: int) -> NDArray[np.float64] | None:
        """See `BlockReader`."""
        return None if self._t_s is None else self._t_s[first:last].astype(np.float64)

    def read_samples(self, first: int, last: int) -> Samples:
        """See `BlockReader`."""
        n_range = self.stream.axis.n_range
        row_bytes = n_range * self._dtype.itemsize
        try:
            self._rows.seek(self._begin + first * row_bytes)
            data = self._rows.read((last - first) * row_bytes)
        except (OSError, EOFError, zipfile.BadZipFile) as err:
            raise refuse(self.path, f"samples cannot be read ({err})") from err
        if len(data) < (last - first) * row_bytes:
            raise refuse(self.path, "samples are cut off")
        rows = np.frombuffer(data, self._dtype).reshape(last - first, n_range)
        return as_samples(rows.conj() if self._conjugate else rows, self.stream.axis.kind)

    def _open(self, name: str, most_bytes: int | None) -> IO[bytes]:
        """Open a member whose declared size the archive can hold; most_bytes None: any size."""
        about = self._zip.getinfo(name)
        most = self.path.stat().st_size * _MOST_PACKED if most_bytes is None else most_bytes
        if about.file_size > most:
            raise refuse(self.path, f"{name} says {about.file_size} bytes, which is too much")
        if about.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
            raise refuse(self.path, f"{name} is packed in a way that NumPy does not write")
        return self._zip.open(name)

    def _load(self, name: str, most_bytes: int) -> NDArray[Any] | None:
        """Return a small array, None if there is none; its size is checked before it is read."""
        member = f"{name}.npy"
        if member not in self._zip.NameToInfo:
            return None
        with self._open(member, most_bytes) as file:
            shape, fortran, dtype = _read_header(file)
            n_bytes = math.prod(shape) * dtype.itemsize
            if dtype.hasobject or fortran or n_bytes > most_bytes:
                raise refuse(self.path, f"{name} is {dtype} of shape {shape}, which is not read")
            data = file.read(n_bytes)
        if len(data) < n_bytes:
            raise refuse(self.path, f"{name} is cut off")
        return np.frombuffer(data, dtype).reshape(shape) if n_bytes else np.empty(shape, dtype)

    def _column(self, name: str) -> NDArray[Any] | None:
        # An array of 8 bytes a frame and its header; numpy itself writes no longer one.
        column = self._load(name, 8 * self.n_frames + _MOST_HEADER_BYTES)
        if column is not None and (
            column.shape != (self.n_frames,) or column.dtype.kind not in "iuf"
        ):
            raise refuse(self.path, f"{name} is no list of {self.n_frames} numbers")
        return column

    def _known(self, name: str, default: Any) -> Any:
        value = self._small[name]
        return default if value is None else value

    def _json(self, name: str) -> Mapping[str, Any]:
        try:
            value = json.loads(str(self._known(name, "{}")))
        except ValueError:
            return {}
        return value if isinstance(value, dict) else {}


def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    length = file.read(2 if version == (1, 0) else 4)
    n = int.from_bytes(length, "little")
    if n > _MOST_HEADER_BYTES:
        msg = f"an array has a header of {n} bytes"
        raise ValueError(msg)
    reader = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        reader = np.lib.format.read_array_header_2_0
    shape, fortran, dtype = reader(io.BytesIO(length + file.read(n)))
    if any(n < 0 for n in shape):
        msg = f"an array has the shape {shape}"
        raise ValueError(msg)
    return shape, fortran and len(shape) > 1, dtype


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new archive; return what was not kept: nothing."""
    axis = source.stream.axis
    dtype = np.dtype(SAMPLE_DTYPES[axis.kind])
    counters, times = [], []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        with archive.open(_SAMPLES, "w", force_zip64=True) as file:
            shape = (source.n_frames, axis.n_range)
            np.lib.format.write_array_header_2_0(
                file, {"descr": dtype.str, "fortran_order": False, "shape": shape}
            )
            for block in source.blocks():
                file.write(block.samples.tobytes())
                counters.append(block.counter)
                times.append(block.t_s)
        labels = source.labels
        small: dict[str, Any] = {
            "counter": np.concatenate(counters),
            "t_s": np.concatenate(times),
            **root_attributes(source.stream, source.started_utc, source.device, source.settings),
        }
        if labels:
            small["labels_t0_s"], small["labels_t1_s"], small["labels_label"] = zip(
                *labels, strict=True
            )
        for name, value in small.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, np.asarray(value), allow_pickle=False)
    return []
