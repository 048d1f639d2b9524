"""Novelda's recordings: `xethru_recording_meta.dat` with datafloat and baseband files.

Layouts (XTAN-05; the meta file decoded from real ones, see docs/hardware.md), little-endian,
records back to back::

    datafloat     u32 content id, u32 frame counter, u32 n, f32[n]      n/2 I then n/2 Q
    baseband_iq   u32 counter, u32 n, f32 bin length, sampling rate, carrier, range offset,
                  f32 I[n], f32 Q[n]
    baseband_ap   the same with amplitude and phase

A datafloat record carries no axis: an X4 module's values are assumed and said so. Amplitude
of baseband_ap is taken as amplitude; X4 documents call it power, X2 clients do not.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import RecordingError
from x2radar.frame import CounterTracker, FastTimeAxis, Frame, Kind, Step, StreamInfo, read_only

META = "xethru_recording_meta.dat"
_META_MAGIC = 0xA0B1C2D3
_META_HEAD = 0x55
_ENTRY = struct.Struct("<BIQQI")
_KINDS = ("datafloat", "baseband_iq", "baseband_ap")
_DATA_BITS = {"baseband_ap": 0x1, "baseband_iq": 0x2, "datafloat": 0x400}
X4_BIN_LENGTH_M = 1.5e8 / 2.916e9
X4_CARRIER_HZ = 7.29e9
X4_BANDWIDTH_HZ = 1.4e9
_LONGEST_META = 1 << 28
_MOST_BINS = 1 << 14


@dataclass(frozen=True, slots=True)
class _Meta:
    started_utc: str
    times_ms: dict[int, NDArray[np.int64]]


class XethruReader:
    """Read a recording folder or one of its data files.

    Parameters
    ----------
    path : Path or str
        Folder, or a ``.dat`` file in it.
    frame_rate_hz : float, optional
        Instead of the rate that the meta file's times give.

    Attributes
    ----------
    stream : StreamInfo
        Axes, and the measured frame rate.
    n_frames : int
        Whole frames.
    started_utc : str
        When the recording began; empty without a meta file.
    warning : str or None
        Assumed axes, a cut-off record.

    Raises
    ------
    RecordingError
        If nothing readable is there; one line that says what.
    """

    def __init__(self, path: Path | str, frame_rate_hz: float | None = None) -> None:
        self._path = Path(path)
        kind, files = _data_files(self._path)
        self._warnings: list[str] = []
        self._kind = kind
        self._parts = [self._map(file) for file in files]
        self.n_frames = sum(len(part) for part in self._parts)
        if self.n_frames == 0:
            msg = f"{path}: no whole record in it"
            raise RecordingError(msg)
        meta_file = files[0].parent / META
        meta = _read_meta(meta_file) if meta_file.is_file() else None
        self.started_utc = meta.started_utc if meta else ""
        axis = self._axis()
        rate_hz = frame_rate_hz or self._measured_rate(meta)
        self.stream = StreamInfo(axis, rate_hz, f"XeThru {kind} recording")
        self.warning = "; ".join(self._warnings) or None

    def frames(self, start_s: float = 0.0) -> Iterator[Frame]:
        """Yield frames as `x2radar.recording.RecordingReader.frames` does."""
        tracker = CounterTracker()
        for part in self._parts:
            for record in part:
                counter = int(record["counter"])
                step, lost = tracker.update(counter)
                late = tracker.index / self.stream.frame_rate_hz >= start_s - 1e-9
                if step is Step.REPEAT or not late:
                    continue
                samples = self._complex(record)
                yield Frame(
                    samples, counter, tracker.index, lost, step is Step.RESTART, self.stream.axis
                )

    def _complex(self, record: np.void) -> NDArray[np.complex64]:
        first, second = record["a"], record["b"]
        samples = np.empty(first.size, np.complex64)
        if self._kind == "baseband_ap":
            samples.real, samples.imag = first * np.cos(second), first * np.sin(second)
        else:
            samples.real, samples.imag = first, second
        read_only(samples)
        return samples

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
        if odd or not 0 < n <= _MOST_BINS:
            msg = f"{file}: no {self._kind} records in it"
            raise RecordingError(msg)
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
            msg = f"{file}: records of different length, or damaged"
            raise RecordingError(msg)
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
            msg = f"{self._path}: bin length {first['bin']:g} m, carrier {first['carrier']:g} Hz"
            raise RecordingError(msg)
        return FastTimeAxis(
            kind=kind,
            n_range=n,
            bin_length_m=float(first["bin"]),
            range_offset_m=float(first["offset"]),
            carrier_hz=float(first["carrier"]),
            sample_rate_hz=float(first["rate"]),
        )

    def _measured_rate(self, meta: _Meta | None) -> float:
        if meta is None:
            msg = f"{self._path}: the frame rate is unknown without {META}"
            raise RecordingError(msg)
        times_ms = meta.times_ms.get(_DATA_BITS[self._kind], np.empty(0, np.int64))
        counters = np.concatenate([part["counter"] for part in self._parts]).astype(np.int64)
        n = min(len(times_ms), len(counters))
        if n < 2 or times_ms[n - 1] <= times_ms[0]:
            msg = f"{self._path}: {META} holds no times for these records"
            raise RecordingError(msg)
        # Stamps are whole milliseconds and bursty: the slope of a line through all of them.
        slope_ms = np.polyfit(counters[:n] - counters[0], times_ms[:n] - times_ms[0], 1)[0]
        if not slope_ms > 0:
            msg = f"{self._path}: {META} has times that do not grow with the frames"
            raise RecordingError(msg)
        return float(1e3 / slope_ms)


def _data_files(path: Path) -> tuple[str, list[Path]]:
    if not path.exists():
        msg = f"{path}: no such recording"
        raise RecordingError(msg)
    if path.is_file():
        for kind in _KINDS:
            if path.name.startswith(f"xethru_{kind}"):
                return kind, [path]
        msg = f"{path}: not one of XeThru's {', '.join(_KINDS)} files"
        raise RecordingError(msg)
    for kind in _KINDS:
        files = sorted(path.glob(f"xethru_{kind}_*.dat"))
        if files:
            return kind, files
    msg = f"{path}: no xethru_datafloat, baseband_iq or baseband_ap file in this folder"
    raise RecordingError(msg)


def _read_meta(file: Path) -> _Meta:
    """Read start time and the record times of every data type.

    Entries are walked to the end; the first that is no record ends them.
    """
    data = file.read_bytes()[:_LONGEST_META]
    try:
        magic, _version, start_ms = struct.unpack_from("<IIQ", data)
        if magic != _META_MAGIC:
            msg = f"{file}: not a XeThru meta file"
            raise RecordingError(msg)
        (n_id,) = struct.unpack_from("<I", data, _META_HEAD)
        at = _META_HEAD + 4 + n_id
        (n_header,) = struct.unpack_from("<I", data, at)
        at += 4 + n_header
    except struct.error as err:
        msg = f"{file}: cut off"
        raise RecordingError(msg) from err
    times: dict[int, list[int]] = {}
    while at + _ENTRY.size <= len(data) and data[at] in {1, 2}:
        kind, data_type, _size, _start, _end = _ENTRY.unpack_from(data, at)
        (ms,) = struct.unpack_from("<I", data, at + 29) if at + 33 <= len(data) else (0,)
        if kind == 1:
            times.setdefault(data_type, []).append(ms)
        at += 33
    started = datetime.fromtimestamp(start_ms / 1e3, UTC) if start_ms < 1 << 43 else None
    return _Meta(
        started.isoformat(timespec="milliseconds").replace("+00:00", "Z") if started else "",
        {key: np.array(value, np.int64) for key, value in times.items()},
    )
