"""Frames of a complex NumPy array, shape (n_frames, n_range), at 60 a second."""

from collections.abc import Iterator, Mapping

import numpy as np

from radard.errors import UsageError
from radard.stream.source import FrameSource
from x2radar.frame import FastTimeAxis, Frame, StreamInfo

RATE_HZ = 60.0


class NpySource:
    """Yields the rows of an array as baseband frames."""

    is_live = False

    def __init__(self, rows: np.ndarray, bin_length_m: float, name: str) -> None:
        self._rows = rows.astype(np.complex64)
        self._rows.flags.writeable = False
        self._is_closed = False
        axis = FastTimeAxis(
            kind="baseband",
            n_range=rows.shape[1],
            bin_length_m=bin_length_m,
            range_offset_m=0.6,
            carrier_hz=6.8e9,
        )
        self.stream = StreamInfo(axis, RATE_HZ, name)

    def frames(self) -> Iterator[Frame]:
        """Yield every row; none of them is lost."""
        for k, row in enumerate(self._rows):
            if self._is_closed:
                return
            yield Frame(row, k, k, 0, False, self.stream.axis)

    def close(self) -> None:
        """End `frames`; may come from another thread."""
        self._is_closed = True


def open_npy(target: str, options: Mapping[str, str], *, speed: float | None) -> FrameSource:
    """Open npy:FILE[?bin=0.03]; a recording, so it comes as fast as it is read."""
    try:
        rows = np.load(target)
        bin_length_m = float(options.get("bin", "0.03"))
    except (OSError, ValueError) as err:
        msg = f"--port npy:{target}: {err}"
        raise UsageError(msg) from err
    return NpySource(rows, bin_length_m, target)
