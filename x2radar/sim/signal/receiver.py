"""What the receiver adds: noise, the swept-threshold converter, and its imperfections.

Raw samples run from 0 to 100 over the threshold sweep; the idle line sits in the middle. Every
draw belongs to a frame's number: block `b` of 256 frames has a generator seeded with the stream's
seed, the kind of effect and `b`. An effect that is off draws nothing.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis
from x2radar.keys import Checked, limited
from x2radar.modules.x2 import DAC_TOP, RadarSettings
from x2radar.sim.points import Array
from x2radar.sim.signal import pulse
from x2radar.sim.signal.pulse import UNIT_PER_COUNT, LinkBudget

MIDDLE = 50.0  # of the threshold sweep, in the module's unit (Radarlib)
_SLOPE_TAPS = 12  # of the differentiator, either side: 0.2 % error, see `delayed_rf`
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
        raw = DAC_TOP + 1 + (counts[row, which] * size).astype(np.int64)
        return row, (column[row, which] * n_range).astype(np.int64), raw

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
        self._sigma = pulse.noise_sigma(settings, budget, effects.noise_figure_db)
        self._at = 0
        pulses = settings.pulses_per_step * settings.iterations
        self._quantum = np.float32(UNIT_PER_COUNT * settings.dac_step / pulses)
        half = effects.clip * MIDDLE
        self._low = np.float32(max(UNIT_PER_COUNT * settings.dac_min, MIDDLE - half))
        self._high = np.float32(min(UNIT_PER_COUNT * settings.dac_max, MIDDLE + half))

    def rf(self, echo: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return raw frames, shape (n_slow, n_range), float32, from noise-free echoes."""
        noise = self._rng.standard_normal(echo.shape, np.float32)
        out, (row, column, counts) = self._received(echo, noise, delayed_rf)
        out += np.float32(MIDDLE)
        out /= self._quantum
        np.rint(out, out=out)
        out *= self._quantum
        np.clip(out, self._low, self._high, out=out)
        out[row, column] = (counts * UNIT_PER_COUNT).astype(np.float32)
        return out

    def baseband(self, echo: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return complex64 baseband frames, (n_slow, n_range), from noise-free echoes.

        Left out: quantisation, 57 dB under the noise with the settings for 60 Hz and 45 dB with
        those for 1000 Hz, and clipping. A spike becomes a pulse.
        """
        noise = pulse.matched_noise(len(echo), self._axis, self._rng)
        out, (row, column, counts) = self._received(echo, noise, delayed_baseband)
        for r, c, count in zip(row, column, counts, strict=True):
            out[r] += self._spike(int(c)) * np.float32(count * UNIT_PER_COUNT - MIDDLE)
        return out

    def _received(
        self, echo: NDArray[Any], noise: NDArray[Any], delayed: Callable[..., NDArray[Any]]
    ) -> tuple[NDArray[Any], tuple[NDArray[np.int64], ...]]:
        """Return the echo with its delay and gain over noise of unit level, and the spikes."""
        first, n = self._at, len(echo)
        self._at += n
        if self._effects.jitter_s:
            echo = delayed(echo, self.draws.delay_s(first, n), self._axis)
        if self._effects.gain_noise:
            echo = echo * self.draws.gain(first, n).astype(np.float32)[:, None]
        noise *= np.asarray((self._sigma * self.draws.noise_gain(first, n))[:, None], np.float32)
        noise += echo
        return noise, self.draws.spikes(first, n, self._axis.n_range)

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
    # Of a slope per sample, from k = 1 on: (-1)^(k+1) / k, Kaiser taper.
    number = np.arange(1, _SLOPE_TAPS + 1)
    taper = np.kaiser(2 * _SLOPE_TAPS + 1, 5.0)[_SLOPE_TAPS + 1 :]
    taps = np.asarray((-1.0) ** (number + 1) / number * taper, np.float32)
    for k, tap in enumerate(taps, start=1):
        ahead, behind = _SLOPE_TAPS + k, _SLOPE_TAPS - k
        difference = wide[:, ahead : ahead + n] - wide[:, behind : behind + n]
        difference *= tap
        slope += difference
    slope *= along.astype(np.float32)[:, None]
    return np.asarray(frames * np.cos(turn).astype(np.float32)[:, None] - slope)
