"""Crawling on hands and knees: four contacts under a level trunk."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.people.striding import SIDES
from x2radar.sim.bodies.motion.people.walking import STIFF_TO, Traits
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.pose import Pose, rod
from x2radar.sim.bodies.skeleton.people import TRUNK_AT, PersonBuild
from x2radar.sim.bodies.skeleton.skeleton import direction, two_links
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import Array

_KNEE_M = 0.06  # height of a kneeling knee's middle (recalled)


@dataclass(frozen=True, slots=True, eq=False)
class Crawling:
    """A person who crawls along a path on hands and knees; a `Motion`."""

    path: Path  # where the middle of the trunk goes
    feet: Feet  # contacts: left knee, left hand, right knee, right hand
    build: PersonBuild
    cruise_mps: float  # speed at which it moves fully
    sway: Wander  # x, y, z, in metres, and turn and nod of the head, in radians
    roll_m: float  # amplitude of the trunk to the sides, once a stride

    @classmethod
    def draw(
        cls, rng: np.random.Generator, path: Path, build: PersonBuild, traits: Traits
    ) -> Self:
        """Draw somebody who crawls, knees with opposite hands (Patrick et al. 2009, recalled)."""
        z, share = traits
        width = (0.10 + 0.05 * share[0]) * build.stature_m / 1.75
        reach, cadence = 0.45 * build.trunk_m, 1 + 0.08 * z[6]
        knee, hand = (-reach, width), (reach, 1.2 * width)
        stride = 0.75 * build.hip_height_m / cadence
        gait = Gait(
            offset=(0.0, 0.58, 0.5, 0.08),
            home_m=(knee, hand, (knee[0], -knee[1]), (hand[0], -hand[1])),
            stride_m=lambda v: stride * np.sqrt(v / 0.5),
            duty=lambda v: np.full(len(v), 0.62),
            lift_m=(0.03, 0.08, 0.03, 0.08),
        )
        sway = Wander.draw(rng, [0.01, 0.01, 0.01, 0.4, 0.2], np.full(5, 0.05))
        cruise = max(path.cruise_mps, 0.05)
        return cls(path, Feet.plan(path, gait), build, cruise, sway, 0.02 + 0.03 * share[1])

    def pose(self, t_s: Array) -> Pose:
        b = self.build
        state = self.path.at(t_s)
        contact = self.feet.at(t_s).position_m
        strides = self.feet.clock.at(t_s)
        vigour = np.minimum(state.speed_mps / self.cruise_mps, 1.0)
        sway = self.sway.at(t_s)
        heading = state.heading_rad
        forward, left = direction(heading), direction(heading + np.pi / 2)
        aside = self.roll_m * vigour * np.sin(2 * np.pi * strides) + sway[:, 1]
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
            ends += [(top, elbow), (elbow, hand), rod(hand, forward)]
        for k, side in enumerate(SIDES):
            knee = contact[:, 2 * k] + np.array([0.0, 0.0, _KNEE_M])
            thigh = hips + side * b.hip_m * left - knee
            thigh *= b.thigh_m / np.maximum(np.linalg.norm(thigh, axis=-1, keepdims=True), 1e-6)
            # Shins lie on the floor behind the knees.
            ankle = knee - b.shank_m * forward
            ends += [
                (knee, knee + thigh),
                (ankle, knee),
                (ankle, ankle - 0.5 * b.foot_m * forward),
            ]
        return Pose.between(ends, left[:, None])
