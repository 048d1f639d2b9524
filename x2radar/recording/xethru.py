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

from x2radar.frame import FastTimeAxis, Kind, Samples, StreamInfo
from x2radar.recording.blocks import (
    MOST_BINS,
    NO_OVERRIDES,
    BlockReader,
    Label,
    Overrides,
    as_samples,
    refuse,
    rows_per_block,
)
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

_LONGEST_META = 1 << 28
"""Above this a file is damaged. Chosen: days of frames."""


@dataclass(frozen=True, slots=True)
class _Meta:
    started_utc: str
    times_ms: Mapping[int, NDArray[np.int64]]
    ours: Mapping[str, Any]


class XethruReader(BlockReader):
    """Read a recording folder, or one ``.dat`` file in it.

    The frame rate is that of `overrides`, else `frame_rate_hz`, else what the times of the meta
    file give; `started_utc` is empty without that file.
    """

    def __init__(
        self,
        path: Path | str,
        frame_rate_hz: float | None = None,
        overrides: Overrides = NO_OVERRIDES,
    ) -> None:
        self.path = Path(path)
        self._overrides = overrides
        kind, files = _data_files(self.path)
        self._warnings: list[str] = []
        self._kind = kind
        self._parts = [self._map(file) for file in files]
        self.n_frames = sum(len(part) for part in self._parts)
        if self.n_frames == 0:
            raise refuse(path, "no whole record in it")
        meta_file = files[0].parent / META
        meta = _read_meta(meta_file) if meta_file.is_file() else None
        self.started_utc = meta.started_utc if meta else ""
        self._ours = meta.ours if meta else {}
        self._device, self._settings = (
            _mapping(self._ours, "device"),
            _mapping(self._ours, "settings"),
        )
        axis = self._axis()
        rate_hz = overrides.frame_rate_hz or frame_rate_hz or self._rate(meta)
        device = str(self.device.get("name", f"XeThru {kind} recording"))
        self.stream = overrides.apply(StreamInfo(axis, rate_hz, device))
        self.warning = "; ".join(self._warnings) or None
        self._first = np.cumsum([0, *(len(part) for part in self._parts)]).tolist()

    def read_labels(self) -> list[Label]:
        """Return what the user header says, if it is ours."""
        return list(self._ours.get("labels", []))

    def ranges(self) -> Iterator[tuple[int, int]]:
        """See `BlockReader`; a block lies in one file."""
        n_block = rows_per_block(self.stream.axis)
        for offset, part in zip(self._first, self._parts, strict=False):
            for first in range(0, len(part), n_block):
                yield offset + first, offset + min(first + n_block, len(part))

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        return np.asarray(self._records(first, last)["counter"])

    def read_samples(self, first: int, last: int) -> Samples:
        """See `BlockReader`."""
        records = self._records(first, last)
        one, two = records["a"], records["b"]
        samples = np.empty(one.shape, np.complex64)
        if self._kind == "baseband_ap":
            samples.real, samples.imag = one * np.cos(two), one * np.sin(two)
        else:
            samples.real, samples.imag = one, two
        return as_samples(samples, "baseband")

    def _records(self, first: int, last: int) -> NDArray[np.void]:
        k = int(np.searchsorted(self._first, first, side="right")) - 1
        return np.asarray(self._parts[k][first - self._first[k] : last - self._first[k]])

    def _map(self, file: Path) -> NDArray[np.void]:
        """Return the file's records as a memory-mapped structured array."""
        size = file.stat().st_size
        head = 12 if self._kind == "datafloat" else 24
        if size < head:
            return np.empty(0, [("counter", "<u4")])
        with file.open("rb") as stream:
            words = struct.unpack("<III", stream.read(12))
        n = words[2] // 2 if self._kind == "datafloat" else words[1]
        odd = self._kind == "datafloat" and (words[0] != 0 or words[2] % 2)
        if odd or not 0 < n <= MOST_BINS:
            raise refuse(file, f"no {self._kind} records in it")
        pair = [("a", "<f4", (n,)), ("b", "<f4", (n,))]
        if self._kind == "datafloat":
            fields = [("content", "<u4"), ("counter", "<u4"), ("n", "<u4"), *pair]
        else:
            axis = [(name, "<f4") for name in ("bin", "rate", "carrier", "offset")]
            fields = [("counter", "<u4"), ("n", "<u4"), *axis, *pair]
        dtype = np.dtype(fields)
        n_records, rest = divmod(size, dtype.itemsize)
        if rest:
            self._warnings.append(f"{file.name}: the last record is cut off")
        if n_records == 0:
            return np.empty(0, dtype)
        records = np.memmap(file, dtype, "r", shape=(n_records,))
        if not (records["n"] == words[2 if self._kind == "datafloat" else 1]).all():
            raise refuse(file, "records of different length, or damaged")
        return records

    def _axis(self) -> FastTimeAxis:
        first = next(part[0] for part in self._parts if len(part))
        n = int(first["a"].size)
        kind: Kind = "baseband"
        if self._kind == "datafloat":
            self._warnings.append(
                f"datafloat records carry no axis: {X4_CARRIER_HZ / 1e9:g} GHz, bins of "
                f"{X4_BIN_LENGTH_M * 1e3:.1f} mm and range offset 0 (X4) are assumed"
            )
            return FastTimeAxis(
                kind=kind,
                n_range=n,
                bin_length_m=X4_BIN_LENGTH_M,
                range_offset_m=0.0,
                carrier_hz=X4_CARRIER_HZ,
                bandwidth_hz=X4_BANDWIDTH_HZ,
            )
        if not (0 < first["bin"] < 10 and 1e8 < first["carrier"] < 1e11):
            raise refuse(
                self.path, f"bin length {first['bin']:g} m, carrier {first['carrier']:g} Hz"
            )
        return FastTimeAxis(
            kind=kind,
            n_range=n,
            bin_length_m=self._exact("bin_length_m", first["bin"]),
            range_offset_m=self._exact("range_offset_m", first["offset"]),
            carrier_hz=self._exact("carrier_hz", first["carrier"]),
            sample_rate_hz=self._exact("sample_rate_hz", first["rate"]),
            bandwidth_hz=self._number("bandwidth_hz"),
        )

    def _number(self, name: str) -> float:
        """Return a number of our user header, 0 without it."""
        value = self._ours.get(name, 0.0)
        return float(value) if isinstance(value, int | float) else 0.0

    def _exact(self, name: str, stored: np.float32) -> float:
        """Return the user header's number where it is what the record holds, rounded."""
        value = self._number(name)
        return value if np.float32(value) == stored else float(stored)

    def _rate(self, meta: _Meta | None) -> float:
        return self._number("frame_rate_hz") or self._measured_rate(meta)

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


def _mapping(ours: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    known = ours.get(name)
    return known if isinstance(known, dict) else {}


def _data_files(path: Path) -> tuple[str, list[Path]]:
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
        data = stream.read(_LONGEST_META)
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
    n_most = max(0, len(data) - at) // ENTRY.itemsize
    entries = np.frombuffer(data, ENTRY, n_most, offset=at if n_most else 0)
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
