"""Fluctuation of a segment's echo as a function of its aspect.

Skin, clothes and fur make the echo of a body part change when the part turns before the antenna:
over an extent L the echoes of its places fall out of step within ``lambda / (2 L)`` radians
(Skolnik, Introduction to Radar Systems, on scintillation). Its decibels are taken as a random
function on the sphere of directions, so a part that does not turn does not scintillate.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.skins.base import NEPER_PER_DB, WAVELENGTH_M
from x2radar.sim.points import Array

_N_WAVES = 16
"""Waves of the random function: 16 make its distribution normal to some per cent."""
_TURN_RAD = (0.03, 1.0)
"""Limits of the decorrelation: a trunk of 0.7 m, and a paw that shows one place alone."""


@dataclass(frozen=True, slots=True, eq=False)
class AspectFluctuation:
    """Power factors of several segments, each log-normal with mean 1 over all aspects.

    Attributes
    ----------
    wave : ndarray, shape (_N_WAVES, 3), float64
        Wave vectors on the sphere of directions, for a decorrelation over one radian.
    turn_rad : ndarray, shape (n_segments,), float64
        Change of aspect over which each decorrelates.
    phase_rad : ndarray, shape (_N_WAVES, n_segments), float64
        Drawn.
    amplitude : ndarray, shape (n_segments,), float64
        Of each wave, in nepers of power.
    """

    wave: Array
    turn_rad: Array
    phase_rad: Array
    amplitude: Array

    @classmethod
    def draw(cls, rng: np.random.Generator, half_m: Array, spread_db: Array) -> Self:
        """Draw the fluctuation of segments of given half-lengths, spread by so many decibels."""
        turn = np.clip(WAVELENGTH_M / (4 * half_m.max(axis=1)), *_TURN_RAD)
        phase = rng.uniform(0, 2 * np.pi, (_N_WAVES, len(half_m)))
        amplitude = spread_db * NEPER_PER_DB * np.sqrt(2.0 / _N_WAVES)
        return cls(rng.standard_normal((_N_WAVES, 3)), turn, phase, amplitude)

    def at(self, seen: Array) -> Array:
        """Return the factors for directions as `seen_from` gives them; good to five digits."""
        # Single precision is plenty for a power, and several times as fast.
        x, y, z = np.ascontiguousarray(np.moveaxis(seen, -1, 0), np.float32)
        wave = (self.wave[:, :, None] / self.turn_rad).astype(np.float32)
        phase = self.phase_rad.astype(np.float32)
        total = np.zeros(seen.shape[:2], np.float32)
        for (a, b, c), p in zip(wave, phase, strict=True):
            total += np.cos(a * x + b * y + c * z + p)
        offset = _N_WAVES * np.log(np.i0(self.amplitude))
        return np.asarray(np.exp(self.amplitude * total - offset), dtype=np.float64)
