"""Variables of MATLAB files of version 5 to 7, read by scipy once every size in them is checked.

MATLAB, "MAT-File Format", Level 5. A file is 128 bytes of head and then elements; an element is
a tag (u32 type, u32 bytes; both in one u32 when there are 4 bytes at most) and its data, padded
to 8 bytes. A variable is a miMATRIX element, often inside one that is deflated. scipy believes
what a file says of its sizes, so every array's is held against the bytes that are there before
scipy sees it: a file costs no more memory than it unpacks to, 1 GiB at most.
"""

import io
import itertools
import math
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from x2radar.errors import RecordingError
from x2radar.recording.faults import refuse

MAX_BYTES = 1 << 30
"""Unpacked: an hour of scans of a P440; the file is held as a whole."""
_HEAD_BYTES = 128
_ORDERS = {b"IM": "<", b"MI": ">"}
_COMPRESSED, _MATRIX = 15, 14
_NAME_BYTES = 512
"""Unpacked to see a variable's name, which is in front and has 63 letters at most."""
_STRUCT = 2
_CLASSES = frozenset({1, _STRUCT, 4, *range(6, 16)})
"""Cells, structs, text and numbers; no sparse matrices, objects or functions."""
_MAX_DEPTH = 8
"""Structs within structs; a scan of a P4xx lies two deep."""
_MAX_LETTERS, _MAX_FIELDS = 64, 1000
"""MATLAB's longest name of a field, with its end, and more fields than a recording has."""


def variables(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Return those of the variables `names` that the file has, as scipy's loadmat gives them.

    Raises RecordingError, ValueError, struct.error or zlib.error if it is no such file, or
    damaged.
    """
    # Late: scipy takes a while, and all other formats do without.
    from scipy.io import loadmat  # noqa: PLC0415

    head, order, content = _opened(path)
    plain: list[bytes | memoryview] = [head]
    left = MAX_BYTES
    for kind, data in _elements(path, order, content):
        if _name_in(path, order, kind, data) in names:
            array = _array(kind, data, left)
            _check(path, order, array)
            left -= len(array)
            plain += [struct.pack(f"{order}II", _MATRIX, len(array)), array]
    return dict(loadmat(io.BytesIO(b"".join(plain))))


def has_frames(path: Path) -> bool:
    """Return whether a file has the variable `samples`, as those that x2radar writes."""
    try:
        _, order, content = _opened(path)
        return any(
            _name_in(path, order, kind, data) == "samples"
            for kind, data in _elements(path, order, content)
        )
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
    return memoryview(zlib.decompressobj().decompress(data, most_bytes))[8:]


def _name_in(path: Path, order: str, kind: int, data: memoryview) -> str:
    """Return the name of a variable; the third part, behind its class and its shape."""
    if kind not in {_COMPRESSED, _MATRIX}:
        return ""
    parts = _elements(path, order, _array(kind, data, _NAME_BYTES))
    _, name = next(itertools.islice(parts, 2, None), (0, b""))
    return bytes(name).decode("latin-1")


def _check(path: Path, order: str, array: memoryview, depth: int = 0) -> None:
    """Refuse an array that says more than it holds: each value, cell or field takes a byte."""
    (flags, shape, _), rest = _first(path, order, array, 3)
    (word,) = struct.unpack_from(f"{order}I", flags)
    dims = struct.unpack(f"{order}{len(shape) // 4}i", shape)
    if not dims or min(dims) < 0 or math.prod(dims) > len(array):
        raise refuse(path, f"damaged: {len(array)} bytes are an array of the shape {dims}")
    if word & 0xFF not in _CLASSES or depth > _MAX_DEPTH:
        raise refuse(path, f"an array of class {word & 0xFF}, {depth} deep, which is not read")
    if word & 0xFF == _STRUCT:
        (length, names), rest = _first(path, order, array, 5, 3)
        (n_letters,) = struct.unpack(f"{order}i", length)
        if not 0 < n_letters <= _MAX_LETTERS or len(names) > _MAX_FIELDS * n_letters:
            raise refuse(path, f"a struct of fields with {n_letters} letters")
    for kind, data in rest:
        # MATLAB writes an empty field as an element without bytes.
        if kind == _MATRIX and data:
            _check(path, order, data, depth + 1)


def _first(
    path: Path, order: str, array: memoryview, n: int, begin: int = 0
) -> tuple[list[memoryview], Iterator[tuple[int, memoryview]]]:
    """Return the first elements of an array, from `begin` to `n`, and the rest."""
    parts = _elements(path, order, array)
    found = [data for _, data in itertools.islice(parts, begin, n)]
    if len(found) < n - begin:
        raise refuse(path, "cut off")
    return found, parts
