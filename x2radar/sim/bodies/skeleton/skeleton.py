"""The table of a kind's parts: their names, joints and girths; and how limbs lie.

A motion that knows joints gives both ends of every part (`Pose.between`). Where they come from is
its own affair: footfalls and inverse kinematics, joint angles, a recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.skins.base import THEORY, EchoGain
from x2radar.sim.points import Array, Ends


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
    """Parts of one kind of body, between named joints, and how strong they echo."""

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
        """Return half-lengths of the parts, shape (n_parts, 3): along, to the side, across."""
        rows = []
        for part, length in zip(self.parts, length_m, strict=True):
            thick = girth if part.is_flesh else 1.0
            side, across = (share * size_m * thick for share in part.half_girth)
            rows.append((part.half_length * size_m or length / 2, side, across))
        return np.array(rows)


Link = tuple[Array, float, float]  # angle forward from the vertical (n_slow,), length, splay

STRETCHED_TO = 0.995  # of a limb's length, at most: a straight joint would snap


def direction(yaw_rad: Array, pitch_rad: Array | float = 0.0) -> Array:
    """Return unit vectors, shape (..., 3), of a yaw and an upward pitch."""
    pitch = np.broadcast_to(np.asarray(pitch_rad, np.float64), yaw_rad.shape)
    level = np.cos(pitch)
    return np.stack([level * np.cos(yaw_rad), level * np.sin(yaw_rad), np.sin(pitch)], axis=-1)


def two_links(
    fixed_m: Array,
    end_m: Array,
    near_m: float,
    far_m: float,
    bend: Array,
    *,
    stiff_to: float,
    slack_m: float = 1e-3,
    is_soft: bool = True,
) -> tuple[Array, Array]:
    """Return the middle joint of limbs of two links, and their other end as far as they reach.

    The end that stays, and where the other shall be, are of shape (..., 3); so is the side to
    which the middle joint bends. Both links keep their lengths, `near_m` at the fixed end. It
    reaches `stiff_to` of its length without giving; beyond, farther more and more slowly, up to a
    straight limb, if it is soft, or not at all. Folded, its ends stay `slack_m` apart.
    """
    reach = end_m - fixed_m
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    whole = near_m + far_m
    span = np.clip(distance, 1.05 * abs(near_m - far_m) + slack_m, stiff_to * whole)
    if is_soft:
        # All at once a joint would snap straight.
        over = np.maximum(distance / whole - stiff_to, 0.0) / (1.0 - stiff_to)
        span = span + (1.0 - stiff_to) * whole * np.tanh(over)
    unit = reach / np.maximum(distance, 1e-6)
    along = (near_m**2 - far_m**2 + span**2) / (2.0 * span)
    aside = np.sqrt(np.maximum(near_m**2 - along**2, 0.0))
    away = bend - (bend * unit).sum(axis=-1, keepdims=True) * unit
    middle = (
        fixed_m
        + along * unit
        + aside * (away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-6))
    )
    return middle, fixed_m + span * unit


def hang(top_m: Array, yaw_rad: Array, *links: Link) -> list[Array]:
    """Return the joints, (n_slow, 3) each, of a chain of links that hangs from `top_m`."""
    ahead, left = direction(yaw_rad), direction(yaw_rad + 0.5 * np.pi)
    down = np.array([0.0, 0.0, -1.0])
    joints = [top_m]
    for angle_rad, length_m, splay_rad in links:
        cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
        link = np.cos(splay_rad) * (cos * down + sin * ahead) + np.sin(splay_rad) * left
        joints.append(joints[-1] + length_m * link)
    return joints
