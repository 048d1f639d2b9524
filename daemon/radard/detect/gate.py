"""Gate: say whether anything moves that is not part of the room's background.

It works from the first dwell on, in any unit. What stays in one place for long (a sleeper's
breath, a washing machine) becomes background of its own few bins; dwells in which motion changes
its range, or fills most of the swath, are not learned from. With c a CPI's strongest range-Doppler
cells in a bin (`radard.dsp.cfar`) and k the factor that follows from
`false_alarms_per_day`, it is open if c > k max(noise, min(residue, 2 noise), 5 (learned - noise))
somewhere, in two of three CPIs in a row. Powers are dB of mean power per bin and frame, in sample
units squared.
"""

from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radard.config.sections import GateSettings
from radard.detect.calibration import Calibration
from radard.dsp import cfar, clutter
from radard.dsp.velocity import CPI_S
from radard.stream.ring import Dwell

DAY_S = 86_400.0
_MOVES = 10**0.5  # times its floor that the power of a bin in motion stands
_LEARNED = 5.0  # times what motion in place usually shows: so far cells swing about their median
_MAX_IN_PLACE = 0.75  # of the swath; a body with its echoes' tail fills 0.68 (built-in scenes)
_TINY = 1e-300  # 10 log10 of it is finite
_GAIN = 0.2  # of a step towards what a dwell shows: five dwells' memory
_SIGMAS = 4.0  # of a CPI's power, within which a bin counts as noise
_SPAN_DB = (-10.0, 20.0)  # of the shape: wider than any receiver's
_MAX_MEMBERS = 24  # of a median: more cost time and tell little


class NoiseFloor:
    """The receiver's noise per range bin, learned from a stream with people in it.

    The common level is the least of `n_memory` dwells. The shape over range, in bounded dB, is
    that of bins that hold stationary white noise, as the median over a quarter of the swath.
    """

    def __init__(self, n_memory: int, most_db_per_dwell: float) -> None:
        self._levels: deque[float] = deque(maxlen=n_memory)
        self._most_db = most_db_per_dwell
        self._shape_db: NDArray[np.float64] | None = None

    def update(
        self, cells: NDArray[np.float32], cpi_power: NDArray[np.float64], n_cpi: int, unit: float
    ) -> tuple[float, NDArray[np.float64]]:
        """Learn from one dwell; return the common level and every bin's noise, shape (n_range,).

        Of `second_differences`, and the residual power of the same rows, shape (n_cpis, n_range);
        `unit` is sample units squared for one unit of the two. Noise is in sample units squared,
        zero in bins that do not change at all.
        """
        here = clutter.noise_of(cells)
        if np.isfinite(here):
            self._levels.append(here * unit)
        level = min(self._levels, default=0.0)
        first = self._shape_db is None
        shape_db = np.zeros(cells.shape[1]) if self._shape_db is None else self._shape_db
        if here > 0 and len(cpi_power):
            own = np.maximum(clutter.noise_profile(cells), np.finfo(np.float32).tiny)
            most = 1 + _SIGMAS / np.sqrt(n_cpi - 1)
            is_noise = (cpi_power < most * own).all(axis=0) & (cpi_power > own / most).all(axis=0)
            own_db = 10 * np.log10(own / here)
            windows = np.where(is_noise, own_db, shape_db)[_windows(len(shape_db))]
            k = (windows.shape[1] - 1) // 2
            step_db = np.partition(windows, k, axis=1)[:, k] - shape_db
            if not first:
                step_db = np.clip(_GAIN * step_db, -self._most_db, self._most_db)
            shape_db = np.clip(shape_db + step_db, *_SPAN_DB)
            self._shape_db = shape_db
        return level, level * 10 ** (shape_db / 10) * cells.any(axis=0)


@lru_cache(maxsize=8)
def _windows(n_range: int) -> NDArray[np.intp]:
    """Return at most `_MAX_MEMBERS` bins about every bin, shape (n_range, odd)."""
    half = n_range // 8
    step = max(1, -(-2 * half // _MAX_MEMBERS))
    reach = half // step
    offsets = np.arange(-reach, reach + 1) * step
    # Mirrored at the ends, so that every window has as many members.
    bins = np.abs(np.arange(n_range)[:, None] + offsets)
    bins = np.asarray(np.where(bins > n_range - 1, 2 * (n_range - 1) - bins, bins))
    bins.flags.writeable = False
    return bins


@dataclass(frozen=True, slots=True)
class GateReading:
    """What the gate saw; powers in dB of sample units squared."""

    is_open: bool  # something moves
    power_db: float  # of the cells that stand out most, in two of three CPIs
    noise_floor_db: float  # their bin's level: noise, clutter's residue, learned background
    threshold_db: float  # what the power had to exceed
    range_m: float  # where the cells stand out most


class Gate:
    """Judge one dwell after another, `hop_s` apart, by a `calibration` where there is one."""

    def __init__(
        self, settings: GateSettings, hop_s: float = 1.0, calibration: Calibration | None = None
    ) -> None:
        self._settings = settings
        self._calibration = calibration
        self._share = settings.false_alarms_per_day * hop_s / DAY_S
        n_memory = max(1, round(settings.memory_s / hop_s))
        self._n_learn = max(1, round(settings.learn_s / hop_s))
        self._noise = NoiseFloor(n_memory, settings.floor_rate_db_per_s * hop_s)
        # Power and usual cells of every bin, by dwell; None where motion was not in place.
        self._in_place: deque[NDArray[np.float64] | None] = deque(maxlen=n_memory)
        # Of the last dwell, in sample units squared: (n_range,), CPIs, the newest last, before it.
        self.background: NDArray[np.float64] = np.zeros(0)  # noise and learned background
        self.power: NDArray[np.float64] = np.zeros(0)  # residual power
        self.noise: NDArray[np.float64] = np.zeros(0)  # of the receiver, as the stream shows it
        self.floor: NDArray[np.float64] = np.zeros(0)  # that, or the calibration's
        self.cpi_power: NDArray[np.float64] = np.zeros((0, 0))  # residual power of every CPI
        self.cell_peak: NDArray[np.float64] = np.zeros((0, 0))  # strongest Doppler cells of each
        self.residue: NDArray[np.float64] = np.zeros(0)  # what clutter left, as cells show it
        self.level: NDArray[np.float64] = np.zeros(0)  # noise, residue and learned background

    def read(self, dwell: Dwell) -> GateReading:
        """Judge a dwell, with clutter or without, and learn; closed if no CPI can be used."""
        n_cpi = min(max(4, round(CPI_S * dwell.frame_rate_hz)), len(dwell.frames))
        rows, usable, scale = clutter.sound_rows(dwell.frames, dwell.valid)
        unit = scale**2
        peak, residue, cpi_power = cfar.doppler_peaks(rows, usable, n_cpi)
        cells = clutter.second_differences(rows, usable)
        noise, floor = self._noise.update(cells, cpi_power, n_cpi, unit)
        self.noise = floor
        factor: float | NDArray[np.float64]
        if self._calibration is not None:
            floor = self._calibration.floor
            factor = np.asarray(10 ** (self._calibration.threshold_db / 10))
        else:
            factor = cfar.cell_factor(self._share, len(peak), n_cpi, len(floor))
        self.floor = floor
        cpi_power *= unit
        peak *= unit
        self.cpi_power, self.cell_peak = cpi_power, peak
        self.power = cpi_power.mean(axis=0) if len(cpi_power) else np.zeros(len(floor))
        self._learn(noise, floor, n_cpi)
        self.residue = residue * unit
        self.level = np.maximum(self.level, level_over(floor, self.residue))
        spread_m = clutter.centre_spread_m(cpi_power, noise, dwell.axis.range_m)
        is_local = np.count_nonzero(self.power > _MOVES * floor) <= _MAX_IN_PLACE * len(floor)
        is_in_place = is_local and spread_m < self._settings.in_place_m and len(peak) > 0
        self._in_place.append(
            np.concatenate([self.power, peak.mean(axis=0)]) if is_in_place else None
        )
        return self._judge(factor, dwell)

    def _judge(self, factor: float | NDArray[np.float64], dwell: Dwell) -> GateReading:
        threshold = factor * self.level
        # Over no noise at all, any power stands out without bounds.
        excess = np.where(self.cell_peak > 0, np.inf, 0.0)
        np.divide(self.cell_peak, threshold, out=excess, where=threshold > 0)
        reached, cpi = cfar.two_of_three(excess.max(axis=1))
        at = int(np.argmax(excess[cpi])) if len(excess) else 0
        strongest = int(np.argmax(excess.max(axis=0))) if len(excess) else 0
        return GateReading(
            reached > 1,
            float(decibels(self.cell_peak[cpi, at] if len(excess) else 0.0)),
            float(decibels(self.level[at])),
            float(decibels(threshold[at])),
            float(dwell.axis.range_m[strongest]),
        )

    def _learn(self, noise: float, floor: NDArray[np.float64], n_cpi: int) -> None:
        self.background = self.level = floor
        learned = [each for each in self._in_place if each is not None]
        if len(learned) < self._n_learn:
            return
        # Dwells last, and in one piece: a quarter of the time.
        power, peak = np.split(np.median(np.ascontiguousarray(np.array(learned).T), axis=1), 2)
        most = noise * 10 ** (self._settings.adapt_db / 10)
        self.background = np.maximum(np.minimum(power, most), floor)
        # What may be learned is bounded by its power: a steady tone is stronger in its cells.
        share = np.minimum(1.0, most / np.maximum(power, _TINY))
        self.level = np.maximum(_LEARNED * (peak / cfar.usual_peak(n_cpi) * share - floor), floor)


def level_over(floor: NDArray[np.float64], residue: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the level that cells must stand out of, all (n_range,): noise and left clutter."""
    # Where noise steps over range, the learned floor steps a bin too early or too late.
    most = floor.copy()
    np.maximum(most[1:], floor[:-1], out=most[1:])
    np.maximum(most[:-1], floor[1:], out=most[:-1])
    return np.clip(residue, floor, cfar.MAX_RESIDUE * most)


def decibels(power: ArrayLike) -> NDArray[np.float64]:
    """Return 10 log10 of powers, finite where there is none."""
    return np.asarray(10 * np.log10(np.maximum(power, _TINY)))
