"""Interference: what fills the swath at all ranges alike, or has made the gate blind in it.

`InterferenceWatch` compares what the gate saw with a kept reference: the least noise floor of
the first `_FIRST_S` of calm dwells, or the calibration's. Any of these is interference:

steady
    The residual power of most of the swath stands `noise_db` over the reference, and its shape
    over range stays as it is: measured in cells of 0.3 m, 0.02 dB of scatter under a continuous
    wave, 0.2 under noise, 0.6 under pulses, 1.1 or more under people and animals who fill the
    swath (tests/test_jamming.py). A common level may come and go, as with pulses.
blind
    What the gate takes for background, floor and learned, stands so far over the reference in
    most of the swath: however it came about, weak motion is no longer seen. For `hold_s`; a
    quarter of that from twice the rise on.
filled
    All of the swath has been in motion for `_FILLED_S`, and no verdict was an alarm.

The reference follows slow change by `MOST_DRIFT_DB` in all, so no ramp can take it along.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from radard.alarm.dwell_cells import CELL_M, quantile
from radard.detect.gate import Gate
from radard.dsp.velocity import CPI_S

URGENT = 4
"""Changes of twice the limit are held for so much less: chosen, 5 s of `hold_s`."""
MOST_DRIFT_DB = 3.0
"""That a reference follows in all: chosen, more than a receiver's warming up (1 dB)."""
MEMORY_S = 600.0
"""Within which it does so: chosen, follows temperature, not a hand."""
_FIRST_S = 600.0  # chosen: people leave a room at times within ten minutes
_STEADY_S = 8.0  # chosen: with the first dwell, announced within 10 s
_STEADY_DB = 0.75  # scatter of the shape; see above
_MOST_SHARE = 0.75  # chosen: of the swath, for most of it
_ALL_SHARE = 0.9  # chosen: for all of it
_FILLED_S = 30.0  # chosen
_TINY = 1e-300  # instead of zero power

Array = NDArray[np.float64]


class InterferenceWatch:
    """Follow one gate, dwell after dwell, `hop_s` apart; forget all by making another one."""

    def __init__(self, noise_db: float, hold_s: float, hop_s: float) -> None:
        self._limit_db = noise_db
        self._hold_s = hold_s
        self._hop_s = hop_s
        self._n_new = max(1, int(hop_s / CPI_S))
        self._levels: deque[Array] = deque(maxlen=max(2, round(_STEADY_S / hop_s)))
        self._reference: Array = np.zeros(0)
        self._kept: Array = np.zeros(0)
        self._t_s = self._blind_s = self._filled_s = 0.0
        self._calm_s = hold_s  # nothing has happened yet
        self._reason = ""

    def update(self, gate: Gate, *, is_passed_over: bool) -> str:
        """Take what the gate saw; return why this is interference, empty if it is none.

        `is_passed_over` is whether there is a verdict and it is no alarm.
        """
        live = gate.floor > 0
        if not live.any() or len(gate.cpi_power) == 0:
            return self._reason
        floor = np.where(live, gate.floor, np.inf)
        if floor.shape != self._reference.shape:
            self._reference = self._kept = floor
            self._levels.clear()
        power_db = _db(gate.power, self._kept)[live]
        rise_db = quantile(power_db, 1 - _MOST_SHARE)
        blind_db = quantile(_db(gate.background, self._kept)[live], 1 - _MOST_SHARE)
        is_blind = blind_db >= self._limit_db
        is_filled = is_passed_over and quantile(power_db, 1 - _ALL_SHARE) >= self._limit_db
        hurry = URGENT if blind_db >= 2 * self._limit_db else 1
        self._blind_s = self._blind_s + hurry * self._hop_s if is_blind else 0.0
        self._filled_s = self._filled_s + self._hop_s if is_filled else 0.0
        is_calm = not is_blind and rise_db < self._limit_db
        self._calm_s = self._calm_s + self._hop_s if is_calm else 0.0
        found = self._found(rise_db, blind_db, is_steady=self._is_steady(gate, live))
        if self._calm_s >= self._hold_s:
            self._reason = ""
            # Not sooner: the gate's floor is disturbed for as long.
            self._learn(floor)
        else:
            # What it began with stays: a new text at every dwell would be as many events.
            self._reason = self._reason or found
        return self._reason

    def _found(self, rise_db: float, blind_db: float, *, is_steady: bool) -> str:
        if is_steady:
            return f"all ranges alike rose {rise_db:.0f} dB"
        if self._blind_s >= self._hold_s:
            return f"the gate's floor rose {blind_db:.0f} dB at most ranges"
        if self._filled_s >= _FILLED_S:
            return f"motion at all ranges for {_FILLED_S:.0f} s, and no verdict was an alarm"
        return ""

    def _learn(self, floor: Array) -> None:
        """Learn the reference from a calm dwell; later, let it follow within bounds."""
        self._t_s += self._hop_s
        if self._t_s <= _FIRST_S:
            self._reference = self._kept = np.minimum(self._reference, floor)
            return
        # In dB; bins that are dead now, or always were, stay as they are.
        is_known = np.isfinite(floor) & np.isfinite(self._kept)
        step_db = _db(np.where(is_known, floor, 1.0), np.where(is_known, self._kept, 1.0))
        kept = self._kept * 10 ** (self._hop_s / MEMORY_S * step_db / 10)
        most = 10 ** (MOST_DRIFT_DB / 10)
        self._kept = np.clip(kept, self._reference / most, self._reference * most)

    def _is_steady(self, gate: Gate, live: NDArray[np.bool_]) -> bool:
        """Whether most of the swath has risen for `_STEADY_S` in a shape that stays."""
        n_bins = max(1, round(CELL_M / gate.bin_length_m))
        n_cells = max(1, len(live) // n_bins)
        share = np.where(live, gate.cpi_power[-self._n_new :] / self._kept, 0.0)
        cells = share[:, : n_cells * n_bins].reshape(len(share), n_cells, -1).mean(axis=2)
        self._levels.append(10 * np.log10(np.maximum(cells, _TINY)))
        shape_db = np.concatenate(self._levels)
        least = np.sort(shape_db, axis=1)[:, round((1 - _MOST_SHARE) * (n_cells - 1))]
        risen = shape_db[least >= self._limit_db]
        if len(self._levels) < (self._levels.maxlen or 0) or len(risen) < len(shape_db) - 2:
            return False
        risen = risen - np.median(risen, axis=1)[:, None]
        return bool(np.median(risen.std(axis=0)) <= _STEADY_DB)


def _db(power: Array, reference: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(10 * np.log10(np.maximum(power, _TINY) / reference))
