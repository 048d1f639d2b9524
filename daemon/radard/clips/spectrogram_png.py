"""A clip's picture: micro-Doppler above, range below, time to the right, as RGB and as PNG.

Made second by second while the clip is written, from frames whose range bins are thinned
out, so it costs little and no plotting library.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from radard.dsp.doppler import micro_doppler
from radard.dsp.downconvert import DownConverter
from radard.dsp.velocity import CPI_S
from x2radar.frame import Frame, StreamInfo

Rgb = NDArray[np.uint8]

# Chosen by eye:
_DECIMATION = 4  # of the range bins
_COLUMNS_PER_S = 20.0
_SCALE = 2  # pixels a column
_SPAN_DB = 45.0
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
        # Approaching motion, and what is near, on top.
        top = _coloured(np.concatenate(self._doppler, axis=1)[::-1])
        bottom = _coloured(np.concatenate(self._range, axis=1))
        line = np.full((2, top.shape[1], 3), 255, np.uint8)
        return np.concatenate([top, line, bottom])


def encode_png(picture: Rgb) -> bytes:
    """Return a picture, shape (height, width, 3), uint8, as a PNG file (RFC 2083)."""
    height, width = picture.shape[:2]
    lines = np.concatenate(
        [np.zeros((height, 1), np.uint8), picture.reshape(height, 3 * width)], axis=1
    )
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(lines.tobytes())), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )


def _coloured(power: NDArray[np.float32]) -> Rgb:
    power_db = 10 * np.log10(np.maximum(power, np.finfo(np.float32).tiny))
    top = float(power_db.max())
    share = np.clip((power_db - top) / _SPAN_DB + 1, 0, 1)
    anchors = np.linspace(0, 1, len(_COLOURS))
    colours = [np.interp(share, anchors, _COLOURS[:, c]) for c in range(3)]
    picture = np.rint(np.stack(colours, axis=-1)).astype(np.uint8)
    tall = max(1, round(192 / len(picture)))
    return np.asarray(picture.repeat(tall, axis=0).repeat(_SCALE, axis=1))
