"""MATLAB files of version 5 to 7: our own, and those of P4xx radars; both are held as a whole.

Ours, for ``load FILE`` and ``scipy.io.loadmat``, are of version 5: samples, counter and t_s (both
columns), the attributes of an HDF5 recording, and labels as JSON text (``jsondecode``).

P4xx, read only: ``scn(i).scn`` is a scan of real bins, ``scn(i).T`` its time in milliseconds,
whose slope is the frame period and whose gaps are lost frames. Scans become RF frames in the
radar's own unit, bins of 61.035 ps from 17.499 ns on (the file's Tstrt when it is there).

MATLAB, "MAT-File Format", Level 5: 128 bytes of head and then elements, a tag (u32 type, u32
bytes; both in one u32 for 4 bytes at most) and its data, padded to 8 bytes. A variable is a
miMATRIX element, often inside one that is deflated: class, shape, name and values. These are made
of the bytes that are there: a file costs no more memory than it unpacks to, 1 GiB at most. scipy,
which only writes here, believes what a file says of its sizes and types.
"""

import itertools
import json
import math
import struct
import zlib
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import RecordingError, SettingsError
from x2radar.frame import count_by_stamps
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.recording import about
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader, Label
from x2radar.recording.faults import refuse

MAX_BYTES = 1 << 30  # Unpacked: an hour of scans of a P440; the file is held as a whole
_HEAD_BYTES, _TEXT_BYTES = 128, 116
_ORDERS = {b"\0\1IM": "<", b"\1\0MI": ">"}  # by version and byte order at the end of the head
_COMPRESSED, _MATRIX = 15, 14
_NAME_BYTES = 512  # unpacked to see a variable's name, of 63 letters at most
_STRUCT, _TEXT = 2, 4  # classes of arrays; the others that are read are numbers
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8"}
_NUMBERS |= {13: "u8", 16: "u1", 17: "u2", 18: "u4"}
"""NumPy's types of elements; the last three are letters in UTF-8, UTF-16 and UTF-32."""
_CODECS = {1: "utf-8", 2: "utf-16-le", 4: "utf-32-le"}

_BIN_S, _WINDOW_START_S = 61.035e-12, 17.499e-9
_P4XX = {
    "bin_length_m": SPEED_OF_LIGHT_MPS * _BIN_S / 2,
    "carrier_hz": 4.0e9,
    "bandwidth_hz": 1.7e9,
    "sample_rate_hz": 1 / _BIN_S,
}
_MAX_START_PS = 1_000_000  # of a P4xx, as above; a window that begins later would lie beyond 150 m


def _variables(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Return those of the variables `names` that the file has, as `_value` gives them."""
    order, content = _opened(path)
    found: dict[str, Any] = {}
    left = MAX_BYTES
    for name, kind, data in _named(order, content):
        if name in names:
            array = _array(kind, data, max(left, 1))
            left -= len(array)
            found[name] = _value(order, array, names)
    return found


def has_frames(path: Path) -> bool:
    """Return whether a file has the variable `samples`, as those that x2radar writes."""
    try:
        return any(name == "samples" for name, *_ in _named(*_opened(path)))
    except (RecordingError, EOFError, zlib.error):
        return False


def _opened(path: Path) -> tuple[str, memoryview]:
    """Return the byte order (of `struct`) and what stands behind the head."""
    if path.stat().st_size > MAX_BYTES:
        raise refuse(path, "larger than 1 GiB; convert it in parts")
    data = path.read_bytes()
    mark = data[124:_HEAD_BYTES]
    if mark in {b"\0\2IM", b"\2\0MI"}:
        raise refuse(path, "MATLAB 7.3 files are not read; save it with -v7")
    if mark not in _ORDERS:
        raise refuse(path, "not a MATLAB file of version 5 to 7")
    return _ORDERS[mark], memoryview(data)[_HEAD_BYTES:]


def _elements(order: str, data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield type and data of each element; EOFError if one is cut off."""
    at = 0
    while at + 8 <= len(data):
        kind, n = struct.unpack_from(f"{order}II", data, at)
        begin, step = at + 8, 8 + n
        if kind >> 16:
            # Small data: the count stands beside the type, the data in place of the count.
            kind, n = kind & 0xFFFF, kind >> 16
            begin, step = at + 4, 8
        if begin + n > min(at + step, len(data)):
            raise EOFError("cut off")
        yield kind, data[begin : begin + n]
        at += step if kind == _COMPRESSED else -(-step // 8) * 8


def _array(kind: int, data: memoryview, most_bytes: int) -> memoryview:
    """Return what stands in a variable's miMATRIX element, as far as `most_bytes` go."""
    if kind != _COMPRESSED:
        return data
    return memoryview(zlib.decompressobj().decompress(data, most_bytes))[8:]


def _named(order: str, content: memoryview) -> Iterator[tuple[str, int, memoryview]]:
    """Yield the variables, each with its name: the third part, behind its class and its shape."""
    for kind, data in _elements(order, content):
        if kind in {_COMPRESSED, _MATRIX}:
            parts = _elements(order, _array(kind, data, _NAME_BYTES))
            _, name = next(itertools.islice(parts, 2, None), (0, b""))
            yield bytes(name).decode("latin-1"), kind, data


def _numbers(order: str, kind: int, data: memoryview) -> NDArray[Any]:
    return np.frombuffer(data, order + _NUMBERS[kind])


def _value(order: str, array: memoryview, names: Collection[str]) -> Any:
    """Return an array of numbers, read-only, a text, or the fields `names` of structs, as lists.

    Python's own errors tell of an array that is not what it says.
    """
    flags, shape, _, *held = _elements(order, array)
    kind, dims = int(_numbers(order, *flags)[0]) & 0xFF, _numbers(order, *shape).tolist()
    if kind == _STRUCT:
        length, text, *held = held
        fields = _numbers(order, *text).view(f"S{_numbers(order, *length)[0]}")
        if len(held) != fields.size * math.prod(dims):
            raise ValueError(f"{len(held)} values are {dims} structs of {fields.size} fields")
        return {
            name: [_value(order, data, names) for _, data in held[k :: fields.size]]
            for name in names
            for k in np.flatnonzero(fields == name.encode()).tolist()
        }
    values, *imaginary = (_numbers(order, *part) for part in held)
    if kind == _TEXT:
        little = values.astype(values.dtype.newbyteorder("<"))
        return little.tobytes().decode(_CODECS[little.itemsize])
    if imaginary:
        real, values = values, np.empty(values.shape, np.result_type(values, np.complex64))
        values.real, values.imag = real, imaginary[0]
    return values.reshape(dims, order="F")


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
        scans = _variables(path, {"scn", "T", "Tstrt"}).get("scn")
        if not (isinstance(scans, dict) and scans.get("scn") and "T" in scans):
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
        said_ps = about.plain(scans["Tstrt"][0]) if "Tstrt" in scans else None
        start_s = _WINDOW_START_S
        if isinstance(said_ps, int | float) and 0 < said_ps < _MAX_START_PS:
            start_s = said_ps * 1e-12
        attributes = _P4XX | {
            "frame_rate_hz": 1 / period_s if np.isfinite(period_s) else None,
            "range_offset_m": SPEED_OF_LIGHT_MPS * start_s / 2,
        }
        self._keep(frames, attributes, "P4xx recording")
