"""Cylinders with round ends, and shadows of what lies before them.

Seen from the side, a cylinder of radius r and length l echoes with ``2 pi r l^2 / lambda`` (Ruck,
Radar Cross Section Handbook, 1970), here patch by patch over a coherent length shorter than l, for
limbs are bent. Away from the side that lobe falls, and both ends remain with half of ``pi r^2``
each; they lie apart in range, so their echoes interfere.
"""

import numpy as np

from x2radar.sim.bodies.skins.base import DEEPEST, SKIN_REFLECTION, WAVELENGTH_M, EchoGain, Skin
from x2radar.sim.points import Array, Points, Pose

_COHERENT_M = (0.03, 0.08)  # over which skin or cloth is straight to an eighth of a wave
_SHADOW_DB = (3.0, 20.0)  # of a part right behind another: diffraction fills shadows


class CapsuleSkin(Skin):
    """A skin of cylinders with round ends, which shade what lies behind them."""

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
