"""The first skin: ellipsoids, with a trunk that is one surface with one bright spot.

Each part of a body is an ellipsoid. High-frequency backscatter of a perfectly conducting
ellipsoid with half-lengths a, b, c, seen along a unit vector with components l, m, n in its
own frame (Ruck, Radar Cross Section Handbook, 1970; recalled)::

    sigma = pi (a b c)^2 / (a^2 l^2 + b^2 m^2 + c^2 n^2)^2

times the power reflection of skin and muscle, about 0.54 at 7 GHz (recalled). Real parts are
rough and bent, so an end-on view keeps some per cent of the broadside echo. The formula wants
a radius above a wavelength over 2 pi (7 mm at 6.8 GHz): a thin tail is at its limit.

A trunk is drawn as several ellipsoids, but it is one surface with one bright spot, see `trunk`.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.skin.aspect import AspectFluctuation
from x2radar.sim.bodies.skin.base import SKIN_REFLECTION
from x2radar.sim.bodies.skin.trunk import one_surface
from x2radar.sim.points import Points

Array = NDArray[np.float64]

SPREAD_DB = (2.0, 4.0)
"""Of a part's echo over all aspects (a guess: skin and cloth)."""
FLOOR = (0.05, 0.10)
"""Least over broadside cross section: real parts are rough and bent (a guess)."""
SHADOW_DB = (6.0, 15.0)
"""What a trunk takes from a part behind it (a guess; creeping waves fill the rest)."""
_NEPER_PER_DB = np.log(10.0) / 10.0
_N_AZIMUTHS = 72
"""5 degrees apart (chosen)."""
_DEEPEST = 0.7
"""Of the way to an antenna inside a part (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSkin:
    """Cross sections of the parts of one body; see `Skin`."""

    half_m: Array  # (n_segments, 3): half-lengths along the part, to the side, across both
    floor_m2: Array  # (n_segments,): least cross section, before `scale`
    shadow_db: Array  # (n_segments,): how much the trunk takes from a part right behind it
    trunk: int  # which part casts the shadow; it has none itself
    fluctuation: AspectFluctuation  # change with the aspect
    scale: float = 1.0  # factor on all cross sections
    n_trunk: int = 1  # so many parts, from `trunk` on, are one surface

    @classmethod
    def draw(
        cls, rng: np.random.Generator, half_m: Array, *, trunk: int = 0, n_trunk: int = 1
    ) -> Self:
        """Draw what is random about the echo of a body; its scale is the physical one.

        `half_m` is as the field; `trunk` is the part that casts the shadow, and so many parts from
        it on are one surface. Floors and shadows are even in `FLOOR` and `SHADOW_DB`.
        """
        half = np.asarray(half_m, dtype=np.float64)
        # Broadside is along the shortest half-length.
        broadside = SKIN_REFLECTION * np.pi * (half.prod(axis=1) / half.min(axis=1) ** 2) ** 2
        floor = rng.uniform(*FLOOR, len(half)) * broadside
        shadow_db = rng.uniform(*SHADOW_DB, len(half))
        shadow_db[trunk] = 0.0
        fluctuation = AspectFluctuation.draw(rng, half, rng.uniform(*SPREAD_DB, len(half)))
        return cls(half, floor, shadow_db, trunk, fluctuation, 1.0, n_trunk)

    def names(self, parts: tuple[str, ...], /) -> tuple[str, ...]:
        """Return the parts' names."""
        return parts

    def points(self, centre_m: Array, axis: Array, side: Array, antenna_m: Array, /) -> Points:
        """Return the parts as the antenna sees them; see `Skin`.

        An ellipsoid echoes where its surface faces the antenna, nearer than its middle by the root
        of ``a^2 l^2 + b^2 m^2 + c^2 n^2``: 10 to 20 cm at a person's trunk, 4 to 8 cm at limbs.
        """
        middle, along, left = _first(centre_m), _first(axis), _first(side)
        towards = antenna_m[:, None, None] - middle
        # A part in the antenna itself looks some way or other, but not NaN.
        distance = np.maximum(np.sqrt(_dot(towards, towards)), 1e-9)
        towards /= distance
        nearer2 = self._nearer2_m2(along, left, towards)
        still = self._still_m2(middle, along, left, towards, nearer2)
        ways = (along, left, _cross(along, left + 0.0 * along))
        seen = np.stack([_dot(way, towards) for way in ways], axis=-1)
        points = Points(
            centre_m,
            np.asarray(still * self.fluctuation.at(seen), dtype=np.float64),
            # An antenna inside a part still has it in front.
            np.minimum(np.sqrt(nearer2), _DEEPEST * distance),
        )
        if self.n_trunk == 1:
            return points
        parts = slice(self.trunk, self.trunk + self.n_trunk)
        floor = self.scale * self.floor_m2
        return one_surface(points, parts, still, floor, antenna_m)

    def mean_total_m2(self, centre_m: Array, axis: Array, side: Array, /) -> float:
        """Return the sum over all parts in square metres, averaged over aspect and postures.

        Postures are of shape (n_postures, n_segments, 3), as in `points`. Seen level from far
        away, every azimuth weighs the same; the fluctuation has mean 1 and changes nothing.
        """
        turn = np.arange(_N_AZIMUTHS) * (2.0 * np.pi / _N_AZIMUTHS)
        level = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
        middle, along, left = (_first(x)[:, None] for x in (centre_m, axis, side))
        towards = level[:, :, None, None]
        nearer2 = self._nearer2_m2(along, left, towards)
        total = self._still_m2(middle, along, left, towards, nearer2).sum(axis=-1)
        return float(total.mean())

    def _nearer2_m2(self, axis: Array, side: Array, towards: Array) -> Array:
        """Return the squared distance from middles to surfaces; x, y, z come first."""
        a2, b2, c2 = (self.half_m**2).T
        # Of the third component only the square is needed, so no cross product.
        below = (a2 - c2) * _dot(axis, towards) ** 2
        below += (b2 - c2) * _dot(side, towards) ** 2
        below += c2
        # At an end the terms cancel to the least square half-length, but for rounding.
        least = 0.5 * np.minimum(np.minimum(a2, b2), c2)
        return np.asarray(np.maximum(below, least, out=below), dtype=np.float64)

    def _still_m2(
        self, centre: Array, axis: Array, side: Array, towards: Array, nearer2: Array
    ) -> Array:
        """Return cross sections without fluctuation; x, y, z come first in all vectors."""
        a2, b2, c2 = (self.half_m**2).T
        rcs = np.maximum(SKIN_REFLECTION * np.pi * a2 * b2 * c2 / nearer2**2, self.floor_m2)
        lost = (self.shadow_db * -_NEPER_PER_DB) * self._covered(centre, axis, side, towards)
        return np.asarray(self.scale * rcs * np.exp(lost), dtype=np.float64)

    def _covered(self, centre: Array, axis: Array, side: Array, towards: Array) -> Array:
        """Return how much the trunk covers each part, from 0 to 1.

        In coordinates where the trunk is the unit sphere, a part is covered if its ray
        towards the antenna has yet to pass the trunk's middle, and passes it closer than 1.
        """
        k = self.trunk
        long = axis[..., k : k + 1]
        left = side if side.shape[-1] == 1 else side[..., k : k + 1]
        from_trunk = centre - centre[..., k : k + 1]
        place2 = ahead = np.zeros(())
        ray2 = np.full((), 1e-30)  # for a part in the antenna itself, which has no ray
        for unit, half in zip((long, left, _cross(long, left)), self.half_m[k], strict=True):
            face = unit / half
            q, u = _dot(from_trunk, face), _dot(towards, face)
            place2 = place2 + q * q
            ray2 = ray2 + u * u
            ahead = ahead - q * u
        miss2 = place2 - ahead * np.abs(ahead) / ray2
        return _ramp(ahead / np.sqrt(ray2), 0.2, 1.0) * (1.0 - _ramp(miss2, 0.5, 1.7))


def _first(x: Array) -> Array:
    """Put x, y, z first: whole rows of memory then add up, several times as fast."""
    return np.ascontiguousarray(np.moveaxis(x, -1, 0))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], dtype=np.float64)


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _ramp(x: Array, low: float, high: float) -> Array:
    """Rise from 0 at `low` to 1 at `high`, smooth with its first derivative."""
    y = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(y * y * (3.0 - 2.0 * y), dtype=np.float64)
