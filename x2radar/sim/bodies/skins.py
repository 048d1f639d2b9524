"""Skins: how the segments of a body echo, whatever moves them.

Four laws, none of which is the truth, so that a network cannot learn one of them by heart:

    surface      ellipsoids with a trunk of one bright spot (`SurfaceSkin`)
    points       constant scatterers along the segments, with drawn weights (`PointSkin`)
    ellipsoids   ellipsoids by physical optics, each by itself, aspect-dependent (`SurfaceSkin`)
    capsules     cylinders with round ends, and shadows of what lies before them (`CapsuleSkin`)

Each takes poses and gives `Points`; all fluctuation is a function of the aspect alone.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.wander import smooth_step
from x2radar.sim.points import Array, Points, Pose

SKIN_REFLECTION = 0.54  # of power, skin and muscle at 7 GHz (Gabriel's tissue data, recalled)
WAVELENGTH_M = 0.044  # at 6.8 GHz, the X2's carrier
DEEPEST = 0.7  # an antenna inside a part still has it in front, by this share of the distance
_FAR_M, _N_AZIMUTHS = 50.0, 24  # whence totals are taken: a body is a point from there
_MAX_GAIN_DB = 4.0  # of parts' own draws of gain: recorded people differ by about as much


@dataclass(frozen=True, slots=True)
class EchoGain:
    """How strong the parts of a kind of body echo against theory; every body draws its own.

    Recorded people show stronger limbs than single bodies of theory have, a recorded dog weaker
    paws (docs/research/evaluation-tried.md); the numbers hold both.
    """

    max_power: float = 0.5  # large parts lose to small ones by up to so much of their ratio
    # Groups of parts, by number, and the most that each group loses, in dB.
    losses: tuple[tuple[tuple[int, ...], float], ...] = ()

    def draw_losses(self, rng: np.random.Generator, n_segments: int) -> Array:
        """Draw the factors of the groups' losses, shape (n_segments,)."""
        factor = np.ones(n_segments)
        for parts, most_db in self.losses:
            factor[list(parts)] *= 10 ** (-rng.uniform(0.0, most_db) / 10)
        return factor

    def draw(self, rng: np.random.Generator, size: Array) -> Array:
        """Draw what segments echo against theory, which gives `size`; weighted by it mean 1."""
        power, spread = rng.uniform(0.0, self.max_power), rng.uniform(0.0, _MAX_GAIN_DB)
        noise = 10 ** (spread / 10 * rng.standard_normal(len(size)).clip(-2, 2))
        gain = (size / size.max()) ** -power * noise * self.draw_losses(rng, len(size))
        return np.asarray(gain * (size.sum() / (size * gain).sum()))


THEORY = EchoGain()  # of bodies of which nothing is known


class Skin(ABC):
    """How the segments of one body echo; everything random was drawn when it was made."""

    scale = 1.0  # factor on all cross sections

    def names(self, parts: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of its points, from those of the segments: one each."""
        return parts

    @abstractmethod
    def points(self, pose: Pose, antenna_m: Array) -> Points:
        """Return the echoes of a pose, as many as `names` has; `antenna_m` has shape (3,)."""

    def mean_total_m2(self, pose: Pose) -> float:
        """Return the sum of all cross sections, level from far away, over aspect and times."""
        middle = pose.centre_m.mean(axis=(0, 1))
        totals = []
        for turn in np.arange(_N_AZIMUTHS) * (2 * np.pi / _N_AZIMUTHS):
            antenna = middle + _FAR_M * np.array([np.cos(turn), np.sin(turn), 0.0])
            totals.append(self.points(pose, antenna).rcs_m2.sum(axis=1).mean())
        return float(np.mean(totals))


TotalRcs = float | Literal["physical"] | None
"""Mean total of a body: in dBsm, by its sizes, or None for a draw of its own."""

TOTAL_RCS_DBSM = (-15.0, 3.0)  # from a cat end-on to a large man: holds both, whatever the body is
_TINY_M2 = 1e-12
_COUNTS = ((0.3, (1, 1)), (0.65, (3, 8)), (1.0, (1, 4)))
"""Scatterers a segment, fewest and most, of bodies up to a cumulated share: studies have
one to eight."""
_MAX_SPREAD_DB = 6.0  # largest spread of the weights within a body, twice that of the other skins
_AREA_POWER = (0.0, 1.6)
"""Weights go with a segment's area to a power between: from limbs as strong as the trunk,
as the first studies have them, to a trunk that outshines all else."""
_COHERENT_M = (0.03, 0.08)  # over which skin or cloth is straight to an eighth of a wave
_SHADOW_DB = (3.0, 20.0)  # of a part right behind another: diffraction fills shadows


class PointSkin(Skin):
    """Constant scatterers along the segments: the model of the first micro-Doppler studies.

    Chen (The Micro-Doppler Effect in Radar) and the thesis put one scatterer of constant cross
    section on each body part; here there may be several, off the axis, with drawn weights that
    follow the segments' areas to a drawn power.
    """

    def __init__(self, rng: np.random.Generator, half_m: Array, gain: EchoGain) -> None:
        share = rng.random()
        fewest, most = next(span for top, span in _COUNTS if share < top)
        count = rng.integers(fewest, most + 1, len(half_m))
        segment = np.repeat(np.arange(len(half_m)), count)
        half = half_m[segment]
        along = rng.uniform(-0.9, 0.9, len(segment)) * half[:, 0]
        around, depth = rng.uniform(0, 2 * np.pi, len(segment)), rng.uniform(0.0, 0.8)
        aside, across = depth * half[:, 1] * np.cos(around), depth * half[:, 2] * np.sin(around)
        area = half[:, 0] * np.sqrt(half[:, 1] * half[:, 2]) / count[segment]
        spread_db = rng.uniform(0, _MAX_SPREAD_DB) * rng.standard_normal(len(segment)).clip(-2, 2)
        weight = area ** rng.uniform(*_AREA_POWER) * 10 ** (spread_db / 10)
        weight *= gain.draw_losses(rng, len(half_m))[segment]
        total = SKIN_REFLECTION * np.pi * (half_m[:, 0] * half_m[:, 1:].mean(axis=1)).sum()
        self.segment = segment  # on which segment each point is
        # Along its axis, to the side and across both, from its middle.
        self.place_m = np.stack([along, aside, across], axis=1)
        self.rcs_m2 = total * weight / weight.sum()  # before `scale`; about what the areas reflect

    def names(self, parts: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(parts[k] for k in self.segment)

    def points(self, pose: Pose, antenna_m: Array) -> Points:  # noqa: ARG002 - they look the same from everywhere
        long = pose.axis[:, self.segment]
        left = np.broadcast_to(pose.side, pose.axis.shape)[:, self.segment]
        a, b, c = self.place_m.T[..., None]
        middle = pose.centre_m[:, self.segment]
        place = middle + a * long + b * left + c * np.cross(long, left)
        return Points(place, np.tile(self.scale * self.rcs_m2, (len(middle), 1)))

    def mean_total_m2(self, pose: Pose) -> float:
        first = Pose(pose.centre_m[:1], pose.axis[:1], pose.side[:1])
        return Skin.mean_total_m2(self, first)


class CapsuleSkin(Skin):
    """Cylinders with round ends, which shade what lies behind them.

    Seen from the side, a cylinder of radius r and length l echoes with ``2 pi r l^2 / lambda``
    (Ruck, Radar Cross Section Handbook, 1970), here patch by patch over a coherent length shorter
    than l, for limbs are bent. Away from the side that lobe falls, and both ends remain with half
    of ``pi r^2`` each; they lie apart in range, so their echoes interfere.
    """

    def __init__(self, rng: np.random.Generator, half_m: Array, gain: EchoGain) -> None:
        self.half_m = half_m
        self._radius_m = np.asarray(np.sqrt(half_m[:, 1] * half_m[:, 2]))
        self.gain = gain.draw(rng, half_m[:, 0] * self._radius_m)  # of each segment, mean 1
        self.coherent_m = rng.uniform(*_COHERENT_M)
        self.shadow_db = rng.uniform(*_SHADOW_DB)  # what a segment right behind another loses

    def names(self, parts: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of sides, far ends and near ends."""
        ends = (f"{part} {end}" for end in ("end", "begin") for part in parts)
        return (*parts, *ends)

    def points(self, pose: Pose, antenna_m: Array) -> Points:
        towards = antenna_m - pose.centre_m
        distance = np.maximum(np.sqrt((towards * towards).sum(axis=-1)), 1e-9)
        slant = (towards * pose.axis).sum(axis=-1) / distance
        radius = self._radius_m
        rod = np.maximum(self.half_m[:, 0] - radius, 0.0)
        length = np.minimum(2 * self.half_m[:, 0], self.coherent_m)
        width = WAVELENGTH_M / (2 * np.pi * length)
        lobe = np.exp(-0.5 * (slant / width) ** 2)
        base = SKIN_REFLECTION * self.scale * self.gain
        base = base * self._lit(pose.centre_m, pose.axis, antenna_m)
        # As many coherent patches as fit, their powers added.
        broad = base * 2 * np.pi * radius * length * 2 * rod / WAVELENGTH_M * lobe
        cap = base * (0.5 * np.pi * radius**2)
        near = np.minimum(radius, DEEPEST * distance)
        end = rod[:, None] * pose.axis
        middle = pose.centre_m
        place = np.concatenate([middle, middle + end, middle - end], axis=1)
        return Points(place, np.concatenate([broad, cap, cap], axis=1), np.tile(near, (1, 3)))

    def _lit(self, centre: Array, axis: Array, antenna_m: Array) -> Array:
        """Return what shadows leave of each segment's power, shape (n_slow, n_segments)."""
        radius, half = self._radius_m, self.half_m[:, 0]
        start = centre - antenna_m
        away = np.sqrt((start * start).sum(axis=-1))
        unit = start / np.maximum(away, 1e-9)[..., None]
        # For a ray to segment i (second) past segment j (third): where on j's axis it is closest,
        # how far along the ray that is, and by how much it misses.
        ahead = unit @ start.transpose(0, 2, 1)
        slant = unit @ axis.transpose(0, 2, 1)
        own = (start * axis).sum(axis=-1)[:, None]
        at = (slant * ahead - own) / np.maximum(1 - slant**2, 1e-3)
        at = np.clip(at, -half, half)
        reach = ahead + at * slant
        place2 = (away**2)[:, None] + 2 * at * own + at**2
        miss = np.sqrt(np.maximum(place2 - reach**2, 0.0))
        covers = np.clip(1.5 - miss / radius, 0.0, 1.0)
        behind = (away[:, :, None] - reach) / (radius + radius[:, None]) - 0.3
        cover = (covers * np.clip(behind, 0.0, 1.0)).max(axis=2)
        return np.asarray(10 ** (-self.shadow_db / 10 * cover))


_NEPER_PER_DB = np.log(10.0) / 10.0
SPREAD_DB = (2.0, 4.0)  # of a part's echo over all aspects (a guess: skin and cloth)
FLOOR = (0.05, 0.10)  # least over broadside cross section: real parts are rough and bent (a guess)
_APART_FLOOR, _APART_SPREAD_DB = (0.0, 0.10), (0.0, 3.0)
"""The same of bodies whose ellipsoids stand by themselves, drawn once a body."""
SHADOW_DB = (6.0, 15.0)  # of a part behind a trunk (a guess; creeping waves fill the rest)
_N_TURNS = 72  # of a mean total: 5 degrees apart, without fluctuation
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
    """Ellipsoids: with a trunk of one bright spot and shadows, or each by itself.

    High-frequency backscatter of a perfectly conducting ellipsoid with half-lengths a, b, c, seen
    along a unit vector with components l, m, n in its own frame (Ruck, Radar Cross Section
    Handbook, 1970; recalled)::

        sigma = pi (a b c)^2 / (a^2 l^2 + b^2 m^2 + c^2 n^2)^2

    times the power reflection of skin and muscle. Real parts are rough and bent, so an end-on view
    keeps some per cent of the broadside echo. The formula wants a radius above a wavelength over 2
    pi (7 mm at 6.8 GHz): a thin tail is at its limit.

    A trunk is several ellipsoids of different girth, but to the radar one smooth convex surface,
    whose backscatter comes from where it is nearest to the antenna (stationary phase; Ruck). The
    spot slides over the surface as the body turns and sways. It carries the mean power of all the
    ellipsoids, less what roughness scatters from each place by itself.

    Over an extent L the echoes of a part's places fall out of step within ``lambda / (2 L)``
    radians (Skolnik, Introduction to Radar Systems, on scintillation). The decibels are a random
    function on the sphere of directions, so a part that does not turn does not scintillate.

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
        turn = np.arange(_N_TURNS) * (2.0 * np.pi / _N_TURNS)
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


SKINS: Mapping[str, Callable[[np.random.Generator, Array, int, EchoGain], Skin]] = {
    "surface": lambda rng, half, n, _: SurfaceSkin(rng, half, n),
    "points": lambda rng, half, _, gain: PointSkin(rng, half, gain),
    "ellipsoids": lambda rng, half, _, gain: SurfaceSkin(rng, half, 1, gain),
    "capsules": lambda rng, half, _, gain: CapsuleSkin(rng, half, gain),
}
"""Every skin: how it is drawn, from half-lengths (n_segments, 3), the number of trunk segments,
and the gains."""


def sized(skin: Skin, rng: np.random.Generator, total_rcs_dbsm: TotalRcs, pose: Pose) -> Skin:
    """Return a new skin, its mean total over a pose set; SceneError outside -60 to 30 dBsm."""
    # Were people larger than pets, a classifier would learn size instead of movement.
    total_m2 = float(10.0 ** (rng.uniform(*TOTAL_RCS_DBSM) / 10.0))
    if total_rcs_dbsm == "physical":
        return skin
    if total_rcs_dbsm is not None:
        Key(-60.0, 30.0).judge(total_rcs_dbsm, "total_rcs_dbsm")
        total_m2 = 10.0 ** (total_rcs_dbsm / 10.0)
    side = np.broadcast_to(pose.side, pose.axis.shape)
    mean_m2 = skin.mean_total_m2(Pose(pose.centre_m, pose.axis, side))
    skin.scale *= total_m2 / max(mean_m2, _TINY_M2)
    return skin
