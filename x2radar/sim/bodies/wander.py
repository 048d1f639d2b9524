"""Smooth random numbers, and a smooth step: what bodies do besides what they mean to do."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from x2radar.sim.points import Array

_N_WAVES = 6  # sinusoids of a `Wander`: with fewer the eye sees its period


@dataclass(frozen=True, slots=True, eq=False)
class Wander:
    """Smooth random numbers within limits: a sum of sinusoids for each."""

    amplitude: Array  # (n_waves, n_numbers): of each sinusoid; a column adds up to the limit
    omega_rad_s: Array  # (n_waves, n_numbers)
    phase_rad: Array  # (n_waves, n_numbers)

    @classmethod
    def draw(cls, rng: np.random.Generator, limits: ArrayLike, rms_rate: ArrayLike) -> Self:
        """Draw numbers within `limits`, (n_numbers,), with root mean square `rms_rate`."""
        limit = np.asarray(limits, np.float64)
        shape = (_N_WAVES, len(limit))
        ladder = 1.35 ** np.arange(_N_WAVES)[:, None]
        omega = ladder * rng.uniform(0.85, 1.15, shape)
        weight = rng.uniform(0.6, 1.4, shape) / ladder
        amplitude = limit * weight / weight.sum(axis=0)
        rate = np.sqrt(0.5 * ((amplitude * omega) ** 2).sum(axis=0))
        omega *= np.divide(rms_rate, rate, out=np.zeros_like(rate), where=rate > 0)
        return cls(amplitude, omega, rng.uniform(0.0, 2.0 * np.pi, shape))

    def at(self, t_s: Array) -> Array:
        """Return the numbers, shape (n_slow, n_numbers), at times of shape (n_slow,)."""
        turn = t_s[:, None, None] * self.omega_rad_s + self.phase_rad
        return np.asarray((self.amplitude * np.cos(turn)).sum(axis=1), dtype=np.float64)


def smooth_step(x: Array) -> Array:
    """Rise from 0 at 0 to 1 at 1, smooth with its first derivative."""
    y = np.clip(x, 0.0, 1.0)
    return np.asarray(y * y * (3.0 - 2.0 * y), dtype=np.float64)


def bouts(wander: Wander, t_s: Array, above: float = 0.0) -> Array:
    """Return how far something is under way, 0 to 1: fully where the wander is well `above`."""
    return smooth_step((wander.at(t_s)[:, 0] - above) / 0.4 + 0.5)
