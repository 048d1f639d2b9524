"""Four-legged animals by footfalls and inverse kinematics: the second of three generators.

It shares no gait law with `gait`: phase lags are drawn about those of walk, trot, pace, canter
and bound (Hildebrand's diagrams), or at random; duty factor, stride and limb proportions are
drawn widely. The trunk is carried half-way between what its feet do.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.motion.limbs import bent, direction, segments
from x2radar.sim.bodies.motion.stride_phase import Footprints, StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.quadruped.build import QuadrupedBuild

Array = NDArray[np.float64]

LAGS: Mapping[str, tuple[float, float, float, float]] = MappingProxyType(
    {
        "walk": (0.0, 0.25, 0.5, 0.75),
        "trot": (0.0, 0.5, 0.5, 0.0),
        "pace": (0.0, 0.05, 0.5, 0.55),
        "canter": (0.0, 0.3, 0.28, 0.58),
        "bound": (0.0, 0.48, 0.08, 0.56),
    }
)
"""When left hind, left fore, right hind and right fore land, in strides."""
_ENDS, _SIDES = (-1.0, 1.0, -1.0, 1.0), (1.0, 1.0, -1.0, -1.0)
_SPEEDS = ((0.25, "walk"), (1.6, "trot"), (np.inf, "canter"))
"""Froude numbers up to which animals walk and trot (Alexander and Jayes 1983, recalled: 0.3 to 0.5
and 2 to 3 on treadmills; pets trot earlier)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bearing:
    """How an animal carries itself.

    Attributes
    ----------
    neck_rad, head_rad, tail_rad : float
        How far neck, head and tail point up.
    nod_rad, bob, sway, surge, spine_rad : float
        Amplitudes: of the neck once or twice a stride; of the trunk up, aside and ahead, in hip
        heights; of its pitch once a stride in canter and bound.
    bobs : int
        How often it goes up and down in a stride.
    bob_lag : float
        In strides.
    wag_hz, wag_rad, wag_lag_rad : float
        Of the tail.
    gaze : Wander
        Yaw and pitch of the head.
    """

    neck_rad: float
    head_rad: float
    tail_rad: float
    nod_rad: float
    bob: float
    sway: float
    surge: float
    spine_rad: float
    bobs: int
    bob_lag: float
    wag_hz: float
    wag_rad: float
    wag_lag_rad: float
    gaze: Wander

    @classmethod
    def draw(cls, rng: np.random.Generator, gait: str, style: str) -> Self:
        """Draw the bearing of an animal in a gait; ranges are chosen to hold those of pets."""
        u, z = rng.random(8), rng.standard_normal(6).clip(-2, 2)
        leaps = gait in {"canter", "bound"}
        low = style in {"stalk", "sniff"}
        wags = u[0] < 0.25
        return cls(
            neck_rad=-0.3 - 0.5 * u[1] if low else 0.1 + 0.9 * u[1],
            head_rad=-0.3 + 0.3 * z[0],
            tail_rad=-0.7 + 1.9 * u[2],
            nod_rad=float((0.14 if leaps else 0.07) * np.exp(0.4 * z[1])),
            bob=float((0.07 if leaps else 0.03) * np.exp(0.4 * z[2])),
            sway=float(0.02 * np.exp(0.5 * z[3])),
            surge=float((0.04 if leaps else 0.012) * np.exp(0.5 * z[5])),
            spine_rad=float((0.16 if leaps else 0.02) * np.exp(0.4 * z[4])),
            bobs=1 if leaps else 2,
            bob_lag=u[3],
            wag_hz=1.5 + 2.5 * u[4] if wags else 0.3 + 0.7 * u[4],
            wag_rad=0.1 + 0.4 * u[5],
            wag_lag_rad=0.1 + 0.8 * u[6],
            gaze=Wander.draw(rng, np.array([0.3, 0.15]), np.array([0.3, 0.15])),
        )


def gait_for(speed_mps: float, hip_m: float) -> str:
    """Return the gait that an animal of a hip height takes at a speed."""
    fr = speed_mps**2 / (9.81 * hip_m)
    return next(name for most, name in _SPEEDS if fr <= most)


def trunk_ends(
    b: QuadrupedBuild, w: Bearing, t_s: Array, trunk: tuple[Array, Array, Array, Array]
) -> tuple[list[tuple[Array, Array]], Array]:
    """Return the ends of trunk, chest, rump, neck, head and tail, and the trunk's own direction.

    `trunk` is the middle (n_slow, 3), heading and pitch (n_slow,), and the phase in strides.
    """
    middle, heading, pitch, phase = trunk
    long, flat = direction(heading, pitch), direction(heading, np.zeros_like(pitch))
    up = np.cross(long, direction(heading + 0.5 * np.pi, np.zeros_like(pitch)))
    gaze = w.gaze.at(t_s)
    nod = w.nod_rad * np.sin(2 * np.pi * w.bobs * phase) + gaze[:, 1]
    neck = direction(heading + gaze[:, 0], w.neck_rad + nod)
    head = direction(heading + 1.4 * gaze[:, 0], w.head_rad + 0.5 * nod)
    base = middle + 0.52 * b.back_m * long + 0.25 * b.half_depth_m * up
    nape = base + b.neck_m * neck
    ends = [
        (middle - 0.5 * b.back_m * long, middle + 0.5 * b.back_m * long),
        (middle + 0.3 * b.back_m * long, middle + 0.54 * b.back_m * long),
        (middle - 0.54 * b.back_m * long, middle - 0.3 * b.back_m * long),
        (base, nape),
        (nape - 0.15 * b.head_m * head, nape + 0.85 * b.head_m * head),
    ]
    at = middle - 0.56 * b.back_m * long + 0.3 * b.half_depth_m * up
    for k in range(3):
        wag = w.wag_rad * np.sin(2 * np.pi * w.wag_hz * t_s - k * w.wag_lag_rad)
        tail = direction(heading + np.pi + wag, np.full_like(wag, w.tail_rad * (1 - 0.25 * k)))
        ends.append((at, at + b.tail_m / 3 * tail))
        at = at + b.tail_m / 3 * tail
    return ends, flat


@dataclass(frozen=True, slots=True, eq=False)
class FootfallQuadruped:
    """An animal that goes along a path.

    Attributes
    ----------
    path, build : Path, QuadrupedBuild
        Where, and which.
    bearing : Bearing
        How it carries itself.
    phase : StridePhase
        Strides done.
    prints : tuple of Footprints
        Of left hind, left fore, right hind, right fore.
    height_m, cruise_mps : float
        Of the trunk's middle, and the speed at which amplitudes are whole.
    """

    path: Path
    build: QuadrupedBuild
    bearing: Bearing
    phase: StridePhase
    prints: tuple[Footprints, ...]
    height_m: float
    cruise_mps: float

    @classmethod
    def draw(cls, rng: np.random.Generator, path: Path, build: QuadrupedBuild, style: str) -> Self:
        """Draw how an animal goes along a path."""
        z, u = rng.standard_normal(8).clip(-2, 2), rng.random(4)
        cruise = max(float(path.pieces[2].max(initial=0.0)), 0.05)
        gait = style if style in LAGS else gait_for(cruise, build.hip_m)
        lags = np.array(LAGS[gait]) + 0.04 * rng.standard_normal(4)
        if u[0] < 0.12:
            lags = rng.random(4)
        fr = cruise**2 / (9.81 * build.hip_m)
        factor = 2.6 * float(np.exp(0.15 * z[0]))
        power = 0.34 + 0.05 * z[1]
        duty = float(np.clip(0.52 * fr**-0.14 * np.exp(0.1 * z[2]), 0.25, 0.75))
        phase = StridePhase.along(
            path,
            lambda v: factor * build.hip_m * (v**2 / (9.81 * build.hip_m)) ** power,
        )
        lift = build.hip_m * 0.12 * float(np.exp(0.5 * z[3]))
        prints = tuple(
            Footprints.plan(
                path,
                phase,
                offset=float(lags[k]),
                duty=duty,
                home_m=(
                    0.5 * _ENDS[k] * build.back_m * (1 + 0.06 * z[4]),
                    _SIDES[k] * build.half_track_m * (0.5 + 0.6 * u[1]),
                ),
                lift_m=lift,
                lift_skew=0.7 + 0.5 * u[2],
            )
            for k in range(4)
        )
        low = 0.68 if style == "stalk" else 0.9 + 0.06 * z[5]
        height = min(low, 1.0) * build.hip_m
        bearing = Bearing.draw(rng, gait, style)
        return cls(path, build, bearing, phase, prints, height, cruise)

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all parts, in the order of `NAMES`."""
        b, w = self.build, self.bearing
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        p = self.phase.at(t_s)
        turn = 2 * np.pi * (p - w.bob_lag)
        heading = state.heading_rad
        left = direction(heading + 0.5 * np.pi, np.zeros_like(heading))
        height = self.height_m + b.hip_m * w.bob * vigour * np.cos(w.bobs * turn)
        aside = b.hip_m * w.sway * vigour * np.cos(turn)
        middle = np.stack([state.x_m, state.y_m, height], axis=-1) + aside[:, None] * left
        surge = b.hip_m * w.surge * vigour * np.sin(w.bobs * turn + 0.5 * np.pi)
        middle = middle + surge[:, None] * direction(heading, np.zeros_like(heading))
        pitch = w.spine_rad * vigour * np.sin(turn)
        ends, ahead = trunk_ends(b, w, t_s, (middle, heading, pitch, p * vigour))
        long = direction(heading, pitch)
        for k in range(4):
            top = middle + 0.5 * _ENDS[k] * b.back_m * long
            top = top + 0.9 * _SIDES[k] * b.half_track_m * left
            sole, swing = self.prints[k].at(t_s, vigour)
            ankle = sole + np.array([0.0, 0.0, 0.25 * b.paw_m])
            # Elbows point back, knees ahead.
            knee, ankle = bent(top, ankle, b.upper_m, b.lower_m, -_ENDS[k] * ahead)
            toe = direction(heading, -1.0 * np.sin(np.pi * swing) * vigour)
            ends += [(top, knee), (knee, ankle), (ankle - 0.2 * b.paw_m * toe,) * 2]
            ends[-1] = (ends[-1][0], ankle + 0.8 * b.paw_m * toe)
        centre, axis = segments(ends)
        return centre, axis, left[:, None]
