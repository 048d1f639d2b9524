"""Write a XeThru recording: a folder with one baseband_iq file and its meta file.

Layouts as in `x2radar.recording.formats.xethru`. Samples and counters are kept bit by bit. The
records hold the axis as float32 and the meta file times in whole milliseconds; so that nothing is
lost, the exact numbers stand in the meta file's user header as JSON, which readers of Novelda's
pass over.
"""

import json
import struct
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np

from x2radar.errors import SettingsError
from x2radar.frame import FastTimeAxis
from x2radar.recording.blocks import Block, BlockReader
from x2radar.recording.formats.xethru import (
    DATA_BITS,
    ENTRY,
    META,
    META_HEAD,
    META_MAGIC,
    record_dtype,
)

_META_VERSION = 13
_SESSION = b"x2radar\0"
_KEPT = ("bin_length_m", "range_offset_m", "carrier_hz", "bandwidth_hz", "sample_rate_hz")
_RECORD, _END_OF_FILE, _FILE_LIST = 1, 2, 3
"""Version and kinds of entries as in real recordings."""


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new folder; return what was not kept.

    Raises SettingsError if the frames are no baseband.
    """
    axis = source.stream.axis
    if axis.kind != "baseband":
        msg = f"{path}: XeThru recordings hold baseband here, this is RF"
        raise SettingsError(msg)
    started = _started(source.started_utc)
    name = f"xethru_baseband_iq_{started:%Y%m%d_%H%M%S}.dat"
    dtype = record_dtype("baseband_iq", axis.n_range)
    path.mkdir()
    total, last_ms = 0, 0
    with (path / name).open("wb") as data, (path / META).open("wb") as meta:
        meta.write(bytes(META_HEAD))
        meta.write(struct.pack("<I", len(_SESSION)) + _SESSION)
        header = json.dumps({"x2radar": _exact(source)}, default=str).encode()
        meta.write(struct.pack("<I", len(header)) + header)
        for block in source.blocks():
            data.write(_records(block, axis, dtype).data)
            ms = np.rint(block.t_s * 1e3).astype(np.int64) & 0xFFFFFFFF
            meta.write(_entries(ms, total, dtype.itemsize).data)
            total += len(ms) * dtype.itemsize
            last_ms = int(ms[-1])
        _write_end(meta, name, total, last_ms)
        list_at = meta.tell() - len(_file_list(name))
        meta.seek(0)
        start_ms = round(started.timestamp() * 1e3)
        meta.write(
            struct.pack("<IIQBI", META_MAGIC, _META_VERSION, start_ms, 1, last_ms)
            + struct.pack("<QQIq", total, list_at - 4, DATA_BITS["baseband_iq"], -1)
            + struct.pack("<II", dtype.itemsize, 0)
            + b"\xcd" * 28
        )
    return ["times (t_s) are counted with the frame rate when it is read"]


def _records(block: Block, axis: FastTimeAxis, dtype: np.dtype[np.void]) -> Any:
    records = np.empty(len(block.counter), dtype)
    records["counter"] = block.counter
    records["n"] = axis.n_range
    records["bin"], records["offset"] = axis.bin_length_m, axis.range_offset_m
    records["rate"], records["carrier"] = axis.sample_rate_hz, axis.carrier_hz
    records["a"], records["b"] = block.samples.real, block.samples.imag
    return records.view(np.uint8)


def _entries(ms: Any, begin: int, record_bytes: int) -> Any:
    entries = np.zeros(len(ms), ENTRY)
    start = begin + record_bytes * np.arange(len(ms), dtype=np.uint64)
    entries["kind"], entries["type"] = _RECORD, DATA_BITS["baseband_iq"]
    entries["size"], entries["ms"] = record_bytes, ms
    entries["start"], entries["end"] = start, start + np.uint64(record_bytes)
    return entries.view(np.uint8)


def _write_end(meta: IO[bytes], name: str, total: int, last_ms: int) -> None:
    end = np.zeros(1, ENTRY)
    end["kind"], end["type"], end["ms"] = _END_OF_FILE, DATA_BITS["baseband_iq"], last_ms
    end["start"] = end["end"] = total
    meta.write(end.tobytes() + _file_list(name))


def _file_list(name: str) -> bytes:
    text = name.encode() + b"\0"
    return struct.pack("<BII", _FILE_LIST, 1, len(text)) + text


def _exact(source: BlockReader) -> dict[str, Any]:
    axis = source.stream.axis
    return {
        **{name: getattr(axis, name) for name in _KEPT},
        "frame_rate_hz": source.stream.frame_rate_hz,
        "started_utc": source.started_utc,
        "device": dict(source.device),
        "settings": dict(source.settings),
        "labels": source.labels,
    }


def _started(started_utc: str) -> datetime:
    """Return the start in UTC; 1970 when it is unknown."""
    try:
        started = datetime.fromisoformat(started_utc)
    except ValueError:
        return datetime.fromtimestamp(0, UTC)
    return started.replace(tzinfo=started.tzinfo or UTC).astimezone(UTC)
