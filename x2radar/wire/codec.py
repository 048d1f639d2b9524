"""Packets to typed messages and back, by the rows of `x2radar.wire.messages`.

Not in the rows: `SetOutput`, `X4Set`, an error of one byte, and REPLY and DATA. Host and module
use the same first bytes for different things, so there is a decoder for each. Arrays come out
read-only and share the packet's memory.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from x2radar.errors import MessageError
from x2radar.wire import messages as msg
from x2radar.wire.framing import Packet, PacketData, PacketDecoder
from x2radar.wire.messages import COMMANDS, RESPONSES, X4_FORMATS, Layout
from x2radar.wire.wire_ids import COMMAND_NAMES, PING_SEED, RESPONSE_NAMES, DataType

_COMMANDS, _RESPONSES = ({row.prefix: row for row in rows} for rows in (COMMANDS, RESPONSES))
_BY_CLASS = {row.cls: row for row in (*RESPONSES, *COMMANDS)}
# First bytes that only a host sends; the second ones of the X4 driver's set, get, write and read,
# and the longest of those: 2 bytes, the setting and two floats.
_ONLY_COMMANDS = frozenset(b"\x02\x21\x22\x23\x24\x25\x26\x40\x41\x42\x90\xb0\xc0")
_X4_SUBS = frozenset(b"\x10\x11\x12\x13")
_MAX_X4 = 14
_SET_OUTPUT = struct.Struct("<2sIII")
_APP_SETINT = b"\x90\x71"
_X4_SET = b"\x50\x10"
_HEAD = struct.Struct("<BBII")
_COUNT = struct.Struct("<I")
_DATA, _REPLY = 0xA0, 0x11
_ELEMENTS: dict[int, str] = {DataType.BYTE: "u1", DataType.INT: "<i4", DataType.FLOAT: "<f4"}
_ELEMENTS[DataType.STRING] = "u1"  # in REPLY alone


def encode(message: msg.Message) -> bytes:
    """Return a message's packet data; MessageError if a field does not fit its place."""
    try:
        match message:
            case msg.SetOutput(ref, value):
                return _SET_OUTPUT.pack(_APP_SETINT, ref, 1, value)
            case msg.X4Set(setting, values):
                body = struct.pack("<" + X4_FORMATS[setting][0], *values)
                return _X4_SET + _COUNT.pack(setting) + body
            case msg.Data() | msg.Reply():
                return _encode_list(message)
            case msg.Unknown(data):
                return data
            case _:
                return _pack(_BY_CLASS[type(message)], message)
    except (struct.error, KeyError, TypeError, ValueError, ArithmeticError) as err:
        raise MessageError(f"{message!r} does not fit the wire: {err}") from err


def decode_command(data: PacketData) -> msg.Message:
    """Read a packet of a host, `Unknown` without a row; MessageError if lengths differ."""
    if len(data) == _SET_OUTPUT.size:
        prefix, ref, count, value = _SET_OUTPUT.unpack(data)
        if prefix == _APP_SETINT and count == 1:
            return msg.SetOutput(ref, value)
    if data[:2] == _X4_SET and len(data) >= 6:
        (setting,) = _COUNT.unpack_from(data, 2)
        for form in X4_FORMATS.get(setting, ()):
            if struct.calcsize("<" + form) == len(data) - 6:
                return msg.X4Set(setting, struct.unpack_from("<" + form, data, 6))
        if setting in X4_FORMATS:
            raise MessageError(f"X4Set of {setting:#x} has {len(data) - 6} bytes")
    return _decode(data, _COMMANDS, COMMAND_NAMES)


def decode_response(data: PacketData) -> msg.Message:
    """Read a packet of a module, `Unknown` without a row; MessageError if lengths differ."""
    first, kind = data[0] if data else None, data[1] if len(data) > 1 else None
    if first == 0x20 and len(data) == 2:
        return msg.ErrorReply(data[1])
    is_list = first == _REPLY or (first == _DATA and kind != DataType.STRING)
    if is_list and (kind is None or kind in _ELEMENTS):
        return _decode_list(data)
    return _decode(data, _RESPONSES, RESPONSE_NAMES)


def read_messages(decoder: PacketDecoder, data: bytes) -> Iterator[msg.Message | None]:
    """Yield what a module's bytes, cut anywhere, complete; None for each that is damaged."""
    for item in decoder.feed(data):
        try:
            yield decode_response(item.data) if isinstance(item, Packet) else None
        except MessageError:
            yield None


def decode_any(data: PacketData) -> msg.Message:
    """Read a packet of unknown direction, as in a trace of both.

    A host's command wins where its bytes cannot be a module's: a ping carries the ping's
    seed; application commands and those of the X4 driver have other lengths or ids than ACK
    and the messages of profiles. Two bytes that begin with 20 are taken for set mode, though
    an error of the short form looks alike; what begins with A0 is a module's DATA, not a
    host's HIL.
    """
    return decode_command(data) if _is_command(data) else decode_response(data)


def _is_command(data: PacketData) -> bool:
    match data[0] if data else None:
        case 0x01:
            return data[1:5] == _COUNT.pack(PING_SEED)
        case 0x10:
            return len(data) > 1
        case 0x20:
            return len(data) in {2, 3}
        case 0x50 if len(data) > 2 and data[1] in _X4_SUBS:
            # A profile's message of these ids is longer, and its id ends in three zeros.
            return len(data) <= _MAX_X4 or data[2] != 0
        case 0x50:
            return data == b"\x50\x20"
        case first:
            return first in _ONLY_COMMANDS


def _decode(
    data: PacketData, rows: Mapping[bytes, Layout], names: Mapping[bytes, str]
) -> msg.Message:
    for length in (6, 5, 2, 1):
        if row := rows.get(bytes(data[:length])):
            return _unpack(row, data)
    known = (names.get(bytes(data[:length])) for length in (5, 2, 1))
    return msg.Unknown(bytes(data), next(filter(None, known), ""))


def _unpack(row: Layout, data: PacketData) -> msg.Message:
    at = len(row.prefix)
    arrays: list[Any] = []
    try:
        fields = struct.unpack_from("<" + row.head, data, at)
        at += struct.calcsize("<" + row.head)
        if row.count is not None:
            n = fields[row.count]
            fields = fields[: row.count] + fields[row.count + 1 :]
            for _ in range(row.n_arrays):
                array = np.frombuffer(data, "<f4", n, at)
                array.flags.writeable = False
                arrays.append(array)
                at += array.nbytes
    except (struct.error, ValueError) as err:
        raise MessageError(f"{row.cls.__name__} cut short: {len(data)} bytes ({err})") from err
    if at != len(data) and not row.has_rest:
        raise MessageError(f"{row.cls.__name__} has {len(data) - at} bytes too many")
    return row.cls(*fields, *arrays)


def _pack(row: Layout, message: msg.Message) -> bytes:
    values = [getattr(message, name) for name in message.__dataclass_fields__]
    bodies = []
    if row.count is not None:
        bodies = [_elements(array, "<f4") for array in values[-row.n_arrays :]]
        del values[-row.n_arrays :]
        sizes = {len(body) // 4 for body in bodies}
        if len(sizes) != 1:
            raise ValueError(f"arrays of unequal length {sorted(sizes)}")
        values.insert(row.count, sizes.pop())
    return b"".join([row.prefix, struct.pack("<" + row.head, *values), *bodies])


def _elements(values: Any, dtype: str) -> bytes:
    """Return an array's bytes on the wire; ValueError or ArithmeticError if they do not fit."""
    with np.errstate(over="raise"):
        return np.asarray(values, dtype).tobytes()


def _encode_list(message: msg.Data | msg.Reply) -> bytes:
    values: Any
    if isinstance(message, msg.Data):
        first, values = _DATA, message.values
        kinds = {np.dtype(np.uint8): DataType.BYTE, np.dtype(np.int32): DataType.INT}
        kind = kinds.get(values.dtype, DataType.FLOAT)
    else:
        first, values = _REPLY, message.value
        if isinstance(values, str):
            kind, values = DataType.STRING, list(values.encode())
        elif isinstance(message, msg.ByteReply):
            kind = DataType.BYTE
        else:
            kind = DataType.FLOAT if any(isinstance(v, float) for v in values) else DataType.INT
    body, size = _elements(values, _ELEMENTS[kind]), np.dtype(_ELEMENTS[kind]).itemsize
    head = _HEAD.pack(first, kind, message.content_id, message.info)
    counted = _COUNT.pack(len(body) // size) + body if body else b""
    return head + counted + (b"" if first == _DATA or kind == DataType.INT else bytes([size]))


def _decode_list(data: PacketData) -> msg.Data | msg.Reply:
    """Read DATA or REPLY: A0 or 11, type, content id, info, [count, elements].

    A REPLY ends with an element's size, which is optional; without elements there is no count.
    """
    name, n_behind = ("Data", 0) if data[0] == _DATA else ("Reply", 1)
    try:
        _, kind, content_id, info = _HEAD.unpack_from(data)
        n, at = (_COUNT.unpack_from(data, 10)[0], 14) if len(data) > 10 + n_behind else (0, 10)
        values: Any = np.frombuffer(data, _ELEMENTS[kind], n, at)
    except (struct.error, ValueError) as err:
        raise MessageError(f"{name} cut short: {len(data)} bytes ({err})") from err
    n_more = len(data) - at - values.nbytes
    if n_more > n_behind:
        raise MessageError(f"{name} has {n_more - n_behind} bytes too many")
    values.flags.writeable = False
    if data[0] == _DATA:
        return msg.Data(content_id, info, values)
    if kind == DataType.STRING:
        text = values.tobytes().rstrip(b"\0").decode("utf-8", "replace")
        return msg.Reply(content_id, info, text)
    made = msg.ByteReply if kind == DataType.BYTE else msg.Reply
    return made(content_id, info, tuple(values.tolist()))
