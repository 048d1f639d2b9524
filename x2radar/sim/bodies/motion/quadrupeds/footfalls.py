"""What four-legged animals of the second and third generator share, and those of the second.

They share no gait law with the first: phase lags are drawn about those of walk, trot, pace, canter
and bound (Hildebrand's diagrams), or at random; duty factor, stride and limb proportions widely.
The second generator puts feet on the floor and has the trunk half-way between what they do.
"""

from collections.abc import Mapping

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Manner, Trunk
from x2radar.sim.bodies.path.feet import Footprints, StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.skeleton import ENDS, SIDES, QuadrupedBuild, direction, two_links
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import UP, Array, Ends, Motion, Pose

_LAGS: Mapping[str, tuple[float, float, float, float]] = {
    "walk": (0.0, 0.25, 0.5, 0.75),
    "trot": (0.0, 0.5, 0.5, 0.0),
    "pace": (0.0, 0.05, 0.5, 0.55),
    "canter": (0.0, 0.3, 0.28, 0.58),
    "bound": (0.0, 0.48, 0.08, 0.56),
}
"""When left hind, left fore, right hind and right fore land, in strides."""
LEAPS = frozenset({"canter", "bound"})  # gaits in which the trunk goes up and down once a stride
_SPEEDS = ((0.25, "walk"), (1.6, "trot"), (np.inf, "canter"))
"""Froude numbers up to which animals walk and trot (Alexander and Jayes 1983, recalled: 0.3 to 0.5
and 2 to 3 on treadmills; pets trot earlier)."""
_ANY_SHARE = 0.12  # of animals whose legs land in no order of the textbooks (a guess)


def draw_lags(
    rng: np.random.Generator,
    style: str,
    speed_mps: float,
    build: QuadrupedBuild,
    spread_and_share: tuple[float, float],
) -> tuple[str, Array]:
    """Return a gait, when its legs land, their spread in strides, and a share of disorder."""
    fr = speed_mps**2 / (9.81 * build.hip_m)
    gait = style if style in _LAGS else next(name for limit, name in _SPEEDS if fr <= limit)
    spread, share = spread_and_share
    lags = np.array(_LAGS[gait]) + spread * rng.standard_normal(4)
    return gait, rng.random(4) if share < _ANY_SHARE else lags


class Bearing:
    """Swings of a trunk over its legs, in a gait; amplitudes in hip heights, as pets have them."""

    def __init__(self, rng: np.random.Generator, gait: str, style: str) -> None:
        u, z = rng.random(8), rng.standard_normal(6).clip(-2, 2)
        leaps = gait in LEAPS
        low = style in {"stalk", "sniff"}
        self.manner = Manner(
            neck_rad=-0.3 - 0.5 * u[1] if low else 0.1 + 0.9 * u[1],
            head_rad=-0.3 + 0.3 * z[0],
            tail_rad=-0.7 + 1.9 * u[2],
            nod_rad=float((0.14 if leaps else 0.07) * np.exp(0.4 * z[1])),
            wag_hz=1.5 + 2.5 * u[4] if u[0] < 0.25 else 0.3 + 0.7 * u[4],
            wag_rad=0.1 + 0.4 * u[5],
            wag_lag_rad=0.1 + 0.8 * u[6],
            gaze=Wander(rng, [0.3, 0.15], [0.3, 0.15]),
        )
        # Up, aside and ahead.
        self.bob = float((0.07 if leaps else 0.03) * np.exp(0.4 * z[2]))
        self.sway = float(0.02 * np.exp(0.5 * z[3]))
        self.surge = float((0.04 if leaps else 0.012) * np.exp(0.5 * z[5]))
        # Of the trunk's pitch, once a stride.
        self.spine_rad = float((0.16 if leaps else 0.02) * np.exp(0.4 * z[4]))
        self.bobs = 1 if leaps else 2  # how often it goes up and down in a stride
        self.bob_lag = u[3]  # in strides


def draw_footfall_quadruped(
    rng: np.random.Generator, path: Path, b: QuadrupedBuild, style: str
) -> Motion:
    """Draw how an animal goes along a path on feet that stand."""
    z, u = rng.standard_normal(8).clip(-2, 2), rng.random(4)
    cruise_mps = max(path.cruise_mps, 0.05)
    gait, lags = draw_lags(rng, style, cruise_mps, b, (0.04, u[0]))
    fr = cruise_mps**2 / (9.81 * b.hip_m)
    factor, power = 2.6 * float(np.exp(0.15 * z[0])), 0.34 + 0.05 * z[1]
    duty = float(np.clip(0.52 * fr**-0.14 * np.exp(0.1 * z[2]), 0.25, 0.75))
    phase = StridePhase(path, lambda v: factor * b.hip_m * (v**2 / (9.81 * b.hip_m)) ** power)
    lift = b.hip_m * 0.12 * float(np.exp(0.5 * z[3]))
    ahead_m = 0.5 * b.back_m * (1 + 0.06 * z[4])
    aside_m = b.half_track_m * (0.5 + 0.6 * u[1])
    prints = tuple(
        Footprints(
            path,
            phase,
            offset=float(lags[k]),
            duty=duty,
            home_m=(ENDS[k] * ahead_m, SIDES[k] * aside_m),
            lift_m=lift,
            lift_skew=0.7 + 0.5 * u[2],
        )
        for k in range(4)
    )
    low = 0.68 if style == "stalk" else 0.9 + 0.06 * z[5]
    height_m, w = min(low, 1.0) * b.hip_m, Bearing(rng, gait, style)

    def pose(t_s: Array) -> Pose:
        state = path.at(t_s)
        vigour = np.clip(state.speed_mps / cruise_mps, 0.0, 1.0)
        p, heading = phase.at(t_s), state.heading_rad
        turn = 2 * np.pi * (p - w.bob_lag)
        ahead, left = direction(heading), direction(heading + 0.5 * np.pi)
        height = height_m + b.hip_m * w.bob * vigour * np.cos(w.bobs * turn)
        aside = b.hip_m * w.sway * vigour * np.cos(turn)
        middle = np.stack([state.x_m, state.y_m, height], axis=-1) + aside[:, None] * left
        surge = b.hip_m * w.surge * vigour * np.sin(w.bobs * turn + 0.5 * np.pi)
        middle = middle + surge[:, None] * ahead
        pitch = w.spine_rad * vigour * np.sin(turn)
        long, legs = direction(heading, pitch), list[Ends]()
        for k in range(4):
            top = middle + 0.5 * ENDS[k] * b.back_m * long
            top = top + 0.9 * SIDES[k] * b.half_track_m * left
            sole, swing = prints[k].at(t_s, vigour)
            ankle = sole + 0.25 * b.paw_m * UP
            # Elbows point back, knees ahead.
            knee, ankle = two_links(top, ankle, b.upper_m, b.lower_m, -ENDS[k] * ahead)
            toe = direction(heading, -1.0 * np.sin(np.pi * swing) * vigour)
            paw = (ankle - 0.2 * b.paw_m * toe, ankle + 0.8 * b.paw_m * toe)
            legs += [(top, knee), (knee, ankle), paw]
        nod = np.sin(2 * np.pi * w.bobs * p * vigour)
        trunk = Trunk(middle_m=middle, heading_rad=heading, pitch_rad=pitch, nod=nod)
        return w.manner.over_legs(t_s, b, trunk, legs)

    return pose
