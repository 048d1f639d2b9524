"""Ellipsoids by physical optics, each by itself: the usual model of micro-Doppler studies.

The formula is that of `surface`; here nothing joins the trunk to one surface, nothing casts a
shadow, and floors and fluctuation may be absent.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.skin.aspect import AspectFluctuation
from x2radar.sim.bodies.skin.base import (
    ANYBODY,
    SKIN_REFLECTION,
    Loudness,
    draw_gain,
    mean_over_azimuths,
    seen_from,
)
from x2radar.sim.points import Points

Array = NDArray[np.float64]

_MOST_FLOOR, _MOST_SPREAD_DB = 0.10, 3.0
"""Largest floor, as a share of the broadside echo, and largest fluctuation (chosen)."""
_DEEPEST = 0.7
"""An antenna inside a part still has it in front, by this share of the distance."""


@dataclass(frozen=True, slots=True, eq=False)
class EllipsoidSkin:
    """Ellipsoids that echo where their surface faces the antenna; see `Skin`.

    Attributes
    ----------
    half_m : ndarray, shape (n_segments, 3), float64
        Half-lengths.
    floor_m2 : ndarray, shape (n_segments,), float64
        Least cross section of each, before `scale`.
    gain : ndarray, shape (n_segments,), float64
        What each echoes against theory.
    fluctuation : AspectFluctuation
        What clothes and bent limbs do to it.
    scale : float
        Factor on all cross sections.
    """

    half_m: Array
    floor_m2: Array
    gain: Array
    fluctuation: AspectFluctuation
    scale: float = 1.0

    @classmethod
    def draw(cls, rng: np.random.Generator, half_m: Array, loudness: Loudness = ANYBODY) -> Self:
        """Draw a body's floor, gains and fluctuation."""
        broadside = SKIN_REFLECTION * np.pi * (half_m.prod(axis=1) / half_m.min(axis=1) ** 2) ** 2
        floor = rng.uniform(0.0, _MOST_FLOOR) * broadside
        spread_db = np.full(len(half_m), rng.uniform(0.0, _MOST_SPREAD_DB))
        gain = draw_gain(rng, broadside, loudness)
        return cls(half_m, floor, gain, AspectFluctuation.draw(rng, half_m, spread_db))

    def names(self, parts: tuple[str, ...], /) -> tuple[str, ...]:
        """Return the segments' names."""
        return parts

    def points(self, centre_m: Array, axis: Array, side: Array, antenna_m: Array, /) -> Points:
        """Return the echoes; see `Skin`."""
        seen, distance = seen_from(centre_m, axis, side, antenna_m)
        a2, b2, c2 = (self.half_m**2).T
        deep2 = a2 * seen[..., 0] ** 2 + b2 * seen[..., 1] ** 2 + c2 * seen[..., 2] ** 2
        # Unit vectors that are not quite square to each other must not make a hole.
        deep2 = np.maximum(deep2, 0.5 * np.minimum(np.minimum(a2, b2), c2))
        rcs = np.maximum(SKIN_REFLECTION * np.pi * a2 * b2 * c2 / deep2**2, self.floor_m2)
        rcs = self.scale * self.gain * rcs * self.fluctuation.at(seen)
        return Points(centre_m, rcs, np.minimum(np.sqrt(deep2), _DEEPEST * distance))

    def mean_total_m2(self, centre_m: Array, axis: Array, side: Array, /) -> float:
        """Return the mean over azimuths; see `Skin`."""
        return mean_over_azimuths(self, centre_m, axis, side)
