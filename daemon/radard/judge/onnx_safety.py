"""What an ONNX file may hold: the network alone, nothing that its hash does not cover.

Tensors in other files and operators of other domains than ONNX's own are refused, by the field
numbers of onnx.proto3 (ONNX 1.18).
"""

from collections.abc import Iterator

_MESSAGES: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute", 7: "domain"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {13: "external data", 14: "data location"},
}
_DOMAINS = {b"", b"ai.onnx", b"ai.onnx.ml"}
_DEEPEST = 64  # graphs within graphs; protobuf itself ends at 100 messages
_VARINT, _BYTES, _FIXED = 0, 2, {1: 8, 5: 4}
"""Wire types of protobuf, some of so many bytes; groups (3 and 4) are not of this language."""


def unsafe_in(onnx: bytes) -> str:
    """Return what is not allowed in an ONNX file, in a few words; empty if it is harmless."""
    if onnx[4:8] == b"ORTM":
        return "it is in onnxruntime's own format, which is not checked"
    try:
        return next(_faults(memoryview(onnx), "model", 0), "")
    except (LookupError, RecursionError):
        return "it is cut off, or no ONNX file"


def _faults(data: memoryview, message: str, depth: int) -> Iterator[str]:
    if depth > _DEEPEST:
        yield f"its messages lie more than {_DEEPEST} deep"
        return
    rows = _MESSAGES[message]
    for number, value in _fields(data):
        kind = rows.get(number, "")
        if kind == "external data" or (kind == "data location" and value != 0):
            yield "a tensor lies in another file, which the hash does not cover"
        elif kind in _MESSAGES or kind == "domain":
            if not isinstance(value, memoryview):
                yield "it is no ONNX file"
            elif kind != "domain":
                yield from _faults(value, kind, depth + 1)
            elif bytes(value) not in _DOMAINS:
                name = bytes(value[:40]).decode("utf-8", "replace")
                yield f"an operator of the domain {name!r}"


def _fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield number and value of each field: a whole number, or the bytes of a longer one."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        number, wire = key >> 3, key & 7
        if wire == _VARINT:
            value, at = _varint(data, at)
            yield number, value
            continue
        if wire == _BYTES:
            n, at = _varint(data, at)
        else:
            n = _FIXED[wire]
        if n > len(data) - at:
            raise IndexError(at)
        yield number, data[at : at + n]
        at += n


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            # As protobuf does: what is beyond 64 bits is lost, and field numbers have 29 of 32.
            return value & 0xFFFFFFFFFFFFFFFF, at
    raise IndexError(at)
