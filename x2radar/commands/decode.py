"""`x2radar decode`: a byte trace or wire capture, a JSON object a packet or in a few lines."""

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from x2radar.commands import Commands, add_command
from x2radar.errors import RecordingError
from x2radar.frame import FrameCounts
from x2radar.recording.capture import MAGIC, Capture
from x2radar.recording.trace import describe, describe_capture, read_trace
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
    try:
        with args.file.open("rb") as file:
            data = file.read(len(MAGIC))
            if data != MAGIC:
                data += file.read()
    except OSError as err:
        raise RecordingError(f"{args.file}: cannot be read: {err.strerror}") from err
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
            name = item.get("name") or item["message"]
            packets[item.get("direction", "").replace("_", " "), name] += 1
            if _is_frame(item):
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


def _is_frame(item: dict[str, Any]) -> bool:
    is_raw = item["message"] == "Data" and item["content_id"] == ContentId.RAW_FRAME
    return is_raw or str(item["message"]).startswith("Baseband")
