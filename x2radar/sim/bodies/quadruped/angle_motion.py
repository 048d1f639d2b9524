"""Four-legged animals by joint angles: the third of three motion generators.

Shoulder and elbow, hip and stifle follow short Fourier series over the stride, drawn about
published means of trotting dogs. The lowest paw carries its end of the trunk.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.motion import curves
from x2radar.sim.bodies.motion.curves import JointCurve, harmonics
from x2radar.sim.bodies.motion.limbs import Moment, direction, hung, segments
from x2radar.sim.bodies.motion.stride_phase import StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.quadruped.build import QuadrupedBuild
from x2radar.sim.bodies.quadruped.footfall_motion import LAGS, Bearing, gait_for, trunk_ends

Array = NDArray[np.float64]

_ENDS, _SIDES = (-1.0, 1.0, -1.0, 1.0), (1.0, 1.0, -1.0, -1.0)
_SOFT = 0.06
"""Depth, in hip heights, within which both feet of a girdle carry."""


@dataclass(frozen=True, slots=True, eq=False)
class AngleQuadruped:
    """An animal that goes along a path; attributes as in `FootfallQuadruped`.

    Attributes
    ----------
    joints : tuple of JointCurve
        Of the fore leg's upper and middle joint, and of the hind leg's.
    lag : ndarray, shape (4,), float64
        Of the legs, in strides.
    crouch_rad, hop : float
        Added to all legs' angles; height of the flight in hip heights.
    """

    path: Path
    build: QuadrupedBuild
    bearing: Bearing
    phase: StridePhase
    joints: tuple[JointCurve, ...]
    lag: Array
    crouch_rad: float
    hop: float
    cruise_mps: float

    @classmethod
    def draw(cls, rng: np.random.Generator, path: Path, build: QuadrupedBuild, style: str) -> Self:
        """Draw how an animal goes along a path."""
        z, u = rng.standard_normal(6).clip(-2, 2), rng.random(3)
        cruise = max(float(path.pieces[2].max(initial=0.0)), 0.05)
        gait = style if style in LAGS else gait_for(cruise, build.hip_m)
        lag = np.array(LAGS[gait]) + 0.05 * rng.standard_normal(4)
        if u[0] < 0.12:
            lag = rng.random(4)
        fr = cruise**2 / (9.81 * build.hip_m)
        stride = 2.5 * build.hip_m * fr**0.36 * float(np.exp(0.15 * z[0]))
        duty = float(np.clip(0.52 * fr**-0.14, 0.28, 0.7))
        # Legs that open as wide as the stride asks.
        scale = float(np.clip(stride * duty / (2 * build.hip_m * np.sin(0.3)), 0.3, 2.0))
        means = (curves.DOG_SHOULDER, curves.DOG_ELBOW, curves.DOG_HIP, curves.DOG_STIFLE)
        joints = tuple(
            JointCurve.draw(rng, harmonics(mean), scale if k % 2 == 0 else 0.5 + 0.5 * scale)
            for k, mean in enumerate(means)
        )
        leaps = gait in {"canter", "bound"}
        return cls(
            path,
            build,
            Bearing.draw(rng, gait, style),
            StridePhase.along(path, lambda v: stride * (v / cruise) ** 0.7),
            joints,
            lag,
            (0.45 if style == "stalk" else 0.0) + 0.12 * float(u[1]),
            float((0.08 if leaps else 0.02) * np.exp(0.3 * z[1])),
            cruise,
        )

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all parts, in the order of `NAMES`."""
        b, w = self.build, self.bearing
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        p = self.phase.at(t_s)
        heading = state.heading_rad
        level = np.zeros_like(heading)
        left = direction(heading + 0.5 * np.pi, level)
        place = np.stack([state.x_m, state.y_m, level], axis=-1)
        turn = 2 * np.pi * w.bobs * (p - w.bob_lag)
        surge = b.hip_m * w.surge * vigour * np.cos(turn)
        place = place + surge[:, None] * direction(heading, level)
        now = Moment(heading, heading, p, vigour, np.zeros((len(p), 0)))
        legs = [self._leg(k, place, now) for k in range(4)]
        drop = np.stack([-leg[-1][1][:, 2] for leg in legs], axis=1)
        soft = _SOFT * b.hip_m
        height = [
            soft * np.logaddexp(drop[:, a] / soft, drop[:, c] / soft) for a, c in ((0, 2), (1, 3))
        ]
        hop = self.hop * b.hip_m * vigour * (1 - np.cos(2 * np.pi * w.bobs * (p - w.bob_lag)))
        hind, fore = height[0] - 0.69 * soft + hop, height[1] - 0.69 * soft + hop
        up = np.array([0.0, 0.0, 1.0])
        middle = place + (0.5 * (hind + fore))[:, None] * up
        pitch = np.arctan2(fore - hind, b.back_m)
        ends, _ = trunk_ends(b, w, t_s, (middle, heading, pitch, p * vigour))
        for k, leg in enumerate(legs):
            lift = (hind if k % 2 == 0 else fore)[:, None] * up
            ends += [(a + lift, c + lift) for a, c in leg]
        centre, axis = segments(ends)
        return centre, axis, left[:, None]

    def _leg(self, k: int, middle: Array, now: Moment) -> list[tuple[Array, Array]]:
        b, end = self.build, _ENDS[k]
        heading, vigour = now.facing_rad, now.vigour
        level = np.zeros_like(heading)
        ahead, left = direction(heading, level), direction(heading + 0.5 * np.pi, level)
        phase = now.phase - self.lag[k]
        upper, lower = self.joints[:2] if end > 0 else self.joints[2:]
        swing = upper.at(phase, vigour)
        bend = np.maximum(lower.at(phase, vigour), 0.05) + self.crouch_rad
        # The fore leg's elbow points back, the hind leg's stifle ahead.
        first = swing - 0.5 * end * bend
        top = middle + 0.5 * end * b.back_m * ahead + 0.9 * _SIDES[k] * b.half_track_m * left
        knee = hung(top, heading, first, b.upper_m)
        ankle = hung(knee, heading, first + end * bend, b.lower_m)
        paw = hung(ankle, heading, first + end * bend + 0.5 + 0.3 * bend, b.paw_m)
        return [(top, knee), (knee, ankle), (ankle, paw)]
