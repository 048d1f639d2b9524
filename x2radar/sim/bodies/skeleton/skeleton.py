"""The table of a kind's parts: their names, joints and girths.

A motion that knows joints gives both ends of every part (`Pose.between`). Where they come from is
its own affair: footfalls and inverse kinematics, joint angles, a recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.pose import Ends
from x2radar.sim.bodies.skins.base import THEORY, EchoGain
from x2radar.sim.points import Array


@dataclass(frozen=True, slots=True)
class Part:
    """A segment of a body; sizes are shares of the body's size: stature, or height of the hip."""

    name: str
    joints: tuple[str, str]  # standard joints where it begins and ends, as recordings have them
    half_girth: tuple[float, float]  # half-widths to the side and across
    half_length: float = 0.0  # of parts that are longer than from joint to joint; 0: half of that
    is_flesh: bool = True  # whether it is thicker on stout bodies


@dataclass(frozen=True, slots=True)
class Skeleton:
    """A kind of body."""

    parts: tuple[Part, ...]
    left: tuple[str, str] | None = None  # joints on the right and on the left of the hips
    n_trunk: int = 1  # so many parts, from the first on, are the trunk
    gain: EchoGain = THEORY  # how strong parts echo against theory

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts."""
        return tuple(part.name for part in self.parts)

    def ends(self, joints: Mapping[str, Array]) -> list[Ends]:
        """Return the ends of all parts, from joints of shape (n_slow, 3)."""
        return [(joints[begin], joints[end]) for begin, end in (p.joints for p in self.parts)]

    def half_m(
        self, length_m: Sequence[float] | Array, size_m: float, girth: float = 1.0
    ) -> Array:
        """Return half-lengths of the parts, shape (n_parts, 3): along, to the side, across.

        `length_m` is from joint to joint, `girth` the thickness against an average body.
        """
        rows = []
        for part, length in zip(self.parts, length_m, strict=True):
            thick = girth if part.is_flesh else 1.0
            side, across = (share * size_m * thick for share in part.half_girth)
            rows.append((part.half_length * size_m or length / 2, side, across))
        return np.array(rows)
