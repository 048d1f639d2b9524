"""Numbers and text from MATLAB files of version 5 to 7, without trust.

MATLAB, "MAT-File Format", Level 5. A file is 128 bytes of head and then elements; an element is
a tag (u32 type, u32 bytes; both in one u32 when there are 4 bytes at most) and its data, padded
to 8 bytes. A variable is a miMATRIX element, often inside one that is deflated. Every size is
held against the bytes that are there before anything is made of it, so that a file costs no more
memory than it unpacks to, 1 GiB at most.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from x2radar.recording.blocks import refuse

_HEAD_BYTES = 128
_ORDERS = {b"IM": "<", b"MI": ">"}
_VERSION = 0x0100
_COMPRESSED, _MATRIX = 15, 14
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}
"""Types of data; the class of an array may promise more than its values need."""
_UTF8 = 16
_STRUCT, _CHARS = 2, 4
_NUMERIC = range(6, 16)
_COMPLEX = 0x0800
"""Classes and a flag of arrays."""
_MOST_LETTERS, _MOST_FIELDS = 64, 1000
"""MATLAB's longest name of a field, with its end; and what no recording needs (chosen)."""
_MOST_BYTES = 1 << 30
"""Unpacked. Chosen: an hour of scans of a P440; the file is held as a whole."""

Rows = list[dict[str, NDArray[np.generic]]]


class _Array(NamedTuple):
    kind: int
    is_complex: bool
    dims: tuple[int, ...]
    name: str
    parts: Iterator[tuple[int, memoryview]]


class Mat5File:
    """A MATLAB file; raises RecordingError, ValueError or zlib.error if it is none, or damaged."""

    def __init__(self, path: Path) -> None:
        self._path = path
        if path.stat().st_size > _MOST_BYTES:
            raise refuse(path, "larger than 1 GiB; convert it in parts")
        data = path.read_bytes()
        order = _ORDERS.get(data[126:128])
        if len(data) < _HEAD_BYTES or order is None:
            raise refuse(path, "not a MATLAB file of version 5 to 7")
        self._order = order
        (version,) = struct.unpack(f"{order}H", data[124:126])
        if version == 2 * _VERSION:
            raise refuse(path, "MATLAB 7.3 files are not read; save it with -v7")
        if version != _VERSION:
            raise refuse(path, f"a MATLAB file of version {version:#x}, which is not read")
        self._data = memoryview(data)[_HEAD_BYTES:]

    def struct(self, name: str, fields: tuple[str, ...]) -> Rows | None:
        """Return the numbers in some fields of every element of a struct array; None without it.

        Fields that are not there, or hold no numbers, are missing in all or some rows.
        """
        for array in self._variables():
            if array.name == name:
                return self._rows(array, fields) if array.kind == _STRUCT else None
        return None

    def variables(self, names: tuple[str, ...]) -> dict[str, NDArray[np.generic] | str]:
        """Return arrays of numbers, in their own shape, and texts; others are left out."""
        found: dict[str, NDArray[np.generic] | str] = {}
        for array in self._variables():
            if array.name in names and array.kind in _NUMERIC:
                parts = [self._values(array) for _ in range(2 if array.is_complex else 1)]
                values = parts[0] if len(parts) == 1 else _joined(*parts)
                found[array.name] = values.reshape(array.dims, order="F")
            elif array.name in names and array.kind == _CHARS:
                kind, data = next(array.parts, (_UTF8, memoryview(b"")))
                if kind == _UTF8:
                    found[array.name] = bytes(data).decode("utf-8", "replace")
        return found

    def _variables(self) -> Iterator[_Array]:
        for kind, found in self._elements(self._data):
            data = found
            if kind == _COMPRESSED:
                kind, data = next(self._elements(self._unpacked(found)), (0, found))  # noqa: PLW2901
            if kind == _MATRIX:
                yield self._array(data)

    def _unpacked(self, data: memoryview) -> memoryview:
        unpack = zlib.decompressobj()
        out = unpack.decompress(data, _MOST_BYTES)
        if unpack.unconsumed_tail:
            raise refuse(self._path, "unpacks to more than 1 GiB; convert it in parts")
        return memoryview(out)

    def _elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        at = 0
        while at + 8 <= len(data):
            kind, n = struct.unpack_from(f"{self._order}II", data, at)
            begin, step = at + 8, 8 + n
            if kind >> 16:
                # Small data: the count stands beside the type, the data in place of the count.
                kind, n = kind & 0xFFFF, kind >> 16
                begin, step = at + 4, 8
                if n > 4:
                    raise refuse(self._path, "damaged: a small element of more than 4 bytes")
            if begin + n > len(data):
                raise refuse(self._path, "cut off")
            yield kind, data[begin : begin + n]
            at += step if kind == _COMPRESSED else -(-step // 8) * 8

    def _array(self, data: memoryview) -> _Array:
        parts = self._elements(data)
        if not data:
            # MATLAB writes an empty field as an element without bytes.
            return _Array(0, False, (), "", parts)
        flags, dims, name = (self._next(parts) for _ in range(3))
        (word,) = struct.unpack_from(f"{self._order}I", flags)
        shape = struct.unpack(f"{self._order}{len(dims) // 4}i", dims)
        if not shape or min(shape) < 0:
            raise refuse(self._path, f"an array has the shape {shape}")
        text = bytes(name).decode("latin-1")
        return _Array(word & 0xFF, bool(word & _COMPLEX), shape, text, parts)

    def _rows(self, array: _Array, wanted: tuple[str, ...]) -> Rows:
        (length,) = struct.unpack(f"{self._order}i", self._next(array.parts))
        joined = bytes(self._next(array.parts))
        if not 0 < length <= _MOST_LETTERS:
            raise refuse(self._path, f"names of fields with {length} letters")
        if len(joined) > _MOST_FIELDS * length:
            raise refuse(self._path, f"a struct of {len(joined) // length} fields")
        names = [
            joined[k : k + length].split(b"\0")[0].decode("latin-1")
            for k in range(0, len(joined), length)
        ]
        rows: Rows = []
        if not set(wanted) & set(names):
            return rows
        for _ in range(math.prod(array.dims)):
            # As many elements must be there as the shape says: an empty one has 8 bytes.
            row = {}
            for name in names:
                data = self._next(array.parts)
                numbers = self._numbers(data) if name in wanted else None
                if numbers is not None:
                    row[name] = numbers
            rows.append(row)
        return rows

    def _numbers(self, data: memoryview) -> NDArray[np.generic] | None:
        """Return the numbers of a real array in MATLAB's order; None if it is no such array."""
        array = self._array(data)
        is_real = array.kind in _NUMERIC and not array.is_complex
        return self._values(array) if is_real else None

    def _values(self, array: _Array) -> NDArray[np.generic]:
        kind, values = next(array.parts, (9, memoryview(b"")))
        if kind not in _NUMBERS:
            raise refuse(self._path, f"numbers of the type {kind}")
        numbers = np.frombuffer(values, self._order + _NUMBERS[kind])
        if numbers.size != math.prod(array.dims):
            raise refuse(self._path, f"{numbers.size} numbers in an array of {array.dims}")
        return numbers

    def _next(self, parts: Iterator[tuple[int, memoryview]]) -> memoryview:
        found = next(parts, None)
        if found is None:
            raise refuse(self._path, "cut off")
        return found[1]


def _joined(real: NDArray[np.generic], imaginary: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return complex64 of parts that may be stored as smaller whole numbers."""
    out = np.empty(real.shape, np.complex64)
    out.real, out.imag = real, imaginary
    return out
