"""MATLAB files of P4xx radars: ``scn(i).scn`` is a scan of real bins, ``scn(i).T`` its time.

Scans become RF frames in the radar's own unit, bins of 61.035 ps from 17.499 ns on (the
file's Tstrt when it is there), carrier 4.0 GHz, -10 dB from 3.1 to 4.8 GHz. T is in
milliseconds; its slope is the frame period and its gaps are lost frames. Read only; integers
are exact up to 2**24. The file is loaded as a whole, there is no other way.
"""

from pathlib import Path

import numpy as np

from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.recording.about import NO_OVERRIDES, Overrides, kind_of, plain, read_about
from x2radar.recording.blocks import BlockReader, as_samples
from x2radar.recording.faults import refuse
from x2radar.recording.formats.matlab import variables
from x2radar.recording.stamps import count_by_stamps

_BIN_S = 61.035e-12
_WINDOW_START_S = 17.499e-9
_CARRIER_HZ = 4.0e9
_BANDWIDTH_HZ = 1.7e9
"""As above."""

_WINDOW_STARTS_PS = (0, 1_000_000)
"""What Tstrt may be; above, the window would begin beyond 150 m."""


class P4xxReader(BlockReader):
    """Read a ``.mat`` file of a P4xx, up to version 7 (7.3 is HDF5 and not read)."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        scans = np.ravel(variables(path, {"scn"}).get("scn", ()))
        if not scans.size or not {"scn", "T"} <= set(scans.dtype.names or ()):
            raise refuse(path, "no P4xx recording: no struct 'scn' with the fields scn and T")
        try:
            stamps_ms = np.array([stamp.item() for stamp in scans["T"]], np.float64)
            rows = np.stack([np.ravel(scan) for scan in scans["scn"]])
        except (ValueError, TypeError) as err:
            raise refuse(path, f"scans of different length, or no numbers ({err})") from err
        frames = kind_of(path, rows.shape, rows.dtype)
        if frames[0] != "rf":
            raise refuse(path, "scans of complex numbers; those of a P4xx are real")
        self.n_frames = len(rows)
        self._rows = as_samples(rows, "rf")
        period_s = float("nan")
        if self.n_frames > 1:
            self._counter, period_s = count_by_stamps(stamps_ms / 1e3)
        said_ps = plain(scans["Tstrt"][0]) if "Tstrt" in scans.dtype.names else None
        low_ps, high_ps = _WINDOW_STARTS_PS
        start_s = _WINDOW_START_S
        if isinstance(said_ps, int | float) and low_ps < said_ps < high_ps:
            start_s = said_ps * 1e-12
        attributes = {
            "frame_rate_hz": 1 / period_s if np.isfinite(period_s) else None,
            "bin_length_m": SPEED_OF_LIGHT_MPS * _BIN_S / 2,
            "range_offset_m": SPEED_OF_LIGHT_MPS * start_s / 2,
            "carrier_hz": _CARRIER_HZ,
            "bandwidth_hz": _BANDWIDTH_HZ,
            "sample_rate_hz": 1 / _BIN_S,
        }
        self._keep(read_about(path, frames, attributes, overrides, "P4xx recording"))
