"""Novelda's recordings: `xethru_recording_meta.dat` with datafloat and baseband files.

Layouts (XTAN-05; the meta file decoded from real ones, see docs/research/hardware.md),
little-endian, records back to back::

    datafloat     u32 content id, u32 frame counter, u32 n, f32[n]      n/2 I then n/2 Q
    baseband_iq   u32 counter, u32 n, f32 bin length, sampling rate, carrier, range offset,
                  f32 I[n], f32 Q[n]
    baseband_ap   the same with amplitude and phase

Recordings that we wrote (`x2radar.recording.formats.xethru_writer`) carry exact axis, rate and
device as JSON in the meta file's user header. A datafloat record carries no axis: an X4 module's
values are assumed and said so. Amplitude of baseband_ap is taken as amplitude; X4 documents call
it power, X2 clients do not.
"""

import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording.about import MAX_BINS, NO_OVERRIDES, Overrides, read_about
from x2radar.recording.blocks import BlockReader, Label, rows_per_block
from x2radar.recording.faults import refuse
from x2radar.recording.stamps import utc_text

META = "xethru_recording_meta.dat"
META_MAGIC = 0xA0B1C2D3
META_HEAD = 0x55
ENTRY = np.dtype(
    [
        ("kind", "u1"),
        ("type", "<u4"),
        ("size", "<u8"),
        ("start", "<u8"),
        ("end", "<u8"),
        ("ms", "<u4"),
    ]
)
_KINDS = ("datafloat", "baseband_iq", "baseband_ap")
DATA_BITS = {"baseband_ap": 0x1, "baseband_iq": 0x2, "datafloat": 0x400}
X4_BIN_LENGTH_M = 1.5e8 / 2.916e9
X4_CARRIER_HZ = 7.29e9
X4_BANDWIDTH_HZ = 1.4e9
"""An X4's decimated bin, with c as the module reckons, and pulse (`x2radar.modules.x4`)."""

_MAX_META_BYTES = 1 << 28
"""Above this a file is damaged: days of frames."""


@dataclass(frozen=True, slots=True)
class _Meta:
    started_utc: str
    times_ms: Mapping[int, NDArray[np.int64]]
    ours: Mapping[str, Any]


class XethruReader(BlockReader):
    """Read a recording folder, or one ``.dat`` file in it.

    The frame rate is that of `overrides`, else what our header says, else what the times of the
    meta file give; `started_utc` is empty without that file.
    """

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        self._kind, files = _data_files(path)
        warnings: list[str] = []
        self._parts = [_map(file, self._kind, warnings) for file in files]
        self.n_frames = sum(len(part) for part in self._parts)
        if self.n_frames == 0:
            raise refuse(path, "no whole record in it")
        meta_file = files[0].parent / META
        meta = _read_meta(meta_file) if meta_file.is_file() else None
        ours = meta.ours if meta else {}
        self._labels: list[Label] = list(ours.get("labels", []))
        said = {**ours, **self._axis(ours, warnings)}
        said["started_utc"] = meta.started_utc if meta else ""
        said["frame_rate_hz"] = (
            overrides.frame_rate_hz or ours.get("frame_rate_hz") or self._measured_rate(meta)
        )
        n_range = next(part for part in self._parts if len(part))["a"].shape[1]
        device = f"XeThru {self._kind} recording"
        self._keep(read_about(path, ("baseband", n_range), said, overrides, device))
        self.warning = "; ".join(warnings) or None
        self._first = np.cumsum([0, *(len(part) for part in self._parts)]).tolist()

    def read_labels(self) -> list[Label]:
        """Return what the user header says, if it is ours."""
        return self._labels

    def ranges(self) -> Iterator[tuple[int, int]]:
        """Yield the borders of the blocks; a block lies in one file."""
        n_block = rows_per_block(self.stream.axis)
        for offset, part in zip(self._first, self._parts, strict=False):
            for first in range(0, len(part), n_block):
                yield offset + first, offset + min(first + n_block, len(part))

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """Return the counters of these frames."""
        return np.asarray(self._records(first, last)["counter"])

    def read_samples(self, first: int, last: int) -> Samples:
        """Return these frames, shape (last - first, n_range), read-only."""
        records = self._records(first, last)
        one, two = records["a"], records["b"]
        samples = np.empty(one.shape, np.complex64)
        if self._kind == "baseband_ap":
            samples.real, samples.imag = one * np.cos(two), one * np.sin(two)
        else:
            samples.real, samples.imag = one, two
        return self._falling(samples)

    def _records(self, first: int, last: int) -> NDArray[np.void]:
        k = int(np.searchsorted(self._first, first, side="right")) - 1
        return np.asarray(self._parts[k][first - self._first[k] : last - self._first[k]])

    def _axis(self, ours: Mapping[str, Any], warnings: list[str]) -> dict[str, Any]:
        """Return what the records say about range, as exactly as our header repeats it."""
        if self._kind == "datafloat":
            warnings.append(
                f"datafloat records carry no axis: {X4_CARRIER_HZ / 1e9:g} GHz, bins of "
                f"{X4_BIN_LENGTH_M * 1e3:.1f} mm and range offset 0 (X4) are assumed"
            )
            return {
                "bin_length_m": X4_BIN_LENGTH_M,
                "range_offset_m": 0.0,
                "carrier_hz": X4_CARRIER_HZ,
                "bandwidth_hz": X4_BANDWIDTH_HZ,
                "sample_rate_hz": 0.0,
            }
        first = next(part[0] for part in self._parts if len(part))
        if not (0 < first["bin"] < 10 and 1e8 < first["carrier"] < 1e11):
            raise refuse(
                self.path, f"bin length {first['bin']:g} m, carrier {first['carrier']:g} Hz"
            )
        stored = {
            "bin_length_m": first["bin"],
            "range_offset_m": first["offset"],
            "carrier_hz": first["carrier"],
            "sample_rate_hz": first["rate"],
        }
        # Ours where it is what the record holds, rounded.
        is_same = {
            name: isinstance(ours.get(name), int | float) and np.float32(ours[name]) == value
            for name, value in stored.items()
        }
        return {name: ours[name] if is_same[name] else value for name, value in stored.items()}

    def _measured_rate(self, meta: _Meta | None) -> float:
        if meta is None:
            raise refuse(self.path, f"the frame rate is unknown without {META}")
        times_ms = meta.times_ms.get(DATA_BITS[self._kind], np.empty(0, np.int64))
        counters = np.concatenate([part["counter"] for part in self._parts]).astype(np.int64)
        n = min(len(times_ms), len(counters))
        if n < 2 or times_ms[n - 1] <= times_ms[0]:
            raise refuse(self.path, f"{META} holds no times for these records")
        # Stamps are whole milliseconds and bursty: the slope of a line through all of them.
        slope_ms = np.polyfit(counters[:n] - counters[0], times_ms[:n] - times_ms[0], 1)[0]
        if not slope_ms > 0:
            raise refuse(self.path, f"{META} has times that do not grow with the frames")
        return float(1e3 / slope_ms)


def _map(file: Path, kind: str, warnings: list[str]) -> NDArray[np.void]:
    """Return the file's records as a memory-mapped structured array."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        head = stream.read(12)
    if len(head) < 12:
        return np.empty(0, [("counter", "<u4")])
    words = struct.unpack("<III", head)
    n, is_odd = (words[2] // 2, words[0] or words[2] % 2) if kind == "datafloat" else (words[1], 0)
    if is_odd or not 0 < n <= MAX_BINS:
        raise refuse(file, f"no {kind} records in it")
    dtype = record_dtype(kind, n)
    n_records, rest = divmod(size, dtype.itemsize)
    if rest:
        warnings.append(f"{file.name}: the last record is cut off")
    if n_records == 0:
        return np.empty(0, dtype)
    records = np.memmap(file, dtype, "r", shape=(n_records,))
    if not (records["n"] == (2 * n if kind == "datafloat" else n)).all():
        raise refuse(file, "records of different length, or damaged")
    return records


def record_dtype(kind: str, n_range: int) -> np.dtype[np.void]:
    """Return the layout of a record of n_range bins."""
    pair = [("a", "<f4", (n_range,)), ("b", "<f4", (n_range,))]
    if kind == "datafloat":
        return np.dtype([("content", "<u4"), ("counter", "<u4"), ("n", "<u4"), *pair])
    axis = [(name, "<f4") for name in ("bin", "rate", "carrier", "offset")]
    return np.dtype([("counter", "<u4"), ("n", "<u4"), *axis, *pair])


def _data_files(path: Path) -> tuple[str, list[Path]]:
    """Return the kind of data and its files, in order."""
    if not path.exists():
        raise refuse(path, "no such recording")
    if path.is_file():
        for kind in _KINDS:
            if path.name.startswith(f"xethru_{kind}"):
                return kind, [path]
        raise refuse(path, f"not one of XeThru's {', '.join(_KINDS)} files")
    for kind in _KINDS:
        files = sorted(path.glob(f"xethru_{kind}_*.dat"))
        if files:
            return kind, files
    raise refuse(path, "no xethru_datafloat, baseband_iq or baseband_ap file in this folder")


def _read_meta(file: Path) -> _Meta:
    """Read start time, our user header, and the record times of every data type."""
    with file.open("rb") as stream:
        data = stream.read(_MAX_META_BYTES)
    try:
        magic, _version, start_ms = struct.unpack_from("<IIQ", data)
        if magic != META_MAGIC:
            raise refuse(file, "not a XeThru meta file")
        (n_id,) = struct.unpack_from("<I", data, META_HEAD)
        at = META_HEAD + 4 + n_id
        (n_header,) = struct.unpack_from("<I", data, at)
        at += 4 + n_header
    except struct.error as err:
        raise refuse(file, "cut off") from err
    # Entries are walked to the end; the first that is no record ends them.
    n_max = max(0, len(data) - at) // ENTRY.itemsize
    entries = np.frombuffer(data, ENTRY, n_max, offset=at if n_max else 0)
    strange = np.flatnonzero((entries["kind"] != 1) & (entries["kind"] != 2))
    entries = entries[: strange[0]] if strange.size else entries
    entries = entries[entries["kind"] == 1]
    times = {
        int(bit): entries["ms"][entries["type"] == bit].astype(np.int64)
        for bit in np.unique(entries["type"])
    }
    ours = _our_header(data[at - n_header : at])
    started = datetime.fromtimestamp(start_ms / 1e3, UTC) if 0 < start_ms < 1 << 43 else None
    text = utc_text(started) if started else ""
    return _Meta(str(ours.get("started_utc", text)), times, ours)


def _our_header(header: bytes) -> Mapping[str, Any]:
    """Return what we wrote into the user header; nothing if another program wrote it."""
    try:
        ours = json.loads(header)["x2radar"]
    except (ValueError, KeyError, TypeError):
        return {}
    return ours if isinstance(ours, dict) else {}
