"""MATLAB files of version 5 to 7: our own, and those of P4xx radars; both are held as a whole.

Ours, for ``load FILE`` and ``scipy.io.loadmat``, are of version 5: samples, counter and t_s (both
columns), the attributes of an HDF5 recording, and labels as JSON text (``jsondecode``).

P4xx, read only: ``scn(i).scn`` is a scan of real bins, ``scn(i).T`` its time in milliseconds,
whose slope is the frame period and whose gaps are lost frames. Scans become RF frames in the
radar's own unit, bins of 61.035 ps from 17.499 ns on (the file's Tstrt when it is there).

scipy reads the variables, and believes what a file says of its sizes: every array's is held
against the bytes that are there first, so a file costs no more memory than it unpacks to, 1 GiB at
most. MATLAB, "MAT-File Format", Level 5: 128 bytes of head and then elements, a tag (u32 type, u32
bytes; both in one u32 for 4 bytes at most) and its data, padded to 8 bytes. A variable is a
miMATRIX element, often inside one that is deflated.
"""

import io
import itertools
import json
import math
import struct
import zlib
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from x2radar.errors import RecordingError, SettingsError
from x2radar.frame import SPEED_OF_LIGHT_MPS, count_by_stamps
from x2radar.recording import about
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader, Label
from x2radar.recording.faults import refuse

MAX_BYTES = 1 << 30  # Unpacked: an hour of scans of a P440; the file is held as a whole
_HEAD_BYTES, _TEXT_BYTES = 128, 116
_ORDERS = {b"IM": "<", b"MI": ">"}
_COMPRESSED, _MATRIX = 15, 14
_NAME_BYTES = 512  # unpacked to see a variable's name, of 63 letters at most
_CELL, _STRUCT, _TEXT = 1, 2, 4
_CLASSES = frozenset({_CELL, _STRUCT, _TEXT, *range(6, 16)})  # of these and numbers alone
_COMPLEX = 0x0800  # of an array's flags
_VALUES = frozenset({*range(1, 8), 9, 12, 13, 16, 17, 18})  # elements of numbers and letters
_MAX_DEPTH = 8  # structs within structs; a scan of a P4xx lies two deep
_MAX_LETTERS, _MAX_FIELDS = 64, 1000  # MATLAB's longest field's name, and more fields than are

_BIN_S, _WINDOW_START_S = 61.035e-12, 17.499e-9
_P4XX = {
    "bin_length_m": SPEED_OF_LIGHT_MPS * _BIN_S / 2,
    "carrier_hz": 4.0e9,
    "bandwidth_hz": 1.7e9,
    "sample_rate_hz": 1 / _BIN_S,
}
_MAX_START_PS = 1_000_000  # of a P4xx, as above; a window that begins later would lie beyond 150 m


def _variables(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Return those of the variables `names` that the file has, as scipy's loadmat gives them."""
    # Late: scipy takes a while, and all other formats do without.
    from scipy.io import loadmat  # noqa: PLC0415

    head, order, content = _opened(path)
    parts: list[bytes | memoryview] = [head]
    left = MAX_BYTES
    for name, kind, data in _named(path, order, content):
        if name in names:
            array = _array(kind, data, left)
            _check(path, order, array)
            left -= len(array)
            parts += [struct.pack(f"{order}II", _MATRIX, len(array)), array]
    return dict(loadmat(io.BytesIO(b"".join(parts))))


def has_frames(path: Path) -> bool:
    """Return whether a file has the variable `samples`, as those that x2radar writes."""
    try:
        return any(name == "samples" for name, *_ in _named(path, *_opened(path)[1:]))
    except (RecordingError, struct.error, zlib.error):
        return False


def _opened(path: Path) -> tuple[bytes, str, memoryview]:
    """Return head, byte order (of `struct`) and what stands behind the head."""
    if path.stat().st_size > MAX_BYTES:
        raise refuse(path, "larger than 1 GiB; convert it in parts")
    data = path.read_bytes()
    order = _ORDERS.get(data[126:128])
    if len(data) < _HEAD_BYTES or order is None:
        raise refuse(path, "not a MATLAB file of version 5 to 7")
    (version,) = struct.unpack(f"{order}H", data[124:126])
    if version == 0x0200:
        raise refuse(path, "MATLAB 7.3 files are not read; save it with -v7")
    if version != 0x0100:
        raise refuse(path, f"a MATLAB file of version {version:#x}, which is not read")
    return data[:_HEAD_BYTES], order, memoryview(data)[_HEAD_BYTES:]


def _elements(path: Path, order: str, data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield type and data of each element."""
    at = 0
    while at + 8 <= len(data):
        kind, n = struct.unpack_from(f"{order}II", data, at)
        begin, step = at + 8, 8 + n
        if kind >> 16:
            # Small data: the count stands beside the type, the data in place of the count.
            kind, n = kind & 0xFFFF, kind >> 16
            begin, step = at + 4, 8
            if n > 4:
                raise refuse(path, "damaged: a small element of more than 4 bytes")
        if begin + n > len(data):
            raise refuse(path, "cut off")
        yield kind, data[begin : begin + n]
        at += step if kind == _COMPRESSED else -(-step // 8) * 8


def _array(kind: int, data: memoryview, most_bytes: int) -> memoryview:
    """Return what stands in a variable's miMATRIX element, as far as `most_bytes` go."""
    if kind != _COMPRESSED:
        return data
    return memoryview(zlib.decompressobj().decompress(data, max(1, most_bytes)))[8:]  # 0: all


def _named(path: Path, order: str, content: memoryview) -> Iterator[tuple[str, int, memoryview]]:
    """Yield the variables, each with its name: the third part, behind its class and its shape."""
    for kind, data in _elements(path, order, content):
        if kind in {_COMPRESSED, _MATRIX}:
            parts = _elements(path, order, _array(kind, data, _NAME_BYTES))
            _, name = next(itertools.islice(parts, 2, None), (0, b""))
            yield bytes(name).decode("latin-1"), kind, data


def _check(path: Path, order: str, array: memoryview, depth: int = 0) -> None:
    """Refuse an array that is not what it says: scipy reads on at places and types as they come.

    Each value, cell or field takes a byte, so a shape beyond the bytes that are there is a lie.
    """
    parts = list(_elements(path, order, array))
    if len(parts) < 3 or len(parts[0][1]) != 8 or (depth and len(array) % 8):
        raise refuse(path, "cut off")
    (word,) = struct.unpack_from(f"{order}I", parts[0][1])
    shape, held = parts[1][1], parts[3:]
    dims = struct.unpack(f"{order}{len(shape) // 4}i", shape)
    if not dims or min(dims) < 0 or math.prod(dims) > len(array):
        raise refuse(path, f"damaged: {len(array)} bytes are an array of the shape {dims}")
    kind, n_held, kinds = word & 0xFF, math.prod(dims), frozenset({_MATRIX})
    if kind not in _CLASSES or depth > _MAX_DEPTH:
        raise refuse(path, f"an array of class {kind}, {depth} deep, which is not read")
    if kind == _STRUCT:
        n_held *= _n_fields(path, order, held[:2])
        held = held[2:]
    elif kind != _CELL:
        n_held = 2 if word & _COMPLEX and kind != _TEXT else 1
        kinds = _VALUES
    if len(held) != n_held or not kinds.issuperset(each for each, _ in held):
        raise refuse(path, f"damaged: an array of class {kind} holds what it cannot")
    for _, data in held:
        # MATLAB writes an empty field as an element without bytes.
        if kinds is not _VALUES and data:
            _check(path, order, data, depth + 1)


def _n_fields(path: Path, order: str, parts: list[tuple[int, memoryview]]) -> int:
    """Return how many fields a struct has, by its elements for the names of them."""
    if len(parts) < 2:
        raise refuse(path, "cut off")
    n_letters: int = struct.unpack(f"{order}i", parts[0][1])[0]
    n_bytes = len(parts[1][1])
    if not 0 < n_letters <= _MAX_LETTERS or n_bytes > _MAX_FIELDS * n_letters:
        raise refuse(path, f"a struct of fields with {n_letters} letters")
    return n_bytes // n_letters


class Reader(BlockReader):
    """Read a MATLAB file with the variables that `write` makes; it is held as a whole."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        arrays = {"samples", "counter", "t_s"}
        found = _variables(path, {*arrays, *about.ATTRIBUTES, "labels"})
        if missing := sorted(arrays - set(found)):
            raise refuse(path, f"lacks {', '.join(missing)}")
        self._rows = found["samples"]
        frames = about.kind_of(path, self._rows.shape, self._rows.dtype)
        self.n_frames = len(self._rows)
        self._keep_lists(found["counter"], found["t_s"])
        self._keep(frames, found, path.name)
        self._labels = about.plain(found.get("labels"))

    def read_labels(self) -> Iterable[Label]:
        labels: list[Label] = json.loads(self._labels) if self._labels else []
        return labels


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file; return what was not kept: nothing."""
    # Late: scipy takes a while, and all other formats do without.
    from scipy.io import savemat  # noqa: PLC0415

    axis = source.stream.axis
    dtype = np.dtype(about.SAMPLE_DTYPES[axis.kind])
    n_bytes = source.n_frames * axis.n_range * dtype.itemsize
    if n_bytes > MAX_BYTES * 3 // 4:
        msg = f"{path.name}: {n_bytes / 1e9:.1f} GB of samples are too many for a MATLAB file"
        raise SettingsError(msg)
    counter, t_s = source.lists()
    content: dict[str, Any] = {
        **source.root_attributes(),
        "samples": np.concatenate([block.samples for block in source.blocks()]),
        "counter": counter[:, None],
        "t_s": t_s[:, None],
        "labels": json.dumps(source.labels),
    }
    savemat(path, content, appendmat=False)
    with path.open("r+b") as file:
        # scipy's text there has the time: the same recording makes the same file.
        file.write(b"MATLAB 5.0 MAT-file of x2radar".ljust(_TEXT_BYTES))
    return []


class P4xxReader(BlockReader):
    """Read a ``.mat`` file of a P4xx, up to version 7 (7.3 is HDF5 and not read)."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        scans = np.ravel(_variables(path, {"scn"}).get("scn", ()))
        if not scans.size or not {"scn", "T"} <= set(scans.dtype.names or ()):
            raise refuse(path, "no P4xx recording: no struct 'scn' with the fields scn and T")
        stamps_ms = np.array([stamp.item() for stamp in scans["T"]], np.float64)
        rows = np.stack([np.ravel(scan) for scan in scans["scn"]])
        frames = about.kind_of(path, rows.shape, rows.dtype)
        if frames[0] != "rf":
            raise refuse(path, "scans of complex numbers; those of a P4xx are real")
        self.n_frames = len(rows)
        self._rows = rows
        period_s = float("nan")
        if self.n_frames > 1:
            self._counter, period_s = count_by_stamps(stamps_ms / 1e3)
        said_ps = about.plain(scans["Tstrt"][0]) if "Tstrt" in scans.dtype.names else None
        start_s = _WINDOW_START_S
        if isinstance(said_ps, int | float) and 0 < said_ps < _MAX_START_PS:
            start_s = said_ps * 1e-12
        attributes = _P4XX | {
            "frame_rate_hz": 1 / period_s if np.isfinite(period_s) else None,
            "range_offset_m": SPEED_OF_LIGHT_MPS * start_s / 2,
        }
        self._keep(frames, attributes, "P4xx recording")
