"""MCAP files for Foxglove, Lichtblick and ROS 2; written only.

The topic `/radar/frames` carries a frame a message, type `x2radar/Frame`, in ROS 2's CDR with
its definition beside it; `/radar/labels` a JSON object where a labelled stretch begins. The
attributes of an HDF5 recording are the metadata record `x2radar`. Times are those of t_s behind
the start, or behind 1970 where the start is unknown. https://mcap.dev/spec
"""

import json
import struct
from datetime import datetime
from pathlib import Path
from typing import Any

from x2radar.extras import needed
from x2radar.recording.blocks import BlockReader
from x2radar.recording.formats.columns import column_names, described, real_columns

_HEAD = "uint32 counter\nfloat64 t_s\n"
_CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Encapsulation header (OMG DDSI-RTPS 2.3, 10.5); members are aligned from behind it."""
_LABELS = {
    "type": "object",
    "title": "x2radar.Label",
    "properties": {
        "t0_s": {"type": "number"},
        "t1_s": {"type": "number"},
        "label": {"type": "string"},
    },
}


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file, block by block; return what was not kept.

    Raises MissingExtra without mcap.
    """
    mcap: Any = needed("mcap.writer", what="MCAP files")
    start_ns = _start_ns(source.started_utc)
    fields = "".join(f"float32[] {n}\n" for n in column_names(source.stream.axis.kind))
    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="ros2", library="x2radar")
        about = {name: _text(value) for name, value in described(source).items()}
        writer.add_metadata("x2radar", about)
        schema = writer.register_schema("x2radar/msg/Frame", "ros2msg", (_HEAD + fields).encode())
        channel = writer.register_channel("/radar/frames", "cdr", schema)
        for block in source.blocks():
            columns = [values.astype("<f4") for values in real_columns(block.samples).values()]
            rows = zip(block.counter.tolist(), block.t_s.tolist(), *columns, strict=True)
            for counter, t_s, *samples in rows:
                at_ns = start_ns + round(t_s * 1e9)
                writer.add_message(channel, at_ns, _cdr(counter, t_s, samples), at_ns, counter)
        _write_labels(writer, source, start_ns)
        writer.finish()
    return [] if start_ns else ["the start is unknown: times begin with 1970"]


def _cdr(counter: int, t_s: float, arrays: list[Any]) -> bytes:
    head = struct.pack("<IxxxxdI", counter, t_s, len(arrays[0]))
    rest = [struct.pack("<I", len(values)) + values.tobytes() for values in arrays[1:]]
    return b"".join((_CDR_LITTLE_ENDIAN, head, arrays[0].tobytes(), *rest))


def _write_labels(writer: Any, source: BlockReader, start_ns: int) -> None:
    if not source.labels:
        return
    schema = writer.register_schema("x2radar.Label", "jsonschema", json.dumps(_LABELS).encode())
    channel = writer.register_channel("/radar/labels", "json", schema)
    for t0_s, t1_s, label in source.labels:
        data = json.dumps({"t0_s": t0_s, "t1_s": t1_s, "label": label}).encode()
        at_ns = start_ns + round(t0_s * 1e9)
        writer.add_message(channel, at_ns, data, at_ns)


def _start_ns(started_utc: str) -> int:
    try:
        return round(datetime.fromisoformat(started_utc).timestamp() * 1e3) * 1_000_000
    except ValueError:
        return 0


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)
