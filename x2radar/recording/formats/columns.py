"""Parquet tables and MCAP files (https://mcap.dev/spec), written only: frames in real columns.

RF frames are `samples`, baseband is `samples_i` and `samples_q`, all float32; Parquet has lists of
n_range. Beside them stand the attributes of an HDF5 recording with n_range, device, settings and
labels, named `x2radar`: JSON in the schema's metadata of Parquet, a metadata record of MCAP. In
MCAP times are those of t_s behind the start, or behind 1970 where it is unknown.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.extras import needed
from x2radar.frame import Samples
from x2radar.recording.blocks import BlockReader
from x2radar.wall_clock import parse_utc

_HEAD = "uint32 counter\nfloat64 t_s\n"
_CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # encapsulation header (OMG DDSI-RTPS 2.3, 10.5)
_LABEL = {"t0_s": {"type": "number"}, "t1_s": {"type": "number"}, "label": {"type": "string"}}
_LABELS = {"type": "object", "title": "x2radar.Label", "properties": _LABEL}
_NAMES = {"rf": ("samples",), "baseband": ("samples_i", "samples_q")}


def _columns(samples: Samples) -> list[NDArray[np.float32]]:
    parts = (samples.real, samples.imag) if np.iscomplexobj(samples) else (samples,)
    return [np.ascontiguousarray(part, "<f4") for part in parts]


def _described(source: BlockReader) -> dict[str, Any]:
    return source.root_attributes() | {
        "n_range": source.stream.axis.n_range,
        "device": dict(source.device),
        "settings": dict(source.settings),
        "labels": [list(label) for label in source.labels],
    }


def write_parquet(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new Parquet file; return what was not kept; or MissingExtra."""
    pa: Any = needed("pyarrow", what="Parquet files")
    parquet: Any = needed("pyarrow.parquet", what="Parquet files")
    axis = source.stream.axis
    row = pa.list_(pa.float32(), axis.n_range)
    fields = [("counter", pa.uint32()), ("t_s", pa.float64())]
    schema = pa.schema(
        [*fields, *((name, row) for name in _NAMES[axis.kind])],
        metadata={"x2radar": json.dumps(_described(source), default=str)},
    )
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for block in source.blocks():
            lists = [
                pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), axis.n_range)
                for values in _columns(block.samples)
            ]
            columns = [pa.array(block.counter), pa.array(block.t_s), *lists]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))
    return []


def write_mcap(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new MCAP file; return what was not kept; or MissingExtra."""
    mcap: Any = needed("mcap.writer", what="MCAP files")
    started = parse_utc(source.started_utc)
    start_ns = round(started.timestamp() * 1e3) * 1_000_000 if started else 0
    about = {
        name: value if isinstance(value, str) else json.dumps(value, default=str)
        for name, value in _described(source).items()
    }
    fields = "".join(f"float32[] {name}\n" for name in _NAMES[source.stream.axis.kind])
    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="ros2", library="x2radar")
        writer.add_metadata("x2radar", about)
        schema = writer.register_schema("x2radar/msg/Frame", "ros2msg", (_HEAD + fields).encode())
        channel = writer.register_channel("/radar/frames", "cdr", schema)
        for block in source.blocks():
            rows = zip(
                block.counter.tolist(), block.t_s.tolist(), *_columns(block.samples), strict=True
            )
            for counter, t_s, *samples in rows:
                at_ns = start_ns + round(t_s * 1e9)
                writer.add_message(channel, at_ns, _cdr(counter, t_s, samples), at_ns, counter)
        if source.labels:
            text = json.dumps(_LABELS).encode()
            schema = writer.register_schema("x2radar.Label", "jsonschema", text)
            channel = writer.register_channel("/radar/labels", "json", schema)
        for t0_s, t1_s, label in source.labels:
            data = json.dumps({"t0_s": t0_s, "t1_s": t1_s, "label": label}).encode()
            at_ns = start_ns + round(t0_s * 1e9)
            writer.add_message(channel, at_ns, data, at_ns)
        writer.finish()
    return [] if start_ns else ["the start is unknown: times begin with 1970"]


def _cdr(counter: int, t_s: float, arrays: list[Any]) -> bytes:
    head = struct.pack("<IxxxxdI", counter, t_s, len(arrays[0]))
    rest = [struct.pack("<I", len(values)) + values.tobytes() for values in arrays[1:]]
    return b"".join((_CDR_LITTLE_ENDIAN, head, arrays[0].tobytes(), *rest))
