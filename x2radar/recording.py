"""HDF5 recordings: write them crash-safe, read them from this or any other program.

Layout (format 1)::

    attributes       format "x2radar-recording", format_version 1, kind "baseband" | "rf",
                     frame_rate_hz, carrier_hz, sample_rate_hz, bin_length_m,
                     range_offset_m, started_utc, device and settings (JSON),
                     optional phase_sign (-1), bandwidth_hz (0: unknown)
    /frames/samples  (n, n_range) complex64 or float32
    /frames/counter  (n,) uint32
    /frames/t_s      (n,) float64
    /labels          optional: t0_s, t1_s, label

Written in SWMR mode, a chunk a second, shuffled and gzipped: after a kill every whole chunk
is readable. `frame_rate_hz` is the rate that decisions run on, so that a replay decides as
the live run did.
"""

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from x2radar.errors import RecordingError
from x2radar.frame import CounterTracker, FastTimeAxis, Frame, Step, StreamInfo, read_only

FORMAT = "x2radar-recording"
VERSION = 1
_DTYPES = {"rf": np.float32, "baseband": np.complex64}
_NUMBERS = ("frame_rate_hz", "carrier_hz", "sample_rate_hz", "bin_length_m", "range_offset_m")
_TEXTS = ("started_utc", "device", "settings")


class RecordingWriter:
    """Write frames into a new recording.

    Parameters
    ----------
    path : Path
        File to make; an existing one is never overwritten.
    stream : StreamInfo
        Axes and rate.
    started_utc : str
        Wall clock of the first frame, ISO 8601.
    device, settings : mapping
        Kept as JSON.

    Raises
    ------
    RecordingError
        If the file exists or cannot be made.
    """

    def __init__(
        self,
        path: Path,
        stream: StreamInfo,
        *,
        started_utc: str,
        device: Mapping[str, Any],
        settings: Mapping[str, Any],
    ) -> None:
        self._path = path
        self._rate_hz = stream.frame_rate_hz
        axis = stream.axis
        try:
            self._file = h5py.File(path, "x", libver="latest")
        except OSError as err:
            why = "exists already" if path.exists() else _reason(err)
            msg = f"{path}: cannot make a recording there: {why}"
            raise RecordingError(msg) from err
        self._file.attrs.update(
            {
                "format": FORMAT,
                "format_version": VERSION,
                "kind": axis.kind,
                "frame_rate_hz": stream.frame_rate_hz,
                "carrier_hz": axis.carrier_hz,
                "sample_rate_hz": axis.sample_rate_hz,
                "bin_length_m": axis.bin_length_m,
                "range_offset_m": axis.range_offset_m,
                "bandwidth_hz": axis.bandwidth_hz,
                "phase_sign": axis.phase_sign,
                "started_utc": started_utc,
                "device": json.dumps(dict(device)),
                "settings": json.dumps(dict(settings)),
            }
        )
        n_chunk = max(1, round(stream.frame_rate_hz))
        self._samples: NDArray[Any] = np.empty((n_chunk, axis.n_range), _DTYPES[axis.kind])
        self._counter = np.empty(n_chunk, np.uint32)
        self._t_s = np.empty(n_chunk, np.float64)
        self._filled = 0
        group = self._file.create_group("frames")
        self._sets = [
            group.create_dataset(
                name,
                shape=(0, *buffer.shape[1:]),
                maxshape=(None, *buffer.shape[1:]),
                chunks=buffer.shape,
                dtype=buffer.dtype,
                shuffle=True,
                compression="gzip",
                compression_opts=1,
            )
            for name, buffer in self._buffers()
        ]
        self._file.swmr_mode = True

    def __enter__(self) -> "RecordingWriter":
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the recording."""
        self.close()

    def write(self, frame: Frame) -> None:
        """Keep one frame; a second's worth goes to the disk at once.

        Raises
        ------
        RecordingError
            If the disk does not take it, or the frame has another length than the stream.
        """
        if frame.samples.shape != self._samples.shape[1:]:
            msg = f"{self._path}: a frame of {frame.samples.size} bins does not fit the recording"
            raise RecordingError(msg)
        k = self._filled
        self._samples[k] = frame.samples
        self._counter[k] = frame.counter
        self._t_s[k] = frame.index / self._rate_hz
        self._filled += 1
        if self._filled == len(self._samples):
            self._flush()

    def close(self) -> None:
        """Write what is left and close the file; a second call does nothing."""
        if not self._file:
            return
        try:
            self._flush()
        finally:
            with contextlib.suppress(OSError, RuntimeError):
                self._file.close()

    def _buffers(self) -> tuple[tuple[str, NDArray[Any]], ...]:
        return (("samples", self._samples), ("counter", self._counter), ("t_s", self._t_s))

    def _flush(self) -> None:
        n, self._filled = self._filled, 0
        if n == 0:
            return
        try:
            for dataset, (_, buffer) in zip(self._sets, self._buffers(), strict=True):
                old = len(dataset)
                dataset.resize(old + n, axis=0)
                dataset[old:] = buffer[:n]
                dataset.flush()
        except (OSError, RuntimeError) as err:
            msg = f"{self._path}: cannot write: {_reason(err)}"
            raise RecordingError(msg) from err


class RecordingReader:
    """Read a recording.

    Parameters
    ----------
    path : Path or str
        The file; it may still be written to.

    Attributes
    ----------
    stream : StreamInfo
        Axes and rate. `axis.phase_sign` is always -1: a recording with +1 is conjugated.
    n_frames : int
        Whole frames in the file.
    started_utc : str
        Wall clock of the first frame.
    warning : str or None
        What is odd about the file, for people.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or no recording; one line that says what.
    """

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        self.warning: str | None = None
        if not self._path.is_file():
            msg = f"{path}: no such recording"
            raise RecordingError(msg)
        try:
            self._file = h5py.File(self._path, "r", swmr=True)
        except OSError as err:
            msg = f"{path}: not an HDF5 file, or damaged ({_reason(err)})"
            raise RecordingError(msg) from err
        try:
            self._check()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def labels(self) -> list[tuple[float, float, str]]:
        """Labelled stretches (t0_s, t1_s, label); empty when there are none."""
        group = self._file.get("labels")
        if not isinstance(group, h5py.Group):
            return []
        rows = zip(group["t0_s"][()], group["t1_s"][()], group["label"][()], strict=True)
        return [(float(t0), float(t1), _text(label)) for t0, t1, label in rows]

    def frames(self, start_s: float = 0.0) -> Iterator[Frame]:
        """Yield the frames in order.

        Parameters
        ----------
        start_s : float
            Begin with the first frame at or behind this time of the file, in seconds.

        Yields
        ------
        Frame
            `index` counts from the file's first frame, losses included, wherever reading
            begins; repeated counters are skipped, as the driver does.

        Raises
        ------
        RecordingError
            If a chunk cannot be read.
        """
        tracker = CounterTracker()
        begun = False
        n_block = max(1, round(self.stream.frame_rate_hz))
        for first in range(0, self.n_frames, n_block):
            last = min(first + n_block, self.n_frames)
            counters = self._read("counter", first, last).astype(np.int64) & 0xFFFFFFFF
            late = self._read("t_s", first, last) >= start_s - 1e-9
            if begun:
                late[:] = True
            begun = begun or bool(late.any())
            np.logical_or.accumulate(late, out=late)
            # Also what lies before the start is counted: file time is kept.
            samples = self._samples(first, last) if begun else None
            for k, counter in enumerate(counters.tolist()):
                step, lost = tracker.update(counter)
                if step is Step.REPEAT or samples is None or not late[k]:
                    continue
                yield Frame(
                    samples[k],
                    counter,
                    tracker.index,
                    lost,
                    step is Step.RESTART,
                    self.stream.axis,
                )

    def _samples(self, first: int, last: int) -> NDArray[np.float32] | NDArray[np.complex64]:
        kind = self.stream.axis.kind
        samples: NDArray[Any] = np.ascontiguousarray(
            self._read("samples", first, last), _DTYPES[kind]
        )
        if self._conjugate:
            np.conj(samples, out=samples)
        read_only(samples)
        return samples

    def _read(self, name: str, first: int, last: int) -> NDArray[Any]:
        try:
            return np.asarray(self._file["frames"][name][first:last])
        except (OSError, KeyError, RuntimeError) as err:
            msg = f"{self._path}: frames {first} to {last} cannot be read ({_reason(err)})"
            raise RecordingError(msg) from err

    def _check(self) -> None:
        attrs = self._file.attrs
        if _text(attrs.get("format", "")) != FORMAT:
            self._refuse(f"no recording (attribute 'format' is not '{FORMAT}')")
        if int(attrs.get("format_version", 0)) != VERSION:
            self._refuse(f"format_version {attrs.get('format_version')}, this reads {VERSION}")
        for name in ("kind", *_NUMBERS, *_TEXTS):
            if name not in attrs:
                self._refuse(f"attribute '{name}' is missing")
        kind = _text(attrs["kind"])
        if kind not in _DTYPES:
            self._refuse(f"kind '{kind}' is neither rf nor baseband")
        numbers = {name: self._number(name) for name in _NUMBERS}
        for name in ("frame_rate_hz", "bin_length_m", "carrier_hz"):
            if numbers[name] <= 0:
                self._refuse(f"attribute '{name}' is {numbers[name]:g}, must be above 0")
        n_range = self._check_sets(kind)
        self.started_utc = _text(attrs["started_utc"])
        self._conjugate = kind == "baseband" and self._number("phase_sign", -1) > 0
        axis = FastTimeAxis(
            kind="rf" if kind == "rf" else "baseband",
            n_range=n_range,
            bin_length_m=numbers["bin_length_m"],
            range_offset_m=numbers["range_offset_m"],
            carrier_hz=numbers["carrier_hz"],
            bandwidth_hz=self._number("bandwidth_hz", 0.0),
            sample_rate_hz=numbers["sample_rate_hz"],
        )
        self.stream = StreamInfo(axis, numbers["frame_rate_hz"], self._device())

    def _check_sets(self, kind: str) -> int:
        sets = {}
        for name in ("samples", "counter", "t_s"):
            try:
                item = self._file[f"frames/{name}"]
            except (KeyError, OSError):
                item = None
            if not isinstance(item, h5py.Dataset):
                self._refuse(f"data set '/frames/{name}' is missing")
            sets[name] = item
        shape, dtype = sets["samples"].shape, sets["samples"].dtype
        if len(shape) != 2 or shape[1] == 0:
            self._refuse(f"/frames/samples has the shape {shape}, not (n, n_range)")
        if dtype.kind != ("c" if kind == "baseband" else "f"):
            self._refuse(f"/frames/samples is {dtype}, which is no {kind} data")
        for name in ("counter", "t_s"):
            if sets[name].ndim != 1 or sets[name].dtype.kind not in "iuf":
                self._refuse(f"/frames/{name} is no list of numbers")
        lengths = {name: len(item) for name, item in sets.items()}
        self.n_frames = min(lengths.values())
        if self.n_frames == 0:
            self._refuse("no frames in it")
        if len(set(lengths.values())) > 1:
            self.warning = (
                f"{self._path}: the recording was cut off; {self.n_frames} whole frames are read"
            )
        return int(shape[1])

    def _device(self) -> str:
        try:
            raw = json.loads(_text(self._file.attrs["device"]))
        except ValueError:
            return self._path.name
        return str(raw.get("name", self._path.name)) if isinstance(raw, dict) else str(raw)

    def _number(self, name: str, default: float = 0.0) -> float:
        value = self._file.attrs.get(name, default)
        try:
            number = float(np.asarray(value).item())
        except (TypeError, ValueError):
            number = float("nan")
        if not np.isfinite(number):
            self._refuse(f"attribute '{name}' is {value!r}, not a number")
        return number

    def _refuse(self, why: str) -> None:
        msg = f"{self._path}: {why}"
        raise RecordingError(msg)


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value)


def _reason(err: BaseException) -> str:
    """Return the part of an HDF5 error that a person can use."""
    text = " ".join(str(err).split())
    _, _, behind = text.partition("error message = '")
    return behind.partition("'")[0] or text.partition("(")[2].rstrip(")") or text
