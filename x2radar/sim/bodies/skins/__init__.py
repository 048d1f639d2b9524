"""Skins: how the segments of a body echo, whatever moves them.

Four laws, none of which is the truth, so that a network cannot learn one of them by heart:

    surface      ellipsoids with a trunk of one bright spot (`surface`)
    points       constant scatterers along the segments, with drawn weights (`PointSkin`)
    ellipsoids   ellipsoids by physical optics, each by itself, aspect-dependent (`surface`)
    capsules     cylinders with round ends, and shadows of what lies before them (`CapsuleSkin`)

Each takes poses and gives `Points`; all fluctuation is a function of the aspect alone.
"""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from x2radar.keys import Key
from x2radar.sim.bodies.skins.base import (
    DEEPEST,
    SKIN_REFLECTION,
    THEORY,
    WAVELENGTH_M,
    EchoGain,
    Skin,
)
from x2radar.sim.bodies.skins.surface import SurfaceSkin
from x2radar.sim.points import Array, Points, Pose

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
        """Return the segments' names, repeated."""
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


SKINS: Mapping[str, Callable[[np.random.Generator, Array, int, EchoGain], Skin]] = {
    "surface": lambda rng, half, n, _: SurfaceSkin(rng, half, n),
    "points": lambda rng, half, _, gain: PointSkin(rng, half, gain),
    "ellipsoids": lambda rng, half, _, gain: SurfaceSkin(rng, half, 1, gain),
    "capsules": lambda rng, half, _, gain: CapsuleSkin(rng, half, gain),
}
"""Every skin: how it is drawn, from half-lengths, the number of trunk segments, the gains."""


def draw_skin(
    rng: np.random.Generator,
    name: str,
    half_m: ArrayLike,
    n_trunk: int = 1,
    gain: EchoGain = THEORY,
) -> Skin:
    """Draw a skin of `SKINS` for parts of half-lengths (n_segments, 3); or SceneError."""
    Key(choices=tuple(SKINS)).judge(name, "skin")
    return SKINS[name](rng, np.array(half_m, dtype=np.float64), n_trunk, gain)


def sized(skin: Skin, rng: np.random.Generator, total_rcs_dbsm: TotalRcs, pose: Pose) -> Skin:
    """Return a new skin, its mean total over a pose set; SceneError outside -70 to 30 dBsm."""
    # Were people larger than pets, a classifier would learn size instead of movement.
    total_m2 = float(10.0 ** (rng.uniform(*TOTAL_RCS_DBSM) / 10.0))
    if total_rcs_dbsm == "physical":
        return skin
    if total_rcs_dbsm is not None:
        Key(-70.0, 30.0).judge(total_rcs_dbsm, "total_rcs_dbsm")
        total_m2 = 10.0 ** (total_rcs_dbsm / 10.0)
    side = np.broadcast_to(pose.side, pose.axis.shape)
    mean_m2 = skin.mean_total_m2(Pose(pose.centre_m, pose.axis, side))
    skin.scale *= total_m2 / max(mean_m2, _TINY_M2)
    return skin
