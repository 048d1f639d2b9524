"""Gate: say whether anything moves that is not part of the room's background.

The receiver's noise is visible in every dwell, also in one with somebody in it, so the gate
works from the first dwell on and in any unit. On top of it, a background is learned per
range bin: what stays in one place for long (a breathing sleeper, a washing machine, a dog
in its basket) blinds its own few bins and no others. Only dwells whose motion keeps its
range are learned from, so nobody who walks through the room ever becomes background, and
power far over the noise is never learned at all.

With p the residual power of a bin, k the threshold and the background b >= noise::

    background = mean over bins of min(p, k b)
    open if  mean(p) > background + (k - 1) noise

In an empty room that is k times the noise. Powers are dB of 10 log10(mean residual power
per bin and frame), in sample units squared.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.dsp.clutter import centre_spread_m, noise_power, residual_power
from radard.ring import Dwell

_TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True)
class GateSettings:
    """How the gate decides.

    Attributes
    ----------
    threshold_db : float
        How far power must stand out of the floor, in dB.
    adapt_db : float
        A bin's background may be learned up to so far above the receiver's noise, in dB.
    memory_s : float
        How long a dwell is remembered, in seconds.
    learn_s : float
        So many seconds of motion in place, within the memory, make a background.
    in_place_m : float
        Motion that wanders less than this within a dwell is in place, in metres.
    cpi_s : float
        Motion slower than one cycle in this time counts as clutter, in seconds.
    """

    threshold_db: float = 6.0
    adapt_db: float = 40.0
    memory_s: float = 60.0
    learn_s: float = 20.0
    in_place_m: float = 0.2
    cpi_s: float = 28 / 60


@dataclass(frozen=True, slots=True)
class GateReading:
    """What the gate saw.

    Attributes
    ----------
    is_open : bool
        Something moves; the same as power_db > threshold_db.
    power_db : float
        Mean residual power.
    noise_floor_db : float
        Receiver's noise and learned background, mean over bins.
    threshold_db : float
        What the power had to exceed.
    range_m : float
        Where the residual power stands out most, in metres.
    """

    is_open: bool
    power_db: float
    noise_floor_db: float
    threshold_db: float
    range_m: float


class Gate:
    """Judge one dwell after another.

    Parameters
    ----------
    settings : GateSettings
        Threshold and learning.
    hop_s : float
        Stream time between dwells, in seconds.
    """

    def __init__(self, settings: GateSettings, hop_s: float = 1.0) -> None:
        self._settings = settings
        n_memory = max(1, round(settings.memory_s / hop_s))
        self._n_learn = max(1, round(settings.learn_s / hop_s))
        self._noise: deque[float] = deque(maxlen=n_memory)
        self._in_place: deque[NDArray[np.float64] | None] = deque(maxlen=n_memory)

    def reset(self) -> None:
        """Forget what was learned, as after a restart of the module."""
        self._noise.clear()
        self._in_place.clear()

    def read(self, dwell: Dwell) -> GateReading:
        """Judge one dwell and learn from it.

        Parameters
        ----------
        dwell : Dwell
            Whole enough to be judged.

        Returns
        -------
        GateReading
            A stream without any power is closed.
        """
        s = self._settings
        n_cpi = min(max(4, round(s.cpi_s * dwell.frame_rate_hz)), len(dwell.frames))
        # Squares are taken in float32: scaled to at most one, no unit of the samples is too
        # small or too large for that.
        scale = float(np.abs(dwell.frames).max()) or 1.0
        frames = dwell.frames / np.float32(scale)
        cpi_power = residual_power(frames, dwell.valid, n_cpi) * scale**2
        self._noise.append(noise_power(frames, dwell.valid) * scale**2)
        noise = min(self._noise)
        floor = self._floor(noise, len(dwell.axis.range_m))
        power = cpi_power.mean(axis=0)
        spread_m = centre_spread_m(cpi_power, noise, dwell.axis.range_m)
        self._in_place.append(power if spread_m < s.in_place_m else None)

        k = 10 ** (s.threshold_db / 10)
        background = np.minimum(power, k * floor)
        threshold = float(background.mean()) + (k - 1) * noise
        mean = float(power.mean())
        return GateReading(
            mean > threshold,
            _db(mean),
            _db(float(floor.mean())),
            _db(threshold),
            float(dwell.axis.range_m[int(np.argmax(power - background))]),
        )

    def _floor(self, noise: float, n_range: int) -> NDArray[np.float64]:
        learned = [power for power in self._in_place if power is not None]
        if len(learned) < self._n_learn:
            return np.full(n_range, noise)
        most = noise * 10 ** (self._settings.adapt_db / 10)
        return np.asarray(np.clip(np.median(learned, axis=0), noise, most))


def _db(power: float) -> float:
    return float(10 * np.log10(max(power, _TINY)))
