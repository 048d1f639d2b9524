"""What is wrong with a real receiver, frame by frame: settings and their draws.

Every draw belongs to a frame's number: block `b` of 256 frames has a generator seeded with the
stream's seed, the kind of effect and `b`. An effect that is off draws nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.keys import Checked, limited
from x2radar.modules.x2 import DAC_TOP
from x2radar.sim.points import Array

_BLOCK = 256  # frames a generator; what is drawn for a frame depends on it, so it must stay
_MAX_BURST, _MAX_SPIKES = 60, 3  # frames of the longest burst, a second; spikes of a frame
_SPIKE_TOP = 1 << 16  # raw samples are 16-bit words
_KINDS = ("delay", "gain", "clock", "burst", "spike", "lost")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverEffects(Checked):
    """Imperfections of one receiver, all off by default; SettingsError if impossible."""

    # The noise level of the link budget belongs to its own 13 dB.
    noise_figure_db: float = limited(13.0, 0, 40, "noise figure, dB")
    # 0.13e-12 to 0.23e-12 measured on real UWB modules, and a gain of up to 0.0012.
    jitter_s: float = limited(0.0, 0, 2e-12, "common delay of a frame, rms, s")
    gain_noise: float = limited(0.0, 0, 0.05, "common gain of a frame, rms")
    frame_jitter: float = limited(0.0, 0, 0.05, "of the frame period, rms")
    # Interference, such as Wi-Fi at 6 GHz; a burst lasts 1 to 60 frames.
    burst_rate_hz: float = limited(0.0, 0, 100, "interference bursts per second")
    burst_s: float = limited(0.05, 0.001, 10, "mean length of a burst, s")
    # Drawn evenly in dB.
    burst_least_db: float = limited(3.0, 0, 40, "least rise of the noise, dB")
    burst_most_db: float = limited(20.0, 0, 40, "greatest rise of the noise, dB")
    # On both sides of the converter's middle.
    clip: float = limited(1.0, 0.001, 1, "share of full scale")
    # 1 to 3 samples of such a frame lie above the converter's 8191 counts.
    spike_share: float = limited(0.0, 0, 1, "share of frames with spikes")
    lost_share: float = limited(0.0, 0, 1, "share of frames lost")


class FrameDraws:
    """The draws of all effects for the frames of one stream, by its seed (not negative)."""

    def __init__(self, effects: ReceiverEffects, seed: int, frame_rate_hz: float) -> None:
        self._effects = effects
        self._seed = seed
        self._rate_hz = frame_rate_hz

    def times_s(self, first: int, n: int) -> Array:
        """Return when `n` frames from `first` on are taken, in order, in seconds."""
        number = np.arange(first, first + n, dtype=np.float64)
        if self._effects.frame_jitter:
            late = self._normal("clock", first, n) * self._effects.frame_jitter
            number += np.clip(late, -0.05, 0.05)
        return number / self._rate_hz

    def delay_s(self, first: int, n: int) -> Array:
        """Return the common delay of each frame, shape (n,), in seconds."""
        return self._effects.jitter_s * self._normal("delay", first, n)

    def gain(self, first: int, n: int) -> Array:
        """Return the common gain of each frame, shape (n,), about 1."""
        return 1 + self._effects.gain_noise * self._normal("gain", first, n)

    def noise_gain(self, first: int, n: int) -> Array:
        """Return how much interference raises the noise's amplitude, shape (n,), from 1."""
        e = self._effects
        out = np.ones(n)
        if e.burst_rate_hz == 0:
            return out
        # A burst may have begun up to its greatest length before the first frame asked for.
        start = max(0, first - _MAX_BURST + 1)
        begins, length, raised = self._draw("burst", start, first + n - start, _draw_bursts)
        chance = 1 - np.exp(-e.burst_rate_hz / self._rate_hz)
        frames = np.ceil(length * e.burst_s * self._rate_hz).clip(1, _MAX_BURST)
        span_db = e.burst_most_db - e.burst_least_db
        gain = 10 ** ((e.burst_least_db + raised * span_db) / 20)
        for k in np.flatnonzero(begins < chance):
            low, high = k + start - first, k + start - first + int(frames[k])
            part = out[max(low, 0) : max(high, 0)]
            np.maximum(part, gain[k], out=part)
        return out

    def lost(self, first: int, n: int) -> NDArray[np.bool_]:
        """Return which frames never arrive, shape (n,)."""
        if self._effects.lost_share == 0:
            return np.zeros(n, np.bool_)
        (chance,) = self._draw("lost", first, n, lambda rng: rng.random((1, _BLOCK)))
        return np.asarray(chance < self._effects.lost_share)

    def spikes(self, first: int, n: int, n_range: int) -> tuple[NDArray[np.int64], ...]:
        """Return the samples above the converter's top: frame from `first`, bin, raw value."""
        if self._effects.spike_share == 0:
            none = np.zeros(0, np.int64)
            return none, none, none
        shape = (2 + 2 * _MAX_SPIKES, _BLOCK)
        chance, number, *rest = self._draw("spike", first, n, lambda rng: rng.random(shape))
        column, counts = np.split(np.stack(rest, axis=1), 2, axis=1)
        is_spiked = (chance < self._effects.spike_share)[:, None]
        rank = np.arange(_MAX_SPIKES)
        row, which = np.nonzero(is_spiked & (rank <= number[:, None] * _MAX_SPIKES))
        size = _SPIKE_TOP - DAC_TOP - 1
        return (
            row,
            (column[row, which] * n_range).astype(np.int64),
            DAC_TOP + 1 + (counts[row, which] * size).astype(np.int64),
        )

    def _normal(self, kind: str, first: int, n: int) -> Array:
        draws = self._draw(kind, first, n, lambda rng: rng.standard_normal((1, _BLOCK)))
        return np.asarray(draws[0])

    def _draw(
        self, kind: str, first: int, n: int, draw: Callable[[np.random.Generator], Array]
    ) -> Array:
        """Return the numbers of frames, shape (n_numbers, n), from their blocks' generators."""
        blocks = range(first // _BLOCK, max(first + n - 1, first) // _BLOCK + 1)
        parts = [draw(np.random.default_rng([self._seed, _KINDS.index(kind), b])) for b in blocks]
        at = first - blocks[0] * _BLOCK
        return np.concatenate(parts, axis=1)[:, at : at + n]


def _draw_bursts(rng: np.random.Generator) -> Array:
    return np.stack([rng.random(_BLOCK), rng.exponential(size=_BLOCK), rng.random(_BLOCK)])
