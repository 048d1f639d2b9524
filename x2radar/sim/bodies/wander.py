"""Smooth random numbers, and a smooth step: what bodies do besides what they mean to do."""

import numpy as np
from numpy.typing import ArrayLike

from x2radar.sim.points import Array

_N_WAVES = 6  # sinusoids of a `Wander`: with fewer the eye sees its period


class Wander:
    """Smooth random numbers: sums of sinusoids within `limits`, (n_numbers,), by `rms_rate`."""

    def __init__(self, rng: np.random.Generator, limits: ArrayLike, rms_rate: ArrayLike) -> None:
        limit = np.asarray(limits, np.float64)
        shape = (_N_WAVES, len(limit))
        ladder = 1.35 ** np.arange(_N_WAVES)[:, None]
        omega = ladder * rng.uniform(0.85, 1.15, shape)
        weight = rng.uniform(0.6, 1.4, shape) / ladder
        self.amplitude = limit * weight / weight.sum(axis=0)
        rate = np.sqrt(0.5 * ((self.amplitude * omega) ** 2).sum(axis=0))
        omega *= np.divide(rms_rate, rate, out=np.zeros_like(rate), where=rate > 0)
        self.omega_rad_s = omega
        self.phase_rad = rng.uniform(0.0, 2.0 * np.pi, shape)

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
