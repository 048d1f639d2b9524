"""A clip's picture: micro-Doppler above, range below, time to the right, as RGB and as PNG.

Made second by second while the clip is written, from frames whose range bins are thinned
out, so it costs little and no plotting library. Its axes stand in a text chunk of the PNG, for
pages that show it small.
"""

import json
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.dsp.doppler import micro_doppler, velocity_mps
from radard.dsp.downconvert import DownConverter
from radard.dsp.velocity import CPI_S
from x2radar.frame import Frame, StreamInfo

Rgb = NDArray[np.uint8]
_MAGIC = b"\x89PNG\r\n\x1a\n"

# Chosen by eye:
_DECIMATION = 4  # of the range bins
_COLUMNS_PER_S = 20.0
_SCALE = 2  # pixels a column
_SPAN_DB = 45.0
_LINE = 2  # rows between the two
_AXES = b"radard-axes"
_MOST_BYTES = 50_000_000  # of a picture's pixels; chosen: ten minutes take 10 MB
# Dark blue over violet and orange to pale yellow, even in lightness.
_COLOURS = np.array(
    [[0, 0, 20], [60, 15, 110], [150, 40, 110], [225, 95, 60], [250, 180, 60], [252, 250, 190]]
)


class PictureMaker:
    """Take a clip's frames block by block, give its picture."""

    def __init__(self, stream: StreamInfo) -> None:
        self._converter = DownConverter(stream.axis, _DECIMATION)
        self._n_cpi = max(4, round(CPI_S * stream.frame_rate_hz))
        self._group = max(1, round(stream.frame_rate_hz / _COLUMNS_PER_S))
        self._rows = np.zeros((0, self._converter.axis.n_range), np.complex64)
        self._doppler: list[NDArray[np.float32]] = []
        self._range: list[NDArray[np.float32]] = []
        self._rate_hz = stream.frame_rate_hz

    def push(self, frames: list[Frame]) -> None:
        """Add the next frames; one that is lost or not finite leaves no mark."""
        rows = np.zeros((len(frames), self._rows.shape[1]), np.complex64)
        for row, frame in zip(rows, frames, strict=True):
            if np.isfinite(frame.samples).all():
                self._converter.convert(frame.samples, row)
        self._rows = np.concatenate([self._rows, rows])
        n_columns = (len(self._rows) - self._n_cpi + 1) // self._group
        if n_columns < 1:
            return
        n_used = n_columns * self._group
        used = self._rows[: n_used + self._n_cpi - 1]
        mu = micro_doppler(used, self._n_cpi)
        self._doppler.append(mu.reshape(len(mu), n_columns, -1).mean(axis=2))
        still = np.add.reduceat(used[:n_used], np.arange(0, n_used, self._group)) / self._group
        # What moves within a CPI: the spread of the groups' own frames about the CPI's mean.
        moving = np.abs(still - used.mean(axis=0)) ** 2
        self._range.append(moving.T)
        self._rows = self._rows[n_used:]

    def picture(self) -> Rgb | None:
        """Return the picture, shape (height, width, 3), uint8; None for a clip too short."""
        if not self._doppler:
            return None
        # Approaching motion, and what is far, on top: as on the pages.
        top = _coloured(np.concatenate(self._doppler, axis=1)[::-1])
        bottom = _coloured(np.concatenate(self._range, axis=1)[::-1])
        line = np.full((_LINE, top.shape[1], 3), 255, np.uint8)
        return np.concatenate([top, line, bottom])

    def axes(self) -> dict[str, Any]:
        """Return the edges of the picture's two parts: velocity_mps, range_m, and its length_s."""
        axis = self._converter.axis
        speeds = velocity_mps(self._n_cpi, self._rate_hz, axis.carrier_hz)
        half_mps, half_m = (speeds[1] - speeds[0]) / 2, axis.bin_length_m / 2
        near_m, far_m = float(axis.range_m[0]), float(axis.range_m[-1])
        n_columns = sum(part.shape[1] for part in self._doppler)
        return {
            "velocity_mps": [
                round(float(v), 3) for v in (speeds[0] - half_mps, speeds[-1] + half_mps)
            ],
            "range_m": [round(near_m - half_m, 3), round(far_m + half_m, 3)],
            "length_s": round(n_columns * self._group / self._rate_hz, 3),
        }


def encode_png(picture: Rgb, axes: dict[str, Any] | None = None) -> bytes:
    """Return a picture, shape (height, width, 3), uint8, as a PNG file (RFC 2083)."""
    height, width = picture.shape[:2]
    lines = np.concatenate(
        [np.zeros((height, 1), np.uint8), picture.reshape(height, 3 * width)], axis=1
    )
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    text = () if axes is None else ((b"tEXt", _AXES + b"\0" + json.dumps(axes).encode()),)
    parts = (
        (b"IHDR", head),
        *text,
        (b"IDAT", zlib.compress(lines.tobytes())),
        (b"IEND", b""),
    )
    return _MAGIC + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )


def decode_png(data: bytes) -> tuple[Rgb, dict[str, Any] | None]:
    """Return picture and axes of a file that `encode_png` made; ValueError for any other."""
    found = dict(_chunks(data))
    try:
        width, height, *form = struct.unpack(">IIBBBBB", found[b"IHDR"])
        n = height * (1 + 3 * width)
        if form != [8, 2, 0, 0, 0] or not 0 < n <= _MOST_BYTES:
            msg = "not a picture of ours"
            raise ValueError(msg)
        pixels = zlib.decompressobj().decompress(found[b"IDAT"], n)
        lines = np.frombuffer(pixels, np.uint8).reshape(height, 1 + 3 * width)
        key, _, text = found.get(b"tEXt", b"").partition(b"\0")
        axes = json.loads(text) if key == _AXES else None
    except (KeyError, struct.error, zlib.error, RecursionError) as err:
        msg = f"not a picture of ours: {err}"
        raise ValueError(msg) from err
    return lines[:, 1:].reshape(height, width, 3), axes


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of a PNG's chunks, one of each kind as in ours."""
    at = len(_MAGIC)
    while data.startswith(_MAGIC) and at + 8 <= len(data):
        (n,) = struct.unpack(">I", data[at : at + 4])
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + n]
        at += 12 + n


def _coloured(power: NDArray[np.float32]) -> Rgb:
    power_db = 10 * np.log10(np.maximum(power, np.finfo(np.float32).tiny))
    top = float(power_db.max())
    share = np.clip((power_db - top) / _SPAN_DB + 1, 0, 1)
    anchors = np.linspace(0, 1, len(_COLOURS))
    colours = [np.interp(share, anchors, _COLOURS[:, c]) for c in range(3)]
    picture = np.rint(np.stack(colours, axis=-1)).astype(np.uint8)
    tall = max(1, round(192 / len(picture)))
    return np.asarray(picture.repeat(tall, axis=0).repeat(_SCALE, axis=1))
