"""Crawling on hands and knees: four contacts under a level trunk."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.path.feet import Feet
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.build import ARMS, LEGS, NAMES, TRUNK_AT, PersonBuild
from x2radar.sim.bodies.person.posture import direction, two_links

Array = NDArray[np.float64]

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

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all parts; see `person.Action`."""
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
        centre, axis = np.empty((n, len(NAMES), 3)), np.empty((n, len(NAMES), 3))
        axis[:, :3] = spine[:, None]
        for k, along in enumerate(TRUNK_AT):
            centre[:, k] = middle + (along - 0.5) * b.trunk_m * spine
        head = direction(heading + sway[:, 3], 0.5 + sway[:, 4])
        centre[:, 3], axis[:, 3] = nape + b.neck_m * head, head
        frame = (forward[:, None], left[:, None])
        centre[:, ARMS], axis[:, ARMS] = self._arms(nape, contact[:, 1::2], frame)
        centre[:, LEGS], axis[:, LEGS] = self._legs(hips, contact[:, 0::2], frame)
        return centre, axis, left[:, None]

    def _arms(self, nape: Array, floor: Array, frame: tuple[Array, Array]) -> tuple[Array, Array]:
        b = self.build
        forward, left = frame
        shoulder = nape[:, None] + b.shoulder_m * _SIDES * left
        hand = floor + np.array([0.0, 0.0, 0.03])
        top, elbow = two_links(shoulder, hand, b.upper_arm_m, b.forearm_m, -forward)
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
