"""Crawling on hands and knees: four contacts under a level trunk."""

from collections.abc import Iterator

import numpy as np

from x2radar.sim.bodies.motion.people.striding import SIDES
from x2radar.sim.bodies.motion.people.walking import STIFF_TO, Traits
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.people import TRUNK_AT, PersonBuild
from x2radar.sim.bodies.skeleton.skeleton import direction, two_links
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import Array, Ends, Motion, Pose, rod

_KNEE_M = 0.06  # height of a kneeling knee's middle (recalled)


def draw_crawling(rng: np.random.Generator, path: Path, b: PersonBuild, traits: Traits) -> Motion:
    """Draw somebody who crawls, knees with opposite hands (Patrick et al. 2009, recalled).

    The middle of the trunk goes along the path.
    """
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
    wander = Wander.draw(rng, [0.01, 0.01, 0.01, 0.4, 0.2], np.full(5, 0.05))
    cruise_mps, feet = max(path.cruise_mps, 0.05), Feet.plan(path, gait)
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
        elbow, top = two_links(
            hand,
            nape + side * b.shoulder_m * left,
            b.forearm_m,
            b.upper_arm_m,
            -forward,
            stiff_to=STIFF_TO,
            slack_m=0.15 * b.upper_arm_m,
        )
        yield from ((top, elbow), (elbow, hand), rod(hand, forward))
    for k, side in enumerate(SIDES):
        knee = contact[:, 2 * k] + np.array([0.0, 0.0, _KNEE_M])
        thigh = hips + side * b.hip_m * left - knee
        thigh *= b.thigh_m / np.maximum(np.linalg.norm(thigh, axis=-1, keepdims=True), 1e-6)
        # Shins lie on the floor behind the knees.
        ankle = knee - b.shank_m * forward
        yield from ((knee, knee + thigh), (ankle, knee), (ankle, ankle - 0.5 * b.foot_m * forward))
