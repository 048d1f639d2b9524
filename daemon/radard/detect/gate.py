"""Gate: say whether anything moves that is not part of the room's background.

The receiver's noise is visible in every dwell, also in one with somebody in it, so the gate
works from the first dwell on and in any unit. On top of it, a background is learned per
range bin: what stays in one place for long (a breathing sleeper, a washing machine, a dog
in its basket) blinds its own few bins and no others. Only dwells whose motion keeps its
range and fills three quarters of the swath at most are learned from, so neither somebody who
walks through the room nor interference at all ranges ever becomes background, and power far
over the noise is never learned at all.

With p the residual power of a bin, k the threshold, the background b >= noise and means over
any stretch of range as long as a body::

    background = mean over bins of min(p, k b)
    open if  mean(p) > background + (k - 1) noise

In an empty room that is k times the noise. A stretch, not the swath: spread over all of it,
somebody far away is weaker by the ratio of the two (8 dB for an X2, 13 dB for an X4M03 that
looks 9 m deep). Noise, background and k are per range bin: noise from the stream
(`radard.detect.noise_floor`) or, with k, from a calibration file. Powers are dB of 10 log10(mean
residual power per bin and frame) of the stretch that stands out most, in sample units squared.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from radard.config.sections import GateSettings
from radard.detect.calibration import Calibration
from radard.detect.noise_floor import NoiseFloor
from radard.dsp.clutter import block_power, centre_spread_m, sound_rows
from radard.dsp.median import median
from radard.dsp.noise import second_differences
from radard.dsp.velocity import CPI_S
from radard.stream.ring import Dwell

EXTENT_M = 0.4
"""Length of a stretch of range that is judged as one: chosen, about the extent of a body."""
_MOST_IN_PLACE = 0.75  # of the swath; a body with its echoes' tail fills 0.68 (built-in scenes)
_TINY = 1e-300  # chosen: 10 log10 of it is finite


@dataclass(frozen=True, slots=True)
class GateReading:
    """What the gate saw; powers in dB of sample units squared."""

    is_open: bool  # something moves; the same as power_db > threshold_db
    power_db: float  # mean residual power of the stretch of range that stands out most
    noise_floor_db: float  # receiver's noise and learned background there, mean over bins
    threshold_db: float  # what the power had to exceed
    range_m: float  # where the residual power stands out most


class Gate:
    """Judge one dwell after another.

    Parameters
    ----------
    settings : GateSettings
        Threshold and learning.
    hop_s : float
        Stream time between dwells.
    calibration : Calibration, optional
        Floors and thresholds instead of those of stream and settings, checked against the stream.
    """

    def __init__(
        self, settings: GateSettings, hop_s: float = 1.0, calibration: Calibration | None = None
    ) -> None:
        self._settings = settings
        self._calibration = calibration
        n_memory = max(1, round(settings.memory_s / hop_s))
        self._n_learn = max(1, round(settings.learn_s / hop_s))
        self._noise = NoiseFloor(n_memory, settings.floor_rate_db_per_s * hop_s)
        self._in_place: deque[NDArray[np.float64] | None] = deque(maxlen=n_memory)
        self.background: NDArray[np.float64] = np.zeros(0)
        """Noise and learned background of every bin at the last dwell, in sample units
        squared, ndarray, shape (n_range,), float64."""
        self.power: NDArray[np.float64] = np.zeros(0)
        """Residual power of every bin in the last dwell, in the same unit and shape."""
        self.noise: NDArray[np.float64] = np.zeros(0)
        """Receiver's noise of every bin as the stream itself shows it, likewise."""
        self.floor: NDArray[np.float64] = np.zeros(0)
        """What held before anything was learned: that noise, or the calibration's."""
        self.cpi_power: NDArray[np.float64] = np.zeros((0, 0))
        """Residual power of every CPI, newest last, shape (n_cpis, n_range)."""
        self.bin_length_m = 0.0

    def reset(self) -> None:
        """Forget what was learned, as after a restart of the module."""
        self._noise.reset()
        self._in_place.clear()

    def read(self, dwell: Dwell) -> GateReading:
        """Judge one dwell, whole enough for it, with or without its static clutter; learn from it.

        A stream without any power is closed, and so is a dwell without a usable CPI.
        """
        n_cpi = min(max(4, round(CPI_S * dwell.frame_rate_hz)), len(dwell.frames))
        rows, usable, scale = sound_rows(dwell.frames, dwell.valid)
        unit = scale**2
        cpi_power = block_power(rows, usable, n_cpi, 1)[0][:, 0]
        noise, floor = self._noise.update(second_differences(rows, usable), cpi_power, n_cpi, unit)
        self.noise = floor
        if self._calibration is not None:
            floor = self._calibration.floor
        self.floor, self.bin_length_m = floor, dwell.axis.bin_length_m
        cpi_power *= unit
        self.cpi_power = cpi_power
        power = cpi_power.mean(axis=0) if len(cpi_power) else np.zeros(len(floor))
        self.power = power
        self.background = self._learned(noise, floor)
        spread_m = centre_spread_m(cpi_power, noise, dwell.axis.range_m)
        over = self._over()
        is_local = np.count_nonzero(power > over * floor) <= _MOST_IN_PLACE * len(power)
        is_in_place = is_local and spread_m < self._settings.in_place_m
        self._in_place.append(power if is_in_place else None)

        background = np.minimum(power, over * self.background)
        n_bins = bins_of(EXTENT_M, dwell.axis.bin_length_m)
        means = stretches(np.stack([power, background + (over - 1) * floor]), n_bins)
        # Over no noise at all, any power stands out without bounds.
        ratio = np.where(means[0] > 0, np.inf, 0.0)
        k = int(np.argmax(np.divide(means[0], means[1], out=ratio, where=means[1] > 0)))
        mean, threshold = (float(row[k]) for row in means)
        return GateReading(
            mean > threshold,
            _db(mean),
            _db(float(self.background[k : k + n_bins].mean())),
            _db(threshold),
            float(dwell.axis.range_m[int(np.argmax(power - background))]),
        )

    def _over(self) -> float | NDArray[np.float64]:
        if self._calibration is not None:
            return np.asarray(10 ** (self._calibration.threshold_db / 10))
        return float(10 ** (self._settings.threshold_db / 10))

    def _learned(self, noise: float, floor: NDArray[np.float64]) -> NDArray[np.float64]:
        learned = [power for power in self._in_place if power is not None]
        if len(learned) < self._n_learn:
            return floor
        most = noise * 10 ** (self._settings.adapt_db / 10)
        return np.maximum(np.minimum(median(np.stack(learned, axis=1)), most), floor)


def bins_of(extent_m: float, bin_length_m: float) -> int:
    """Return how many range bins make a stretch of a length."""
    return max(1, round(extent_m / bin_length_m))


def stretches(values: NDArray[np.float64], n_bins: int) -> NDArray[np.float64]:
    """Return the means over all stretches of `n_bins` neighbouring bins.

    Values are not negative, shape (..., n_range); the result has shape (..., n_stretches), and
    stretch k begins at bin k. A swath with fewer bins is one stretch. Relative error at most 1e-12
    of the strongest.
    """
    n_bins = min(n_bins, values.shape[-1])
    return np.asarray(sliding_window_view(values, n_bins, axis=-1).mean(axis=-1))


def _db(power: float) -> float:
    return float(10 * np.log10(max(power, _TINY)))
