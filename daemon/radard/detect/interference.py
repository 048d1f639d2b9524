"""Interference: what fills the swath at all ranges alike, or has made the gate blind in it.

*Steady*: a third of the swath stands `noise_db` over the reference and keeps its shape over range
(scatter of 0.3 m cells 0.02 to 0.1 dB under a continuous wave, 0.2 to 0.5 under noise, 0.6 to 0.9
under pulses, fans 0.2 or more, bodies and plants 0.8), and but for a continuous wave its spectrum
is as flat as noise's (0.96 or more; a fan's 0.7 at most). *Blind*: what the gate takes for
background is so far over the reference in most of the swath. *Filled*: all of it has moved, and no
verdict was an alarm. The reference is the least floor of the first calm dwells.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.detect.gate import Gate
from radard.dsp.velocity import CPI_S
from radard.stream.ring import Dwell

URGENT = 4  # changes of twice the limit are held for so much less: 5 s of `hold_s`
CELL_M = 0.3  # a piece of furniture
MAX_DRIFT_DB = 3.0  # that a reference follows in all: more than a receiver's warming up (1 dB)
MEMORY_S = 600.0  # within which it does so: follows temperature, not a hand
_FIRST_S = 600.0  # people leave a room at times within ten minutes
_STEADY_S = 8.0  # with the first dwell, announced within 10 s
_STEADY_DB, _TONE_DB = 0.85, 0.12  # scatter of the shape of noise and of a tone; see above
_FLAT = 0.93  # geometric over arithmetic mean of the spectrum; see above
_MIN_SHARE, _MIN_CELLS = 0.3, 3  # of the swath; a body fills up to 0.68, unsteadily
_MAX_TIME = 0.9  # of `_STEADY_S`: a fade is no end
_SKIRT = 3  # Doppler bins about what stands still, in the window's main lobe
_MAX_SHARE = 0.75  # of the swath, for most of it
_ALL_SHARE = 0.9  # for all of it
_FILLED_S = 30.0  # nobody who walks fills all of the swath for so long
_TINY = 1e-300  # instead of zero power

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FloorReference:
    """What interference is measured against; powers in sample units squared, shape (n_range,)."""

    first: Array  # least floor of the first calm minutes; infinite in bins that were dead
    kept: Array  # the same, as it has followed the room
    t_s: float  # calm stream time in it


NO_FLOOR = FloorReference(np.zeros(0), np.zeros(0), 0.0)


class InterferenceWatch:
    """Follow one gate, dwell after dwell, `hop_s` apart; forget all by making another one."""

    def __init__(
        self, noise_db: float, hold_s: float, hop_s: float, reference: FloorReference = NO_FLOOR
    ) -> None:
        self._limit_db = noise_db
        self._hold_s = hold_s
        self._hop_s = hop_s
        self._n_new = max(1, int(hop_s / CPI_S))
        self._levels: deque[Array] = deque(maxlen=max(2, round(_STEADY_S / hop_s)))
        self.reference = reference  # what is compared with now; empty before the first dwell
        self._blind_s = self._filled_s = 0.0
        self._calm_s = hold_s  # nothing has happened yet
        self.reason = ""  # why there is interference now; empty if there is none
        self._where = np.zeros(0, np.bool_)

    def update(self, gate: Gate, dwell: Dwell, *, is_passed_over: bool) -> str:
        """Take what the gate saw, and whether the verdict is no alarm; return the `reason`."""
        live = gate.floor > 0
        if not live.any() or len(gate.cpi_power) == 0:
            return self.reason
        floor = np.where(live, gate.floor, np.inf)
        if floor.shape != self.reference.first.shape:
            self.reference = FloorReference(floor, floor, self.reference.t_s)
            self._levels.clear()
            self._where = np.zeros(0, np.bool_)
        power_db = _db(gate.power, self.reference.kept)[live]
        rise_db = quantile(power_db, 1 - _MAX_SHARE)
        blind_db = quantile(_db(gate.background, self.reference.kept)[live], 1 - _MAX_SHARE)
        is_blind = blind_db >= self._limit_db
        is_filled = is_passed_over and quantile(power_db, 1 - _ALL_SHARE) >= self._limit_db
        hurry = URGENT if blind_db >= 2 * self._limit_db else 1
        self._blind_s = self._blind_s + hurry * self._hop_s if is_blind else 0.0
        self._filled_s = self._filled_s + self._hop_s if is_filled else 0.0
        found = self._steady(gate, dwell, live)
        if not found and self._blind_s >= self._hold_s:
            found = f"the gate's floor rose {blind_db:.0f} dB at most ranges"
        elif not found and self._filled_s >= _FILLED_S:
            found = f"motion at all ranges for {_FILLED_S:.0f} s, and no verdict was an alarm"
        # Whether cells in which interference was found are as high as ever.
        here_db = self._levels[-1][:, self._where] if len(self._where) else np.zeros(0)
        still_stands = here_db.size > 0 and float(np.median(here_db)) >= self._limit_db
        is_calm = not is_blind and rise_db < self._limit_db and not still_stands
        self._calm_s = self._calm_s + self._hop_s if is_calm else 0.0
        if self._calm_s >= self._hold_s:
            self.reason = ""
            # Not sooner: the gate's floor is disturbed for as long.
            self._learn(floor)
        else:
            # What it began with stays: a new text at every dwell would be as many events.
            self.reason = self.reason or found
        return self.reason

    def _learn(self, floor: Array) -> None:
        """Learn the reference from a calm dwell; later, let it follow within bounds."""
        self._where = np.zeros(0, np.bool_)
        first, before, t_s = self.reference.first, self.reference.kept, self.reference.t_s
        t_s += self._hop_s
        if t_s <= _FIRST_S:
            least = np.minimum(first, floor)
            self.reference = FloorReference(least, least, t_s)
            return
        # In dB; bins that are dead now, or always were, stay as they are.
        is_known = np.isfinite(floor) & np.isfinite(before)
        step_db = _db(np.where(is_known, floor, 1.0), np.where(is_known, before, 1.0))
        kept = before * 10 ** (self._hop_s / MEMORY_S * step_db / 10)
        most = 10 ** (MAX_DRIFT_DB / 10)
        self.reference = FloorReference(first, np.clip(kept, first / most, first * most), t_s)

    def _steady(self, gate: Gate, dwell: Dwell, live: NDArray[np.bool_]) -> str:
        """Return which part of the swath has risen for `_STEADY_S` in a shape that stays."""
        n_bins = max(1, round(CELL_M / dwell.axis.bin_length_m))
        n_cells = max(1, len(live) // n_bins)
        share = np.where(live, gate.cpi_power[-self._n_new :] / self.reference.kept, 0.0)
        cells = share[:, : n_cells * n_bins].reshape(len(share), n_cells, -1).mean(axis=2)
        self._levels.append(10 * np.log10(np.maximum(cells, _TINY)))
        level_db = np.concatenate(self._levels)
        risen = (level_db >= self._limit_db).mean(axis=0) >= _MAX_TIME
        fewest = min(n_cells, max(_MIN_CELLS, round(_MIN_SHARE * n_cells)))
        if len(self._levels) < (self._levels.maxlen or 0) or np.count_nonzero(risen) < fewest:
            return ""
        shape_db = level_db[:, risen]
        middle_db = np.median(shape_db, axis=1)
        scatter_db = float(np.median((shape_db - middle_db[:, None]).std(axis=0)))
        is_steady = scatter_db <= _TONE_DB or (
            scatter_db <= _STEADY_DB and _flatness(dwell, np.flatnonzero(risen), n_bins) >= _FLAT
        )
        if not is_steady:
            return ""
        self._where = risen
        rise_db = float(np.median(middle_db))
        if risen.all():
            return f"all ranges alike rose {rise_db:.0f} dB"
        at = np.flatnonzero(risen)
        ends_m = dwell.axis.range_m[[at[0] * n_bins, (at[-1] + 1) * n_bins - 1]]
        return f"ranges of {ends_m[0]:.1f} to {ends_m[1]:.1f} m alike rose {rise_db:.0f} dB"


def _flatness(dwell: Dwell, cells: NDArray[np.intp], n_bins: int) -> float:
    """Return how flat some cells' spectrum over slow time is, 0 to 1 (noise)."""
    bins = (cells[:, None] * n_bins + np.arange(n_bins)).ravel()
    rows = dwell.frames[:, bins].astype(np.complex128)
    rows = (rows - rows.mean(axis=0)) * np.hanning(len(rows))[:, None]
    spectrum = np.abs(np.fft.fft(rows, axis=0)) ** 2
    mean = (spectrum / np.maximum(spectrum.mean(axis=0), _TINY)).mean(axis=1)
    mean = np.maximum(mean[_SKIRT : 1 - _SKIRT], _TINY)
    return float(np.exp(np.log(mean).mean()) / mean.mean()) if len(mean) else 0.0


def _db(power: Array, reference: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(10 * np.log10(np.maximum(power, _TINY) / reference))


def quantile(values: NDArray[np.float64], share: float) -> float:
    """Return the nearest of a few values to a quantile; numpy's own takes ten times as long."""
    return float(np.sort(values)[round(share * (len(values) - 1))])
