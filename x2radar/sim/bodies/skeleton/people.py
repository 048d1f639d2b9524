"""Sizes of people: segment lengths in shares of the stature, and their spread.

Shares follow Winter (Biomechanics and Motor Control of Human Movement) and Boulic and
Thalmann 1990, both recalled. Statures: men 1.77 m, women 1.63 m, standard deviation 0.07 m
(recalled, NCD-RisC for Europe); toddlers of one to three years 0.75 to 0.95 m, children of
about three to eleven 0.95 to 1.45 m. Legs grow faster than trunk and head: from 0.82 of an
adult's share of the stature at 0.85 m over 0.92 at 1.05 m to all of it at 1.45 m (after the
ratio of sitting height to stature, 0.61, 0.56 and 0.52, recalled).
"""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.skeleton.skeleton import Part, Skeleton
from x2radar.sim.bodies.skins.base import EchoGain
from x2radar.sim.points import Array

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
