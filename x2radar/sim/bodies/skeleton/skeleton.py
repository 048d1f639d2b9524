"""Skeletons of people and four-legged animals: their parts, how large they are, how limbs lie.

A motion that knows joints gives both ends of every part (`Pose.between`). Where they come from is
its own affair: footfalls and inverse kinematics, joint angles, a recording.

Shares of people follow Winter (Biomechanics and Motor Control of Human Movement) and Boulic and
Thalmann 1990, both recalled. Statures: men 1.77 m, women 1.63 m, standard deviation 0.07 m
(recalled, NCD-RisC for Europe); toddlers of one to three years 0.75 to 0.95 m, children of
about three to eleven 0.95 to 1.45 m. Legs grow faster than trunk and head: from 0.82 of an
adult's share of the stature at 0.85 m over 0.92 at 1.05 m to all of it at 1.45 m (after the
ratio of sitting height to stature, 0.61, 0.56 and 0.52, recalled). The hip of an animal is
``0.155 M^0.35`` m high, times what animals differ by.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.skeleton.species import Species
from x2radar.sim.bodies.skins import THEORY, EchoGain
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


Link = tuple[Array, float]  # angle forward from the vertical (n_slow,), and length

_STRETCHED_TO = 0.995  # of a limb's length, at most: a straight joint would snap


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
    soft_from: float | None = None,
    slack_m: float = 1e-3,
) -> tuple[Array, Array]:
    """Return the middle joint of limbs of two links, and their other end as far as they reach.

    The end that stays, and where the other shall be, are of shape (..., 3); so is the side to
    which the middle joint bends. Both links keep their lengths, `near_m` at the fixed end. It
    reaches 0.995 of its length, or `soft_from` of it without giving and farther more and more
    slowly, up to a straight limb. Folded, its ends stay `slack_m` apart.
    """
    stiff_to = soft_from or _STRETCHED_TO
    reach = end_m - fixed_m
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    whole = near_m + far_m
    span = np.clip(distance, 1.05 * abs(near_m - far_m) + slack_m, stiff_to * whole)
    if soft_from:
        # All at once a joint would snap straight.
        over = np.maximum(distance / whole - stiff_to, 0.0) / (1.0 - stiff_to)
        span = span + (1.0 - stiff_to) * whole * np.tanh(over)
    unit = reach / np.maximum(distance, 1e-6)
    along = (near_m**2 - far_m**2 + span**2) / (2.0 * span)
    aside = np.sqrt(np.maximum(near_m**2 - along**2, 0.0))
    away = bend - (bend * unit).sum(axis=-1, keepdims=True) * unit
    out = away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-6)
    return fixed_m + along * unit + aside * out, fixed_m + span * unit


def hang(
    top_m: Array, yaw_rad: Array, *links: Link, splays_rad: Sequence[float] = (0.0, 0.0, 0.0)
) -> list[Array]:
    """Return the joints, (n_slow, 3) each, of up to three links that hang from `top_m`."""
    ahead, left = direction(yaw_rad), direction(yaw_rad + 0.5 * np.pi)
    down = np.array([0.0, 0.0, -1.0])
    joints = [top_m]
    for (angle_rad, length_m), splay_rad in zip(links, splays_rad, strict=False):
        cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
        link = np.cos(splay_rad) * (cos * down + sin * ahead) + np.sin(splay_rad) * left
        joints.append(joints[-1] + length_m * link)
    return joints


_STATURE_M = (0.6, 2.3)  # that a scene may ask for: beyond, shares of the stature hold no more
_SMALL_M = {"toddler": (0.75, 0.95), "child": (0.95, 1.45)}
Age = Literal["adult", "child", "toddler"]
_GROWN: Mapping[Age, float] = {"toddler": 0.0, "adult": 1.0}
_GROWTH = (0.85, 1.05, 1.45), (0.0, 0.55, 1.0)  # statures of children, toddler (0) to adult (1)


def _limbs(side: str) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    s = side[0]
    arm = (
        Part(f"{side} upper arm", (f"{s}_shoulder", f"{s}_elbow"), (0.027, 0.027)),
        Part(f"{side} forearm", (f"{s}_elbow", f"{s}_wrist"), (0.022, 0.022)),
        Part(f"{side} hand", (f"{s}_wrist", f"{s}_hand"), (0.012, 0.022), 0.05, is_flesh=False),
    )
    leg = (
        Part(f"{side} thigh", (f"{s}_hip", f"{s}_knee"), (0.043, 0.043)),
        Part(f"{side} shank", (f"{s}_knee", f"{s}_ankle"), (0.030, 0.030)),
        Part(f"{side} foot", (f"{s}_ankle", f"{s}_toe"), (0.026, 0.020), is_flesh=False),
    )
    return arm, leg


(_LEFT_ARM, _LEFT_LEG), (_RIGHT_ARM, _RIGHT_LEG) = _limbs("left"), _limbs("right")
PERSON = Skeleton(
    parts=(
        # From the lower end of the pelvis to the upper one of the chest.
        Part("trunk", ("pelvis", "head"), (0.100, 0.065), 0.18),
        Part("chest", ("chest", "head"), (0.100, 0.065), 0.09),
        Part("pelvis", ("pelvis", "spine"), (0.095, 0.065), 0.06),
        Part("head", ("head", "head_top"), (0.045, 0.052), 0.065, is_flesh=False),
        *(*_LEFT_ARM, *_RIGHT_ARM, *_LEFT_LEG, *_RIGHT_LEG),
    ),
    left=("r_hip", "l_hip"),
    n_trunk=3,
    gain=EchoGain(losses=(((0, 1, 2), 10.0),)),
)
"""Parts of people; sizes in shares of the stature."""
TRUNK_AT = (0.47, 0.78, 0.06)  # middles of its parts, hips (0) to shoulders (1) (Winter)


class PersonBuild:
    """One person's sizes, in metres, about their shares of the stature; or SceneError."""

    def __init__(
        self, rng: np.random.Generator, *, age: Age = "adult", height_m: float | None = None
    ) -> None:
        is_man, z, share = rng.random(), rng.standard_normal(10), rng.random()
        stature = float(np.clip((1.77 if is_man < 0.5 else 1.63) + 0.07 * z[0], 1.45, 2.05))
        if age != "adult":
            low_m, high_m = _SMALL_M[age]
            stature = low_m + share * (high_m - low_m)
        if height_m is not None:
            Key(*_STATURE_M).judge(height_m, "height_m")
            stature = height_m
        limbs = 1 + 0.03 * z[1:9].clip(-2.5, 2.5)
        growth = _GROWN[age] if age != "child" else float(np.interp(stature, *_GROWTH))
        legs = (1 - 0.18 * (1 - growth)) * stature
        trunk = (1 + 0.12 * (1 - growth)) * stature
        self.stature_m: float = stature  # height of the whole body
        self.thigh_m: float = 0.245 * legs * limbs[0]
        self.shank_m: float = 0.246 * legs * limbs[1]
        self.foot_m: float = 0.143 * stature * limbs[2]
        self.ankle_m: float = 0.039 * stature  # height over the sole
        # Half the width of the hips, and that of the shoulders.
        self.hip_m: float = 0.0955 * stature * limbs[3] * 0.8
        self.shoulder_m: float = 0.13 * stature * limbs[4]
        self.trunk_m: float = 0.288 * trunk * limbs[5]  # from hips to shoulders
        self.neck_m: float = 0.13 * trunk * limbs[6]  # from shoulders to the middle of the head
        self.upper_arm_m: float = 0.188 * stature * limbs[7]
        self.forearm_m: float = 0.152 * stature * limbs[7]
        # Thickness against an average body of this stature.
        self.girth = float(np.exp(0.10 * z[9].clip(-2.5, 2.5)))
        self.leg_m: float = self.thigh_m + self.shank_m  # from hip to ankle
        # Of the hips over the floor with straight legs: 0.53 of the stature.
        self.hip_height_m: float = self.leg_m + self.ankle_m

    def half_lengths(self) -> Array:
        """Return half-lengths of the parts, shape (16, 3): along, to the side, across."""
        arm = [self.upper_arm_m, self.forearm_m, 0.0]
        leg = [self.thigh_m, self.shank_m, self.foot_m]
        return PERSON.half_m([0.0] * 4 + 2 * arm + 2 * leg, self.stature_m, self.girth)


LEGS = ("left hind", "left fore", "right hind", "right fore")
ENDS = np.array([-1.0, 1.0, -1.0, 1.0])
"""At which end of the trunk each of `LEGS` is: 1 at the shoulder."""
SIDES = np.array([1.0, 1.0, -1.0, -1.0])  # on which side: 1 on the left
_JOINTS = {
    "left hind": ("HL_hip", "HL_knee", "HL_hock", "HL_paw"),
    "left fore": ("FL_shoulder", "FL_elbow", "FL_carpus", "FL_paw"),
    "right hind": ("HR_hip", "HR_knee", "HR_hock", "HR_paw"),
    "right fore": ("FR_shoulder", "FR_elbow", "FR_carpus", "FR_paw"),
}
_LEG_GIRTHS = {"upper leg": 0.068, "lower leg": 0.032, "paw": 0.046}
QUADRUPED = Skeleton(
    parts=(
        Part("trunk", ("pelvis", "withers"), (0.21, 0.25), 0.63),
        Part("chest", ("spine", "withers"), (0.20, 0.25), 0.24),
        Part("rump", ("pelvis", "spine"), (0.19, 0.21), 0.20),
        Part("neck", ("withers", "head"), (0.115, 0.115)),
        Part("head", ("head", "nose"), (0.147, 0.147)),
        Part("tail base", ("pelvis", "tail1"), (0.025, 0.025)),
        Part("tail middle", ("tail1", "tail2"), (0.025, 0.025)),
        Part("tail tip", ("tail2", "tail3"), (0.025, 0.025)),
        *(
            Part(f"{leg} {name}", (joints[k], joints[k + 1]), (girth, girth))
            for leg, joints in _JOINTS.items()
            for k, (name, girth) in enumerate(_LEG_GIRTHS.items())
        ),
    ),
    left=("HR_hip", "HL_hip"),
    n_trunk=3,
    # Legs are slender, and a recorded dog shows less of its tail, shanks and paws than of its
    # thighs.
    gain=EchoGain(
        max_power=0.0, losses=(((0, 1, 2), 5.0), ((5, 6, 7, 9, 10, 12, 13, 15, 16, 18, 19), 10.0))
    ),
)
"""Parts of four-legged animals; sizes in heights of the hip, those of a medium dog."""


class QuadrupedBuild:
    """Sizes of an animal, in metres but for its mass; SceneError if `mass_kg` is impossible."""

    def __init__(
        self, rng: np.random.Generator, species: Species, mass_kg: float | None = None
    ) -> None:
        drawn = species.mass_kg(rng)
        self.mass_kg = kg = drawn if mass_kg is None else mass_kg
        Key(*species.possible_kg).judge(kg, "mass_kg")
        self.hip_m = hip = 0.155 * kg**0.35 * species.tall(rng)  # height of the hip, standing
        self.back_m = hip * rng.uniform(*species.back)  # from hip to shoulder
        depth_over_width = rng.uniform(1.1, 1.3)
        # Volume of an ellipsoid; its first half-length is the trunk's of `half_lengths`.
        section = species.trunk_share * kg / 1000.0 / (4.0 / 3.0 * np.pi * 0.58 * self.back_m)
        self.half_width_m = float(np.sqrt(section / depth_over_width))  # of the trunk
        self.half_depth_m = depth_over_width * self.half_width_m
        leg = hip * species.leg
        # Links of a leg; both together are longer than `hip_m`.
        self.upper_m = leg * rng.uniform(0.46, 0.50)
        self.lower_m = leg - self.upper_m
        self.neck_m = hip * rng.uniform(*species.neck)
        self.head_m = hip * rng.uniform(*species.head)
        self.tail_m = hip * rng.uniform(*species.tail)
        # Length of a paw; its middle is half its height over the sole.
        self.paw_m = hip * rng.uniform(*species.paw)
        # Half the distance between left and right feet.
        self.half_track_m = self.half_width_m * rng.uniform(0.6, 0.9)

    def half_lengths(self) -> list[tuple[float, float, float]]:
        """Return half-lengths of the parts of `QUADRUPED`: along, to the side, across."""
        w, d = self.half_width_m, self.half_depth_m
        thick = 0.045 * self.hip_m
        tail = (self.tail_m / 6, 0.025 * self.hip_m, 0.025 * self.hip_m)
        leg = [
            (0.5 * self.upper_m, 1.5 * thick, 1.5 * thick),
            (0.5 * self.lower_m, 0.7 * thick, 0.7 * thick),
            (0.5 * self.paw_m, 0.3 * self.paw_m, 0.3 * self.paw_m),
        ]
        return [
            (0.58 * self.back_m, w, d),
            (0.95 * d, 0.95 * w, d),
            (0.8 * d, 0.9 * w, 0.85 * d),
            (0.55 * self.neck_m, 0.55 * w, 0.55 * w),
            (0.5 * self.head_m, 0.3 * self.head_m, 0.3 * self.head_m),
            *(tail,) * 3,
            *leg * 4,
        ]
