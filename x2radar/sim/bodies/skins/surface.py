"""The first skin: ellipsoids, with a trunk that is one surface with one bright spot.

Each part of a body is an ellipsoid. High-frequency backscatter of a perfectly conducting
ellipsoid with half-lengths a, b, c, seen along a unit vector with components l, m, n in its
own frame (Ruck, Radar Cross Section Handbook, 1970; recalled)::

    sigma = pi (a b c)^2 / (a^2 l^2 + b^2 m^2 + c^2 n^2)^2

times the power reflection of skin and muscle, about 0.54 at 7 GHz (recalled). Real parts are
rough and bent, so an end-on view keeps some per cent of the broadside echo. The formula wants
a radius above a wavelength over 2 pi (7 mm at 6.8 GHz): a thin tail is at its limit.

A trunk is drawn with several ellipsoids, because chest, belly and hips, or chest, barrel and
rump, are of different girth. To the radar they are one smooth convex surface, and high-frequency
backscatter of a smooth convex body comes from one place, where it is nearest to the antenna
(stationary phase; Ruck). The spot slides over the surface as the body turns and sways. It carries
the mean power of all the ellipsoids, less what roughness scatters from each place by itself.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.pose import Pose
from x2radar.sim.bodies.skins.aspect import AspectFluctuation
from x2radar.sim.bodies.skins.base import (
    DEEPEST,
    NEPER_PER_DB,
    SKIN_REFLECTION,
    Skin,
    broadside_m2,
)
from x2radar.sim.points import Array, Points

SPREAD_DB = (2.0, 4.0)
"""Of a part's echo over all aspects (a guess: skin and cloth)."""
FLOOR = (0.05, 0.10)
"""Least over broadside cross section: real parts are rough and bent (a guess)."""
SHADOW_DB = (6.0, 15.0)
"""What a trunk takes from a part behind it (a guess; creeping waves fill the rest)."""
_N_AZIMUTHS = 72
"""Of a mean total: 5 degrees apart, without fluctuation."""
_BLEND_M = 0.011
"""Depth within which parts of the surface answer together: the first Fresnel zone is a quarter
of a wavelength deep, 11 mm at 6.8 GHz."""
_TINY = 1e-300
"""For parts without an echo, which weigh nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSkin(Skin):
    """Cross sections of the parts of one body; see `Skin`. The first part casts the shadow."""

    half_m: Array  # (n_segments, 3): half-lengths along the part, to the side, across both
    floor_m2: Array  # (n_segments,): least cross section, before `scale`
    shadow_db: Array  # (n_segments,): how much the trunk takes from a part right behind it
    fluctuation: AspectFluctuation  # change with the aspect
    n_trunk: int = 1  # so many parts, from the first on, are one surface

    @classmethod
    def draw(cls, rng: np.random.Generator, half_m: Array, n_trunk: int = 1) -> Self:
        """Draw what is random about the echo of a body; its scale is the physical one.

        Floors and shadows are even in `FLOOR` and `SHADOW_DB`.
        """
        n = len(half_m)
        floor = rng.uniform(*FLOOR, n) * broadside_m2(half_m)
        shadow_db = rng.uniform(*SHADOW_DB, n)
        shadow_db[0] = 0.0
        fluctuation = AspectFluctuation.draw(rng, half_m, rng.uniform(*SPREAD_DB, n))
        return cls(half_m, floor, shadow_db, fluctuation, n_trunk)

    def points(self, pose: Pose, antenna_m: Array) -> Points:
        """Return the parts as the antenna sees them; see `Skin`.

        An ellipsoid echoes where its surface faces the antenna, nearer than its middle by the root
        of ``a^2 l^2 + b^2 m^2 + c^2 n^2``: 10 to 20 cm at a person's trunk, 4 to 8 cm at limbs.
        """
        middle, along, left = _first(pose.centre_m), _first(pose.axis), _first(pose.side)
        towards = antenna_m[:, None, None] - middle
        # A part in the antenna itself looks some way or other, but not NaN.
        distance = np.maximum(np.sqrt(_dot(towards, towards)), 1e-9)
        towards /= distance
        nearer2 = self._nearer2_m2(along, left, towards)
        still = self._still_m2(middle, along, left, towards, nearer2)
        ways = (along, left, _cross(along, left + 0.0 * along))
        seen = np.stack([_dot(way, towards) for way in ways], axis=-1)
        rcs = np.asarray(still * self.fluctuation.at(seen), dtype=np.float64)
        nearer_m = np.minimum(np.sqrt(nearer2), DEEPEST * distance)
        if self.n_trunk > 1:
            rcs, nearer_m = self._one_surface(pose, antenna_m, still, (rcs, nearer_m))
        return Points(pose.centre_m, rcs, nearer_m)

    def _one_surface(
        self, pose: Pose, antenna_m: Array, still_m2: Array, echo: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Return cross sections and depths with the trunk as one bright spot.

        `still_m2` is without fluctuation: the spot must not wander when an echo glints. Its other
        parts keep no more than roughness gives in any view. The sum of cross sections is the same
        at every time. The spot, at the first part, is so much nearer than its middle as the
        nearest surface is; where two are equally near, between them.
        """
        parts = slice(self.n_trunk)
        rcs, nearer_m = (x.copy() for x in echo)
        floor_m2 = (self.scale * self.floor_m2)[parts]
        still = np.maximum(still_m2[:, parts], _TINY)
        towards_m = antenna_m - pose.centre_m[:, parts]
        away_m = np.sqrt((towards_m**2).sum(axis=-1))
        range_m = away_m - nearer_m[:, parts]
        weight = still * np.exp((range_m.min(axis=1, keepdims=True) - range_m) / _BLEND_M)
        spot_m = (weight * range_m).sum(axis=1) / weight.sum(axis=1)
        nearer_m[:, 0] = np.maximum(away_m[:, 0] - spot_m, 0.0)
        total = rcs[:, parts].sum(axis=1)
        rcs[:, parts] *= np.minimum(floor_m2 / still, 1.0)
        rcs[:, 0] = total - rcs[:, 1 : self.n_trunk].sum(axis=1)
        return rcs, nearer_m

    def mean_total_m2(self, pose: Pose) -> float:
        """Return the sum over all parts, averaged over aspect and times; see `Skin`.

        The fluctuation has mean 1 and changes nothing.
        """
        turn = np.arange(_N_AZIMUTHS) * (2.0 * np.pi / _N_AZIMUTHS)
        level = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
        middle, along, left = (_first(x)[:, None] for x in (pose.centre_m, pose.axis, pose.side))
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
        lost = (self.shadow_db * -NEPER_PER_DB) * self._covered(centre, axis, side, towards)
        return np.asarray(self.scale * rcs * np.exp(lost), dtype=np.float64)

    def _covered(self, centre: Array, axis: Array, side: Array, towards: Array) -> Array:
        """Return how much the trunk covers each part, from 0 to 1.

        In coordinates where the trunk is the unit sphere, a part is covered if its ray
        towards the antenna has yet to pass the trunk's middle, and passes it closer than 1.
        """
        long, left = axis[..., :1], side[..., :1]
        from_trunk = centre - centre[..., :1]
        place2 = ahead = np.zeros(())
        ray2 = np.full((), 1e-30)  # for a part in the antenna itself, which has no ray
        for unit, half in zip((long, left, _cross(long, left)), self.half_m[0], strict=True):
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
