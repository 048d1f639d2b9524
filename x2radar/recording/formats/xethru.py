"""Novelda's recordings: `xethru_recording_meta.dat` with datafloat and baseband files.

Layouts (XTAN-05; the meta file decoded from real ones, docs/research/hardware.md), little-endian,
records back to back::

    datafloat     u32 content id, u32 frame counter, u32 n, f32[n]      n/2 I then n/2 Q
    baseband_iq   u32 counter, u32 n, f32 bin length, sampling rate, carrier, range offset,
                  f32 I[n], f32 Q[n]
    baseband_ap   the same with amplitude and phase

A datafloat record carries no axis: an X4 module's values are assumed and said so. Amplitude of
baseband_ap is taken as amplitude; X4 documents call it power, X2 clients do not.

Written is a folder with one baseband_iq file and its meta file, bit by bit. What float32 and whole
milliseconds would lose (axis, rate, device, labels) stands as JSON in the meta file's user header,
which readers of Novelda's pass over.
"""

import json
import struct
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SettingsError
from x2radar.frame import Samples
from x2radar.recording.about import MAX_BINS, NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader
from x2radar.recording.faults import refuse
from x2radar.wall_clock import parse_utc, utc_text

META = "xethru_recording_meta.dat"
_MAGIC, _VERSION, _HEAD = 0xA0B1C2D3, 13, 0x55
_SESSION = b"x2radar\0"
_FIELDS = {"kind": "u1", "type": "<u4", "size": "<u8", "start": "<u8", "end": "<u8", "ms": "<u4"}
_ENTRY = np.dtype(list(_FIELDS.items()))
_RECORD, _END_OF_FILE, _FILE_LIST = 1, 2, 3  # version, length of the head, kinds of entries
_BITS = {"datafloat": 0x400, "baseband_iq": 0x2, "baseband_ap": 0x1}
"""The kinds of data, and how the entries name them."""
X4_BIN_LENGTH_M = 1.5e8 / 2.916e9
_X4 = {
    "bin_length_m": X4_BIN_LENGTH_M,
    "range_offset_m": 0.0,
    "carrier_hz": 7.29e9,
    "bandwidth_hz": 1.4e9,
    "sample_rate_hz": 0.0,
}
"""An X4's decimated bin, with c as the module reckons, and pulse (`x2radar.modules.x4`)."""
_STORED = {
    "bin_length_m": "bin",
    "range_offset_m": "offset",
    "carrier_hz": "carrier",
    "sample_rate_hz": "rate",
}
"""What of the axis a record holds, and as which field."""

_MAX_META_BYTES = 1 << 28  # above this a file is damaged: days of frames


class Reader(BlockReader):
    """Read a recording folder, or one ``.dat`` file in it; its meta file gives the times."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        self._kind, files = _data_files(path)
        mapped = [_map(file, self._kind, self._warnings) for file in files]
        self._parts = [part for part in mapped if len(part)]
        if not self._parts:
            raise refuse(path, "no whole record in it")
        self.n_frames = sum(len(part) for part in self._parts)
        meta, ms, ours = files[0].parent / META, np.empty(0, np.int64), dict[str, Any]()
        if meta.is_file():
            ms, ours = _read_meta(meta, _BITS[self._kind])
        self._labels = list(ours.get("labels", []))
        said = {**self._axis(), **ours}
        rate_hz = overrides.frame_rate_hz or ours.get("frame_rate_hz")
        said["frame_rate_hz"] = rate_hz or self._measured_rate(ms)
        n_range = self._parts[0]["a"].shape[1]
        self._keep(("baseband", n_range), said, f"XeThru {self._kind} recording")

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        return self._read("counter", first, last)

    def read_samples(self, first: int, last: int) -> Samples:
        one, two = self._read("a", first, last), self._read("b", first, last)
        samples = np.empty(one.shape, np.complex64)
        if self._kind == "baseband_ap":
            samples.real, samples.imag = one * np.cos(two), one * np.sin(two)
        else:
            samples.real, samples.imag = one, two
        return self._falling(samples)

    def _read(self, field: str, first: int, last: int) -> NDArray[Any]:
        found = []
        for part in self._parts:
            found.append(part[field][max(first, 0) : max(last, 0)])
            first, last = first - len(part), last - len(part)
        return np.concatenate(found)

    def _axis(self) -> dict[str, Any]:
        """Return what the records say about range."""
        if self._kind == "datafloat":
            self._warnings.append(
                f"datafloat records carry no axis: {_X4['carrier_hz'] / 1e9:g} GHz, bins of "
                f"{X4_BIN_LENGTH_M * 1e3:.1f} mm and range offset 0 (X4) are assumed"
            )
            return _X4
        return {name: self._parts[0][0][field] for name, field in _STORED.items()}

    def _measured_rate(self, ms: NDArray[np.int64]) -> float:
        counters = self.read_counters(0, len(ms)).astype(np.int64)
        n, slope_ms = min(len(ms), len(counters)), 0.0
        if n > 1:
            # Whole milliseconds and bursty: the slope of a line through all of them.
            slope_ms = np.polyfit(counters[:n] - counters[0], ms[:n] - ms[0], 1)[0]
        if not slope_ms > 0:
            why = f"the frame rate is unknown without times in {META} that grow with the frames"
            raise refuse(self.path, why)
        return float(1e3 / slope_ms)


def _map(file: Path, kind: str, warnings: list[str]) -> NDArray[np.void]:
    """Return the file's records as a memory-mapped structured array."""
    words = np.fromfile(file, "<u4", 3).tolist()
    if len(words) < 3:
        return np.empty(0, [("counter", "<u4")])
    n, is_odd = (words[2] // 2, words[0] or words[2] % 2) if kind == "datafloat" else (words[1], 0)
    if is_odd or not 0 < n <= MAX_BINS:
        raise refuse(file, f"no {kind} records in it")
    dtype = _record_dtype(kind, n)
    n_records, rest = divmod(file.stat().st_size, dtype.itemsize)
    if rest:
        warnings.append(f"{file.name}: the last record is cut off")
    if n_records == 0:
        return np.empty(0, dtype)
    records = np.memmap(file, dtype, "r", shape=(n_records,))
    if not (records["n"] == (2 * n if kind == "datafloat" else n)).all():
        raise refuse(file, "records of different length, or damaged")
    return records


def _record_dtype(kind: str, n_range: int) -> np.dtype[np.void]:
    """Return the layout of a record of n_range bins."""
    pair = [("a", "<f4", (n_range,)), ("b", "<f4", (n_range,))]
    if kind == "datafloat":
        return np.dtype([("content", "<u4"), ("counter", "<u4"), ("n", "<u4"), *pair])
    axis = [(name, "<f4") for name in ("bin", "rate", "carrier", "offset")]
    return np.dtype([("counter", "<u4"), ("n", "<u4"), *axis, *pair])


def _data_files(path: Path) -> tuple[str, list[Path]]:
    """Return the kind of data and its files, in order."""
    files = sorted(path.glob("xethru_*.dat")) if path.is_dir() else [path]
    for kind in _BITS:
        if found := [file for file in files if file.name.startswith(f"xethru_{kind}")]:
            return kind, found
    raise refuse(path, f"no xethru_{', '.join(_BITS)} file")


def _read_meta(file: Path, bit: int) -> tuple[NDArray[np.int64], dict[str, Any]]:
    """Return times in ms of the records of a kind, and what our header says, or the start."""
    with file.open("rb") as stream:
        data = stream.read(_MAX_META_BYTES)
    magic, _version, start_ms = struct.unpack_from("<IIQ", data)
    if magic != _MAGIC:
        raise refuse(file, "not a XeThru meta file")
    at, n = _HEAD, 0
    for _ in ("session", "header"):
        (n,) = struct.unpack_from("<I", data, at)
        at += 4 + n
    entries = np.frombuffer(data[at:], _ENTRY, (len(data) - at) // _ENTRY.itemsize)
    # The first that is neither record nor end of a file ends them.
    is_entry = np.isin(entries["kind"], (_RECORD, _END_OF_FILE))
    entries = entries[np.logical_and.accumulate(is_entry)]
    entries = entries[(entries["kind"] == _RECORD) & (entries["type"] == bit)]
    try:
        ours = dict(json.loads(data[at - n : at])["x2radar"])
    except (ValueError, KeyError, TypeError):
        # Another program wrote it.
        ours = {}
    if 0 < start_ms < 1 << 43:
        start = utc_text(datetime.fromtimestamp(start_ms / 1e3, UTC))
        ours = {"started_utc": start, **ours}
    return entries["ms"].astype(np.int64), ours


def write(path: Path, source: BlockReader) -> list[str]:
    """Write baseband `source` into a new folder; return what was not kept."""
    axis = source.stream.axis
    if axis.kind != "baseband":
        raise SettingsError(f"{path.name}: XeThru recordings hold baseband here, this is RF")
    started = parse_utc(source.started_utc) or datetime.fromtimestamp(0, UTC)
    name = f"xethru_baseband_iq_{started:%Y%m%d_%H%M%S}.dat"
    ours = {
        **{name: getattr(axis, name) for name in _X4},
        "frame_rate_hz": source.stream.frame_rate_hz,
        "started_utc": source.started_utc,
        "device": dict(source.device),
        "settings": dict(source.settings),
        "labels": source.labels,
    }
    header = json.dumps({"x2radar": ours}, default=str).encode()
    dtype, bit = _record_dtype("baseband_iq", axis.n_range), _BITS["baseband_iq"]
    path.mkdir()
    with (path / name).open("wb") as data:
        for block in source.blocks():
            records = np.zeros(len(block.counter), dtype)
            records["counter"], records["n"] = block.counter, axis.n_range
            for field, stored in _STORED.items():
                records[stored] = getattr(axis, field)
            records["a"], records["b"] = block.samples.real, block.samples.imag
            data.write(records.view(np.uint8).data)
    t_s = source.lists()[1]
    entries = np.zeros(len(t_s) + 1, _ENTRY)
    entries["kind"], entries["type"], entries["size"] = _RECORD, bit, dtype.itemsize
    entries["start"] = dtype.itemsize * np.arange(len(entries), dtype=np.uint64)
    entries["end"][:-1] = entries["start"][1:]
    entries["ms"][:-1] = np.rint(t_s * 1e3).astype(np.int64) & 0xFFFFFFFF
    total, last_ms = int(entries["start"][-1]), int(entries["ms"][-2])
    entries[-1] = (_END_OF_FILE, bit, 0, total, total, last_ms)
    texts = b"".join(struct.pack("<I", len(text)) + text for text in (_SESSION, header))
    parts = [
        struct.pack("<IIQBI", _MAGIC, _VERSION, round(started.timestamp() * 1e3), 1, last_ms),
        struct.pack("<QQIq", total, _HEAD + len(texts) + entries.nbytes - 4, bit, -1),
        struct.pack("<II28s", dtype.itemsize, 0, b"\xcd" * 28),
        texts,
        entries.tobytes(),
        struct.pack("<BII", _FILE_LIST, 1, len(name) + 1) + name.encode() + b"\0",
    ]
    (path / META).write_bytes(b"".join(parts))
    return ["times (t_s) are counted with the frame rate when it is read"]
