"""Four-legged animals by the first generator: a skeleton hung between feet and a moving trunk.

What an animal does (`Action`) says where trunk and paws are; here the rest follows: two-link
legs by inverse kinematics with the elbow backwards and the knee forwards, neck, head and tail.
"""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.manner import Manner
from x2radar.sim.bodies.pose import UP, Pose
from x2radar.sim.bodies.skeleton.limbs import direction, two_links
from x2radar.sim.bodies.skeleton.quadrupeds import ENDS, QUADRUPED, SIDES, QuadrupedBuild
from x2radar.sim.bodies.wander import bouts, smooth_step
from x2radar.sim.points import Array

_STIFF_TO = 0.85
"""Share of a leg's length up to which it alone reaches for the floor; beyond, shoulder blades and
hips give."""
_TRUNK_AT = (0.0, 0.42, -0.42)
"""Where trunk, chest and rump are ahead of the trunk's middle, in lengths of the back."""


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """Where trunk and paws are at given times."""

    middle_m: Array  # (n_slow, 3): half-way between hip and shoulder
    heading_rad: Array  # (n_slow,): of the trunk
    pitch_rad: Array  # (n_slow,): up at the shoulder
    paw_m: Array  # (n_slow, 4, 3): soles, in the order of `LEGS`
    nod: Array | float = 0.0  # (n_slow,): -1 to 1, once or twice a stride; 0 at rest
    turn_rad_s: Array | float = 0.0  # (n_slow,): turn rate; the head looks into the bend


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
        frame = _Frame.of(s)
        centre, axis = (np.empty((len(t_s), len(QUADRUPED.parts), 3)) for _ in range(2))
        axis[:, :3] = frame.long[:, None]
        for k, along in enumerate(_TRUNK_AT):
            centre[:, k] = s.middle_m + along * b.back_m * frame.long
        centre[:, 3:5], axis[:, 3:5] = self._front(s, frame, t_s)
        centre[:, 5:8], axis[:, 5:8] = self._tail(s, frame, t_s)
        centre[:, 8:], axis[:, 8:] = self._legs(s, frame)
        return Pose(centre, axis, frame.left[:, None])

    def _front(self, s: Stance, frame: "_Frame", t_s: Array) -> tuple[Array, Array]:
        """Return middles and axes of neck and head."""
        b, m = self.build, self.manner
        gaze = m.gaze.at(t_s)
        down = smooth_step((m.down_below - m.down.at(t_s)[:, 0]) / 0.4 + 0.5)
        yaw = s.heading_rad + gaze[:, 0] + np.clip(0.2 * s.turn_rad_s, -0.5, 0.5)
        nod = (1.0 - 0.8 * down) * (m.nod_rad * s.nod + gaze[:, 1])
        nod = nod + down * m.lick_rad * np.sin(2.0 * np.pi * m.lick_hz * t_s)
        neck = direction(yaw, m.neck_rad + down * (m.down_rad[0] - m.neck_rad) + nod)
        head_pitch = m.head_rad + down * (m.down_rad[1] - m.head_rad) + 0.5 * nod
        head = direction(yaw + 0.5 * gaze[:, 0], head_pitch)
        base = s.middle_m + 0.52 * b.back_m * frame.long + 0.25 * b.half_depth_m * frame.above
        nape = base + b.neck_m * neck
        centre = np.stack([base + 0.5 * b.neck_m * neck, nape + 0.35 * b.head_m * head], axis=1)
        return centre, np.stack([neck, head], axis=1)

    def _tail(self, s: Stance, frame: "_Frame", t_s: Array) -> tuple[Array, Array]:
        """Return middles and axes of the tail's thirds."""
        b, m = self.build, self.manner
        wags = m.wag_rad * bouts(m.bout, t_s, m.wag_above)
        turn = 2.0 * np.pi * m.wag_hz * t_s
        base = s.middle_m - 0.56 * b.back_m * frame.long + 0.3 * b.half_depth_m * frame.above
        # The tail flattens out towards its tip.
        axis = np.stack(
            [
                direction(
                    s.heading_rad + np.pi + wags * np.sin(turn - k * m.wag_lag_rad),
                    m.tail_rad * (1.0 - 0.2 * k),
                )
                for k in range(3)
            ],
            axis=1,
        )
        third = axis * (b.tail_m / 3.0)
        return base[:, None] + np.cumsum(third, axis=1) - 0.5 * third, axis

    def _legs(self, s: Stance, frame: "_Frame") -> tuple[Array, Array]:
        """Return middles and axes of upper leg, lower leg and paw of each leg."""
        b = self.build
        end, side = 0.5 * ENDS * b.back_m, 0.9 * SIDES * b.half_track_m
        joint = s.middle_m[:, None] + end[:, None] * frame.long[:, None]
        joint = joint + side[:, None] * frame.left[:, None]
        ankle = s.paw_m + 0.25 * b.paw_m * UP
        bend = -ENDS[:, None] * frame.forward[:, None]
        knee, top = two_links(ankle, joint, b.lower_m, b.upper_m, bend, stiff_to=_STIFF_TO)
        centre = np.stack([0.5 * (top + knee), 0.5 * (knee + ankle), ankle], axis=2)
        toes = np.broadcast_to(frame.forward[:, None], ankle.shape)
        axis = np.stack([(top - knee) / b.upper_m, (knee - ankle) / b.lower_m, toes], axis=2)
        return centre.reshape(-1, 12, 3), axis.reshape(-1, 12, 3)


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """Unit vectors of the trunk, shape (n_slow, 3): level ahead, along it, left, up from it."""

    forward: Array
    long: Array
    left: Array
    above: Array

    @classmethod
    def of(cls, s: Stance) -> Self:
        long = direction(s.heading_rad, s.pitch_rad)
        left = direction(s.heading_rad + 0.5 * np.pi)
        return cls(direction(s.heading_rad), long, left, np.cross(long, left))
