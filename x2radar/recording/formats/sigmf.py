"""SigMF: ``NAME.sigmf-data`` with the samples and ``NAME.sigmf-meta``, JSON, with the rest.

Every range bin is a channel, sampled once a frame: ``core:num_channels`` is the number of bins,
``core:sample_rate`` the frame rate, ``core:frequency`` the carrier. A capture segment begins with
the recording and wherever a counter does not follow the one before; ``x2radar:counter`` is the
segment's first. The range axis, device and settings stand in the global object as ``x2radar:…``.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import CounterTracker, Kind, Step
from x2radar.keys import unrepeated
from x2radar.recording.about import MAX_BINS, NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader, Label
from x2radar.recording.faults import refuse

META = ".sigmf-meta"
DATA = ".sigmf-data"
_VERSION = "1.0.0"
_KINDS: dict[str, tuple[Kind, str]] = {"cf32_le": ("baseband", "<c8"), "rf32_le": ("rf", "<f4")}
_MAX_META_BYTES = 1 << 26  # a capture segment a gap, for days; as JSON in memory some hundred MB
_Object = dict[str, Any]
_KEPT = ("bin_length_m", "range_offset_m", "bandwidth_hz", "sample_rate_hz")


def pair_of(path: Path) -> tuple[Path, Path]:
    """Return the meta and the data file that `path`, either of them or neither, belongs to."""
    name = path.name.removesuffix(META).removesuffix(DATA).removesuffix(".sigmf")
    return path.with_name(name + META), path.with_name(name + DATA)


class Reader(BlockReader):
    """Read a SigMF pair whose channels are range bins, by the name of either file."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        meta, data = pair_of(path)
        super().__init__(meta, overrides)
        if path.name.endswith(".sigmf") and path.is_file():
            raise refuse(path, "an archive; unpack it, as by 'tar -xf'")
        head, segments, self._annotations = _read_meta(meta)
        usual = {"core:metadata_only": False, "core:offset": 0, "core:dataset": data.name}
        odd = [name for name, value in usual.items() if head.get(name, value) != value]
        extensions = head.get("core:extensions", ())
        odd += [each["name"] for each in extensions if not each.get("optional")]
        if set(odd) - {"x2radar"}:
            raise refuse(meta, f"{', '.join(odd)}: means samples that are not read")
        datatype, n_range = str(head.get("core:datatype")), head.get("core:num_channels", 1)
        if datatype not in _KINDS or type(n_range) is not int or not 0 < n_range <= MAX_BINS:
            why = f"{datatype} x {n_range} channels; "
            raise refuse(meta, why + "read are cf32_le and rf32_le with a channel a range bin")
        kind, dtype = _KINDS[datatype]
        self._map(data, np.dtype((dtype, (n_range,))), head, segments)
        if len({repr(each.get("core:frequency")) for each in segments}) > 1:
            raise refuse(meta, "its core:frequency changes: frames of several carriers")
        kept = (*_KEPT, "phase_sign", "device", "settings")
        said = {name: head.get(f"x2radar:{name}") for name in kept}
        said["frame_rate_hz"] = head.get("core:sample_rate")
        said["carrier_hz"] = segments[0].get("core:frequency")
        said["started_utc"] = segments[0].get("core:datetime")
        if said["device"] is None and "core:hw" in head:
            said["device"] = {"name": head["core:hw"]}
        self._keep((kind, n_range), said, meta.name)
        begins = [_count(meta, segment, "core:sample_start") for segment in segments]
        pairs = zip(segments, begins, strict=True)
        numbers = [_count(meta, segment, "x2radar:counter", k + 1) for segment, k in pairs]
        self._begin, self._number = np.array(begins), np.array(numbers)
        if begins[0] != 0 or not (np.diff([*begins, self.n_frames]) > 0).all():
            raise refuse(meta, "its capture segments are not in order, or behind the data")

    def _map(self, data: Path, row: np.dtype[Any], head: _Object, segments: list[_Object]) -> None:
        """Map the frames of the data file; bytes in front of and behind them are left out."""
        meta = self.path
        if any(_count(meta, segment, "core:header_bytes", 0) for segment in segments[1:]):
            raise refuse(meta, "core:header_bytes between frames, which are not read")
        before = _count(meta, segments[0], "core:header_bytes", 0)
        behind = _count(meta, head, "core:trailing_bytes", 0)
        with data.open("rb") as file:
            size = data.stat().st_size - before - behind
            wanted = str(head.get("core:sha512") or "").lower()
            if wanted and hashlib.file_digest(file, "sha512").hexdigest() != wanted:
                raise refuse(data, "its bytes are not those that core:sha512 is of: damaged")
        self.n_frames, rest = divmod(max(size, 0), row.itemsize)
        if self.n_frames == 0:
            raise refuse(data, "no frames in it")
        if rest:
            self._warnings.append(f"{data}: the last frame is cut off")
        self._rows = np.memmap(data, row.base, "r", before, (self.n_frames, *row.shape))

    def read_labels(self) -> list[Label]:
        """Return the annotations that have a label; in whole frames unless we wrote them."""
        out = []
        meta, rate_hz = self.path, self.stream.frame_rate_hz
        for note in self._annotations:
            if "core:label" not in note:
                continue
            first = _count(meta, note, "core:sample_start", 0)
            last = first + _count(meta, note, "core:sample_count", max(self.n_frames - first, 0))
            times_s = note.get("x2radar:t_s", (first / rate_hz, last / rate_hz))
            t0_s, t1_s = map(float, times_s)
            out.append((t0_s, t1_s, str(note["core:label"])))
        return out

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        k = np.arange(first, last)
        segment = np.searchsorted(self._begin, k, side="right") - 1
        return np.asarray(self._number[segment] + k - self._begin[segment])


def _read_meta(meta: Path) -> tuple[_Object, list[_Object], list[_Object]]:
    """Return the global object, capture segments and annotations."""
    with meta.open("rb") as file:
        root = json.loads(file.read(_MAX_META_BYTES), object_pairs_hook=unrepeated)
    captures = root.get("captures") or [{"core:sample_start": 0}]
    annotations = root.get("annotations", [])
    return dict(root["global"]), [dict(s) for s in captures], [dict(a) for a in annotations]


def _count(meta: Path, said: _Object, name: str, default: int | None = None) -> int:
    """Return a whole number of samples or bytes."""
    value = said.get(name, default)
    if type(value) is not int or not 0 <= value < 1 << 62:
        raise refuse(meta, f"'{name}' is {value!r}, not a whole number from 0 on")
    return value


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new pair of files; return what was not kept."""
    meta, data = pair_of(path)
    axis, rate_hz = source.stream.axis, source.stream.frame_rate_hz
    digest = hashlib.sha512()
    segments: list[_Object] = []
    dtype, datatype = ("<c8", "cf32_le") if axis.kind == "baseband" else ("<f4", "rf32_le")
    with data.open("wb") as file:
        for block in source.blocks():
            rows = np.ascontiguousarray(block.samples, dtype)
            file.write(rows.data)
            digest.update(rows.data)
    tracker, about = CounterTracker(), {"core:frequency": axis.carrier_hz}
    for k, number in enumerate(source.lists()[0].tolist()):
        if tracker.update(number)[0] is not Step.NEXT:
            segments.append({"core:sample_start": k, "x2radar:counter": number, **about})
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
        "annotations": [_annotation(label, rate_hz, source.n_frames) for label in source.labels],
    }
    meta.write_text(json.dumps(root, indent=1, default=str) + "\n", "utf-8")
    return ["times (t_s) are counted with the frame rate when it is read"]


def _annotation(label: Label, rate_hz: float, n_frames: int) -> _Object:
    t0_s, t1_s, text = label
    first = min(max(0, round(t0_s * rate_hz)), n_frames)
    last = min(max(first, round(t1_s * rate_hz)), n_frames)
    return {
        "core:sample_start": first,
        "core:sample_count": last - first,
        "core:label": text,
        "x2radar:t_s": [t0_s, t1_s],
    }
