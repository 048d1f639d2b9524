"""`x2radar decode`: a byte trace or wire capture, a JSON object a packet or in a few lines."""

import argparse
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from x2radar.commands import Commands, add_command
from x2radar.errors import MessageError
from x2radar.frame import FrameCounts
from x2radar.recording.capture import FROM_MODULE, MAGIC, OPENED, TO_MODULE, Capture
from x2radar.recording.faults import unreadable
from x2radar.wire.codec import decode_any, decode_command, decode_response
from x2radar.wire.framing import LineFault, Packet, PacketData, PacketDecoder
from x2radar.wire.messages import Message
from x2radar.wire.wire_ids import ContentId


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "decode",
        "print a byte trace as one JSON object a packet",
        "examples:\n  x2radar decode trace.txt\n  x2radar decode walk.x2cap --summary\n",
    )
    parser.add_argument("file", type=Path, help="hex text, raw bytes or a wire capture")
    parser.add_argument(
        "--summary", action="store_true", help="counts, rate, gaps and faults alone"
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    with unreadable(args.file), args.file.open("rb") as file:
        data = file.read(len(MAGIC))
        if data != MAGIC:
            data += file.read()
    is_capture = data == MAGIC
    items = describe_capture(Capture(args.file)) if is_capture else describe(read_trace(data))
    for line in _summary(items) if args.summary else map(json.dumps, items):
        print(line)
    return 0


def _summary(items: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Yield lines for people about what `describe` or `describe_capture` gives."""
    packets: Counter[tuple[str, str]] = Counter()
    faults: Counter[str] = Counter()
    frames, times_s = FrameCounts(), [0.0]
    for item in items:
        if "fault" in item:
            faults[item["fault"]] += 1
        elif "message" in item:
            kind = item["message"]
            packets[item.get("direction", "").replace("_", " "), item.get("name") or kind] += 1
            is_raw = kind == "Data" and item["content_id"] == ContentId.RAW_FRAME
            if is_raw or kind.startswith("Baseband"):
                frames.add(item["counter"] if "counter" in item else item["info"])
                times_s.append(item.get("t_s", 0.0))
    yield f"packets  {packets.total()}"
    for (direction, name), n in packets.most_common():
        yield f"{n:>9}  {name}{f', {direction}' if direction else ''}"
    yield f"frames   {frames.n_frames}; {frames}"
    span_s = times_s[-1] - times_s[1] if frames.n_frames > 1 else 0.0
    if span_s > 0:
        yield f"rate     {(frames.n_frames - 1) / span_s:.2f} frames a second over {span_s:.2f} s"
    yield f"faults   {faults.total()}"
    for fault, n in faults.most_common():
        yield f"{n:>9}  {fault}"


_COMMENT = re.compile(r"//.*|#.*")
# Four bytes at least, the shortest packet. A label in front is fine (`Read: 0x7d ...`);
# prose that quotes some bytes is not.
_LINE = re.compile(
    r"(?:.*:)?\s*((?:0[xX][0-9a-fA-F]{2}[\s,]*){4,})|\s*((?:[0-9a-fA-F]{2}[\s,]*){4,})"
)
_BYTE = re.compile(r"(?:0[xX])?([0-9a-fA-F]{2})")


def read_trace(data: bytes) -> bytes:
    """Return the wire's bytes from a trace file: raw, or lines of hex bytes amid prose."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data
    out = bytearray()
    for line in text.splitlines():
        if match := _LINE.fullmatch(_COMMENT.sub("", line)):
            out += bytes.fromhex("".join(_BYTE.findall(match[1] or match[2])))
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
        message = decode(item.data)
    except MessageError as err:
        return {"fault": str(err), "n_bytes": len(item.data)}
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
