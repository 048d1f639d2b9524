"""Packets to typed messages and back; layouts are tables, not code.

A `Layout` row names a message class, the bytes it begins with, the struct format of its
fixed fields, and its arrays with the count that rules them. `encode` and `decode_*` read
the same rows, so the simulated module and the host cannot disagree. Two messages have a
shape of their own (REPLY and DATA); they stand at the end.

Host and module use the same first bytes for different things (10 is APPCOMMAND and ACK),
so there are two decoders: `decode_command` for what a host sends and `decode_response` for
what a module sends. Arrays come out read-only and share the packet's memory.
"""

import struct
from typing import Any

import numpy as np

from x2radar.errors import MessageError
from x2radar.layouts import COMMANDS, RESPONSES, VARIANTS, Layout
from x2radar.messages import (
    BasebandAp,
    BasebandIq,
    Data,
    ErrorReply,
    Message,
    Reply,
    SetOutput,
    Unknown,
)
from x2radar.wire_ids import PING_SEED, DataType

_OLD_BASEBAND: dict[int, type[Message]] = {0x0C: BasebandIq, 0x0D: BasebandAp}
_ALL = COMMANDS + RESPONSES + VARIANTS
_STRUCTS = {row.head: struct.Struct("<" + row.head) for row in _ALL}
_BY_CLASS = {row.cls: row for row in _ALL}
_BY_LENGTH = {(row.prefix, len(row.prefix) + _STRUCTS[row.head].size): row for row in VARIANTS}
_COMMAND_ROWS = {row.prefix: row for row in COMMANDS}
_RESPONSE_ROWS = {row.prefix: row for row in RESPONSES}
_X4_DRIVER = (b"\x50\x10", b"\x50\x11", b"\x50\x20")
_LONGEST_X4 = 14
_ONLY_COMMANDS = tuple(bytes([b]) for b in b"\x02\x21\x22\x24\x25\x26\x40\x41\x90\xb0")
_SET_OUTPUT = struct.Struct("<BBIII")
_FOUR_WORDS = struct.Struct("<BBII")
_DATA_TYPES: dict[int, str] = {DataType.FLOAT: "<f4", DataType.BYTE: "u1"}


def encode(message: Message) -> bytes:
    """Return the packet data of any message.

    Parameters
    ----------
    message : Message
        A message of this module.

    Returns
    -------
    bytes
        Data for `x2radar.framing.encode`.

    Raises
    ------
    MessageError
        If a field does not fit its place on the wire.
    """
    try:
        match message:
            case SetOutput(ref, value, count):
                return _SET_OUTPUT.pack(0x90, 0x71, ref, count, value)
            case ErrorReply(code):
                return struct.pack("<BI", 0x20, code)
            case Data():
                return _encode_data(message)
            case Reply():
                return _encode_reply(message)
            case Unknown(data):
                return data
            case _:
                return _pack(_BY_CLASS[type(message)], message)
    except (struct.error, KeyError, TypeError, ValueError, OverflowError) as err:
        msg = f"{message!r} does not fit the wire: {err}"
        raise MessageError(msg) from err


def decode_command(data: bytes) -> Message:
    """Read what a host sends.

    Parameters
    ----------
    data : bytes
        Data of one packet.

    Returns
    -------
    Message
        `Unknown` when no row describes the packet.

    Raises
    ------
    MessageError
        If the packet is shorter or longer than its row says.
    """
    if data[:2] == b"\x90\x71":
        return _decode_set_output(data)
    return _decode(data, _COMMAND_ROWS, (6, 2, 1))


def decode_response(data: bytes) -> Message:
    """Read what a module sends.

    Parameters
    ----------
    data : bytes
        Data of one packet.

    Returns
    -------
    Message
        `Unknown` when no row describes the packet.

    Raises
    ------
    MessageError
        If the packet is shorter or longer than its row, or its counts, say.
    """
    first = data[:1]
    if first == b"\xa0":
        return _decode_data(data)
    if first == b"\x11":
        return _decode_reply(data)
    if first == b"\x20":
        # Documented as a u32; some hosts' tests have a single byte.
        if len(data) not in {2, 5}:
            msg = f"ErrorReply has {len(data)} bytes instead of 2 or 5"
            raise MessageError(msg)
        return ErrorReply(int.from_bytes(data[1:], "little"))
    return _decode(data, _RESPONSE_ROWS, (5, 1))


def decode_any(data: bytes) -> Message:
    """Read a packet of unknown direction, as in a trace of both.

    A host's command wins only where its bytes cannot be a module's: a ping carries the
    ping's seed; set mode, application commands and those of the X4 driver have other lengths
    than ERROR, ACK and the messages of profiles.
    """
    as_command = (
        data[:5] == b"\x01" + PING_SEED.to_bytes(4, "little")
        or (data[:1] == b"\x20" and len(data) in {2, 3})
        or (data[:1] == b"\x10" and len(data) > 1)
        or (data[:2] in _X4_DRIVER and len(data) <= _LONGEST_X4)
        or data[:1] in _ONLY_COMMANDS
    )
    return decode_command(data) if as_command else decode_response(data)


def _decode_set_output(data: bytes) -> Message:
    """APP_SETINT: 90 71, reference, count, values; more than one value is `Unknown`."""
    if len(data) < _SET_OUTPUT.size:
        msg = f"SetOutput cut short: {len(data)} bytes"
        raise MessageError(msg)
    _, _, ref, count, value = _SET_OUTPUT.unpack_from(data)
    if len(data) != _SET_OUTPUT.size + 4 * (count - 1):
        msg = f"SetOutput has {len(data)} bytes, but {count} values"
        raise MessageError(msg)
    return SetOutput(ref, value, count) if count == 1 else Unknown(data)


def _decode(data: bytes, rows: dict[bytes, Layout], lengths: tuple[int, ...]) -> Message:
    for length in lengths:
        prefix = data[:length]
        row = rows.get(prefix)
        if row is not None:
            row = _BY_LENGTH.get((prefix, len(data)), row)
            return _unpack(row, row.cls, data, len(row.prefix))
    return Unknown(data)


def _unpack(row: Layout, cls: type[Message], data: bytes, at: int) -> Message:
    head = _STRUCTS[row.head]
    try:
        fields = head.unpack_from(data, at)
        at += head.size
        counts = [fields[k] for k in row.counts]
        arrays = []
        for which, dtype in row.arrays:
            arrays.append(_array(data, dtype, counts[which], at))
            at += arrays[-1].nbytes
    except (struct.error, ValueError) as err:
        msg = f"{cls.__name__} cut short: {len(data)} bytes ({err})"
        raise MessageError(msg) from err
    if at != len(data) and not row.tail:
        msg = f"{cls.__name__} has {len(data) - at} bytes too many"
        raise MessageError(msg)
    scalars = [f for k, f in enumerate(fields) if k not in row.counts]
    return cls(*scalars, *arrays)


def _array(data: bytes, dtype: str, n: int, at: int) -> Any:
    """Return `n` elements from `at` on as a read-only view; ValueError if they are not there."""
    array = np.frombuffer(data, dtype, n, at)
    array.flags.writeable = False
    return array


def _pack(row: Layout, message: Message) -> bytes:
    values: list[Any] = [getattr(message, name) for name in message.__dataclass_fields__]  # type: ignore[attr-defined]
    n_arrays = len(row.arrays)
    scalars = values[: len(values) - n_arrays]
    arrays = [
        np.ascontiguousarray(a, dtype)
        for a, (_, dtype) in zip(values[len(scalars) :], row.arrays, strict=True)
    ]
    for which, position in enumerate(row.counts):
        sizes = {a.size for a, (w, _) in zip(arrays, row.arrays, strict=True) if w == which}
        if len(sizes) != 1:
            msg = f"arrays of unequal length {sorted(sizes)}"
            raise ValueError(msg)
        scalars.insert(position, sizes.pop())
    return b"".join(
        [row.prefix, _STRUCTS[row.head].pack(*scalars), *(a.tobytes() for a in arrays)]
    )


def _decode_data(data: bytes) -> Message:
    """Read DATA: A0, type, content id, info, [count, elements]; the old baseband form as well."""
    try:
        _, kind, content_id, info = _FOUR_WORDS.unpack_from(data)
        if kind == DataType.BASEBAND_OLD and content_id in _OLD_BASEBAND:
            cls = _OLD_BASEBAND[content_id]
            # info is the frame counter: from there on the fields are those of APPDATA.
            return _unpack(_BY_CLASS[cls], cls, data, 6)
        dtype = _DATA_TYPES.get(kind)
        if dtype is None:
            return Unknown(data)
        n, at = (struct.unpack_from("<I", data, 10)[0], 14) if len(data) > 10 else (0, 10)
        values = _array(data, dtype, n, at)
    except (struct.error, ValueError) as err:
        msg = f"Data cut short: {len(data)} bytes ({err})"
        raise MessageError(msg) from err
    if at + values.nbytes != len(data):
        msg = f"Data has {len(data) - at - values.nbytes} bytes too many"
        raise MessageError(msg)
    return Data(content_id, info, values)


def _encode_data(message: Data) -> bytes:
    kind = DataType.BYTE if message.values.dtype == np.uint8 else DataType.FLOAT
    dtype = "u1" if kind is DataType.BYTE else "<f4"
    head = _FOUR_WORDS.pack(0xA0, kind, message.content_id, message.info)
    if message.values.size == 0:
        return head
    values = np.ascontiguousarray(message.values, dtype)
    return head + struct.pack("<I", values.size) + values.tobytes()


_REPLY_TYPES: dict[int, tuple[str, int]] = {
    DataType.BYTE: ("B", 1),
    DataType.INT: ("i", 4),
    DataType.FLOAT: ("f", 4),
    DataType.STRING: ("", 1),
}


def _decode_reply(data: bytes) -> Message:
    """REPLY: 11, type, content id, info, [count, elements], element size (not for INT)."""
    try:
        _, kind, content_id, info = _FOUR_WORDS.unpack_from(data)
        if kind not in _REPLY_TYPES:
            return Unknown(data)
        code, size = _REPLY_TYPES[kind]
        # Without elements there is no count; the element size is optional, see above.
        n, at = (struct.unpack_from("<I", data, 10)[0], 14) if len(data) > 11 else (0, 10)
    except struct.error as err:
        msg = f"Reply cut short: {len(data)} bytes ({err})"
        raise MessageError(msg) from err
    body = data[at : at + n * size]
    if len(body) != n * size or len(data) - at - len(body) > 1:
        msg = f"Reply has {len(data) - at} bytes for {n} elements of {size} bytes"
        raise MessageError(msg)
    if kind == DataType.STRING:
        return Reply(content_id, info, body.rstrip(b"\0").decode("utf-8", "replace"))
    return Reply(content_id, info, struct.unpack(f"<{n}{code}", body))


def _encode_reply(message: Reply) -> bytes:
    value = message.value
    if isinstance(value, str):
        kind, body = DataType.STRING, value.encode()
        n = len(body)
    else:
        n = len(value)
        kind = DataType.FLOAT if any(isinstance(v, float) for v in value) else DataType.INT
        body = struct.pack(f"<{n}{_REPLY_TYPES[kind][0]}", *value)
    head = _FOUR_WORDS.pack(0x11, kind, message.content_id, message.info)
    counted = struct.pack("<I", n) + body if n else b""
    size = b"" if kind is DataType.INT else bytes([_REPLY_TYPES[kind][1]])
    return head + counted + size
