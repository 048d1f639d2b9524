"""NumPy archives: ``numpy.load(FILE)`` gives samples, counter, t_s and the attributes.

Everything is kept bit by bit. Arrays: samples (n, n_range) float32 or complex64, counter (n,)
uint32, t_s (n,) float64, the attributes of an HDF5 recording as arrays without dimensions,
and labels_t0_s, labels_t1_s, labels_label where there are labels. Foreign archives need
samples only: counters then run from 1, and what the axis lacks must be given.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording.blocks import (
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


class NpzReader(BlockReader):
    """Read a NumPy archive; samples are streamed, not loaded."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        self._path = path
        self._overrides = overrides
        try:
            self._zip = zipfile.ZipFile(path)
            self._small = self._load_small()
            self._rows = self._zip.open(_SAMPLES)
            shape, self._dtype = _read_header(self._rows)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as err:
            raise refuse(path, f"not a NumPy archive of frames ({err})") from err
        if len(shape) != 2 or 0 in shape:
            raise refuse(path, f"samples have the shape {shape}, not (n, n_range)")
        self._begin = self._rows.tell()
        self.n_frames, n_range = shape
        kind = "baseband" if self._dtype.kind == "c" else "rf"
        self._device, self._settings = self._json("device") or None, self._json("settings")
        name = str((self._device or {}).get("name", path.name))
        self.stream = stream_from(path, (kind, n_range), self._small, overrides, name)
        self._counter = self._column("counter", np.arange(1, self.n_frames + 1))
        self._t_s = self._column("t_s", None)
        self.started_utc = str(self._small.get("started_utc", ""))
        self._conjugate = kind == "baseband" and float(self._small.get("phase_sign", -1)) > 0

    @property
    def labels(self) -> list[Label]:
        """As the archive says."""
        names = ("labels_t0_s", "labels_t1_s", "labels_label")
        if any(name not in self._small for name in names):
            return []
        rows = zip(*(self._small[name].tolist() for name in names), strict=False)
        return [(float(t0_s), float(t1_s), str(label)) for t0_s, t1_s, label in rows]

    def close(self) -> None:
        """Close the archive."""
        self._rows.close()
        self._zip.close()

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        return np.asarray(self._counter)[first:last]

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
            raise refuse(self._path, f"samples cannot be read ({err})") from err
        if len(data) < (last - first) * row_bytes:
            raise refuse(self._path, "samples are cut off")
        rows = np.frombuffer(data, self._dtype).reshape(last - first, n_range)
        return as_samples(rows.conj() if self._conjugate else rows, self.stream.axis.kind)

    def _load_small(self) -> dict[str, NDArray[Any]]:
        names = [name for name in self._zip.namelist() if name != _SAMPLES]
        small = {}
        for name in names:
            with self._zip.open(name) as file:
                array = np.lib.format.read_array(io.BytesIO(file.read()), allow_pickle=False)
            small[name.removesuffix(".npy")] = array
        return small

    def _column(self, name: str, default: Any) -> Any:
        column = self._small.get(name)
        if column is None:
            return default
        if column.shape != (self.n_frames,) or column.dtype.kind not in "iuf":
            raise refuse(self._path, f"{name} is no list of {self.n_frames} numbers")
        return column

    def _json(self, name: str) -> Mapping[str, Any]:
        try:
            value = json.loads(str(self._small.get(name, "{}")))
        except ValueError:
            return {}
        return value if isinstance(value, dict) else {}


def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    reader = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        reader = np.lib.format.read_array_header_2_0
    shape, fortran, dtype = reader(file)
    if fortran or dtype.kind not in "cf":
        msg = f"samples are {dtype}{' in Fortran order' if fortran else ''}"
        raise ValueError(msg)
    return shape, dtype


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
