"""How people put their feet: stride, duty factor, and what the body does over them.

Walking follows Boulic and Thalmann 1990 (recalled): with the speed RV relative to the hip
height Ht, the stride is 1.346 sqrt(RV) Ht and the period 1.346 / sqrt(RV) seconds, the
support 0.752 periods - 0.143 s. Running: strides of 1.3 to 1.6 a second, with a flight.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from x2radar.sim.bodies.path.feet import Gait
from x2radar.sim.bodies.skeleton.people import Age, PersonBuild
from x2radar.sim.points import Array

Traits = tuple[Array, Array]  # drawn whatever the style: 12 normal numbers and 8 shares

_STRIDE = 1.346
FASTEST_WALK = 3.0  # RV up to which the relation holds (Boulic and Thalmann, recalled)
_SURGE = 0.084  # of the hips, see `carriage_of`
_BRISK = 1.5  # relative speed of the carriage that a free walk has: about 1.4 m/s
_QUICKER: Mapping[Age, float] = {"adult": 1.0, "child": 1.1, "toddler": 1.35}
"""Cadence against that of an adult of the same leg length and speed (recalled)."""


@dataclass(frozen=True, slots=True)
class Carriage:
    """Lean, crouch and swing with which a body is carried over its feet."""

    bend: float = 0.012  # how much lower the hips are than on straight legs, as a share of the leg
    lean_rad: float = 0.05  # of the trunk, forward
    # Of the hips, up and down twice a stride, at cruising speed: highest over the standing foot;
    # if negative, as in running, lowest.
    bob_m: float = 0.022
    sway_m: float = 0.02  # and to the sides, once a stride
    surge_m: float = 0.0  # and ahead of their even way: slowest over the standing foot
    arm_rad: float = 0.40  # amplitude of the arms' swing
    arm_rest_rad: float = 0.05  # about which the arms swing, forward
    elbow_rad: float = 0.45  # bend of the elbows
    yaw_rad: float = 0.12  # amplitude of the pelvis' turn; the chest turns against it
    heel_rad: float = 0.9  # how far the heel has risen at toe-off


@dataclass(frozen=True, slots=True)
class PersonStyle:
    """How a style of people moves: speed, carriage and what it does besides."""

    speed_mps: tuple[float, float] | None  # None for a body that stays in place
    carriage: Carriage = Carriage()
    lift: float = 0.06  # of the feet, as a share of the stature
    kind: Literal["walk", "run", "crawl"] = "walk"
    stops: bool = False
    grows: bool = False  # whether bob, arms and pelvis move more the faster it goes
    limps: bool = False
    age: Age = "adult"
    does: Literal["", "busy", "sit", "exercise"] = ""  # besides going, or instead


STYLES: Mapping[str, PersonStyle] = {
    "walk": PersonStyle((0.7, 1.7), grows=True),
    "stroll": PersonStyle((0.3, 0.8), grows=True),
    "stealth": PersonStyle(
        (0.2, 0.5),
        Carriage(bend=0.10, lean_rad=0.25, arm_rad=0.08, elbow_rad=0.9, bob_m=0.008),
        lift=0.10,
    ),
    "crouch": PersonStyle(
        (0.3, 1.0), Carriage(bend=0.28, lean_rad=0.65, arm_rad=0.12, elbow_rad=1.0, bob_m=0.012)
    ),
    "jog": PersonStyle(
        (1.8, 2.8),
        Carriage(bend=0.07, lean_rad=0.10, bob_m=-0.035, arm_rad=0.5, elbow_rad=1.5, heel_rad=1.1),
        lift=0.16,
        kind="run",
    ),
    "run": PersonStyle(
        (2.8, 4.5),
        Carriage(bend=0.08, lean_rad=0.17, bob_m=-0.04, arm_rad=0.8, elbow_rad=1.6, heel_rad=1.2),
        lift=0.24,
        kind="run",
    ),
    "crawl": PersonStyle((0.2, 0.7), lift=0.04, kind="crawl"),
    "limp": PersonStyle((0.4, 1.0), Carriage(bob_m=0.03, sway_m=0.04), grows=True, limps=True),
    "carry": PersonStyle(
        (0.5, 1.4), Carriage(arm_rad=0.03, arm_rest_rad=0.35, elbow_rad=1.5, lean_rad=-0.04)
    ),
    "carry_pet": PersonStyle((0.5, 1.3), Carriage(arm_rad=0.03, arm_rest_rad=0.25, elbow_rad=1.8)),
    "toddler": PersonStyle(
        (0.3, 0.9),
        Carriage(bend=0.06, arm_rad=0.10, arm_rest_rad=0.5, elbow_rad=1.4),
        lift=0.08,
        age="toddler",
    ),
    "child": PersonStyle((0.4, 1.5), grows=True, age="child"),
    "child_run": PersonStyle(
        (1.3, 3.0),
        Carriage(bend=0.07, lean_rad=0.12, bob_m=-0.03, arm_rad=0.6, elbow_rad=1.3, heel_rad=1.1),
        lift=0.18,
        kind="run",
        age="child",
    ),
    "stop_and_go": PersonStyle((0.5, 1.3), stops=True, grows=True),
    "stand": PersonStyle(None),
    "busy": PersonStyle(None, does="busy"),
    "sit": PersonStyle(None, does="sit"),
    "exercise": PersonStyle(None, does="exercise"),
    "search": PersonStyle((0.4, 1.2), stops=True, grows=True, does="busy"),
}
"""What people do, by name; speeds and carriages by eye, where no source stands above."""


def carriage_of(style: PersonStyle, build: PersonBuild, speed_mps: float, z: Array) -> Carriage:
    """Return how a body is carried at a speed, with a manner of its own by normal numbers `z`.

    Boulic and Thalmann 1990 (recalled) let the bob (0.015 RV), the swing of the arms and the
    turn of the pelvis grow with the relative speed RV, and the surge of the hips be
    0.084 RV (1 - RV) of the hip height up to RV = 0.5 and 0.021 beyond. Somebody who goes at
    0.3 m/s does not swing the arms as at 1.4 m/s.
    """
    c, rv, size = style.carriage, speed_mps / build.hip_height_m, build.stature_m / 1.75
    slow = min(rv, 0.5)
    surge_m = build.hip_height_m * _SURGE * slow * (1 - slow) if style.kind == "walk" else 0.0
    share = min(rv / _BRISK, 1.3) if style.grows else 1.0
    return replace(
        c,
        bend=c.bend * float(np.exp(0.2 * z[0])),
        lean_rad=c.lean_rad + 0.03 * z[1],
        surge_m=surge_m * float(np.exp(0.2 * z[8])),
        bob_m=c.bob_m * share * size * float(np.exp(0.2 * z[2])),
        sway_m=c.sway_m * size * float(np.exp(0.2 * z[3])),
        arm_rad=c.arm_rad * share * float(np.exp(0.35 * z[4])),
        elbow_rad=c.elbow_rad * float(np.exp(0.2 * z[5])),
        yaw_rad=c.yaw_rad * share * float(np.exp(0.25 * z[7])),
    )


def gait_of(style: PersonStyle, build: PersonBuild, traits: Traits) -> Gait:
    """Return the footwork of somebody who walks or runs."""
    z, share = traits
    h, toe_m = build.hip_height_m, 0.45 * build.foot_m
    cadence = float(_QUICKER[style.age] * (1 + 0.06 * z[6]))
    width_m = (0.045 + 0.03 * share[0]) * (1.8 if style.age == "toddler" else 1.0)
    width_m = width_m * max(build.stature_m, 1.0) / 1.75 + 0.01
    lift_m = style.lift * build.stature_m * (0.7 + 0.6 * share[3])
    # The share that the right foot is spared.
    limp = 0.10 + 0.10 * share[2] if style.limps else 0.0

    def stride(v: Array) -> Array:
        if style.kind == "run":
            return v / (cadence * (1.22 + 0.07 * v))
        return np.asarray(_STRIDE * np.sqrt(v / h) * h / cadence)

    def duty(v: Array) -> Array:
        if style.kind == "run":
            return np.clip(0.47 - 0.045 * v, 0.25, 0.42)
        return np.clip(0.752 - 0.143 * np.sqrt(np.maximum(v / h, 0.02)) / _STRIDE, 0.55, 0.76)

    return Gait(
        offset=(0.0, 0.5 - limp / 2),
        home_m=((toe_m, width_m), (toe_m, -width_m)),
        stride_m=stride,
        duty=duty,
        lift_m=(lift_m, lift_m * (1 - 2 * limp)),
        more_duty=(limp / 2, -limp / 2),
        ramp=0.2,
    )
