"""Constant scatterers along the segments: the model of the first micro-Doppler studies.

Chen (The Micro-Doppler Effect in Radar) and the thesis put one scatterer of constant cross section
on each body part; here there may be several, off the axis, with drawn weights.
"""

import numpy as np

from x2radar.sim.bodies.skins.base import SKIN_REFLECTION, EchoGain, Skin
from x2radar.sim.points import Array, Points, Pose

_COUNTS = ((0.3, (1, 1)), (0.65, (3, 8)), (1.0, (1, 4)))
"""Scatterers a segment, fewest and most, of bodies up to a cumulated share: studies have
one to eight."""
_MAX_SPREAD_DB = 6.0  # largest spread of the weights within a body, twice that of the other skins
_AREA_POWER = (0.0, 1.6)
"""Weights go with a segment's area to a power between: from limbs as strong as the trunk,
as the first studies have them, to a trunk that outshines all else."""


class PointSkin(Skin):
    """A skin of scatterers whose cross sections stay as they were drawn.

    Their weights follow the segments' areas to a drawn power.
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
