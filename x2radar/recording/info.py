"""What a recording says about itself, and what its counters and times say about it."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from x2radar.recording.blocks import BlockReader, unwrap
from x2radar.recording.registry import format_of, open_recording


def describe_recording(path: Path) -> dict[str, Any]:
    """Return facts about a recording, JSON-safe; counters and times are read, not samples.

    measured_rate_hz is that of t_s over the counters, null for one frame. Raises RecordingError
    if it cannot be read.
    """
    with open_recording(path) as reader:
        axis = asdict(reader.stream.axis)
        last = len(reader.stream.axis.range_m) - 1
        axis["range_m"] = [float(reader.stream.axis.range_m[k]) for k in (0, last)]
        parts = [str(part) for part in reader.paths]
        return {
            "path": str(path),
            "format": format_of(path).name,
            "kind": axis.pop("kind"),
            **_counted(reader),
            "axis": axis,
            "started_utc": reader.started_utc,
            "device": dict(reader.device),
            "settings": dict(reader.settings),
            "labels": [list(label) for label in reader.labels],
            "has_decisions": reader.has_decisions,
            "compression": reader.compression,
            "n_bytes": _size(path, parts),
            "parts": parts,
            "warning": reader.warning,
        }


def _counted(reader: BlockReader) -> dict[str, Any]:
    last: int | None = None
    index, n_frames, lost, gaps, longest, restarts, repeats = -1, 0, 0, 0, 0, 0, 0
    first_s = end_s = 0.0
    for block in reader.blocks(samples=False):
        steps = unwrap(block.counter, last, index)
        if last is None:
            first_s = float(block.t_s[0])
        last, index, end_s = int(block.counter[-1]), int(steps.index[-1]), float(block.t_s[-1])
        n_frames += len(block.counter)
        lost += int(steps.lost.sum())
        gaps += int(np.count_nonzero(steps.lost))
        longest = max(longest, int(steps.lost.max()))
        restarts += int(np.count_nonzero(steps.restarted))
        repeats += int(np.count_nonzero(steps.repeated))
    span_s = end_s - first_s
    return {
        "n_frames": n_frames,
        "duration_s": span_s + 1 / reader.stream.frame_rate_hz,
        "frame_rate_hz": reader.stream.frame_rate_hz,
        "measured_rate_hz": index / span_s if span_s > 0 and index > 0 else None,
        "lost": lost,
        "gaps": gaps,
        "longest_gap": longest,
        "restarts": restarts,
        "repeats": repeats,
    }


def _size(path: Path, parts: list[str]) -> int:
    if parts:
        return sum(Path(part).stat().st_size for part in parts)
    if path.is_dir():
        return sum(file.stat().st_size for file in path.iterdir() if file.is_file())
    return sum(file.stat().st_size for file in format_of(path).files(path))


def summary(facts: dict[str, Any]) -> list[str]:
    """Return the facts of `describe_recording` as lines for people."""
    axis, device = facts["axis"], facts["device"]
    low_m, high_m = axis["range_m"]
    measured = facts["measured_rate_hz"]
    labels = sorted({label for _, _, label in facts["labels"]})
    rows = {
        "format": f"{facts['format']}, {facts['kind']}",
        "frames": f"{facts['n_frames']}, {facts['duration_s']:.3f} s",
        "frame rate": f"{facts['frame_rate_hz']:.6g} Hz stated, "
        + (f"{measured:.6g} Hz measured" if measured else "not measurable"),
        "losses": f"{facts['lost']} frames in {facts['gaps']} gaps, longest "
        f"{facts['longest_gap']}; {facts['restarts']} restarts, {facts['repeats']} repeats",
        "range": f"{low_m:.3f} to {high_m:.3f} m, {axis['n_range']} bins of "
        f"{axis['bin_length_m'] * 1e3:.3f} mm",
        "pulse": f"{axis['carrier_hz'] / 1e9:g} GHz, bandwidth "
        + (f"{axis['bandwidth_hz'] / 1e9:g} GHz" if axis["bandwidth_hz"] else "unknown"),
        "sampler": f"{axis['sample_rate_hz'] / 1e9:g} GS/s"
        if axis["sample_rate_hz"]
        else "unknown",
        "started": facts["started_utc"] or "unknown",
        "device": device.get("name", "unknown"),
        "labels": f"{len(facts['labels'])} ({', '.join(labels)})" if labels else "none",
        "decisions": "present" if facts["has_decisions"] else "none",
        "size": f"{facts['n_bytes'] / 1e6:.3f} MB, compression {facts['compression']}"
        + (f", {len(facts['parts'])} parts" if facts["parts"] else ""),
        "warning": facts["warning"] or "none",
    }
    return [f"{name:<11}{text}" for name, text in rows.items()]
