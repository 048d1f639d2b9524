"""Where a flying animal is: rounds about a point, fluttering, and hops between perches."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_N_WAVES = 6
"""Sinusoids of a `Wander`: enough that it does not look periodic (chosen)."""
_HOP_S = 0.25
"""How long a small bird hops (recalled)."""


@dataclass(frozen=True, slots=True, eq=False)
class Wander:
    """Smooth random numbers within limits: a sum of sinusoids for each."""

    amplitude: Array  # (n_waves, n_numbers): of each sinusoid; a column adds up to the limit
    omega_rad_s: Array  # (n_waves, n_numbers)
    phase_rad: Array  # (n_waves, n_numbers)

    @classmethod
    def draw(cls, rng: np.random.Generator, limits: Array, rms_rate: Array) -> Self:
        """Draw numbers within ``-limits`` to ``limits``, shape (n_numbers,).

        `rms_rate` is the root mean square of each one's time derivative.
        """
        shape = (_N_WAVES, len(limits))
        ladder = 1.35 ** np.arange(_N_WAVES)[:, None]
        omega = ladder * rng.uniform(0.85, 1.15, shape)
        weight = rng.uniform(0.6, 1.4, shape) / ladder
        amplitude = limits * weight / weight.sum(axis=0)
        rate = np.sqrt(0.5 * ((amplitude * omega) ** 2).sum(axis=0))
        omega *= np.divide(rms_rate, rate, out=np.zeros_like(rate), where=rate > 0)
        return cls(amplitude, omega, rng.uniform(0.0, 2.0 * np.pi, shape))

    def at(self, t_s: Array) -> Array:
        """Return the numbers, shape (n_slow, n_numbers), at times of shape (n_slow,)."""
        turn = t_s[:, None, None] * self.omega_rad_s + self.phase_rad
        return np.asarray((self.amplitude * np.cos(turn)).sum(axis=1), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A course through the air."""

    home_m: Array  # (3,): middle of the rounds, or first perch
    orbit_m: float  # radius of the rounds
    orbit_rad_s: float  # turn rate of the rounds; its sign is the way round
    orbit_rad: float  # angle at time 0
    wander: Wander  # offsets in x, y, z, in metres, and of the heading, in radians
    effort: Wander  # one number in -1 to 1; the wings rest where it is low
    rest_below: float  # how low: -2 for wings that never rest, 2 for wings that do so until a hop
    hop_s: Array  # (n_hops,): when hops begin, rising, within one period
    perch_m: Array  # (n_hops, 3): where each hop begins, from `home_m`
    period_s: float  # after which the hops are repeated

    def at(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return place, heading and effort at times of shape (n_slow,).

        Shapes (n_slow, 3), in room coordinates, (n_slow,), counter-clockwise from the x axis, and
        (n_slow,): how hard the wings beat, 0 to 1.
        """
        offset = self.wander.at(t_s)
        turn = self.orbit_rad + self.orbit_rad_s * t_s
        place = self.home_m + offset[:, :3]
        place[:, 0] += self.orbit_m * np.cos(turn)
        place[:, 1] += self.orbit_m * np.sin(turn)
        ahead = np.copysign(0.5 * np.pi, self.orbit_rad_s)
        effort = smooth_step((self.effort.at(t_s)[:, 0] - self.rest_below) / 0.3 + 0.5)
        if self.hop_s.size:
            hop, aloft = self._hop(t_s)
            place += hop
            effort = np.maximum(effort, aloft)
        return place, turn + ahead + offset[:, 3], effort

    def _hop(self, t_s: Array) -> tuple[Array, Array]:
        """Return the offset from home, and how far through the air it is, 0 to 1."""
        within = np.mod(t_s, self.period_s)
        # Before the first hop of a period the last one's end still holds.
        k = np.searchsorted(self.hop_s, within, side="right") - 1
        since = within - self.hop_s[k] + np.where(k < 0, self.period_s, 0.0)
        start, end = self.perch_m[k], self.perch_m[(k + 1) % len(self.hop_s)]
        share = np.clip(since / _HOP_S, 0.0, 1.0)
        offset = start + (end - start) * smooth_step(share)[:, None]
        aloft = np.where(share < 1.0, np.sin(np.pi * share) ** 2, 0.0)
        # A hop of 0.25 s under gravity rises g T^2 / 8 = 77 mm.
        offset[:, 2] += 0.077 * aloft
        return offset, aloft


def smooth_step(x: Array) -> Array:
    """Rise from 0 at 0 to 1 at 1, smooth with its first derivative."""
    y = np.clip(x, 0.0, 1.0)
    return np.asarray(y * y * (3.0 - 2.0 * y), dtype=np.float64)
