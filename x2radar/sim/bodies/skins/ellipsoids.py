"""Ellipsoids by physical optics, each by itself: the usual model of micro-Doppler studies.

The formula is that of `surface`; here nothing joins the trunk to one surface, nothing casts a
shadow, and floors and fluctuation may be absent.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.pose import Pose
from x2radar.sim.bodies.skins.aspect import AspectFluctuation
from x2radar.sim.bodies.skins.base import (
    DEEPEST,
    SKIN_REFLECTION,
    EchoGain,
    Skin,
    broadside_m2,
    seen_from,
)
from x2radar.sim.points import Array, Points

_MAX_FLOOR, _MAX_SPREAD_DB = 0.10, 3.0
"""Largest floor, as a share of the broadside echo, and largest fluctuation: those of `surface`."""


@dataclass(frozen=True, slots=True, eq=False)
class EllipsoidSkin(Skin):
    """Ellipsoids that echo where their surface faces the antenna; see `Skin`."""

    half_m: Array  # (n_segments, 3): half-lengths
    floor_m2: Array  # (n_segments,): least cross section of each, before `scale`
    gain: Array  # (n_segments,): what each echoes against theory
    fluctuation: AspectFluctuation  # what clothes and bent limbs do to it

    @classmethod
    def draw(cls, rng: np.random.Generator, half_m: Array, gain: EchoGain) -> Self:
        """Draw a body's floor, gains and fluctuation."""
        broadside = broadside_m2(half_m)
        floor = rng.uniform(0.0, _MAX_FLOOR) * broadside
        spread_db = np.full(len(half_m), rng.uniform(0.0, _MAX_SPREAD_DB))
        drawn = gain.draw(rng, broadside)
        return cls(half_m, floor, drawn, AspectFluctuation.draw(rng, half_m, spread_db))

    def points(self, pose: Pose, antenna_m: Array) -> Points:
        """Return the echoes; see `Skin`."""
        seen, distance = seen_from(pose, antenna_m)
        a2, b2, c2 = (self.half_m**2).T
        deep2 = a2 * seen[..., 0] ** 2 + b2 * seen[..., 1] ** 2 + c2 * seen[..., 2] ** 2
        # Unit vectors that are not quite square to each other must not make a hole.
        deep2 = np.maximum(deep2, 0.5 * np.minimum(np.minimum(a2, b2), c2))
        rcs = np.maximum(SKIN_REFLECTION * np.pi * a2 * b2 * c2 / deep2**2, self.floor_m2)
        rcs = self.scale * self.gain * rcs * self.fluctuation.at(seen)
        return Points(pose.centre_m, rcs, np.minimum(np.sqrt(deep2), DEEPEST * distance))
