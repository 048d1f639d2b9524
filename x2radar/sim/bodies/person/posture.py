"""The skeleton of a person: trunk and arms over legs that reach for their footfalls.

The feet stand where the plan says; the ball of a standing foot does not move. The heel rises
over it in the last third of the stance, so the ankle is still from foot-flat to heel-off. Knees
and elbows follow by two-link inverse kinematics, knees bending forward and elbows
backward where arms hang.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import smooth_step
from x2radar.sim.bodies.path.feet import FootState
from x2radar.sim.bodies.person.build import ARMS, LEGS, NAMES, TRUNK_AT, PersonBuild
from x2radar.sim.bodies.person.doing import Doing
from x2radar.sim.bodies.person.gait import Carriage

Array = NDArray[np.float64]

HEEL_OFF = 0.65
"""Share of the stance after which the heel begins to rise: 40 % of a walking stride (Perry)."""
_FACE = 0.015
"""Share of the stature by which the head's middle is ahead of the neck: one that turns moves
its echo (chosen)."""
STIFF_TO = 0.93
"""Share of a limb's length up to which it reaches; beyond, its upper joint gives (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Soles:
    """Feet at given times, left and right."""

    state: FootState  # `position_m` is the ball of the foot
    duty: Array  # (n_slow, 2): duty factor of the stride that each foot is in


def moved(soles: Soles, heading_rad: Array, feet_m: Array) -> Soles:
    """Return feet moved ahead, to the left and up, shape (n_slow, 2, 3), in metres."""
    cos, sin = np.cos(heading_rad)[:, None], np.sin(heading_rad)[:, None]
    ahead, left, up = np.moveaxis(feet_m, -1, 0)
    by = np.stack([ahead * cos - left * sin, ahead * sin + left * cos, up], axis=-1)
    return replace(soles, state=replace(soles.state, position_m=soles.state.position_m + by))


@dataclass(frozen=True, slots=True, eq=False)
class Hips:
    """Where the middle of the hips is, and how the body is turned."""

    middle_m: Array  # (n_slow, 3): middle between the hip joints
    heading_rad: Array  # (n_slow,): where the body faces
    yaw_rad: Array  # (n_slow,): turn of the pelvis against that; the chest turns the other way
    vigour: Array  # (n_slow,): 0 standing to 1 at cruising speed
    swing: Array  # (n_slow,): -1 to 1: 1 when the left leg is foremost
    lean_rad: Array  # (n_slow,): of the trunk, forward


def direction(yaw_rad: Array, pitch_rad: Array | float = 0.0) -> Array:
    """Return unit vectors, shape (..., 3)."""
    pitch = np.broadcast_to(np.asarray(pitch_rad, np.float64), yaw_rad.shape)
    level = np.cos(pitch)
    return np.stack([level * np.cos(yaw_rad), level * np.sin(yaw_rad), np.sin(pitch)], axis=-1)


def upright(
    b: PersonBuild,
    c: Carriage,
    hips: Hips,
    feet: Soles,
    look: Array,
    *,
    doing: Doing | None = None,
) -> tuple[Array, Array, Array]:
    """Return middles, axes and side vectors of all parts of somebody on two feet.

    `look` is turn and nod of the head, shape (n_slow, 2), in radians; without `doing` the arms
    swing. Shapes as `quadruped.posture`, parts in the order of `NAMES`.
    """
    n = len(hips.heading_rad)
    centre, axis = np.empty((n, len(NAMES), 3)), np.empty((n, len(NAMES), 3))
    left = direction(hips.heading_rad + np.pi / 2)
    spine = direction(hips.heading_rad, np.pi / 2 - hips.lean_rad)
    axis[:, :3] = spine[:, None]
    for k, along in enumerate(TRUNK_AT):
        centre[:, k] = hips.middle_m + along * b.trunk_m * spine
    nape = hips.middle_m + b.trunk_m * spine
    head = direction(hips.heading_rad + look[:, 0], np.pi / 2 - 0.5 * hips.lean_rad + look[:, 1])
    face = direction(hips.heading_rad + look[:, 0], -0.5 * hips.lean_rad + look[:, 1])
    centre[:, 3], axis[:, 3] = nape + b.neck_m * head + _FACE * b.stature_m * face, head
    # The chest turns against the pelvis.
    facing = hips.heading_rad - hips.yaw_rad + (doing.twist_rad if doing else 0.0)
    chest_left = direction(facing + np.pi / 2)
    centre[:, ARMS], axis[:, ARMS] = _arms(b, c, hips, nape, chest_left, doing=doing)
    hip_left = direction(hips.heading_rad + hips.yaw_rad + np.pi / 2)
    centre[:, LEGS], axis[:, LEGS] = _legs(b, c, hips, feet, hip_left)
    return centre, axis, left[:, None]


def _arms(
    b: PersonBuild, c: Carriage, hips: Hips, nape: Array, left: Array, *, doing: Doing | None
) -> tuple[Array, Array]:
    n = len(nape)
    centre, axis = np.empty((n, 6, 3)), np.empty((n, 6, 3))
    down = -np.pi / 2 - hips.lean_rad * 0.3
    for side, sign in ((0, 1.0), (1, -1.0)):
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
            wrist += doing.share[:, None] * (_at_work(b, doing, shoulder, left, side) - wrist)
            shoulder, elbow = _elbow(b, shoulder, wrist, left, sign)
            upper, fore = (elbow - shoulder) / b.upper_arm_m, (wrist - elbow) / b.forearm_m
        k = 3 * side
        centre[:, k], axis[:, k] = 0.5 * (shoulder + elbow), upper
        centre[:, k + 1], axis[:, k + 1] = 0.5 * (elbow + wrist), fore
        centre[:, k + 2], axis[:, k + 2] = wrist + 0.05 * b.stature_m * fore, fore
    return centre, axis


def _at_work(b: PersonBuild, doing: Doing, shoulder: Array, left: Array, side: int) -> Array:
    """Return where a wrist is whose hand is at work."""
    ahead = np.stack([left[:, 1], -left[:, 0], left[:, 2]], axis=-1)
    along, outward, up = (b.upper_arm_m + b.forearm_m) * doing.hands[:, side].T[..., None]
    return np.asarray(shoulder + along * ahead + outward * left + up * np.array([0.0, 0.0, 1.0]))


def _elbow(
    b: PersonBuild, shoulder: Array, wrist: Array, left: Array, sign: float
) -> tuple[Array, Array]:
    """Return shoulder and elbow of an arm whose wrist is given.

    Before the body elbows point down. For other directions that turns with the arm by the
    shortest way: back where it hangs, ahead where it is raised, smooth all but behind the back.
    """
    ahead = np.stack([left[:, 1], -left[:, 0], left[:, 2]], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    fore = ahead + (0.4 * sign) * left - 0.3 * up
    fore /= np.sqrt((fore * fore).sum(axis=-1, keepdims=True))
    down = -up + fore[:, 2:] * fore
    arm = wrist - shoulder
    arm /= np.maximum(np.sqrt((arm * arm).sum(axis=-1, keepdims=True)), 1e-6)
    cosine = np.maximum(1.0 + (fore * arm).sum(axis=-1, keepdims=True), 1e-6)
    away = down - (down * arm).sum(axis=-1, keepdims=True) / cosine * (fore + arm)
    limb = shoulder[:, None], wrist[:, None]
    top, elbow = two_links(*limb, b.upper_arm_m, b.forearm_m, away[:, None])
    return top[:, 0], elbow[:, 0]


def _legs(
    b: PersonBuild, c: Carriage, hips: Hips, feet: Soles, left: Array
) -> tuple[Array, Array]:
    n = len(left)
    state = feet.state
    toes = direction(state.heading_rad)
    sole = 0.7 * b.foot_m
    rise = heel_rise(feet, c.heel_rad) * hips.vigour[:, None]
    back = -np.cos(rise)[..., None] * toes
    back[..., 2] += np.sin(rise)
    ankle = state.position_m + sole * back
    ankle[..., 2] += b.ankle_m
    joint = hips.middle_m[:, None] + b.hip_m * np.array([1.0, -1.0])[:, None] * left[:, None]
    forward = direction(hips.heading_rad)[:, None]
    top, knee = two_links(joint, ankle, b.thigh_m, b.shank_m, forward)
    centre = np.stack(
        [0.5 * (top + knee), 0.5 * (knee + ankle), state.position_m + 0.45 * sole * back], axis=2
    )
    centre[:, :, 2, 2] += 0.5 * b.ankle_m
    axis = np.stack([(top - knee) / b.thigh_m, (knee - ankle) / b.shank_m, -back], axis=2)
    return centre.reshape(n, 6, 3), axis.reshape(n, 6, 3)


def heel_rise(feet: Soles, most_rad: float) -> Array:
    """Return the angle by which each heel is up over the ball, shape (n_slow, n_legs).

    From `HEEL_OFF` it grows to its most at toe-off; in the swing it goes back.
    """
    state = feet.state
    push = smooth_step((state.phase / feet.duty - HEEL_OFF) / (1 - HEEL_OFF))
    swing = 1.0 - smooth_step(state.swing / 0.55)
    return np.asarray(most_rad * np.where(state.is_stance, push, swing))


def two_links(
    joint: Array, end: Array, upper_m: float, lower_m: float, bend: Array
) -> tuple[Array, Array]:
    """Return where the upper joint comes to lie, and the middle joint, of two-link limbs.

    Joints and ends are of shape (n_slow, n_limbs, 3); the end is always reached, both links
    keep their lengths, and where the limb is too short, the upper joint gives. `bend` is the
    side to which the middle joint bends.
    """
    reach = joint - end
    distance = _size(reach)
    whole, least = upper_m + lower_m, 1.05 * abs(upper_m - lower_m) + 0.15 * upper_m
    soft = 1.0 - STIFF_TO
    over = np.maximum(distance / whole - STIFF_TO, 0.0) / soft
    span = np.clip(distance, least, STIFF_TO * whole) + soft * whole * np.tanh(over)
    unit = reach / np.maximum(distance, 1e-6)
    along = (lower_m**2 - upper_m**2 + span**2) / (2.0 * span)
    aside = np.sqrt(np.maximum(lower_m**2 - along**2, 0.0))
    away = bend - (bend * unit).sum(axis=-1, keepdims=True) * unit
    middle = end + along * unit + aside * (away / np.maximum(_size(away), 1e-6))
    return end + span * unit, middle


def _size(x: Array) -> Array:
    return np.asarray(np.sqrt((x * x).sum(axis=-1, keepdims=True)), dtype=np.float64)
