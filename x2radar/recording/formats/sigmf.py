"""SigMF: ``NAME.sigmf-data`` with the samples and ``NAME.sigmf-meta``, JSON, with the rest.

Every range bin is a channel, sampled once a frame: ``core:num_channels`` is the number of
bins, ``core:sample_rate`` the frame rate, ``core:frequency`` the carrier, so that one frame
is one sample of all channels. ``core:datatype`` is cf32_le for baseband and rf32_le for RF.
A capture segment begins with the recording and wherever a counter does not follow the one
before; ``x2radar:counter`` is the segment's first. The range axis, device and settings stand
in the global object as ``x2radar:…``; labels are annotations. Samples, counters, axis and
rate are kept bit by bit; times are counted with the rate.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording.blocks import (
    MOST_BINS,
    NO_OVERRIDES,
    BlockReader,
    Label,
    Overrides,
    as_samples,
    refuse,
    unwrap,
)
from x2radar.recording.formats.axis import stream_from

META = ".sigmf-meta"
DATA = ".sigmf-data"
_VERSION = "1.0.0"
_KINDS = {"cf32_le": ("baseband", "<c8"), "rf32_le": ("rf", "<f4")}
_LONGEST_META = 1 << 26
"""Bytes. Chosen: a capture segment a gap, for days; as JSON in memory some hundred MB."""
_KEPT = ("bin_length_m", "range_offset_m", "bandwidth_hz", "sample_rate_hz")


def pair_of(path: Path) -> tuple[Path, Path]:
    """Return the meta and the data file that `path`, either of them or neither, belongs to."""
    name = path.name.removesuffix(META).removesuffix(DATA).removesuffix(".sigmf")
    return path.with_name(name + META), path.with_name(name + DATA)


class SigmfReader(BlockReader):
    """Read a SigMF pair whose channels are range bins, by the name of either file."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = path
        self._overrides = overrides
        meta, data = pair_of(path)
        try:
            with meta.open("rb") as file:
                text = file.read(_LONGEST_META + 1)
            if len(text) > _LONGEST_META:
                raise refuse(meta, "too long for a SigMF meta file")
            root = json.loads(text)
            head, segments = dict(root["global"]), [dict(s) for s in root.get("captures", [])]
            self._annotations = [dict(a) for a in root.get("annotations", [])]
            size = data.stat().st_size
        except OSError as err:
            raise refuse(err.filename, f"cannot be read: {err.strerror}") from err
        except (ValueError, KeyError, TypeError) as err:
            raise refuse(meta, f"not a SigMF meta file ({err!r})") from err
        kind, dtype = _KINDS.get(str(head.get("core:datatype")), ("", ""))
        n_range = head.get("core:num_channels", 1)
        if not kind or type(n_range) is not int or not 0 < n_range <= MOST_BINS:
            why = f"{head.get('core:datatype')} x {n_range} channels; "
            raise refuse(meta, why + "read are cf32_le and rf32_le with a channel a range bin")
        row_bytes = np.dtype(dtype).itemsize * n_range
        self.n_frames, rest = divmod(size, row_bytes)
        if self.n_frames == 0:
            raise refuse(data, "no frames in it")
        if rest:
            self.warning = f"{data}: the last frame is cut off"
        self._rows = np.memmap(data, dtype, "r", shape=(self.n_frames, n_range))
        said = {name: head.get(f"x2radar:{name}") for name in _KEPT}
        said["frame_rate_hz"] = head.get("core:sample_rate")
        said["carrier_hz"] = segments[0].get("core:frequency") if segments else None
        known = {
            k: v for k in ("device", "settings") if isinstance(v := head.get(f"x2radar:{k}"), dict)
        }
        self._settings = known.get("settings", {})
        self._device = known.get("device", {"name": head["core:hw"]} if "core:hw" in head else {})
        name = str(self._device.get("name", meta.name))
        self.stream = stream_from(meta, (kind, n_range), said, overrides, name)
        self._conjugate = kind == "baseband" and head.get("x2radar:phase_sign", -1) == 1
        self.started_utc = str(segments[0].get("core:datetime", "")) if segments else ""
        self._begin, self._number = _segments(meta, segments, self.n_frames)

    def read_labels(self) -> list[Label]:
        """Return the annotations that have a label; in whole frames unless we wrote them."""
        out = []
        rate_hz = self.stream.frame_rate_hz
        for note in self._annotations:
            first = note.get("core:sample_start", 0)
            last = first + note.get("core:sample_count", self.n_frames - first)
            t0_s, t1_s = note.get("x2radar:t_s", (first / rate_hz, last / rate_hz))
            if "core:label" in note:
                out.append((t0_s, t1_s, note["core:label"]))
        return out

    def close(self) -> None:
        """Let go of the data file."""
        del self._rows

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        k = np.arange(first, last)
        segment = np.searchsorted(self._begin, k, side="right") - 1
        return self._number[segment] + k - self._begin[segment]

    def read_samples(self, first: int, last: int) -> Samples:
        """See `BlockReader`."""
        rows = self._rows[first:last]
        return as_samples(rows.conj() if self._conjugate else rows, self.stream.axis.kind)


def _segments(
    meta: Path, segments: list[dict[str, Any]], n_frames: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first frame and first counter of every segment."""
    if not segments:
        return np.zeros(1, np.int64), np.ones(1, np.int64)
    try:
        begin = np.array([int(s["core:sample_start"]) for s in segments], np.int64)
        number = np.array(
            [int(s.get("x2radar:counter", b + 1)) for s, b in zip(segments, begin, strict=True)],
            np.int64,
        )
    except (KeyError, TypeError, ValueError, OverflowError) as err:
        raise refuse(meta, f"a capture segment makes no sense ({err!r})") from err
    if begin[0] != 0 or (np.diff(begin) <= 0).any() or begin[-1] >= n_frames:
        raise refuse(meta, "its capture segments are not in order, or behind the data")
    return begin, number


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new pair of files; return what was not kept."""
    meta, data = pair_of(path)
    axis, rate_hz = source.stream.axis, source.stream.frame_rate_hz
    digest = hashlib.sha512()
    segments: list[dict[str, Any]] = []
    last: int | None = None
    n = 0
    dtype, datatype = ("<c8", "cf32_le") if axis.kind == "baseband" else ("<f4", "rf32_le")
    with data.open("wb") as file:
        for block in source.blocks():
            rows = np.ascontiguousarray(block.samples, dtype)
            file.write(rows.data)
            digest.update(rows.data)
            steps = unwrap(block.counter, last)
            breaks = np.flatnonzero(steps.lost.astype(bool) | steps.restarted | steps.repeated)
            for k in [0, *breaks.tolist()] if n == 0 else breaks.tolist():
                number = int(block.counter[k])
                segments.append({"core:sample_start": n + k, "x2radar:counter": number})
            n += len(block.counter)
            last = int(block.counter[-1])
    for segment in segments:
        segment["core:frequency"] = axis.carrier_hz
    if source.started_utc:
        segments[0]["core:datetime"] = source.started_utc
    root = {
        "global": {
            "core:datatype": datatype,
            "core:version": _VERSION,
            "core:sample_rate": rate_hz,
            "core:num_channels": axis.n_range,
            "core:hw": source.stream.device,
            "core:sha512": digest.hexdigest(),
            "core:description": "Radar frames: a channel is a range bin, a sample is a frame",
            "core:extensions": [{"name": "x2radar", "version": "1.0.0", "optional": True}],
            **{f"x2radar:{name}": getattr(axis, name) for name in _KEPT},
            "x2radar:phase_sign": axis.phase_sign,
            "x2radar:device": dict(source.device),
            "x2radar:settings": dict(source.settings),
        },
        "captures": segments,
        "annotations": [_annotation(label, rate_hz, n) for label in source.labels],
    }
    meta.write_text(json.dumps(root, indent=1, default=str) + "\n", "utf-8")
    return ["times (t_s) are counted with the frame rate when it is read"]


def _annotation(label: Label, rate_hz: float, n_frames: int) -> dict[str, Any]:
    t0_s, t1_s, text = label
    first = min(max(0, round(t0_s * rate_hz)), n_frames)
    last = min(max(first, round(t1_s * rate_hz)), n_frames)
    return {
        "core:sample_start": first,
        "core:sample_count": last - first,
        "core:label": text,
        "x2radar:t_s": [t0_s, t1_s],
    }
