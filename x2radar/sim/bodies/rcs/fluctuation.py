"""Slow random change of a body part's echo, a function of time alone.

Skin, clothes, fur and small movements that no model holds change the echo of a body part
from moment to moment. Its decibels are taken as a stationary normal process: a sum of
oscillators whose frequencies and phases are drawn once, so any time can be asked at any
moment, in any order.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Guesses: skin and cloth change within a step's time; docs/scenes.md has the coherence measured.
SPREAD_DB = (2.0, 4.0)
CORRELATION_S = (0.1, 0.5)
_N_OSCILLATORS = 32
"""Enough for a Gaussian correlation at both ends of `CORRELATION_S` (tests)."""
_NEPER_PER_DB = np.log(10.0) / 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Fluctuation:
    """Power factors of several parts, each log-normal with mean 1.

    The correlation of the decibels falls as ``exp(-(lag / correlation_s)**2)``.
    """

    spread_db: Array  # (n_parts,): standard deviation
    correlation_s: Array  # (n_parts,): lag at which the correlation has fallen to 1/e
    omega_rad_s: Array  # (n_oscillators,): frequencies, shared by all parts
    weight: Array  # (2 * n_oscillators, n_parts): of cosines, then sines, in nepers of power
    offset: Array  # (n_parts,): nepers that make the mean over time 1

    @classmethod
    def draw(cls, rng: np.random.Generator, n_parts: int) -> Self:
        """Draw it; spreads are even in `SPREAD_DB`, correlation times in `CORRELATION_S`."""
        spread_db = rng.uniform(*SPREAD_DB, n_parts)
        correlation_s = rng.uniform(*CORRELATION_S, n_parts)
        # A Gaussian correlation has a Gaussian spectrum of this width. The grid covers the
        # widest to 3 widths and resolves the narrowest; logarithmic, so few are enough.
        width = np.sqrt(2.0) / correlation_s
        edge = np.geomspace(
            0.1 * np.sqrt(2.0) / CORRELATION_S[1],
            3.2 * np.sqrt(2.0) / CORRELATION_S[0],
            _N_OSCILLATORS + 1,
        )
        # One draw within each cell: no common period, so the sum never repeats.
        omega = edge[:-1] + rng.uniform(0.2, 0.8, _N_OSCILLATORS) * np.diff(edge)
        power = np.diff(edge)[:, None] * np.exp(-0.5 * (omega[:, None] / width) ** 2)
        power /= power.sum(axis=0)
        amplitude = spread_db * _NEPER_PER_DB * np.sqrt(2.0 * power)
        phase = rng.uniform(0.0, 2.0 * np.pi, (_N_OSCILLATORS, n_parts))
        # The mean of exp(A cos x) over x is I0(A); of a product of independent phases, the
        # product.
        offset = -np.log(np.i0(amplitude)).sum(axis=0)
        weight = np.concatenate([amplitude * np.cos(phase), -amplitude * np.sin(phase)])
        return cls(spread_db, correlation_s, omega, weight, offset)

    def at(self, t_s: Array) -> Array:
        """Return positive power factors, shape (n_slow, n_parts), good to six digits."""
        # Single precision is five times as fast and plenty for a power; but only after the
        # whole turns are gone, or an hour of them would leave no digits for the phase.
        turn = t_s[:, None] * (self.omega_rad_s / (2.0 * np.pi))
        turn -= np.rint(turn)
        phase = (turn * (2.0 * np.pi)).astype(np.float32)
        waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
        nepers = waves @ self.weight.astype(np.float32) + self.offset.astype(np.float32)
        return np.asarray(np.exp(nepers), dtype=np.float64)
