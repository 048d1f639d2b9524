"""A clip's picture, small, with its axes: for a list of events."""

import base64
from pathlib import Path
from typing import Any

from radard.clips.spectrogram_png import decode_png, encode_png

_STEP = 2  # a quarter of the pixels; every column stands twice in the picture
_MAX_BYTES = 20_000_000  # of a file: ten minutes take a third of that


def thumbnail(path: Path) -> dict[str, Any]:
    """Return `png`, a data: URL, and `axes` (`PictureMaker.axes`; None in an old picture).

    Raises OSError, or ValueError if the file is no picture of a clip.
    """
    if path.stat().st_size > _MAX_BYTES:
        msg = "it is too large"
        raise ValueError(msg)
    picture, axes = decode_png(path.read_bytes())
    small = encode_png(picture[::_STEP, ::_STEP])
    return {"png": f"data:image/png;base64,{base64.b64encode(small).decode()}", "axes": axes}
