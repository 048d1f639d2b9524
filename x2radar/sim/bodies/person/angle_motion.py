"""People by joint angles: the third of three motion generators.

Hips, knees, ankles, shoulders and elbows follow short Fourier series over the stride, drawn about
published means. The lowest foot carries the body: nothing pins a foot to its place, so feet slide
a little, and the hips go up and down as the angles make them.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.motion import curves
from x2radar.sim.bodies.motion.curves import JointCurve, harmonics
from x2radar.sim.bodies.motion.limbs import Moment, direction, hung, segments
from x2radar.sim.bodies.motion.stride_phase import StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.build import PersonBuild
from x2radar.sim.bodies.person.footfall_motion import RUN_STRIDE, WALK_STRIDE, sides
from x2radar.sim.bodies.person.torso import Torso

Array = NDArray[np.float64]

_SIDES = (1.0, -1.0)
_BACKWARDS_SHARE = 0.15
"""Of people who do not run (chosen)."""
_SOFT_M = 0.02
"""Depth within which both feet carry; it keeps the hips from a kink when they change."""


@dataclass(frozen=True, slots=True, eq=False)
class AnglePerson:
    """Somebody who goes along a path; an `Action` of a `Person`.

    Attributes
    ----------
    path, build : Path, PersonBuild
        Where, and who.
    phase : StridePhase
        Strides done.
    joints : tuple of JointCurve
        Hip, knee, ankle, shoulder, elbow.
    lag : ndarray, shape (4,), float64
        Of left leg, right leg, left arm, right arm, in strides.
    crouch_rad, lean_rad, facing_rad, yaw_rad, hop_m, surge_m : float
        Added to hip and knee; of the trunk; of the body against its way; of the pelvis; height of
        the flight; how far hips swing ahead and back.
    cruise_mps : float
        Speed at which amplitudes are whole.
    gesture, torso : Wander, Torso
        As in `FootfallPerson`.
    """

    path: Path
    build: PersonBuild
    phase: StridePhase
    joints: tuple[JointCurve, ...]
    lag: Array
    crouch_rad: float
    lean_rad: float
    facing_rad: float
    yaw_rad: float
    hop_m: float
    surge_m: float
    cruise_mps: float
    gesture: Wander
    torso: Torso

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        path: Path,
        build: PersonBuild,
        style: str,
        gesture: Wander,
    ) -> Self:
        """Draw somebody who goes in a style of `STYLES`; unknown ones walk."""
        z, u = rng.standard_normal(10).clip(-2, 2), rng.random(4)
        cruise = max(float(path.pieces[2].max(initial=0.0)), 0.1)
        leg_m = build.leg_m
        fr = cruise / np.sqrt(9.81 * leg_m)
        run = 1.0 if style in {"jog", "run", "child_run"} else 0.0
        stride = (RUN_STRIDE if run else WALK_STRIDE) * leg_m * fr**0.5
        stride *= float(np.exp(0.12 * z[0]))
        # Legs that open as wide as the stride asks, at a stance of some 60 % of it, in which the
        # foot rolls from heel to toe: as published at 1.3 m/s.
        mean = 0.4 if run else 0.62
        opening_m = stride * mean - build.foot_m
        scale = float(np.clip(opening_m / (2 * leg_m * np.sin(0.36)), 0.25, 1.5))
        kind = "RUN" if run else "WALK"
        shares = {"HIP": scale, "KNEE": 0.4 + 0.6 * scale, "ANKLE": 0.4 + 0.6 * scale}
        legs = [
            JointCurve.draw(rng, harmonics(getattr(curves, f"{kind}_{name}")), share)
            for name, share in shares.items()
        ]
        n = curves.N_HARMONICS
        swing = 0.35 * scale * float(np.exp(0.5 * z[1])) * (0.15 if style == "carry" else 1.0)
        size = swing * np.array([1.0, 0.12, 0.04, 0.02]) * np.exp(0.3 * rng.standard_normal(n))
        shoulder = JointCurve(0.1 * z[2], size, np.pi + 0.3 * rng.standard_normal(n))
        bend = 1.4 if run or style == "carry" else 0.4
        elbow = JointCurve(bend * float(np.exp(0.3 * z[3])), 0.6 * size, np.pi - 0.4 + 0 * size)
        limp = 0.1 if style == "limp" else 0.02 * z[4]
        facing = float(np.pi) if not run and u[0] < _BACKWARDS_SHARE else 0.0
        return cls(
            path,
            build,
            StridePhase.along(path, lambda v: stride * (v / cruise) ** 0.5),
            (*legs, shoulder, elbow),
            np.array([0.0, 0.5 + limp, 0.04 * z[5], 0.5 + 0.04 * z[6]]),
            {"crouch": 0.7, "stealth": 0.45}.get(style, 0.05) + 0.08 * float(u[1]),
            {"crouch": 0.5, "stealth": 0.3, "run": 0.15}.get(style, 0.05) + 0.05 * z[7],
            facing,
            float(0.16 * np.exp(0.5 * z[8])),
            float(0.04 * run * np.exp(0.3 * z[9])),
            float(0.018 * leg_m * np.exp(0.6 * rng.standard_normal())),
            cruise,
            gesture,
            Torso.draw(rng),
        )

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all parts; see `Action`."""
        b = self.build
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        backwards = 1.0 if self.facing_rad == 0 else -1.0
        p = backwards * self.phase.at(t_s)
        gesture = self.gesture.at(t_s)
        facing = state.heading_rad + self.facing_rad
        level = np.zeros_like(facing)
        left = direction(facing + 0.5 * np.pi, level)
        yaw = facing + self.yaw_rad * vigour * np.cos(2 * np.pi * p)
        place = np.stack([state.x_m, state.y_m, level], axis=-1)
        ahead = self.surge_m * vigour * np.sin(4 * np.pi * (p - 0.31))
        place = place - ahead[:, None] * direction(state.heading_rad, level)
        now = Moment(facing, yaw, p, vigour, gesture)
        legs = [self._leg(k, place, now) for k in range(2)]
        drop = np.stack([-leg[2][1][:, 2] for leg in legs], axis=1)
        most = drop.max(axis=1, keepdims=True)
        soft = _SOFT_M * np.log(np.exp((drop - most) / _SOFT_M).sum(axis=1))
        height = most[:, 0] + soft + 0.01
        height += self.hop_m * vigour * (1 - np.cos(4 * np.pi * (p + 0.05)))
        lift = height[:, None] * np.array([0.0, 0.0, 1.0])
        legs = [[(a + lift, c + lift) for a, c in leg] for leg in legs]
        middle = place + lift
        lean = self.lean_rad * (0.4 + 0.6 * vigour)
        up = self.torso.up(t_s, facing, lean, p, vigour)
        top = middle + b.trunk_m * up
        arms = [self._arm(k, top, now) for k in range(2)]
        look = direction(facing + gesture[:, 4], 0.5 * np.pi - 0.4 * gesture[:, 5])
        trunk = [(middle - 0.06 * b.trunk_m * up, top), (middle + 0.56 * b.trunk_m * up, top)]
        pelvis = (middle - 0.05 * b.stature_m * left, middle + 0.05 * b.stature_m * left)
        head = (top + 0.6 * b.neck_m * look, top + 1.4 * b.neck_m * look)
        centre, axis = segments([*trunk, pelvis, head, *arms[0], *arms[1], *legs[0], *legs[1]])
        axis[:, 2] = up
        return centre, axis, sides(left, yaw - facing)

    def _leg(self, k: int, middle: Array, now: Moment) -> list[tuple[Array, Array]]:
        b, side = self.build, _SIDES[k]
        facing, yaw, vigour = now.facing_rad, now.yaw_rad, now.vigour
        phase = now.phase - self.lag[k]
        hip_rad, knee_rad, ankle_rad = (j.at(phase, vigour) for j in self.joints[:3])
        knee_rad = np.maximum(knee_rad, 0.02) + 1.6 * self.crouch_rad
        hip_rad = hip_rad + self.crouch_rad
        hip = middle + side * b.hip_m * direction(yaw + 0.5 * np.pi, np.zeros_like(yaw))
        knee = hung(hip, facing, hip_rad, b.thigh_m)
        ankle = hung(knee, facing, hip_rad - knee_rad, b.shank_m)
        # A foot is square to its shank at rest.
        toe = hung(ankle, facing, hip_rad - knee_rad + ankle_rad + 0.5 * np.pi, 0.75 * b.foot_m)
        heel = ankle - (toe - ankle) / 3 - np.array([0.0, 0.0, b.ankle_m])
        return [(hip, knee), (knee, ankle), (heel, toe - np.array([0.0, 0.0, b.ankle_m]))]

    def _arm(self, k: int, top: Array, now: Moment) -> list[tuple[Array, Array]]:
        b, side = self.build, _SIDES[k]
        facing, vigour, gesture = now.facing_rad, now.vigour, now.gesture
        phase = now.phase - self.lag[2 + k]
        angle = self.joints[3].at(phase, vigour) + gesture[:, 2 * k]
        bend = np.maximum(self.joints[4].at(phase, vigour) + gesture[:, 2 * k + 1], 0.05)
        level = np.zeros_like(facing)
        # The chest turns against the pelvis.
        chest = facing - 0.7 * (now.yaw_rad - facing)
        shoulder = top + side * b.shoulder_m * direction(chest + 0.5 * np.pi, level)
        elbow = hung(shoulder, facing, angle, b.upper_arm_m, 0.12 * side)
        wrist = hung(elbow, facing, angle + bend, b.forearm_m, 0.06 * side)
        return [(shoulder, elbow), (elbow, wrist), (wrist, wrist + 0.3 * (wrist - elbow))]
