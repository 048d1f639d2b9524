"""A clip's picture: micro-Doppler above, range below, time to the right, as RGB and as PNG.

Made second by second while the clip is written, of the same columns as the dashboard's pictures
(`radard.dsp.pictures`), so it costs little and no plotting library. Its axes stand in a text
chunk of the PNG, for pages that show it small.
"""

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.dsp.downconvert import DownConverter
from radard.dsp.pictures import Columns, Spectrograms
from x2radar.frame import Frame, StreamInfo

Rgb = NDArray[np.uint8]
_MAGIC = b"\x89PNG\r\n\x1a\n"
_DECIMATION = 4  # of the range bins: twice as many as the picture has rows
_MAX_LOST = 32  # frames of a gap that are shown: half a second
_WIDE = 2  # pixels a column
_LINE = 2  # rows between the two
_AXES = b"radard-axes"
# Dark blue over violet and orange to pale yellow, even in lightness.
_COLOURS = np.array(
    [[0, 0, 20], [60, 15, 110], [150, 40, 110], [225, 95, 60], [250, 180, 60], [252, 250, 190]]
)


class PictureMaker:
    """Take a clip's frames block by block, `decimation` range bins as one; give its picture."""

    def __init__(self, stream: StreamInfo, decimation: int = _DECIMATION) -> None:
        self._converter = DownConverter(stream.axis, decimation)
        self._rate_hz = stream.frame_rate_hz
        self.made = Spectrograms(self._converter.axis, stream.frame_rate_hz)
        self._columns: list[Columns] = []
        self._n_seen = 0

    def push(self, frames: Sequence[Frame]) -> None:
        """Add frames; one that is lost, or not finite, takes its time and leaves no mark."""
        samples: list[NDArray[Any] | None] = []
        for frame in frames:
            lost = min(frame.lost, _MAX_LOST) if self._n_seen or samples else 0
            good = bool(np.isfinite(frame.samples).all())
            samples += [*[None] * lost, frame.samples if good else None]
        for first in range(0, len(samples), self.made.longest_push):
            part = samples[first : first + self.made.longest_push]
            rows = np.zeros((len(part), self._converter.axis.n_range), np.complex64)
            for row, each in zip(rows, part, strict=True):
                if each is not None:
                    self._converter.convert(each, row)
            self._n_seen += len(part)
            is_good = np.array([each is not None for each in part])
            columns = self.made.push(rows, is_good, self._n_seen / self._rate_hz)
            if columns is not None:
                self._columns.append(columns)

    def columns(self) -> Columns | None:
        """Return all columns so far as one piece; None for a clip too short."""
        if not self._columns:
            return None
        parts = [each.values for each in self._columns]
        values = {name: np.concatenate([p[name] for p in parts], axis=1) for name in parts[0]}
        valid = np.concatenate([each.valid for each in self._columns])
        return Columns(self._columns[-1].t_s, valid, values)

    def picture(self) -> Rgb | None:
        """Return the picture, shape (height, width, 3), uint8; None for a clip too short."""
        if (columns := self.columns()) is None:
            return None
        # Approaching motion, and what is far, on top: as on the pages.
        top, bottom = (_coloured(columns.values[name][::-1]) for name in ("doppler", "range"))
        line = np.full((_LINE, top.shape[1], 3), 255, np.uint8)
        return np.concatenate([top, line, bottom])

    def axes(self) -> dict[str, Any]:
        """Return the edges of the picture's two parts: velocity_mps, range_m, and its length_s."""
        edges = {}
        for each in self.made.pictures:
            low = each.first - each.step / 2
            edges[each.name] = [round(low, 3), round(low + each.n_rows * each.step, 3)]
        n_columns = sum(len(each.valid) for each in self._columns)
        return {
            "velocity_mps": edges["doppler"],
            "range_m": edges["range"],
            "length_s": round(n_columns * self.made.column_s, 3),
        }


def encode_png(picture: Rgb, axes: dict[str, Any] | None = None) -> bytes:
    """Return a picture, shape (height, width, 3), uint8, as a PNG file (RFC 2083)."""
    height, width = picture.shape[:2]
    lines = np.pad(picture.reshape(height, 3 * width), ((0, 0), (1, 0)))
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    text = () if axes is None else ((b"tEXt", _AXES + b"\0" + json.dumps(axes).encode()),)
    parts = ((b"IHDR", head), *text, (b"IDAT", zlib.compress(lines.tobytes())), (b"IEND", b""))
    return _MAGIC + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )


def decode_png(data: bytes) -> tuple[Rgb, dict[str, Any] | None]:
    """Return picture and axes of a file that `encode_png` made; ValueError for any other."""
    found = dict(_chunks(data))
    try:
        width, height, *form = struct.unpack(">IIBBBBB", found[b"IHDR"])
        if form != [8, 2, 0, 0, 0]:
            raise ValueError("not a picture of ours")
        pixels = np.frombuffer(zlib.decompress(found[b"IDAT"]), np.uint8)
        lines = pixels.reshape(height, 1 + 3 * width)
        key, _, text = found.get(b"tEXt", b"").partition(b"\0")
        axes = json.loads(text) if key == _AXES else None
    except (KeyError, struct.error, zlib.error, RecursionError) as err:
        raise ValueError(f"not a picture of ours: {err}") from err
    return lines[:, 1:].reshape(height, width, 3), axes


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = len(_MAGIC)
    while data.startswith(_MAGIC) and at + 8 <= len(data):
        (n,) = struct.unpack(">I", data[at : at + 4])
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + n]
        at += 12 + n


def _coloured(shares: NDArray[np.uint8]) -> Rgb:
    anchors = np.linspace(0, 255, len(_COLOURS))
    table = np.stack([np.interp(np.arange(256), anchors, c) for c in _COLOURS.T], axis=-1)
    tall = max(1, round(192 / len(shares)))
    picture = np.rint(table).astype(np.uint8)[shares]
    return np.asarray(picture.repeat(tall, axis=0).repeat(_WIDE, axis=1))
