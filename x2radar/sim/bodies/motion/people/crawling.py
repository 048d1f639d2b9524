"""Crawling on hands and knees: four contacts under a level trunk."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.people.walking import STIFF_TO, Traits
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.pose import Pose
from x2radar.sim.bodies.skeleton.limbs import direction, two_links
from x2radar.sim.bodies.skeleton.people import ARMS, LEGS, PERSON, TRUNK_AT, PersonBuild
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import Array

_KNEE_M = 0.06
"""Height of a kneeling knee's middle (recalled)."""
_SIDES = np.array([1.0, -1.0])[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class Crawling:
    """Somebody who crawls along a path."""

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
        """Draw somebody who crawls."""
        z, share = traits
        width = (0.10 + 0.05 * share[0]) * build.stature_m / 1.75
        gait = _gait(
            build.hip_height_m,
            cadence=1 + 0.08 * z[6],
            width_m=width,
            reach_m=0.45 * build.trunk_m,
        )
        sway = Wander.draw(rng, [0.01, 0.01, 0.01, 0.4, 0.2], np.full(5, 0.05))
        cruise = max(path.cruise_mps, 0.05)
        return cls(path, Feet.plan(path, gait), build, cruise, sway, 0.02 + 0.03 * share[1])

    def pose(self, t_s: Array) -> Pose:
        """Return the pose of all parts; see `Motion`."""
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

        n = len(t_s)
        centre, axis = (np.empty((n, len(PERSON.parts), 3)) for _ in range(2))
        axis[:, :3] = spine[:, None]
        for k, along in enumerate(TRUNK_AT):
            centre[:, k] = middle + (along - 0.5) * b.trunk_m * spine
        head = direction(heading + sway[:, 3], 0.5 + sway[:, 4])
        centre[:, 3], axis[:, 3] = nape + b.neck_m * head, head
        frame = (forward[:, None], left[:, None])
        centre[:, ARMS], axis[:, ARMS] = self._arms(nape, contact[:, 1::2], frame)
        centre[:, LEGS], axis[:, LEGS] = self._legs(hips, contact[:, 0::2], frame)
        return Pose(centre, axis, left[:, None])

    def _arms(self, nape: Array, floor: Array, frame: tuple[Array, Array]) -> tuple[Array, Array]:
        b = self.build
        forward, left = frame
        shoulder = nape[:, None] + b.shoulder_m * _SIDES * left
        hand = floor + np.array([0.0, 0.0, 0.03])
        elbow, top = two_links(
            hand,
            shoulder,
            b.forearm_m,
            b.upper_arm_m,
            -forward,
            stiff_to=STIFF_TO,
            slack_m=0.15 * b.upper_arm_m,
        )
        ahead = np.broadcast_to(forward, hand.shape)
        middle = np.stack([0.5 * (top + elbow), 0.5 * (elbow + hand), hand], axis=2)
        along = np.stack(
            [(elbow - top) / b.upper_arm_m, (hand - elbow) / b.forearm_m, ahead], axis=2
        )
        return middle.reshape(-1, 6, 3), along.reshape(-1, 6, 3)

    def _legs(self, hips: Array, floor: Array, frame: tuple[Array, Array]) -> tuple[Array, Array]:
        b = self.build
        forward, left = frame
        joint = hips[:, None] + b.hip_m * _SIDES * left
        knee = floor + np.array([0.0, 0.0, _KNEE_M])
        thigh = joint - knee
        length = np.sqrt((thigh * thigh).sum(axis=-1, keepdims=True))
        thigh = thigh / np.maximum(length, 1e-6)
        # Shins lie on the floor behind the knees.
        behind = -np.broadcast_to(forward, knee.shape)
        ankle = knee + b.shank_m * behind
        toe = ankle + 0.5 * b.foot_m * behind
        middle = np.stack(
            [knee + 0.5 * b.thigh_m * thigh, 0.5 * (knee + ankle), 0.5 * (ankle + toe)], axis=2
        )
        return middle.reshape(-1, 6, 3), np.stack([thigh, -behind, behind], axis=2).reshape(
            -1, 6, 3
        )


def _gait(hip_height_m: float, *, cadence: float, width_m: float, reach_m: float) -> Gait:
    """Return the footwork of a crawl: left knee, left hand, right knee, right hand.

    Knees and hands of opposite sides go nearly together (Patrick et al. 2009, recalled);
    `reach_m` is how far the hands are ahead of the middle of the trunk, and the knees behind.
    """
    return Gait(
        offset=(0.0, 0.58, 0.5, 0.08),
        home_m=(
            (-reach_m, width_m),
            (reach_m, 1.2 * width_m),
            (-reach_m, -width_m),
            (reach_m, -1.2 * width_m),
        ),
        stride_m=lambda v: np.asarray(0.75 * hip_height_m * np.sqrt(v / 0.5) / cadence),
        duty=lambda v: np.full(len(v), 0.62),
        lift_m=(0.03, 0.08, 0.03, 0.08),
    )
