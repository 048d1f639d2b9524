"""Four-legged animals by footfalls and inverse kinematics: the second of three generators.

Duty factor, stride and limb proportions are drawn widely. The trunk is carried half-way between
what its feet do.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.striding import (
    Bearing,
    StridingQuadruped,
    Trunk,
    draw_lags,
)
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.path.prints import Footprints, StridePhase
from x2radar.sim.bodies.pose import UP, Ends, Pose
from x2radar.sim.bodies.skeleton.limbs import STRETCHED_TO, direction, two_links
from x2radar.sim.bodies.skeleton.quadrupeds import ENDS, SIDES, QuadrupedBuild
from x2radar.sim.points import Array


@dataclass(frozen=True, slots=True, eq=False)
class FootfallQuadruped(StridingQuadruped):
    """An animal that goes along a path on feet that stand."""

    prints: tuple[Footprints, ...]  # of left hind, left fore, right hind, right fore
    height_m: float  # of the trunk's middle

    @classmethod
    def draw(cls, rng: np.random.Generator, path: Path, build: QuadrupedBuild, style: str) -> Self:
        """Draw how an animal goes along a path."""
        z, u = rng.standard_normal(8).clip(-2, 2), rng.random(4)
        cruise = max(path.cruise_mps, 0.05)
        gait, lags = draw_lags(rng, style, cruise, build, (0.04, u[0]))
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
                    0.5 * ENDS[k] * build.back_m * (1 + 0.06 * z[4]),
                    SIDES[k] * build.half_track_m * (0.5 + 0.6 * u[1]),
                ),
                lift_m=lift,
                lift_skew=0.7 + 0.5 * u[2],
            )
            for k in range(4)
        )
        low = 0.68 if style == "stalk" else 0.9 + 0.06 * z[5]
        height = min(low, 1.0) * build.hip_m
        bearing = Bearing.draw(rng, gait, style)
        return cls(path, build, bearing, phase, cruise, prints, height)

    def pose(self, t_s: Array) -> Pose:
        """Return the pose of all parts; see `Motion`."""
        b, w = self.build, self.bearing
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        p = self.phase.at(t_s)
        turn = 2 * np.pi * (p - w.bob_lag)
        heading = state.heading_rad
        ahead, left = direction(heading), direction(heading + 0.5 * np.pi)
        height = self.height_m + b.hip_m * w.bob * vigour * np.cos(w.bobs * turn)
        aside = b.hip_m * w.sway * vigour * np.cos(turn)
        middle = np.stack([state.x_m, state.y_m, height], axis=-1) + aside[:, None] * left
        surge = b.hip_m * w.surge * vigour * np.sin(w.bobs * turn + 0.5 * np.pi)
        middle = middle + surge[:, None] * ahead
        pitch = w.spine_rad * vigour * np.sin(turn)
        long = direction(heading, pitch)
        legs: list[Ends] = []
        for k in range(4):
            top = middle + 0.5 * ENDS[k] * b.back_m * long
            top = top + 0.9 * SIDES[k] * b.half_track_m * left
            sole, swing = self.prints[k].at(t_s, vigour)
            # Elbows point back, knees ahead.
            knee, ankle = two_links(
                top,
                sole + 0.25 * b.paw_m * UP,
                b.upper_m,
                b.lower_m,
                -ENDS[k] * ahead,
                stiff_to=STRETCHED_TO,
                is_soft=False,
            )
            toe = direction(heading, -1.0 * np.sin(np.pi * swing) * vigour)
            paw = (ankle - 0.2 * b.paw_m * toe, ankle + 0.8 * b.paw_m * toe)
            legs += [(top, knee), (knee, ankle), paw]
        return self._over_legs(t_s, Trunk(middle, heading, pitch, p * vigour), legs)
