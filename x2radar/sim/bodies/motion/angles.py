"""People and four-legged animals by joint angles: the third of three motion generators.

Joints follow short Fourier series over the stride; the lowest foot carries the body. Means:
walking and running of Winter (Biomechanics and Motor Control of Human Movement) and Novacheck (The
biomechanics of running, 1998), trotting dogs of Hottinger et al. 1996; recalled.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from x2radar.sim.bodies.motion.people import footfalls
from x2radar.sim.bodies.motion.people.footfalls import SIDES, Moment
from x2radar.sim.bodies.motion.quadrupeds.footfalls import LEAPS, Bearing, draw_lags
from x2radar.sim.bodies.motion.quadrupeds.hung import Trunk
from x2radar.sim.bodies.path.feet import StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton import skeleton
from x2radar.sim.bodies.skeleton.skeleton import PersonBuild, QuadrupedBuild, direction, hang
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import UP, Array, Ends, Motion, Pose

N_HARMONICS = 4  # enough to hold a knee to two degrees (tests)

# Degrees at 0, 10, ..., 90 % of a stride that begins with the foot's landing.
WALK = (
    (30, 26, 18, 8, -2, -9, -7, 10, 26, 32),  # hip
    (5, 16, 16, 9, 5, 11, 34, 58, 45, 12),  # knee
    (0, -3, 4, 8, 9, 5, -15, -8, 0, 2),  # ankle
)
RUN = (
    (32, 24, 10, -4, -8, 2, 22, 40, 44, 38),
    (14, 38, 38, 22, 26, 58, 88, 92, 62, 22),
    (4, 16, 20, 2, -22, -16, -4, 2, 4, 4),
)
DOG = (
    (14, 8, 0, -8, -14, -17, -10, 4, 14, 17),  # shoulder
    (22, 30, 30, 26, 20, 22, 48, 72, 60, 32),  # elbow
    (18, 12, 4, -6, -14, -18, -12, 4, 16, 20),  # hip
    (24, 32, 32, 28, 24, 26, 48, 66, 52, 30),  # stifle
)


JointCurve = Callable[[Array, Array], Array]
"""An angle, in radians, by the phase in strides and the vigour; 0 leaves the mean alone."""


def curve(mean_rad: float, amplitude_rad: Array, phase_rad: Array) -> JointCurve:
    """Return an angle over the phase of a stride, of `N_HARMONICS` harmonics."""

    def at(phase: Array, vigour: Array) -> Array:
        turn = 2 * np.pi * phase[:, None] * np.arange(1, N_HARMONICS + 1) + phase_rad
        swing = (amplitude_rad * np.cos(turn)).sum(axis=1)
        return np.asarray(mean_rad * (0.3 + 0.7 * vigour) + vigour * swing)

    return at


def draw_curve(rng: np.random.Generator, degrees: ArrayLike, scale: float) -> JointCurve:
    """Draw a curve about one at even steps of a stride: about twice people's spread (Winter)."""
    mean_rad = np.deg2rad(np.asarray(degrees, np.float64))
    middle, *c = np.fft.rfft(mean_rad)[: N_HARMONICS + 1] / len(mean_rad)
    n = N_HARMONICS
    size = 2 * scale * np.abs(c) * np.exp(0.2 * rng.standard_normal(n))
    size += 0.1 * size[0] * rng.random(n) * (np.arange(n) > 0)
    phase = np.angle(c) + 0.15 * rng.standard_normal(n)
    mean = scale * float(middle.real) + np.deg2rad(5.0) * rng.standard_normal()
    return curve(float(mean), size, phase)


_BACKWARDS_SHARE = 0.15  # of people who do not run (a guess)
_SOFT_M, _SOFT = 0.02, 0.06  # depth, in m or hip heights, within which both feet carry: no kink


class AnglePerson(footfalls.StridingPerson):
    """A person who walks a path by joint angles over the stride, in a style of `STYLES`."""

    def __init__(
        self, rng: np.random.Generator, path: Path, build: PersonBuild, style: str, gesture: Wander
    ) -> None:
        super().__init__(path, build)
        self.gesture = gesture
        z, u = rng.standard_normal(10).clip(-2, 2), rng.random(4)
        cruise, leg_m = self.cruise_mps, build.leg_m
        fr = cruise / np.sqrt(9.81 * leg_m)
        run = 1.0 if style in footfalls.RUNS else 0.0
        stride = (footfalls.RUN_STRIDE if run else footfalls.WALK_STRIDE) * leg_m * fr**0.5
        stride *= float(np.exp(0.12 * z[0]))
        # Legs that open as wide as the stride asks, at a stance of some 60 % of it, in which the
        # foot rolls from heel to toe: as published at 1.3 m/s.
        mean = 0.4 if run else 0.62
        opening_m = stride * mean - build.foot_m
        scale = float(np.clip(opening_m / (2 * leg_m * np.sin(0.36)), 0.25, 1.5))
        shares = (scale, *[0.4 + 0.6 * scale] * 2)
        means = zip(RUN if run else WALK, shares, strict=True)
        legs = [draw_curve(rng, degrees, share) for degrees, share in means]
        n = N_HARMONICS
        swing = 0.35 * scale * float(np.exp(0.5 * z[1])) * (0.15 if style == "carry" else 1.0)
        size = swing * np.array([1.0, 0.12, 0.04, 0.02]) * np.exp(0.3 * rng.standard_normal(n))
        shoulder = curve(0.1 * z[2], size, np.pi + 0.3 * rng.standard_normal(n))
        bend = 1.4 if run or style == "carry" else 0.4
        elbow = curve(bend * float(np.exp(0.3 * z[3])), 0.6 * size, np.pi - 0.4 + 0 * size)
        self.joints = (*legs, shoulder, elbow)  # legs are hip, knee and ankle
        limp = 0.1 if style == "limp" else 0.02 * z[4]
        # Of left leg, right leg, left arm, right arm, in strides.
        self.lag = np.array([0.0, 0.5 + limp, 0.04 * z[5], 0.5 + 0.04 * z[6]])
        crouch_rad = {"crouch": 0.7, "stealth": 0.45}.get(style, 0.05)
        self.crouch_rad = crouch_rad + 0.08 * float(u[1])  # added to hip and knee
        lean_rad = {"crouch": 0.5, "stealth": 0.3, "run": 0.15}.get(style, 0.05)
        self.lean_rad = lean_rad + 0.05 * z[7]  # of the trunk
        # Of the body against its way.
        self.turned_rad = float(np.pi) if not run and u[0] < _BACKWARDS_SHARE else 0.0
        self.yaw_rad = float(0.16 * np.exp(0.5 * z[8]))  # of the pelvis
        self.hop_m = float(0.04 * run * np.exp(0.3 * z[9]))  # height of the flight
        # How far hips swing ahead and back.
        self.surge_m = float(0.018 * leg_m * np.exp(0.6 * rng.standard_normal()))
        self.phase = StridePhase(path, lambda v: stride * (v / cruise) ** 0.5)
        self.torso = footfalls.draw_torso(rng)

    def __call__(self, t_s: Array) -> Pose:
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        p = (-1.0 if self.turned_rad else 1.0) * self.phase.at(t_s)
        facing = state.heading_rad + self.turned_rad
        yaw = facing + self.yaw_rad * vigour * np.cos(2 * np.pi * p)
        place = np.stack([state.x_m, state.y_m, np.zeros_like(facing)], axis=-1)
        ahead = self.surge_m * vigour * np.sin(4 * np.pi * (p - 0.31))
        place = place - ahead[:, None] * direction(state.heading_rad)
        now = Moment(facing, yaw, p, vigour, self.gesture.at(t_s))
        legs = [self._leg(k, place, now) for k in range(2)]
        drop = np.stack([-leg[2][1][:, 2] for leg in legs], axis=1)
        lowest = drop.max(axis=1, keepdims=True)
        soft = _SOFT_M * np.log(np.exp((drop - lowest) / _SOFT_M).sum(axis=1))
        height = lowest[:, 0] + soft + 0.01
        height += self.hop_m * vigour * (1 - np.cos(4 * np.pi * (p + 0.05)))
        lift = height[:, None] * UP
        lean = self.lean_rad * (0.4 + 0.6 * vigour)
        raised = [[(a + lift, c + lift) for a, c in leg] for leg in legs]
        return self._over_hips(t_s, now, place + lift, (lean, 0.0), raised)

    def _leg(self, k: int, middle: Array, now: Moment) -> list[Ends]:
        b, vigour = self.build, now.vigour
        phase = now.phase - self.lag[k]
        hip_rad, knee_rad, ankle_rad = (joint(phase, vigour) for joint in self.joints[:3])
        knee_rad = np.maximum(knee_rad, 0.02) + 1.6 * self.crouch_rad
        hip_rad = hip_rad + self.crouch_rad
        shank_rad = hip_rad - knee_rad
        # A foot is square to its shank at rest.
        foot_rad = shank_rad + ankle_rad + 0.5 * np.pi
        hip = middle + SIDES[k] * b.hip_m * direction(now.yaw_rad + 0.5 * np.pi)
        links = ((hip_rad, b.thigh_m), (shank_rad, b.shank_m), (foot_rad, 0.75 * b.foot_m))
        _, knee, ankle, toe = hang(hip, now.facing_rad, *links)
        sole = b.ankle_m * UP
        return [(hip, knee), (knee, ankle), (ankle - (toe - ankle) / 3 - sole, toe - sole)]

    def _arm_swing(self, k: int, now: Moment, chest_rad: Array) -> footfalls.Swing:  # noqa: ARG002 - these swing where the body faces
        phase, gesture = now.phase - self.lag[2 + k], now.gesture
        angle = self.joints[3](phase, now.vigour) + gesture[:, 2 * k]
        bend = np.maximum(self.joints[4](phase, now.vigour) + gesture[:, 2 * k + 1], 0.05)
        return now.facing_rad, angle, bend, 0.12


def draw_angle_quadruped(
    rng: np.random.Generator, path: Path, b: QuadrupedBuild, style: str
) -> Motion:
    """Draw how an animal goes along a path by joint angles."""
    z, u = rng.standard_normal(6).clip(-2, 2), rng.random(3)
    cruise_mps = max(path.cruise_mps, 0.05)
    gait, lag = draw_lags(rng, style, cruise_mps, b, (0.05, u[0]))
    fr = cruise_mps**2 / (9.81 * b.hip_m)
    stride = 2.5 * b.hip_m * fr**0.36 * float(np.exp(0.15 * z[0]))
    duty = float(np.clip(0.52 * fr**-0.14, 0.28, 0.7))
    # Legs that open as wide as the stride asks.
    scale = float(np.clip(stride * duty / (2 * b.hip_m * np.sin(0.3)), 0.3, 2.0))
    means = zip(DOG, (scale, 0.5 + 0.5 * scale) * 2, strict=True)
    joints = [draw_curve(rng, degrees, share) for degrees, share in means]
    w = Bearing(rng, gait, style)
    strides = StridePhase(path, lambda v: stride * (v / cruise_mps) ** 0.7)
    crouch_rad = (0.45 if style == "stalk" else 0.0) + 0.12 * float(u[1])  # of all legs
    flight = float((0.08 if gait in LEAPS else 0.02) * np.exp(0.3 * z[1]))  # in hip heights

    def leg(k: int, middle: Array, heading: Array, phase: Array, vigour: Array) -> list[Ends]:
        end, side = skeleton.ENDS[k], 0.9 * skeleton.SIDES[k] * b.half_track_m
        upper, lower = joints[:2] if end > 0 else joints[2:]
        bend = np.maximum(lower(phase, vigour), 0.05) + crouch_rad
        # The fore leg's elbow points back, the hind leg's stifle ahead.
        first = upper(phase, vigour) - 0.5 * end * bend
        top = middle + 0.5 * end * b.back_m * direction(heading)
        top = top + side * direction(heading + 0.5 * np.pi)
        second = first + end * bend
        third = second + 0.5 + 0.3 * bend
        links = ((first, b.upper_m), (second, b.lower_m), (third, b.paw_m))
        _, knee, ankle, paw = hang(top, heading, *links)
        return [(top, knee), (knee, ankle), (ankle, paw)]

    def pose(t_s: Array) -> Pose:
        state, p = path.at(t_s), strides.at(t_s)
        heading, vigour = state.heading_rad, np.clip(state.speed_mps / cruise_mps, 0.0, 1.0)
        turn, soft = 2 * np.pi * w.bobs * (p - w.bob_lag), _SOFT * b.hip_m
        place = np.stack([state.x_m, state.y_m, np.zeros_like(heading)], axis=-1)
        surge = b.hip_m * w.surge * vigour * np.cos(turn)
        place = place + surge[:, None] * direction(heading)
        legs = [leg(k, place, heading, p - lag[k], vigour) for k in range(4)]
        drop = np.stack([-ends[-1][1][:, 2] for ends in legs], axis=1)
        hop = flight * b.hip_m * vigour * (1 - np.cos(turn))
        hind, fore = (
            soft * np.logaddexp(drop[:, a] / soft, drop[:, a + 2] / soft) - 0.69 * soft + hop
            for a in (0, 1)
        )
        trunk = Trunk(
            middle_m=place + (0.5 * (hind + fore))[:, None] * UP,
            heading_rad=heading,
            pitch_rad=np.arctan2(fore - hind, b.back_m),
            nod=np.sin(2 * np.pi * w.bobs * p * vigour),
        )
        lifts = [height[:, None] * UP for height in (hind, fore)]
        raised = [(a + lifts[k % 2], c + lifts[k % 2]) for k in range(4) for a, c in legs[k]]
        return w.manner.over_legs(t_s, b, trunk, raised)

    return pose
