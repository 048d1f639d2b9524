"""Gate: does anything move? Residual power against a floor learned from the stream itself.

The floor of a range bin lies between two bounds. Below: the receiver's noise, which is
visible in every dwell, also in one with somebody in it. Above: what that bin shows even at
its quietest within the last half minute, at most `adapt_db` over the noise. So a breathing
person or a busy corner is learned as background of its own few bins, while somebody who
moves through the room never is, because every bin is quiet again behind him; and nothing
at all is learned before `learn_after_s`.

Powers are dB of 10 log10(mean residual power per bin and frame), in sample units squared.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.dsp.clutter import noise_power, residual_power
from radard.ring import Dwell

_TINY = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True)
class GateSettings:
    """How the gate decides.

    Attributes
    ----------
    threshold_db : float
        The gate opens this far above the floor, in dB.
    adapt_db : float
        The learned background may lie this far above the receiver's noise, in dB.
    memory_s : float
        How long a quiet moment of a bin is remembered, in seconds.
    learn_after_s : float
        Until then the floor is the receiver's noise alone, in seconds.
    cpi_s : float
        Motion slower than one cycle in this time counts as clutter, in seconds.
    """

    threshold_db: float = 8.0
    adapt_db: float = 25.0
    memory_s: float = 30.0
    learn_after_s: float = 15.0
    cpi_s: float = 28 / 60


@dataclass(frozen=True, slots=True)
class GateReading:
    """What the gate saw.

    Attributes
    ----------
    is_open : bool
        Something moves.
    power_db, noise_floor_db, threshold_db : float
        Mean residual power, learned floor, and floor + threshold.
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
        self._learn_after = max(1, round(settings.learn_after_s / hop_s))
        self._noise: deque[float] = deque(maxlen=n_memory)
        self._power: deque[NDArray[np.float64]] = deque(maxlen=n_memory)

    def reset(self) -> None:
        """Forget what was learned, as after a restart of the module."""
        self._noise.clear()
        self._power.clear()

    def read(self, dwell: Dwell) -> GateReading:
        """Judge one dwell and learn from it.

        Parameters
        ----------
        dwell : Dwell
            Whole enough to be judged.

        Returns
        -------
        GateReading
            Open when the mean power exceeds the threshold. A stream without any power is
            closed.
        """
        s = self._settings
        n_cpi = min(max(4, round(s.cpi_s * dwell.frame_rate_hz)), len(dwell.frames))
        # Squares are taken in float32: scaled to at most one, no unit of the samples is too
        # small or too large for that.
        scale = float(np.abs(dwell.frames).max()) or 1.0
        frames = dwell.frames / np.float32(scale)
        power = residual_power(frames, dwell.valid, n_cpi) * scale**2
        self._noise.append(noise_power(frames, dwell.valid) * scale**2)
        noise = min(self._noise)
        floor = np.full(power.shape, noise)
        if len(self._power) >= self._learn_after:
            quietest = np.min(self._power, axis=0)
            floor = np.clip(quietest, noise, noise * 10 ** (s.adapt_db / 10))
        self._power.append(power)
        power_db, floor_db = _db(float(power.mean())), _db(float(floor.mean()))
        threshold_db = floor_db + s.threshold_db
        at = int(np.argmax(power - floor))
        return GateReading(
            power_db > threshold_db,
            power_db,
            floor_db,
            threshold_db,
            float(dwell.axis.range_m[at]),
        )


def _db(power: float) -> float:
    return float(10 * np.log10(max(power, _TINY)))
