"""ClipFile: one alarm's evidence, a recording that replays, and room for the next one.

When it ends it gets what was decided: `/decisions/*`, with `t_s` on the clip's own clock;
`/picture`; and the attributes `event`, `config_hash`, `model`, `model_sha256`, `sensor`,
`stream_t_s` (of its first frame) and `version`.
"""

import contextlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from radard.clips.room import date_last
from radard.clips.spectrogram_png import PictureMaker, encode_png
from radard.errors import FeatureError, OutputError
from radard.judge.bundle import PROBABILITIES
from x2radar.atomic import write_atomically
from x2radar.errors import RecordingError
from x2radar.frame import Frame, StreamInfo
from x2radar.recording.hdf5_writer import RecordingWriter

Record = Mapping[str, Any]
_TEXTS = ("gate", "label")
_NUMBERS = ("power_db", "noise_floor_db", "threshold_db", *PROBABILITIES, "range_m")
_WHOLE = ("seq", "frames", "dropped", "alarm")


@dataclass(eq=False)
class ClipFile:
    """Writer of one clip: frames, decisions, picture and attributes."""

    path: Path
    stream: StreamInfo
    first_index: int
    started_utc: str
    attributes: Mapping[str, str]

    def __post_init__(self) -> None:
        self._stream_t_s = self.first_index / self.stream.frame_rate_hz
        self._picture = PictureMaker(self.stream)
        self._writer = RecordingWriter(
            self.path,
            self.stream,
            started_utc=self.started_utc,
            device={"name": self.stream.device},
            first_index=self.first_index,
            attributes={**self.attributes, "stream_t_s": self._stream_t_s},
        )

    def write(self, frames: list[Frame]) -> None:
        """Keep frames; if that cannot be done, the file is left as it is."""
        try:
            for frame in frames:
                self._writer.write(frame)
            self._picture.push(frames)
        except (RecordingError, FeatureError):
            with contextlib.suppress(RecordingError, OSError, RuntimeError):
                self._writer.close()
            raise

    def preview(self) -> None:
        """Draw what there is up to now, for those who are told of the alarm while it is on."""
        if (picture := self._picture.picture()) is not None:
            png = encode_png(picture, self._picture.axes())
            path = self.path.with_suffix(".png")
            write_atomically(path, png, sync=False)
            # The picture dates the clip: the recording has the clock's time while it grows.
            date_last(path)

    def finish(self, decisions: Sequence[Record], event: Record) -> None:
        """Close the clip and add what was decided; OutputError if the disk does not take it."""
        try:
            self._writer.close()
            # In memory, for HDF5 crashes the process where a full disk takes a part only. What was
            # written stays whole, and a reader who holds it keeps nothing out.
            whole = io.BytesIO(self.path.read_bytes())
            with h5py.File(whole, "r+", libver="latest") as file:
                file.attrs["event"] = json.dumps(event)
                _write_decisions(file, decisions, self._stream_t_s)
                if (picture := self._picture.picture()) is not None:
                    image = file.create_dataset("picture", data=picture, compression="gzip")
                    # HDF5 Image and Palette Specification 1.2: viewers then show it.
                    image.attrs["CLASS"] = np.bytes_("IMAGE")
                    image.attrs["IMAGE_VERSION"] = np.bytes_("1.2")
                    image.attrs["IMAGE_SUBCLASS"] = np.bytes_("IMAGE_TRUECOLOR")
                    image.attrs["INTERLACE_MODE"] = np.bytes_("INTERLACE_PIXEL")
            write_atomically(self.path, whole.getvalue(), sync=False)
            self.preview()
        except (RecordingError, OSError, RuntimeError) as err:
            msg = f"{self.path}: the clip lacks its decisions: {' '.join(str(err).split())}"
            raise OutputError(msg) from err


def _write_decisions(file: h5py.File, decisions: Sequence[Record], offset_s: float) -> None:
    group = file.create_group("decisions")
    group["t_s"] = np.array([d["t_s"] - offset_s for d in decisions], np.float64)
    for names, kind in ((_WHOLE, np.int64), (_NUMBERS, np.float64)):
        for name in names:
            # What is None becomes NaN.
            group[name] = np.array([d[name] for d in decisions], kind)
    for name in _TEXTS:
        texts = [d[name] or "" for d in decisions]
        group.create_dataset(name, data=texts, dtype=h5py.string_dtype())
