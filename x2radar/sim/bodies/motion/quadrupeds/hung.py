"""Four-legged animals by the first generator: a skeleton hung between feet and a moving trunk.

What an animal does (`Action`) says where trunk and paws are; here the rest follows: two-link
legs by inverse kinematics with the elbow backwards and the knee forwards, neck, head and tail.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.manner import Manner, Trunk
from x2radar.sim.bodies.pose import UP, Ends, Pose
from x2radar.sim.bodies.skeleton.limbs import direction, two_links
from x2radar.sim.bodies.skeleton.quadrupeds import ENDS, SIDES, QuadrupedBuild
from x2radar.sim.points import Array

_STIFF_TO = 0.85
"""Share of a leg's length up to which it alone reaches for the floor; beyond, shoulder blades and
hips give."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stance(Trunk):
    """Where trunk and paws are at given times."""

    paw_m: Array  # (n_slow, 4, 3): soles, in the order of `LEGS`


class Action(Protocol):
    """What an animal does; a function of time alone."""

    def at(self, t_s: Array) -> Stance:
        """Return where trunk and paws are at times of shape (n_slow,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Hung:
    """An animal by what it does, and by how it carries head and tail; a `Motion`."""

    build: QuadrupedBuild
    action: Action
    manner: Manner

    def pose(self, t_s: Array) -> Pose:
        """Return the pose of all parts; see `Motion`."""
        s, b = self.action.at(t_s), self.build
        ahead, left = direction(s.heading_rad), direction(s.heading_rad + 0.5 * np.pi)
        end, side = 0.5 * ENDS * b.back_m, 0.9 * SIDES * b.half_track_m
        joint = s.middle_m[:, None] + end[:, None] * direction(s.heading_rad, s.pitch_rad)[:, None]
        joint = joint + side[:, None] * left[:, None]
        ankle = s.paw_m + 0.25 * b.paw_m * UP
        bend = -ENDS[:, None] * ahead[:, None]
        knee, top = two_links(ankle, joint, b.lower_m, b.upper_m, bend, stiff_to=_STIFF_TO)
        toes = 0.5 * b.paw_m * ahead
        legs: list[Ends] = []
        for k in range(4):
            paw = (ankle[:, k] - toes, ankle[:, k] + toes)
            legs += [(knee[:, k], top[:, k]), (ankle[:, k], knee[:, k]), paw]
        return self.manner.over_legs(t_s, b, s, legs)
