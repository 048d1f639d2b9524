"""HDF5 files from anywhere, opened and looked into without trust.

HDF5's own SWMR mode repeats every read whose checksum is wrong, 100 times a level, and holds the
GIL. So a file that its writer has not closed is read through a view with the superblock that a
close would have left, with some further attempts. Links that lead out of the file or around it,
external storage, virtual data sets and impossible sizes are refused first.
"""

import contextlib
import io
import math
import mmap
import re
import struct
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording import about
from x2radar.recording.about import NO_OVERRIDES, Overrides, plain
from x2radar.recording.blocks import BLOCK_BYTES, BlockReader, Label
from x2radar.recording.faults import refuse, unreadable

_T = TypeVar("_T")

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SUPERBLOCK_BYTES = 48  # of version 2 and 3; the last 4 are its checksum (Specification, II.A)
_OPEN_FOR_WRITE = 0b101  # consistency flags of a superblock: bit 0 write access, bit 2 SWMR
_HEAP, _MIN_HEAP = b"GCOL\x01", 4096
_HEAP_OBJECT = struct.Struct("<HHIQ")
"""Signature, version and least size of a global heap; index, references, reserved and size."""
_ATTEMPTS, _WAIT_S = 5, 0.02  # at a file that is being written, in well under 1 ms a block

_U32 = 0xFFFFFFFF
MAX_CHUNK_BYTES = 1 << 26  # unpacked as a whole: other programs write minutes of frames
_MAX_PACKED = 1100  # bytes that one byte of a file unpacks to; deflate reaches 1032 at most
_MAX_ATTRIBUTE_BYTES = 1 << 20  # of an attribute; device and settings are some kB of JSON


class _Unflagged(io.FileIO):
    """A file with another superblock, for HDF5 to read."""

    def __init__(self, path: Path, head: bytes) -> None:
        super().__init__(path)
        self._head = head

    def readinto(self, buffer: Any, /) -> int:
        """Read; the superblock comes from memory."""
        at, n = self.tell(), super().readinto(buffer) or 0
        head = self._head[at : at + n]
        memoryview(buffer)[: len(head)] = head
        return n


class Hdf5File:
    """A file that is only read; RecordingError if it is damaged or asks for what is refused."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with unreadable(path):
            checked = _checked_head(path)
            self._n_bytes = path.stat().st_size
            head = _unflagged(checked, self._n_bytes)
            self.is_unclosed = head is not None
            self.file: h5py.File = self._patient(lambda: self._open(head))

    def _open(self, head: bytes | None) -> h5py.File:
        with contextlib.ExitStack() as opened:
            view = opened.enter_context(_Unflagged(self.path, head)) if head else self.path
            file: h5py.File = opened.enter_context(h5py.File(view, "r"))
            # HDF5 closes what is open when the process ends, and then no Python answers any more.
            self._end = weakref.finalize(self, opened.pop_all().close)
            return file

    def close(self) -> None:
        self._end()

    def _patient(self, work: Callable[[], _T]) -> _T:
        """Return what `work` does, tried several times if the file may be being written."""
        for _ in range(_ATTEMPTS - 1 if self.is_unclosed else 0):
            try:
                return work()
            except (OSError, RuntimeError, KeyError):
                time.sleep(_WAIT_S)
        return work()

    def attribute(self, name: str) -> Any:
        """Return a root attribute: text, bytes or a number; None if there is none."""
        if name not in self.file.attrs:
            return None
        known = self.file.attrs.get_id(name)
        is_text = h5py.check_string_dtype(known.dtype) is not None
        if math.prod(known.shape or ()) != 1 or not (is_text or known.dtype.kind in "SUbiuf"):
            raise refuse(self.path, f"attribute '{name}' is no text and no number")
        if known.get_storage_size() > _MAX_ATTRIBUTE_BYTES:
            raise refuse(self.path, f"attribute '{name}' is longer than any of a recording")
        return plain(self.file.attrs[name])

    def data_set(self, name: str) -> h5py.Dataset | None:
        """Return a data set by its path, None if there is none; raise if it is refused."""
        item: Any = self.file
        for part in name.split("/"):
            link = item.get(part, getlink=True) if isinstance(item, h5py.Group) else None
            if link is None:
                return None
            if not isinstance(link, h5py.HardLink):
                raise refuse(self.path, f"/{name} is a link to elsewhere, which is not followed")
            item = self._patient(lambda item=item, part=part: item[part])  # type: ignore[misc]
        if not isinstance(item, h5py.Dataset):
            return None
        self._check_size(name, item)
        return item

    def _check_size(self, name: str, item: h5py.Dataset) -> None:
        """Refuse a data set that lies elsewhere, or is larger than this file can hold."""
        if item.external or item.is_virtual:
            raise refuse(self.path, f"/{name} lies in other files, which are not read")
        if item.shape is None:
            raise refuse(self.path, f"/{name} is empty")
        n_bytes = math.prod(item.shape) * item.dtype.itemsize
        pack = item.id.get_create_plist()
        found = [pack.get_filter(k) for k in range(pack.get_nfilters())]
        filters = [name or b"filter %d" % number for number, _, _, name in found]
        packing = [f for f in filters if f not in {b"shuffle", b"fletcher32"}]
        if len(packing) > 1 or not set(packing) <= {b"deflate", b"lzf"}:
            known = b", ".join(filters).decode("utf-8", "replace")
            raise refuse(self.path, f"/{name} is packed by {known}; read are gzip and lzf")
        if n_bytes > self._n_bytes * (_MAX_PACKED if packing else 1):
            raise refuse(self.path, f"/{name} says {n_bytes} bytes, which the file cannot hold")
        if item.chunks and math.prod(item.chunks) * item.dtype.itemsize > MAX_CHUNK_BYTES:
            raise refuse(self.path, f"/{name} has chunks of {item.chunks}, which is too large")

    def read(self, item: h5py.Dataset, at: Any) -> NDArray[Any]:
        """Return what stands in a data set at these indices."""
        return self._patient(lambda: np.asarray(item[at]))


def _checked_head(path: Path) -> bytes:
    """Refuse what is no HDF5 file, or has a global heap (where texts lie) that does not add up.

    HDF5 2.0 goes in a circle there, and holds the GIL. HDF5 File Format Specification 3.0, III.E.
    Return the superblock, of version 2 or 3.
    """
    with path.open("rb") as file:
        head = file.read(_SUPERBLOCK_BYTES)
        # Sizes of 8 bytes, as all programs write them, at the places of both kinds of superblock.
        sizes = head[9:11] if head[8:9] > b"\x01" else head[13:15]
        if head[:8] != _SIGNATURE or sizes != b"\x08\x08":
            raise refuse(path, "not an HDF5 file, or damaged")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            # `re` is three times as fast as `mmap.find`: 0.7 s for 1 GB.
            for begin in (found.start() for found in re.finditer(_HEAP, data)):
                size = int.from_bytes(data[begin + 8 : begin + 16], "little")
                # By chance these bytes stand anywhere, and then no such size behind them.
                if _MIN_HEAP <= size <= len(data) - begin and not _is_filled(data, begin, size):
                    raise refuse(path, "damaged: a heap of texts that does not add up")
    return head


def _is_filled(data: mmap.mmap, begin: int, size: int) -> bool:
    at, end = begin + 16, begin + size
    while at + 16 <= end:
        index, _, _, n = _HEAP_OBJECT.unpack_from(data, at)
        # The free space, object 0, counts its head.
        n = 16 + -(-n // 8) * 8 if index else n
        if not 16 <= n <= end - at:
            return False
        at += n
    return True


def _unflagged(head: bytes, n_bytes: int) -> bytes | None:
    """Return the superblock that a file should have; None where its own will do."""
    version, flags = head[8], head[11]
    is_sound = version in {2, 3} and head[44:] == lookup3(head[:44]).to_bytes(4, "little")
    if not (is_sound and flags & _OPEN_FOR_WRITE):
        return None
    # The end of the file stands there as it was at some flush.
    end = n_bytes.to_bytes(8, "little")
    out = head[:11] + bytes([flags & ~_OPEN_FOR_WRITE]) + head[12:28] + end + head[36:44]
    return out + lookup3(out).to_bytes(4, "little")


def lookup3(data: bytes) -> int:
    """Return the checksum of HDF5's metadata: `hashlittle` of Jenkins' lookup3, start 0.

    B. Jenkins, "lookup3.c", 2006.

    >>> hex(lookup3(b"Four score and seven years ago"))
    '0x17770551'
    """
    a = b = c = (0xDEADBEEF + len(data)) & _U32
    n_blocks = -(-len(data) // 12)
    words = struct.unpack(f"<{3 * n_blocks}I", data.ljust(12 * n_blocks, b"\0"))
    for k in range(0, len(words), 3):
        a, b, c = (a + words[k]) & _U32, (b + words[k + 1]) & _U32, (c + words[k + 2]) & _U32
        # The steps of lookup3's mix() and final() differ by names and turns alone.
        for turn in (4, 6, 8, 16, 19, 4) if k + 3 < len(words) else ():
            a = ((a - c) & _U32) ^ _turned(c, turn)
            a, b, c = b, (c + b) & _U32, a
    for turn in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, ((c ^ b) - _turned(b, turn)) & _U32, a
    return b


def _turned(x: int, k: int) -> int:
    return ((x << k) | (x >> (32 - k))) & _U32


_OPTIONAL = ("bandwidth_hz", "phase_sign", "run_id")
_MAX_LABELS = 10_000  # a label every few seconds for a night
_MAX_LABEL_CHARACTERS = 1 << 22  # of all labels together, some hundred each


class RecordingReader(Hdf5File, BlockReader):
    """Read a recording, which may still be written to, with `axis.phase_sign` -1."""

    def __init__(self, path: Path | str, overrides: Overrides = NO_OVERRIDES) -> None:
        BlockReader.__init__(self, Path(path), overrides)
        Hdf5File.__init__(self, self.path)
        with unreadable(path):
            self._check()

    def read_labels(self) -> Iterator[Label]:
        if "labels" not in self.file:
            return
        found = [self.data_set(f"labels/{name}") for name in ("t0_s", "t1_s", "label")]
        sets = [item for item in found if item is not None and item.ndim == 1]
        n = min(map(len, sets), default=0)
        if len(sets) < len(found) or n < max(map(len, sets)):
            raise refuse(self.path, "/labels lacks t0_s, t1_s or label, or they differ in length")
        if n > _MAX_LABELS:
            raise refuse(self.path, f"{n} labels, at most {_MAX_LABELS} are read")
        n_left = _MAX_LABEL_CHARACTERS
        for k in range(n):
            # One by one: many labels of a hostile file may share one long text.
            t0_s, t1_s, label = (plain(self.read(item, slice(k, k + 1))) for item in sets)
            text = str(label)
            n_left -= len(text)
            if n_left < 0:
                raise refuse(self.path, "labels of more text than those of any recording")
            yield t0_s, t1_s, text

    @property
    def _n_block(self) -> int:
        # Whole chunks: every one is unpacked once.
        n_block, chunks = super()._n_block, self._sets["samples"].chunks
        if chunks and chunks[0] * BLOCK_BYTES < n_block * MAX_CHUNK_BYTES:
            n_block = max(1, n_block // chunks[0]) * chunks[0]
        return n_block

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        return self._column("counter", first, last)

    def read_times(self, first: int, last: int) -> NDArray[np.float64]:
        return self._column("t_s", first, last).astype(np.float64, copy=False)

    def read_samples(self, first: int, last: int) -> Samples:
        return self._falling(self.read(self._sets["samples"], slice(first, last)))

    def _column(self, name: str, first: int, last: int) -> NDArray[Any]:
        """Return numbers of a list, which may be a column or a row of a matrix."""
        item, rows = self._sets[name], slice(first, last)
        is_row = item.ndim == 2 and len(item) == 1
        return self.read(item, (0, rows) if is_row else rows).ravel()

    def _check(self) -> None:
        said = {name: self.attribute(name) for name in ("format", *about.ATTRIBUTES)}
        if said["format"] != about.FORMAT:
            raise refuse(self.path, f"no recording (attribute 'format' is not '{about.FORMAT}')")
        for name, value in said.items():
            if value is None and name not in _OPTIONAL:
                raise refuse(self.path, f"attribute '{name}' is missing")
        self._keep(self._check_sets(), said, self.path.name)
        samples = self._sets["samples"]
        packed = samples.compression or "none"
        self.compression = f"shuffle+{packed}" if samples.shuffle else str(packed)
        self.has_decisions = "decisions" in self.file

    def _check_sets(self) -> about.Row:
        """Find the data sets and how long they are; return kind and bins of the samples."""
        self._sets: dict[str, Any] = {}
        for name in ("samples", "counter", "t_s"):
            self._sets[name] = item = self.data_set(f"frames/{name}")
            if item is None:
                raise refuse(self.path, f"data set '/frames/{name}' is missing")
        samples, *lists = self._sets.values()
        frames = about.kind_of(self.path, samples.shape, samples.dtype)
        for item in lists:
            is_list = item.size == max(item.shape, default=0) and item.ndim <= 2
            if not is_list or item.dtype.kind not in "iuf":
                raise refuse(self.path, f"{item.name} is no list of numbers")
        sizes = {item.size for item in lists}
        if sizes == {samples.shape[1]} != {len(samples)}:
            raise refuse(self.path, "samples has a column a frame; it must be (n, n_range)")
        lengths = {len(samples), *sizes}
        self.n_frames = min(lengths)
        if self.n_frames == 0:
            raise refuse(self.path, "no frames in it")
        if self.is_unclosed or len(lengths) > 1:
            still = "is being written, or " if self.is_unclosed else ""
            self._warn(f"the recording {still}was cut off; {self.n_frames} whole frames are read")
        return frames
