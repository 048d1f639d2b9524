"""Pictures to bytes and their axes to JSON, for the page's `pictures.js`.

All numbers are little-endian. A message of columns::

    u8 kind (1), u8 pictures, u16 columns, u32 number of the first column,
    u32 epoch (changes when the stream restarts), f32 column_s, f64 t_s of the last column,
    a byte per column (1: valid), then for each picture rows x columns bytes, column by column

and one of the gait picture::

    u8 kind (2), u8 0, u16 columns, u32 rows, u32 epoch, f32 step_hz, f64 t_s,
    then rows x columns bytes, column by column
"""

import struct
from dataclasses import asdict
from typing import Any

from radard.dsp.pictures import SPANS_DB, Bytes, Columns, Spectrograms

COLUMNS, GAIT = 1, 2
TIMED = ("range", "velocity", "doppler")
_HEAD = struct.Struct("<BBHIIfd")


def axes(spectrograms: Spectrograms) -> dict[str, Any]:
    """Return what a page needs to draw the pictures of `spectrograms`."""
    return {
        "column_s": spectrograms.column_s,
        "gait_step_hz": spectrograms.gait_step_hz,
        "unambiguous_mps": spectrograms.unambiguous_mps,
        "pictures": [{**asdict(p), "span_db": SPANS_DB[p.name]} for p in spectrograms.pictures],
    }


def encode_columns(columns: Columns, *, first: int, epoch: int, column_s: float) -> bytes:
    """Return the message of new columns, the first of which has number `first`."""
    n = len(columns.valid)
    head = _HEAD.pack(COLUMNS, len(TIMED), n, first, epoch, column_s, columns.t_s)
    parts = [columns.values[name].T.tobytes() for name in TIMED]
    return b"".join([head, columns.valid.astype("u1").tobytes(), *parts])


def encode_gait(picture: Bytes, *, epoch: int, step_hz: float, t_s: float) -> bytes:
    """Return the message of a gait picture."""
    n_rows, n = picture.shape
    return _HEAD.pack(GAIT, 0, n, n_rows, epoch, step_hz, t_s) + picture.T.tobytes()
