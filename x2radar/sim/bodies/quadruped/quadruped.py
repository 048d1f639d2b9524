"""Four-legged animals: a skeleton hung between its feet and a moving trunk.

What an animal does (`Action`) says where trunk and paws are; here the rest follows: two-link
legs by inverse kinematics with the elbow backwards and the knee forwards, neck and head,
tail, breathing. How the parts echo, their skin says.
"""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import smooth_step
from x2radar.sim.bodies.quadruped.build import NAMES, TRUNK, Manner, QuadrupedBuild
from x2radar.sim.bodies.skin.base import Skin
from x2radar.sim.points import Label, Points

Array = NDArray[np.float64]

STIFF_TO = 0.85
"""Share of a leg's length up to which it alone reaches for the floor (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """Where trunk and paws are at given times."""

    middle_m: Array  # (n_slow, 3): half-way between hip and shoulder
    heading_rad: Array  # (n_slow,): of the trunk
    pitch_rad: Array  # (n_slow,): up at the shoulder
    paw_m: Array  # (n_slow, 4, 3): soles, in the order of `LEGS`
    nod: Array  # (n_slow,): -1 to 1, once or twice a stride; 0 at rest
    turn_rad_s: Array  # (n_slow,): turn rate; the head looks into the bend


class Action(Protocol):
    """What an animal does; a function of time alone."""

    def at(self, t_s: Array) -> Stance:
        """Return where trunk and paws are at times of shape (n_slow,)."""
        ...


class Motion(Protocol):
    """Where all parts of an animal are; a function of time alone."""

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all parts at times of shape (n_slow,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Hung:
    """A skeleton hung between its feet and a moving trunk: the first of three generators."""

    build: QuadrupedBuild
    action: Action  # where trunk and paws are
    manner: Manner  # head and tail

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors; see `Motion`."""
        return posture(self.build, self.action, self.manner, t_s)


@dataclass(frozen=True, slots=True, eq=False)
class Quadruped:
    """A four-legged animal; see `Mover`."""

    label: Label  # what an alarm should take it for
    names: tuple[str, ...]
    motion: Motion
    manner: Manner  # breathing
    skin: Skin

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points; see `Mover`."""
        centre, axis, side = self.motion.posture(t_s)
        # Breathing moves the surface of the trunk towards the antenna.
        n = len(TRUNK)
        towards = antenna_m - centre[:, :n]
        distance = np.sqrt((towards**2).sum(axis=-1, keepdims=True))
        swell = breath_m(self.manner, t_s)[:, None, None]
        centre[:, :n] += towards * (swell / np.maximum(distance, 0.05))
        return self.skin.points(centre, axis, side, antenna_m)


def breath_m(manner: Manner, t_s: Array) -> Array:
    """Return how far breathing has moved the surface of the trunk outwards, in metres."""
    turn = 2.0 * np.pi * manner.breath_hz * t_s + manner.breath_rad
    # Breathing in is quicker than breathing out.
    return np.asarray(manner.breath_m * np.sin(turn + 0.35 * np.sin(turn)), dtype=np.float64)


def posture(
    b: QuadrupedBuild, action: Action, manner: Manner, t_s: Array
) -> tuple[Array, Array, Array]:
    """Return middles, axes and side vectors of all parts at times of shape (n_slow,).

    Middles in room coordinates and unit vectors along the parts are of shape (n_slow,
    n_parts, 3), in the order of `NAMES`; unit vectors to the left of shape (n_slow, 1, 3).
    """
    s = action.at(t_s)
    frame = _Frame.of(s)
    centre, axis = np.empty((len(t_s), len(NAMES), 3)), np.empty((len(t_s), len(NAMES), 3))
    axis[:, :3] = frame.long[:, None]
    for k, along in enumerate((0.0, 0.42, -0.42)):
        centre[:, k] = s.middle_m + along * b.back_m * frame.long
    centre[:, 3:5], axis[:, 3:5] = _front(b, manner, s, frame, t_s)
    centre[:, 5:8], axis[:, 5:8] = _tail(b, manner, s, frame, t_s)
    centre[:, 8:], axis[:, 8:] = _legs(b, s, frame)
    return centre, axis, frame.left[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """Unit vectors of the trunk, shape (n_slow, 3): level ahead, along it, left, up from it."""

    forward: Array
    long: Array
    left: Array
    above: Array

    @classmethod
    def of(cls, s: Stance) -> Self:
        level = np.zeros_like(s.heading_rad)
        long = _direction(s.heading_rad, s.pitch_rad)
        left = _direction(s.heading_rad + 0.5 * np.pi, level)
        return cls(_direction(s.heading_rad, level), long, left, np.cross(long, left))


def _front(
    b: QuadrupedBuild, m: Manner, s: Stance, frame: _Frame, t_s: Array
) -> tuple[Array, Array]:
    """Return middles and axes of neck and head."""
    gaze = m.gaze.at(t_s)
    down = smooth_step((m.down_below - m.down.at(t_s)[:, 0]) / 0.4 + 0.5)
    yaw = s.heading_rad + gaze[:, 0] + np.clip(0.2 * s.turn_rad_s, -0.5, 0.5)
    nod = (1.0 - 0.8 * down) * (m.nod_rad * s.nod + gaze[:, 1])
    nod = nod + down * m.lick_rad * np.sin(2.0 * np.pi * m.lick_hz * t_s)
    neck = _direction(yaw, m.neck_rad + down * (m.down_rad[0] - m.neck_rad) + nod)
    head_pitch = m.head_rad + down * (m.down_rad[1] - m.head_rad) + 0.5 * nod
    head = _direction(yaw + 0.5 * gaze[:, 0], head_pitch)
    base = s.middle_m + 0.52 * b.back_m * frame.long + 0.25 * b.half_depth_m * frame.above
    nape = base + b.neck_m * neck
    centre = np.stack([base + 0.5 * b.neck_m * neck, nape + 0.35 * b.head_m * head], axis=1)
    return centre, np.stack([neck, head], axis=1)


def _tail(
    b: QuadrupedBuild, m: Manner, s: Stance, frame: _Frame, t_s: Array
) -> tuple[Array, Array]:
    """Return middles and axes of the tail's thirds."""
    wags = m.wag_rad * smooth_step((m.bout.at(t_s)[:, 0] - m.wag_above) / 0.4 + 0.5)
    turn = 2.0 * np.pi * m.wag_hz * t_s
    base = s.middle_m - 0.56 * b.back_m * frame.long + 0.3 * b.half_depth_m * frame.above
    # The tail flattens out towards its tip.
    axis = np.stack(
        [
            _direction(
                s.heading_rad + np.pi + wags * np.sin(turn - k * m.wag_lag_rad),
                np.full_like(turn, m.tail_rad * (1.0 - 0.2 * k)),
            )
            for k in range(3)
        ],
        axis=1,
    )
    third = axis * (b.tail_m / 3.0)
    return base[:, None] + np.cumsum(third, axis=1) - 0.5 * third, axis


def _legs(b: QuadrupedBuild, s: Stance, frame: _Frame) -> tuple[Array, Array]:
    """Return middles and axes of upper leg, lower leg and paw of each leg."""
    end = np.array([-0.5, 0.5, -0.5, 0.5]) * b.back_m
    side = np.array([0.9, 0.9, -0.9, -0.9]) * b.half_track_m
    joint = s.middle_m[:, None] + end[:, None] * frame.long[:, None]
    joint = joint + side[:, None] * frame.left[:, None]
    ankle = s.paw_m + np.array([0.0, 0.0, 0.25 * b.paw_m])
    reach = joint - ankle
    distance = _size(reach)
    # Shoulder blades and hips give where a leg would be too short, or too long to fold; more
    # and more, or its middle joint would snap straight.
    whole, least = b.upper_m + b.lower_m, 1.05 * abs(b.upper_m - b.lower_m) + 1e-3
    soft = 1.0 - STIFF_TO
    over = np.maximum(distance / whole - STIFF_TO, 0.0) / soft
    span = np.clip(distance, least, STIFF_TO * whole) + soft * whole * np.tanh(over)
    unit = reach / np.maximum(distance, 1e-6)
    # How far the middle joint is from the ankle along the line to the upper one, and aside.
    along = (b.lower_m**2 - b.upper_m**2 + span**2) / (2.0 * span)
    aside = np.sqrt(np.maximum(b.lower_m**2 - along**2, 0.0))
    bend = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * frame.forward[:, None]
    bend = bend - (bend * unit).sum(axis=-1, keepdims=True) * unit
    knee = ankle + along * unit + aside * (bend / np.maximum(_size(bend), 1e-6))
    top = ankle + span * unit
    centre = np.stack([0.5 * (top + knee), 0.5 * (knee + ankle), ankle], axis=2)
    toes = np.broadcast_to(frame.forward[:, None], ankle.shape)
    axis = np.stack([(top - knee) / b.upper_m, (knee - ankle) / b.lower_m, toes], axis=2)
    parts = (len(centre), 12, 3)
    return centre.reshape(parts), axis.reshape(parts)


def _size(x: Array) -> Array:
    return np.asarray(np.sqrt((x * x).sum(axis=-1, keepdims=True)), dtype=np.float64)


def _direction(yaw_rad: Array, pitch_rad: Array) -> Array:
    """Return unit vectors, shape (n_slow, 3)."""
    level = np.cos(pitch_rad)
    return np.stack([level * np.cos(yaw_rad), level * np.sin(yaw_rad), np.sin(pitch_rad)], axis=-1)
