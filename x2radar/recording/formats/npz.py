"""NumPy archives: ``numpy.load(FILE)`` gives samples, counter, t_s and the attributes.

Everything is kept bit by bit: samples, counter and t_s as in an HDF5 recording, its attributes as
arrays without dimensions, and labels_t0_s, labels_t1_s, labels_label where there are labels.
Foreign archives need samples only. Nothing is unpickled, and no other array is read.
"""

import contextlib
import io
import math
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording.about import ATTRIBUTES, NO_OVERRIDES, SAMPLE_DTYPES, Overrides, kind_of
from x2radar.recording.blocks import BlockReader, Label
from x2radar.recording.faults import refuse

_SAMPLES = "samples"
_LABELS = ("labels_t0_s", "labels_t1_s", "labels_label")
_MAX_SMALL_BYTES = 1 << 22  # of an attribute or of the labels; device and settings are some kB
_MAX_HEADER_BYTES = 10_012  # 10,000 as in numpy, and what stands before them
_MAX_WHOLE_BYTES = 1 << 30  # of samples in Fortran order, which are held as a whole
_MAX_PACKED = 1100  # bytes that one byte of an archive unpacks to; deflate reaches 1032 at most


class Reader(BlockReader):
    """Read a NumPy archive; samples are streamed, unless they are in Fortran order."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        with contextlib.ExitStack() as opened:
            if not zipfile.is_zipfile(path):
                raise refuse(path, "not a NumPy archive")
            self._zip = opened.enter_context(zipfile.ZipFile(path))
            most_bytes = path.stat().st_size * _MAX_PACKED
            self._file = opened.enter_context(self._open(_SAMPLES, most_bytes))
            shape, is_fortran, self._dtype, self._begin = _read_header(self._file)
            frames = kind_of(path, shape, self._dtype)
            self.n_frames, self._n_range = n, _ = shape
            if self._bytes(n) > self._zip.getinfo(f"{_SAMPLES}.npy").file_size:
                raise refuse(path, "samples are cut off")
            self._rows = self._load(_SAMPLES, _MAX_WHOLE_BYTES) if is_fortran else None
            small = {name: self._load(name, _MAX_SMALL_BYTES) for name in ATTRIBUTES}
            # An array of 8 bytes a frame and its header; numpy itself writes no longer one.
            column_bytes = 8 * n + _MAX_HEADER_BYTES
            self._keep_lists(self._load("counter", column_bytes), self._load("t_s", column_bytes))
            self._labels = [self._load(name, _MAX_SMALL_BYTES) for name in _LABELS]
            self._keep(frames, small, path.name)
            self._opened = opened.pop_all()

    def read_labels(self) -> Iterable[Label]:
        columns = [c.ravel().astype(str).tolist() for c in self._labels if c is not None]
        if len(columns) not in {0, len(_LABELS)}:
            raise refuse(self.path, f"its labels lack one of {', '.join(_LABELS)}")
        return zip(*columns, strict=True)

    def close(self) -> None:
        self._opened.close()

    def read_samples(self, first: int, last: int) -> Samples:
        if self._rows is not None:
            return super().read_samples(first, last)
        self._file.seek(self._begin + self._bytes(first))
        data = self._file.read(self._bytes(last - first))
        rows = np.frombuffer(data, self._dtype).reshape(last - first, self._n_range)
        return self._falling(rows)

    def _bytes(self, n_frames: int) -> int:
        return n_frames * self._n_range * self._dtype.itemsize

    def _open(self, name: str, most_bytes: int) -> IO[bytes]:
        """Open an array whose declared size the archive can hold."""
        about = self._zip.getinfo(f"{name}.npy")
        if about.file_size > most_bytes:
            raise refuse(self.path, f"{name} says {about.file_size} bytes, which is too much")
        if about.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
            raise refuse(self.path, f"{name} is packed in a way that NumPy does not write")
        return self._zip.open(about)

    def _load(self, name: str, most_bytes: int) -> NDArray[Any] | None:
        """Return an array as a whole, None if there is none; its size is checked first."""
        if f"{name}.npy" not in self._zip.NameToInfo:
            return None
        with self._open(name, most_bytes) as file:
            shape, _, dtype, _ = _read_header(file)
            if dtype.hasobject or math.prod(shape) * dtype.itemsize > most_bytes:
                raise refuse(self.path, f"{name} is {dtype} of shape {shape}, which is not read")
            file.seek(0)
            return np.lib.format.read_array(file, allow_pickle=False)


def _read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Return shape, whether it is in Fortran order, type, and where the array begins."""
    # No more is read, whatever length the header says it has.
    head = io.BytesIO(file.read(_MAX_HEADER_BYTES))
    reader = np.lib.format.read_array_header_2_0
    if np.lib.format.read_magic(head) == (1, 0):
        reader = np.lib.format.read_array_header_1_0
    return *reader(head), head.tell()


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new archive; return what was not kept: nothing."""
    axis = source.stream.axis
    dtype = np.dtype(SAMPLE_DTYPES[axis.kind])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        with archive.open(f"{_SAMPLES}.npy", "w", force_zip64=True) as file:
            shape = (source.n_frames, axis.n_range)
            np.lib.format.write_array_header_2_0(
                file, {"descr": dtype.str, "fortran_order": False, "shape": shape}
            )
            for block in source.blocks():
                file.write(block.samples.tobytes())
        counter, t_s = source.lists()
        small: dict[str, Any] = {"counter": counter, "t_s": t_s, **source.root_attributes()}
        small |= dict(zip(_LABELS, zip(*source.labels, strict=True), strict=False))
        for name, value in small.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, np.asarray(value), allow_pickle=False)
    return []
