"""Ellipsoids: with a trunk of one bright spot and shadows, or each by itself.

High-frequency backscatter of a perfectly conducting ellipsoid with half-lengths a, b, c, seen
along a unit vector with components l, m, n in its own frame (Ruck, Radar Cross Section Handbook,
1970; recalled)::

    sigma = pi (a b c)^2 / (a^2 l^2 + b^2 m^2 + c^2 n^2)^2

times the power reflection of skin and muscle. Real parts are rough and bent, so an end-on view
keeps some per cent of the broadside echo. The formula wants a radius above a wavelength over 2 pi
(7 mm at 6.8 GHz): a thin tail is at its limit.

A trunk is several ellipsoids of different girth, but to the radar one smooth convex surface, whose
backscatter comes from where it is nearest to the antenna (stationary phase; Ruck). The spot slides
over the surface as the body turns and sways. It carries the mean power of all the ellipsoids, less
what roughness scatters from each place by itself.

Over an extent L the echoes of a part's places fall out of step within ``lambda / (2 L)`` radians
(Skolnik, Introduction to Radar Systems, on scintillation). The decibels are a random function on
the sphere of directions, so a part that does not turn does not scintillate.
"""

import numpy as np

from x2radar.sim.bodies.skins.base import DEEPEST, SKIN_REFLECTION, WAVELENGTH_M, EchoGain, Skin
from x2radar.sim.bodies.wander import smooth_step
from x2radar.sim.points import Array, Points, Pose

_NEPER_PER_DB = np.log(10.0) / 10.0
SPREAD_DB = (2.0, 4.0)  # of a part's echo over all aspects (a guess: skin and cloth)
FLOOR = (0.05, 0.10)  # least over broadside cross section: real parts are rough and bent (a guess)
_APART_FLOOR, _APART_SPREAD_DB = (0.0, 0.10), (0.0, 3.0)
"""The same of bodies whose ellipsoids stand by themselves, drawn once a body."""
SHADOW_DB = (6.0, 15.0)  # of a part behind a trunk (a guess; creeping waves fill the rest)
_N_AZIMUTHS = 72  # of a mean total: 5 degrees apart, without fluctuation
_BLEND_M = 0.011  # first Fresnel zone: a quarter of a wavelength deep, at 6.8 GHz
_TINY = 1e-300  # for parts without an echo, which weigh nothing
_N_WAVES = 16  # waves of the fluctuation: 16 make its distribution normal to some per cent
_TURN_RAD = (0.03, 1.0)  # limits of its decorrelation: a trunk of 0.7 m, and a paw


class AspectFluctuation:
    """Power factors of several segments, each log-normal with mean 1 over all aspects.

    Segments have half-lengths (n_segments, 3) and are spread by so many decibels, (n_segments,).
    """

    def __init__(self, rng: np.random.Generator, half_m: Array, spread_db: Array) -> None:
        # Change of aspect over which each segment decorrelates.
        self.turn_rad = np.clip(WAVELENGTH_M / (4 * half_m.max(axis=1)), *_TURN_RAD)
        self.phase_rad = rng.uniform(0, 2 * np.pi, (_N_WAVES, len(half_m)))
        # Of each wave, in nepers of power.
        self.amplitude = spread_db * _NEPER_PER_DB * np.sqrt(2.0 / _N_WAVES)
        # On the sphere of directions, for decorrelation over one radian.
        self.wave = rng.standard_normal((_N_WAVES, 3))

    def at(self, x: Array, y: Array, z: Array) -> Array:
        """Return the factors for directions in the segments' own axes; good to five digits."""
        # Single precision is plenty for a power, and several times as fast.
        seen = [v.astype(np.float32) for v in (x, y, z)]
        wave = (self.wave[:, :, None] / self.turn_rad).astype(np.float32)
        phase = self.phase_rad.astype(np.float32)
        total = np.zeros(x.shape, np.float32)
        for (a, b, c), p in zip(wave, phase, strict=True):
            total += np.cos(a * seen[0] + b * seen[1] + c * seen[2] + p)
        offset = _N_WAVES * np.log(np.i0(self.amplitude))
        return np.asarray(np.exp(self.amplitude * total - offset), dtype=np.float64)


class SurfaceSkin(Skin):
    """Cross sections of the parts of one body; see `Skin`. The first part casts the shadow.

    Parts have half-lengths (n_segments, 3) along the part, to the side and across both; `n_trunk`
    of them, from the first on, are one surface. Given a gain, they are ellipsoids by themselves,
    the usual model of micro-Doppler studies.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        half_m: Array,
        n_trunk: int = 1,
        gain: EchoGain | None = None,
    ) -> None:
        # Seen along the shortest half-length.
        area_m2 = (half_m.prod(axis=1) / half_m.min(axis=1) ** 2) ** 2
        n, broadside = len(half_m), SKIN_REFLECTION * np.pi * area_m2
        self.half_m, self.n_trunk = half_m, n_trunk
        # Least cross section, before `scale`; how much the trunk takes from a part right behind
        # it; what each echoes against theory.
        if gain is None:
            self.floor_m2 = rng.uniform(*FLOOR, n) * broadside
            self.shadow_db = rng.uniform(*SHADOW_DB, n)
            self.shadow_db[0] = 0.0
            spread_db, self.gain = rng.uniform(*SPREAD_DB, n), np.ones(n)
        else:
            self.floor_m2 = rng.uniform(*_APART_FLOOR) * broadside
            self.shadow_db = np.zeros(n)
            spread_db = np.full(n, rng.uniform(*_APART_SPREAD_DB))
            self.gain = gain.draw(rng, broadside)
        self.fluctuation = AspectFluctuation(rng, half_m, spread_db)

    def points(self, pose: Pose, antenna_m: Array) -> Points:
        """Return the parts where their surface faces the antenna; see `Skin`."""
        middle, along, left = _first(pose.centre_m), _first(pose.axis), _first(pose.side)
        towards = antenna_m[:, None, None] - middle
        # A part in the antenna itself looks some way or other, but not NaN.
        distance = np.maximum(np.sqrt(_dot(towards, towards)), 1e-9)
        towards /= distance
        nearer2 = self._nearer2_m2(along, left, towards)
        still = self._still_m2(middle, along, left, towards, nearer2)
        ways = (along, left, _cross(along, left + 0.0 * along))
        rcs = still * self.fluctuation.at(*(_dot(way, towards) for way in ways))
        nearer_m = np.minimum(np.sqrt(nearer2), DEEPEST * distance)
        if self.n_trunk > 1:
            rcs, nearer_m = self._one_surface(pose, antenna_m, still, (rcs, nearer_m))
        return Points(pose.centre_m, rcs, nearer_m)

    def _one_surface(
        self, pose: Pose, antenna_m: Array, still_m2: Array, echo: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Return cross sections and depths with the trunk as one bright spot, their sum kept."""
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
        """Return the sum over all parts, averaged over aspect and times; see `Skin`."""
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
        rcs *= self.scale * self.gain
        if self.shadow_db.any():
            covered = self._covered(centre, axis, side, towards)
            rcs *= np.exp((self.shadow_db * -_NEPER_PER_DB) * covered)
        return np.asarray(rcs, dtype=np.float64)

    def _covered(self, centre: Array, axis: Array, side: Array, towards: Array) -> Array:
        """Return how much the trunk, taken for a sphere, covers each part, from 0 to 1."""
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
        behind = smooth_step((ahead / np.sqrt(ray2) - 0.2) / 0.8)
        return behind * (1.0 - smooth_step((miss2 - 0.5) / 1.2))


def _first(x: Array) -> Array:
    """Put x, y, z first: whole rows of memory then add up, several times as fast."""
    return np.ascontiguousarray(np.moveaxis(x, -1, 0))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], dtype=np.float64)


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
