"""People by the first generator, on two feet or on hands and knees: limbs reach for footfalls.

The ball of a standing foot does not move; the heel rises over it in the last third of the stance.
Knees and elbows follow by two-link inverse kinematics.

Walking follows Boulic and Thalmann 1990 (recalled): with the speed RV relative to the hip
height Ht, the stride is 1.346 sqrt(RV) Ht and the period 1.346 / sqrt(RV) seconds, the
support 0.752 periods - 0.143 s. Running: strides of 1.3 to 1.6 a second, with a flight.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from x2radar.sim.bodies.motion.people.doing import DOERS, Doing
from x2radar.sim.bodies.motion.people.footfalls import SIDES
from x2radar.sim.bodies.path.feet import Feet, FootState, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.skeleton import TRUNK_AT, Age, PersonBuild, direction, two_links
from x2radar.sim.bodies.wander import Wander, smooth_step
from x2radar.sim.points import UP, Array, Ends, Motion, Pose, rod

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


_STIFF_TO = 0.93  # share of a limb's length up to which it reaches; beyond, its upper joint gives
_HEEL_OFF = 0.65  # share of the stance after which the heel rises: 40 % of a stride (Perry)
_KNEE_M = 0.06  # height of a kneeling knee's middle (recalled)
_FACE = 0.015  # of the stature: the head's middle ahead of the neck


@dataclass(frozen=True, slots=True, eq=False)
class _Hips:
    """Place of the middle of the hips, and the body's heading."""

    middle_m: Array  # (n_slow, 3): middle between the hip joints
    heading_rad: Array  # (n_slow,): where the body faces
    yaw_rad: Array  # (n_slow,): turn of the pelvis against that; the chest turns the other way
    vigour: Array  # (n_slow,): 0 standing to 1 at cruising speed
    swing: Array  # (n_slow,): -1 to 1: 1 when the left leg is foremost
    lean_rad: Array  # (n_slow,): of the trunk, forward
    look_rad: Array  # (n_slow, 2): turn and nod of the head


class OnFeet:
    """A person who walks a path on two feet and stands where it stops; a `Motion`."""

    def __init__(
        self,
        rng: np.random.Generator,
        style: PersonStyle,
        path: Path,
        build: PersonBuild,
        traits: Traits,
    ) -> None:
        gait, cruise = gait_of(style, build, traits), max(path.cruise_mps, 0.1)
        self.path, self.build, self.cruise_mps = path, build, cruise
        self.feet = Feet(path, gait)
        self.carriage = carriage_of(style, build, cruise, traits[0])
        self.duty = float(gait.duty(np.array([cruise]))[0])
        # Of the hips ahead, aside and up, in metres, and turn and nod of the head.
        limits = (0.02, 0.015, 0.004, 0.5, 0.15)
        self.sway = Wander(rng, limits, [0.012, 0.010, 0.003, 0.10, 0.05])
        # What is done besides.
        self.doer = DOERS[style.does](rng, build.leg_m) if style.does else None

    def __call__(self, t_s: Array) -> Pose:
        b, c = self.build, self.carriage
        state, feet = self.path.at(t_s), self.feet.at(t_s)
        strides = self.feet.clock.at(t_s)
        vigour = np.minimum(state.speed_mps / self.cruise_mps, 1.0)
        middle_stance = strides - 0.5 * self.duty
        bob = np.cos(4 * np.pi * middle_stance)
        # Long steps lower the hips.
        rate_hz = float(self.feet.clock.rate_hz.max(initial=0.0))
        step_m = 0.25 * vigour * self.cruise_mps / max(rate_hz, 0.1)
        straight = np.sqrt(np.maximum(b.leg_m**2 - (0.8 * step_m) ** 2, 0.3 * b.leg_m**2))
        sway = self.sway.at(t_s)
        ahead = sway[:, 0] - c.surge_m * vigour * np.sin(4 * np.pi * middle_stance)
        aside = c.sway_m * vigour * np.cos(2 * np.pi * middle_stance) + sway[:, 1]
        bend, lean = np.full(len(t_s), c.bend), np.full(len(t_s), c.lean_rad)
        heading, up, look = state.heading_rad, sway[:, 2], sway[:, 3:5]
        cos, sin = np.cos(heading), np.sin(heading)
        doing = self.doer(t_s, vigour) if self.doer else None
        if doing:
            bend, lean, look = bend + doing.crouch, lean + doing.lean_rad, look + doing.look_rad
            ahead, aside = ahead + doing.shift_m[:, 0], aside + doing.shift_m[:, 1]
            up = up + doing.shift_m[:, 2]
            on, left, lift = np.moveaxis(doing.feet_m, -1, 0)
            by = (on * cos[:, None] - left * sin[:, None], on * sin[:, None] + left * cos[:, None])
            feet = replace(feet, position_m=feet.position_m + np.stack([*by, lift], axis=-1))
        height = b.ankle_m + (1 - bend) * straight + c.bob_m * vigour * bob
        x_m = state.x_m - aside * sin + ahead * cos
        y_m = state.y_m + aside * cos + ahead * sin
        middle = np.stack([x_m, y_m, height + up], axis=-1)
        swing = np.cos(2 * np.pi * strides)
        hips = _Hips(middle, heading, -c.yaw_rad * vigour * swing, vigour, swing, lean, look)
        return self._upright(hips, feet, doing)

    def _upright(self, hips: _Hips, feet: FootState, doing: Doing | None) -> Pose:
        b, look = self.build, hips.look_rad
        spine = direction(hips.heading_rad, np.pi / 2 - hips.lean_rad)
        nape = hips.middle_m + b.trunk_m * spine
        gaze = hips.heading_rad + look[:, 0]
        head = direction(gaze, np.pi / 2 - 0.5 * hips.lean_rad + look[:, 1])
        face = direction(gaze, -0.5 * hips.lean_rad + look[:, 1])
        # The chest turns against the pelvis.
        facing = hips.heading_rad - hips.yaw_rad + (doing.twist_rad if doing else 0.0)
        ends = [
            *(rod(hips.middle_m + along * b.trunk_m * spine, spine) for along in TRUNK_AT),
            rod(nape + b.neck_m * head + _FACE * b.stature_m * face, head),
        ]
        for side in range(2):
            ends += self._arm(side, hips, nape, direction(facing + np.pi / 2), doing)
        ends += self._legs(hips, feet)
        return Pose.between(ends, direction(hips.heading_rad + np.pi / 2)[:, None])

    def _arm(
        self, side: int, hips: _Hips, nape: Array, left: Array, doing: Doing | None
    ) -> list[Ends]:
        b, c, sign = self.build, self.carriage, SIDES[side]
        down = -np.pi / 2 - hips.lean_rad * 0.3
        shoulder = nape + (sign * b.shoulder_m) * left
        # Arms go against the legs of their side.
        swing = -sign * c.arm_rad * hips.vigour * hips.swing
        upper = direction(hips.heading_rad, down + c.arm_rest_rad + swing)
        bend = c.elbow_rad * (0.6 + 0.4 * hips.vigour) + 0.35 * np.maximum(swing, 0.0)
        fore = direction(hips.heading_rad, down + c.arm_rest_rad + swing + bend)
        # A little away from the body.
        upper = upper + (0.12 * sign) * left
        upper /= np.sqrt((upper * upper).sum(axis=-1, keepdims=True))
        elbow = shoulder + b.upper_arm_m * upper
        wrist = elbow + b.forearm_m * fore
        if doing:
            ahead = np.stack([left[:, 1], -left[:, 0], left[:, 2]], axis=-1)
            along, out, high = (b.upper_arm_m + b.forearm_m) * doing.hands[:, side].T[..., None]
            at_work = shoulder + along * ahead + out * left + high * UP
            wrist += doing.share[:, None] * (at_work - wrist)
            away = _elbow_way(wrist - shoulder, ahead + (0.4 * sign) * left - 0.3 * UP)
            elbow, shoulder = _reach(wrist, shoulder, b.forearm_m, b.upper_arm_m, away)
            fore = (wrist - elbow) / b.forearm_m
        return [(shoulder, elbow), (elbow, wrist), (wrist, wrist + 0.1 * b.stature_m * fore)]

    def _legs(self, hips: _Hips, feet: FootState) -> list[Ends]:
        b = self.build
        toes = direction(feet.heading_rad)
        sole = 0.7 * b.foot_m
        # The heel's rise grows to its most at toe-off; in the swing it goes back.
        push = smooth_step((feet.phase / feet.duty - _HEEL_OFF) / (1 - _HEEL_OFF))
        back_again = 1.0 - smooth_step(feet.swing / 0.55)
        rise = self.carriage.heel_rad * np.where(feet.swing == 0, push, back_again)
        rise = rise * hips.vigour[:, None]
        back = -np.cos(rise)[..., None] * toes
        back[..., 2] += np.sin(rise)
        ankle = feet.position_m + sole * back
        ankle[..., 2] += b.ankle_m
        left = direction(hips.heading_rad + hips.yaw_rad + np.pi / 2)
        joint = hips.middle_m[:, None] + b.hip_m * np.array(SIDES)[:, None] * left[:, None]
        forward = direction(hips.heading_rad)[:, None]
        knee, top = _reach(ankle, joint, b.shank_m, b.thigh_m, forward)
        foot = feet.position_m + 0.45 * sole * back
        foot[..., 2] += 0.5 * b.ankle_m
        ends: list[Ends] = []
        for k in range(2):
            ends += [(knee[:, k], top[:, k]), (ankle[:, k], knee[:, k])]
            ends.append(rod(foot[:, k], -back[:, k]))
        return ends


def _elbow_way(arm: Array, fore: Array) -> Array:
    """Return where an elbow bends to: down if the arm points along `fore`, else turned with it."""
    fore = fore / np.sqrt((fore * fore).sum(axis=-1, keepdims=True))
    down = -UP + fore[:, 2:] * fore
    arm = arm / np.maximum(np.sqrt((arm * arm).sum(axis=-1, keepdims=True)), 1e-6)
    cosine = np.maximum(1.0 + (fore * arm).sum(axis=-1, keepdims=True), 1e-6)
    return np.asarray(down - (down * arm).sum(axis=-1, keepdims=True) / cosine * (fore + arm))


def _reach(
    fixed: Array, joint: Array, lower_m: float, upper_m: float, bend: Array
) -> tuple[Array, Array]:
    """Return middle and upper joint of a limb whose end is fixed: its upper joint gives."""
    slack = 0.15 * upper_m
    return two_links(fixed, joint, lower_m, upper_m, bend, soft_from=_STIFF_TO, slack_m=slack)


def draw_crawling(rng: np.random.Generator, path: Path, b: PersonBuild, traits: Traits) -> Motion:
    """Draw somebody who crawls, knees with opposite hands (Patrick et al. 2009, recalled)."""
    z, share = traits
    width = (0.10 + 0.05 * share[0]) * b.stature_m / 1.75
    reach, cadence = 0.45 * b.trunk_m, 1 + 0.08 * z[6]
    knee_m, hand_m = (-reach, width), (reach, 1.2 * width)
    stride = 0.75 * b.hip_height_m / cadence
    gait = Gait(
        # Left knee, left hand, right knee, right hand.
        offset=(0.0, 0.58, 0.5, 0.08),
        home_m=(knee_m, hand_m, (knee_m[0], -knee_m[1]), (hand_m[0], -hand_m[1])),
        stride_m=lambda v: stride * np.sqrt(v / 0.5),
        duty=lambda v: np.full(len(v), 0.62),
        lift_m=(0.03, 0.08, 0.03, 0.08),
    )
    # Of the trunk, in metres, and turn and nod of the head, in radians.
    wander = Wander(rng, [0.01, 0.01, 0.01, 0.4, 0.2], np.full(5, 0.05))
    cruise_mps, feet = max(path.cruise_mps, 0.05), Feet(path, gait)
    roll_m = 0.02 + 0.03 * share[1]  # amplitude of the trunk to the sides, once a stride

    def pose(t_s: Array) -> Pose:
        state = path.at(t_s)
        strides = feet.clock.at(t_s)
        vigour = np.minimum(state.speed_mps / cruise_mps, 1.0)
        sway, heading = wander.at(t_s), state.heading_rad
        left = direction(heading + np.pi / 2)
        aside = roll_m * vigour * np.sin(2 * np.pi * strides) + sway[:, 1]
        hip_height = 0.95 * b.thigh_m + _KNEE_M
        shoulder_height = 0.93 * (b.upper_arm_m + b.forearm_m)
        lift = 0.012 * vigour * np.cos(4 * np.pi * strides)
        pitch = np.arcsin(np.clip((shoulder_height - hip_height) / b.trunk_m, -0.5, 0.5))
        spine = direction(heading, pitch)
        middle = np.stack([state.x_m, state.y_m, np.zeros_like(heading)], axis=-1)
        middle = middle + aside[:, None] * left
        middle[:, 2] = 0.5 * (hip_height + shoulder_height) + lift + sway[:, 2]
        hips, nape = middle - 0.5 * b.trunk_m * spine, middle + 0.5 * b.trunk_m * spine
        head = direction(heading + sway[:, 3], 0.5 + sway[:, 4])
        ends = [
            *(rod(middle + (along - 0.5) * b.trunk_m * spine, spine) for along in TRUNK_AT),
            rod(nape + b.neck_m * head, head),
        ]
        ends += _limbs(b, feet.at(t_s).position_m, (hips, nape), heading)
        return Pose.between(ends, left[:, None])

    return pose


def _limbs(
    b: PersonBuild, contact: Array, trunk: tuple[Array, Array], heading: Array
) -> Iterator[Ends]:
    """Yield the ends of arms and legs between hips, nape and what is on the floor."""
    (hips, nape), forward = trunk, direction(heading)
    left = direction(heading + np.pi / 2)
    for k, side in enumerate(SIDES):
        hand = contact[:, 2 * k + 1] + np.array([0.0, 0.0, 0.03])
        joint = nape + side * b.shoulder_m * left
        elbow, top = _reach(hand, joint, b.forearm_m, b.upper_arm_m, -forward)
        yield from ((top, elbow), (elbow, hand), rod(hand, forward))
    for k, side in enumerate(SIDES):
        knee = contact[:, 2 * k] + np.array([0.0, 0.0, _KNEE_M])
        thigh = hips + side * b.hip_m * left - knee
        thigh *= b.thigh_m / np.maximum(np.linalg.norm(thigh, axis=-1, keepdims=True), 1e-6)
        # Shins lie on the floor behind the knees.
        ankle = knee - b.shank_m * forward
        yield from ((knee, knee + thigh), (ankle, knee), (ankle, ankle - 0.5 * b.foot_m * forward))
