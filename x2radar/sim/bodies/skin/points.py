"""Constant scatterers along the segments: the model of the first micro-Doppler studies.

Chen (The Micro-Doppler Effect in Radar) and the thesis put one scatterer of constant cross section
on each body part; here there may be several, off the axis, with drawn weights.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.skin.base import ANYBODY, SKIN_REFLECTION, Loudness, mean_over_azimuths
from x2radar.sim.points import Points

Array = NDArray[np.float64]

_COUNTS = ((0.3, (1, 1)), (0.65, (3, 8)), (1.0, (1, 4)))
"""Scatterers a segment, fewest and most, of bodies up to a cumulated share (chosen)."""
_SPREAD_DB = 6.0
"""Largest spread of the weights within a body (chosen: twice that of the other skins)."""
_AREA_POWER = (0.0, 1.6)
"""Weights go with a segment's area to a power between (chosen): from limbs as strong as the trunk,
as the first studies have them, to a trunk that outshines all else."""


@dataclass(frozen=True, slots=True, eq=False)
class PointSkin:
    """Constant scatterers; see `Skin`.

    Attributes
    ----------
    segment : ndarray, shape (n_points,), int
        On which segment each is.
    place_m : ndarray, shape (n_points, 3), float64
        Along its axis, to the side and across both, from its middle.
    rcs_m2 : ndarray, shape (n_points,), float64
        Cross sections, before `scale`; they sum to about what the segments' areas reflect.
    scale : float
        Factor on all of them.
    """

    segment: NDArray[np.int64]
    place_m: Array
    rcs_m2: Array
    scale: float = 1.0

    @classmethod
    def draw(cls, rng: np.random.Generator, half_m: Array, loudness: Loudness = ANYBODY) -> Self:
        """Draw places, and weights that follow the segments' areas to a drawn power."""
        share = rng.random()
        fewest, most = next(span for top, span in _COUNTS if share < top)
        count = rng.integers(fewest, most + 1, len(half_m))
        segment = np.repeat(np.arange(len(half_m)), count)
        half = half_m[segment]
        along = rng.uniform(-0.9, 0.9, len(segment)) * half[:, 0]
        around, depth = rng.uniform(0, 2 * np.pi, len(segment)), rng.uniform(0.0, 0.8)
        aside, across = depth * half[:, 1] * np.cos(around), depth * half[:, 2] * np.sin(around)
        area = half[:, 0] * np.sqrt(half[:, 1] * half[:, 2]) / count[segment]
        spread_db = rng.uniform(0, _SPREAD_DB) * rng.standard_normal(len(segment)).clip(-2, 2)
        weight = area ** rng.uniform(*_AREA_POWER) * 10 ** (spread_db / 10)
        weight *= loudness.draw(rng, len(half_m))[segment]
        total = SKIN_REFLECTION * np.pi * (half_m[:, 0] * half_m[:, 1:].mean(axis=1)).sum()
        place = np.stack([along, aside, across], axis=1)
        return cls(segment, place, total * weight / weight.sum())

    def names(self, parts: tuple[str, ...], /) -> tuple[str, ...]:
        """Return the segments' names, repeated."""
        return tuple(parts[k] for k in self.segment)

    def points(self, centre_m: Array, axis: Array, side: Array, antenna_m: Array, /) -> Points:  # noqa: ARG002 - they look the same from everywhere
        """Return the echoes; see `Skin`."""
        long = axis[:, self.segment]
        left = np.broadcast_to(side, axis.shape)[:, self.segment]
        a, b, c = self.place_m.T[..., None]
        place = centre_m[:, self.segment] + a * long + b * left + c * np.cross(long, left)
        return Points(place, np.tile(self.scale * self.rcs_m2, (len(centre_m), 1)))

    def mean_total_m2(self, centre_m: Array, axis: Array, side: Array, /) -> float:
        """Return the sum of the cross sections; see `Skin`."""
        return mean_over_azimuths(self, centre_m[:1], axis[:1], side[:1])
