"""What the receiver adds: noise, the swept-threshold converter, and its imperfections.

Raw samples run from 0 to 100 over the threshold sweep; the idle line sits in the middle.
What goes wrong in which frame is drawn in `x2radar.sim.signal.effects`; here it is applied.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS, RadarSettings
from x2radar.sim.points import Array
from x2radar.sim.signal import pulse
from x2radar.sim.signal.effects import FrameDraws, ReceiverEffects
from x2radar.sim.signal.pulse import UNIT_PER_COUNT, LinkBudget

MIDDLE = 50.0  # of the threshold sweep, in the module's unit (Radarlib)
_SLOPE_TAPS = 12  # of the differentiator, either side: 0.2 % error, see `delayed_rf`


class Receiver:
    """Turn echoes into what the module would send, by `settings`, `rng` and `effects`."""

    def __init__(
        self,
        settings: RadarSettings,
        axis: FastTimeAxis,
        budget: LinkBudget,
        rng: np.random.Generator,
        *,
        effects: ReceiverEffects | None = None,
        seed: int = 0,
    ) -> None:
        self._axis = axis
        self._rng = rng
        self._effects = effects = effects or ReceiverEffects()
        self.draws = FrameDraws(effects, seed, settings.frame_rate_hz)
        self._sigma = pulse.noise_sigma(settings, budget, effects)
        self._at = 0
        pulses = settings.pulses_per_step * settings.iterations
        self._quantum = np.float32(UNIT_PER_COUNT * settings.dac_step / pulses)
        half = effects.clip * MIDDLE
        self._low = np.float32(max(UNIT_PER_COUNT * settings.dac_min, MIDDLE - half))
        self._high = np.float32(min(UNIT_PER_COUNT * settings.dac_max, MIDDLE + half))

    def rf(self, echo: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return raw frames, shape (n_slow, n_range), float32, from noise-free echoes."""
        first, n = self._at, len(echo)
        self._at += n
        if self._effects.jitter_s:
            echo = delayed_rf(echo, self.draws.delay_s(first, n), self._axis)
        out = self._rng.standard_normal(echo.shape, np.float32)
        out *= self._noise_scale(first, n)
        out += echo * self._gain(first, n) if self._effects.gain_noise else echo
        out += np.float32(MIDDLE)
        out /= self._quantum
        np.rint(out, out=out)
        out *= self._quantum
        np.clip(out, self._low, self._high, out=out)
        row, column, counts = self.draws.spikes(first, n, self._axis.n_range)
        out[row, column] = (counts * UNIT_PER_COUNT).astype(np.float32)
        return out

    def baseband(self, echo: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return complex64 baseband frames, (n_slow, n_range), from noise-free echoes.

        Left out: quantisation, 57 dB under the noise with the settings for 60 Hz and 45 dB with
        those for 1000 Hz, and clipping. A spike becomes a pulse.
        """
        first, n = self._at, len(echo)
        self._at += n
        if self._effects.jitter_s:
            echo = delayed_baseband(echo, self.draws.delay_s(first, n), self._axis)
        out = pulse.matched_noise(n, self._axis, self._rng)
        out *= self._noise_scale(first, n)
        out += echo * self._gain(first, n) if self._effects.gain_noise else echo
        row, column, counts = self.draws.spikes(first, n, self._axis.n_range)
        for r, c, count in zip(row, column, counts, strict=True):
            out[r] += self._spike(int(c)) * np.float32(count * UNIT_PER_COUNT - MIDDLE)
        return out

    def _gain(self, first: int, n: int) -> NDArray[np.float32]:
        return self.draws.gain(first, n).astype(np.float32)[:, None]

    def _noise_scale(self, first: int, n: int) -> NDArray[np.float32]:
        scale = self._sigma * self.draws.noise_gain(first, n)
        return np.asarray(scale[:, None], np.float32)

    def _spike(self, column: int) -> NDArray[np.complex64]:
        """Return what one raw sample of 1 becomes: the kernel 2 p / sum p^2 around it."""
        sigma = pulse.pulse_sigma_s(self._axis.bandwidth_hz) * pulse.bins_per_s(self._axis)
        away = np.arange(self._axis.n_range) - column
        at_s = 2 * self._axis.range_m[column] / SPEED_OF_LIGHT_MPS
        turns = self._axis.phase_sign * ((self._axis.carrier_hz * at_s) % 1.0)
        shape = np.exp(-0.5 * (away / sigma) ** 2) * (2 / (sigma * math.sqrt(math.pi)))
        return np.asarray(shape * np.exp(2j * np.pi * turns), np.complex64)


def delayed_baseband(
    frames: NDArray[np.complex64], delay_s: Array, axis: FastTimeAxis
) -> NDArray[np.complex64]:
    """Return baseband frames that come later by a little, each by its own delay.

    The carrier's phase is exact; the envelope is moved by its slope over range, with an
    error of ``(2 pi f delay)^2 / 2`` for f within half the bandwidth: below 1e-4 for 2 ps.
    """
    turn = np.exp(axis.phase_sign * 2j * np.pi * ((axis.carrier_hz * delay_s) % 1.0))
    bins = (delay_s * pulse.bins_per_s(axis)).astype(np.float32)
    slope = np.empty_like(frames)
    slope[:, 1:-1] = (frames[:, 2:] - frames[:, :-2]) * np.float32(0.5)
    slope[:, 0], slope[:, -1] = frames[:, 1] - frames[:, 0], frames[:, -1] - frames[:, -2]
    slope *= bins[:, None]
    np.subtract(frames, slope, out=slope)
    slope *= turn.astype(np.complex64)[:, None]
    return slope


def delayed_rf(
    frames: NDArray[np.float32], delay_s: Array, axis: FastTimeAxis
) -> NDArray[np.float32]:
    """Return RF frames that come later by a little, each by its own delay.

    ``x cos(w d) - x' sin(w d) / w`` with w at the carrier: exact there, and with an error of
    ``|f^2 - fc^2| (2 pi d)^2 / 2`` elsewhere in the band: below 1e-3 for 2 ps. The slope x'
    comes from a windowed differentiator, good to 0.2 % from 0.05 to 0.45 of the sampling
    rate. Frames count as zero beyond their ends, so the last 12 samples there are inexact
    where an echo is cut off.
    """
    turn = 2 * np.pi * axis.carrier_hz * delay_s
    # Slope per sample, so the factor is in samples.
    along = np.sin(turn) / (2 * np.pi * axis.carrier_hz) * pulse.bins_per_s(axis)
    n = frames.shape[1]
    wide = np.pad(frames, ((0, 0), (_SLOPE_TAPS, _SLOPE_TAPS)))
    slope = np.zeros_like(frames)
    for k, tap in enumerate(_differentiator(), start=1):
        ahead, behind = _SLOPE_TAPS + k, _SLOPE_TAPS - k
        difference = wide[:, ahead : ahead + n] - wide[:, behind : behind + n]
        difference *= tap
        slope += difference
    slope *= along.astype(np.float32)[:, None]
    return np.asarray(frames * np.cos(turn).astype(np.float32)[:, None] - slope)


@lru_cache(maxsize=1)
def _differentiator() -> NDArray[np.float32]:
    """Return the taps of a slope per sample, from k = 1 on: (-1)^(k+1) / k, Kaiser taper."""
    k = np.arange(1, _SLOPE_TAPS + 1)
    taper = np.kaiser(2 * _SLOPE_TAPS + 1, 5.0)[_SLOPE_TAPS + 1 :]
    return np.asarray((-1.0) ** (k + 1) / k * taper, np.float32)
