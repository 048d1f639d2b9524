"""A clip's pictures and decisions for a page: u32 length of the JSON, the JSON, then columns.

It is a program, `python -m radard.web.pictures.clip_view FILE`, for `clip_process`: the answer
goes to stdout, or one line to stderr why there is none.
"""

import json
import os
import resource
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.dsp.downconvert import DownConverter
from radard.dsp.pictures import Columns, Spectrograms
from radard.web.pictures.wire import TIMED, axes, encode_columns
from x2radar.errors import RecordingError
from x2radar.recording.hdf5_reader import Hdf5File
from x2radar.recording.registry import open_recording

Row = tuple[NDArray[np.complex64], bool]

_BLOCK = 32  # frames at once: half a second
_MAX_S = 660.0  # above the longest clip, clips.longest_s of 600 s and its pre_s
_MAX_MEMORY = 2 << 30  # bytes of addresses: numpy, h5py and eleven minutes fit
_MAX_DECISIONS = 10_000  # one a second, of eleven minutes
_NICE = 10  # decisions come first
_KEYS = ("t_s", "seq", "gate", "label", "alarm", "fused_p_human", "fused_p_pet", "range_m")


def clip_view(path: Path) -> bytes:
    """Return the answer for a clip; X2RadarError, FeatureError or OSError if it is none."""
    with open_recording(path) as reader:
        stream = reader.stream
        thin = max(1, stream.axis.n_range // 96)
        converter = DownConverter(stream.axis, thin)
        spectrograms = Spectrograms(converter.axis, stream.frame_rate_hz)
        made: list[Columns] = []
        rows: list[Row] = []
        length_s = 0.0
        for frame in reader.frames(0.0):
            length_s = (frame.index + 1) / stream.frame_rate_hz
            if length_s > _MAX_S:
                break
            row = converter.convert(frame.samples)
            # Lost frames take their time in the pictures.
            rows += [(row, False)] * min(frame.lost, _BLOCK) if rows else []
            rows.append((row, bool(np.isfinite(row).all())))
            if len(rows) >= _BLOCK:
                _push(spectrograms, rows, length_s, made)
                rows = []
        if rows:
            _push(spectrograms, rows, length_s, made)
    head = {"length_s": length_s, "axes": axes(spectrograms), "decisions": _decisions(path)}
    text = json.dumps(head).encode()
    return struct.pack("<I", len(text)) + text + _joined(made, spectrograms)


def _push(spectrograms: Spectrograms, rows: list[Row], t_s: float, made: list[Columns]) -> None:
    frames = np.array([row for row, _ in rows], np.complex64)
    columns = spectrograms.push(frames, np.array([is_good for _, is_good in rows]), t_s)
    if columns is not None:
        made.append(columns)


def _joined(made: list[Columns], spectrograms: Spectrograms) -> bytes:
    if not made:
        return b""
    whole = Columns(
        made[-1].t_s,
        np.concatenate([c.valid for c in made]),
        {name: np.concatenate([c.values[name] for c in made], axis=1) for name in TIMED},
    )
    return encode_columns(whole, first=0, epoch=0, column_s=spectrograms.column_s)


def _decisions(path: Path) -> list[dict[str, Any]]:
    """Return what was decided on the clip, on its own clock; nothing for a bare recording."""
    try:
        file = Hdf5File(path)
    except RecordingError:
        return []
    try:
        sets = {key: file.data_set(f"decisions/{key}") for key in _KEYS}
        if any(each is None or each.ndim != 1 for each in sets.values()):
            return []
        columns = {key: file.read(each, slice(_MAX_DECISIONS)) for key, each in sets.items()}
    except (RecordingError, OSError):
        return []
    finally:
        file.close()
    return [
        {key: _plain(values[i]) for key, values in columns.items()}
        for i in range(min(map(len, columns.values())))
    ]


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    number = value.item()
    return None if isinstance(number, float) and not np.isfinite(number) else number


def main(path: str) -> int:
    """Write the answer for a clip to stdout, within limits; return the exit code."""
    os.nice(_NICE)
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY, _MAX_MEMORY))
    try:
        data = clip_view(Path(path))
    except MemoryError:
        sys.stderr.write("it asks for too much memory; the file may be damaged\n")
        return 1
    except Exception as err:  # noqa: BLE001 - h5py raises all kinds of errors on damaged files
        sys.stderr.write(" ".join(str(err).split())[:500] + "\n")
        return 1
    sys.stdout.buffer.write(data)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
