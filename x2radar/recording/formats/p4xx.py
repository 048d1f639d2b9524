"""MATLAB files of P4xx radars: ``scn(i).scn`` is a scan of real bins, ``scn(i).T`` its time.

Scans become RF frames in the radar's own unit, bins of 61.035 ps from 17.499 ns on (the
file's Tstrt when it is there), carrier 4.0 GHz, -10 dB from 3.1 to 4.8 GHz. T is in
milliseconds; its slope is the frame period and its gaps are lost frames. Read only; integers
are exact up to 2**24. The file is loaded as a whole, there is no other way.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.recording.blocks import (
    MOST_BINS,
    NO_OVERRIDES,
    BlockReader,
    Overrides,
    as_samples,
    refuse,
)
from x2radar.recording.formats.axis import stream_from
from x2radar.recording.formats.mat5 import Mat5File
from x2radar.recording.stamps import count_by_stamps

BIN_S = 61.035e-12
WINDOW_START_S = 17.499e-9
CARRIER_HZ = 4.0e9
BANDWIDTH_HZ = 1.7e9
"""As above."""

_WINDOW_STARTS_PS = (0, 1_000_000)
"""What Tstrt may be. Chosen: above, the window would begin beyond 150 m."""


class P4xxReader(BlockReader):
    """Read a ``.mat`` file of a P4xx, up to version 7 (7.3 is HDF5 and not read)."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = path
        self._overrides = overrides
        scans = Mat5File(path).struct("scn", ("scn", "T", "Tstrt"))
        if not scans:
            raise refuse(path, "no P4xx recording: no struct 'scn' with the fields scn and T")
        try:
            stamps_ms = np.array([scan["T"].item() for scan in scans], np.float64)
            samples = np.stack([scan["scn"] for scan in scans], dtype=np.float32, casting="unsafe")
        except (ValueError, KeyError) as err:
            raise refuse(path, f"scans of different length, or no numbers ({err})") from err
        self.n_frames, n_range = samples.shape
        if not 0 < n_range <= MOST_BINS:
            raise refuse(path, f"scans of {n_range} bins")
        self._rows = as_samples(samples, "rf")
        counter, period_s = np.ones(1, np.uint32), float("nan")
        if self.n_frames > 1:
            counter, period_s = count_by_stamps(stamps_ms / 1e3)
        self._counter = counter
        said = {
            "frame_rate_hz": 1 / period_s if np.isfinite(period_s) else None,
            "bin_length_m": SPEED_OF_LIGHT_MPS * BIN_S / 2,
            "range_offset_m": SPEED_OF_LIGHT_MPS * _window_start_s(scans[0]) / 2,
            "carrier_hz": CARRIER_HZ,
            "bandwidth_hz": BANDWIDTH_HZ,
            "sample_rate_hz": 1 / BIN_S,
        }
        self.stream = stream_from(path, ("rf", n_range), said, overrides, "P4xx recording")

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        return self._counter[first:last]

    def read_samples(self, first: int, last: int) -> Samples:
        """See `BlockReader`."""
        return self._rows[first:last]


def _window_start_s(scan: Mapping[str, NDArray[Any]]) -> float:
    """Return when the window begins behind the pulse, in seconds; Tstrt is in picoseconds."""
    said = scan.get("Tstrt")
    start_ps = float(said[0]) if said is not None and said.size == 1 else 0.0
    low, high = _WINDOW_STARTS_PS
    return start_ps * 1e-12 if low < start_ps < high else WINDOW_START_S
