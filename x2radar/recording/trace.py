"""Traces of the wire to readable messages: text with hex bytes, raw bytes, captures."""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from x2radar.errors import MessageError
from x2radar.recording.capture import FROM_MODULE, OPENED, TO_MODULE, Capture
from x2radar.wire.codec import decode_any, decode_command, decode_response
from x2radar.wire.framing import LineFault, Packet, PacketData, PacketDecoder
from x2radar.wire.messages import Message

_COMMENT = re.compile(r"//.*|#.*")
# Four bytes at least, the shortest packet. A label in front is fine (`Read: 0x7d ...`);
# prose that quotes some bytes is not.
_PREFIXED_LINE = re.compile(r"(?:.*:)?\s*((?:0[xX][0-9a-fA-F]{2}[\s,]*){4,})")
_PREFIXED = re.compile(r"0[xX]([0-9a-fA-F]{2})")
_BARE_LINE = re.compile(r"\s*((?:[0-9a-fA-F]{2}[\s,]*){4,})")
_BARE = re.compile(r"[0-9a-fA-F]{2}")


def read_trace(data: bytes) -> bytes:
    """Return the wire's bytes from a trace file: raw, or lines of hex bytes amid prose."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data
    out = bytearray()
    for line in text.splitlines():
        body = _COMMENT.sub("", line)
        if match := _PREFIXED_LINE.fullmatch(body):
            pairs = _PREFIXED.findall(match[1])
        elif match := _BARE_LINE.fullmatch(body):
            pairs = _BARE.findall(match[1])
        else:
            continue
        out += bytes(int(pair, 16) for pair in pairs)
    return bytes(out) or data


def describe(data: bytes) -> Iterator[dict[str, Any]]:
    """Yield ``{"message": name, ...}`` or ``{"fault": why, "n_bytes": n}`` for all bytes."""
    decoder = PacketDecoder()
    for item in decoder.feed(data):
        yield _describe(item, decode_any)
    if decoder.n_buffered:
        yield {"fault": "incomplete packet at the end", "n_bytes": decoder.n_buffered}


def describe_capture(capture: Capture) -> Iterator[dict[str, Any]]:
    """Yield what `describe` does for a wire capture, with t_s and direction in front."""
    ways: dict[int, tuple[str, PacketDecoder, Callable[[PacketData], Message]]] = {
        FROM_MODULE: ("from_module", PacketDecoder(), decode_response),
        TO_MODULE: ("to_module", PacketDecoder(), decode_command),
    }
    t_s = 0.0
    for kind, t_s, data in capture.chunks():
        if kind not in ways:
            yield {"t_s": t_s, "port": "opened" if kind == OPENED else "closed"}
            continue
        direction, decoder, decode = ways[kind]
        for item in decoder.feed(data):
            yield {"t_s": t_s, "direction": direction, **_describe(item, decode)}
    for direction, decoder, _ in ways.values():
        if n := decoder.n_buffered:
            about = {"t_s": t_s, "direction": direction}
            yield {**about, "fault": "incomplete packet at the end", "n_bytes": n}
    if capture.warning:
        yield {"t_s": t_s, "fault": capture.warning}


def _describe(item: Packet | LineFault, decode: Callable[[PacketData], Message]) -> dict[str, Any]:
    if isinstance(item, LineFault):
        return {"fault": item.fault.value, "n_bytes": item.n_bytes}
    try:
        return _message(decode(item.data))
    except MessageError as err:
        return {"fault": str(err), "n_bytes": len(item.data)}


def _message(message: Message) -> dict[str, Any]:
    out: dict[str, Any] = {"message": type(message).__name__}
    out |= {name: _json_safe(getattr(message, name)) for name in message.__dataclass_fields__}
    if out.get("name") == "":
        del out["name"]
    return out


def _json_safe(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_json_safe(v) for v in value]
    if isinstance(value, bytes):
        return value.hex(" ")
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
