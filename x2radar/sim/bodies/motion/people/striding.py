"""What people of the second and third generator share: trunk, arms and head over their hips.

The trunk pitches twice a stride, rolls once, and is never quite still. Recorded people spread more
power beside the trunk's velocity than stiff trunks do (docs/research/evaluation-tried.md);
amplitudes are wide.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.path.feet import StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.people import PersonBuild
from x2radar.sim.bodies.skeleton.skeleton import direction, hang
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import Array, Ends, Pose

Swing = tuple[Array, Array, Array, float]  # yaw of an arm's swing, shoulder, elbow, and its splay

SIDES = (1.0, -1.0)  # left and right
RUNS = frozenset({"jog", "run", "child_run"})  # styles that leave the floor
WALK_STRIDE, RUN_STRIDE = 2.65, 2.6
"""`GaitParams.stride` at half a power of the speed. Walkers take steps of 6.5 mm for every step a
minute (Sekiya et al. 1996, recalled), strides of 1.42 m at 1.3 m/s; runners 2.2 m at 3 m/s."""
_SWING_RAD, _MAX_SIGMAS = 0.05, 2.0  # spread of the amplitudes of pitch and roll, and its end
_WANDER_RAD, _WANDER_RAD_S = (0.12, 0.10), (0.15, 0.12)  # what lean and roll do besides
_TURNS = np.array([0.0, -0.7, 1.0, -0.2, *[-0.7] * 6, *[1.0] * 6])
"""Of the parts, in their order, for one of the pelvis: the chest turns against it (recalled)."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What all limbs of a body share at given times, each of shape (n_slow,) but the last."""

    facing_rad: Array
    yaw_rad: Array  # of the pelvis
    phase: Array  # strides done
    vigour: Array  # 0 standing to 1 at cruising speed
    gesture: Array  # (n_slow, 6): added to shoulders and elbows, left and right; turn and nod


Torso = Callable[[Array, Moment, Array], Array]
"""Unit vectors from hips to neck, (n_slow, 3), at times, about a forward lean (n_slow,)."""


def draw_torso(rng: np.random.Generator) -> Torso:
    """Draw how a trunk swings over its hips in step with the stride, and how it wanders."""
    # In periods, against the left foot's landing; amplitudes at cruising speed.
    pitch_lag, roll_lag = (float(x) for x in rng.random(2))
    swings_rad = _SWING_RAD * np.abs(rng.standard_normal(2)).clip(0, _MAX_SIGMAS)
    pitch_rad, roll_rad = (float(x) for x in swings_rad)
    # Added to lean and roll, whether the body goes or stands.
    wanders = Wander(rng, _WANDER_RAD, _WANDER_RAD_S)

    def up(t_s: Array, now: Moment, lean_rad: Array) -> Array:
        wander, phase = wanders.at(t_s), now.phase
        pitch = pitch_rad * now.vigour * np.sin(2 * np.pi * (2 * phase - pitch_lag))
        roll = roll_rad * now.vigour * np.sin(2 * np.pi * (phase - roll_lag)) + wander[:, 1]
        upright = direction(now.facing_rad, 0.5 * np.pi - (lean_rad + pitch + wander[:, 0]))
        left = direction(now.facing_rad + 0.5 * np.pi)
        return np.cos(roll)[:, None] * upright + np.sin(roll)[:, None] * left

    return up


class StridingPerson(ABC):
    """A person who walks a path with a trunk that swings; a `Motion`."""

    phase: StridePhase  # strides done
    gesture: Wander  # what arms and head do besides, see `Moment`
    torso: Torso

    def __init__(self, path: Path, build: PersonBuild) -> None:
        self.path, self.build = path, build
        self.cruise_mps = max(path.cruise_mps, 0.1)  # speed at which amplitudes are whole

    @abstractmethod
    def _arm_swing(self, k: int, now: Moment, chest_rad: Array) -> Swing:
        """Return how an arm swings, given where the chest faces."""

    def _over_hips(
        self,
        t_s: Array,
        now: Moment,
        middle_m: Array,
        leans_rad: tuple[Array, Array | float],
        legs: list[list[Ends]],
    ) -> Pose:
        """Return the pose over hips and legs; `leans_rad` are those of trunk and head."""
        b = self.build
        lean, look_lean = leans_rad
        up = self.torso(t_s, now, lean)
        left = direction(now.facing_rad + 0.5 * np.pi)
        top = middle_m + b.trunk_m * up
        gaze = now.facing_rad + now.gesture[:, 4]
        look = direction(gaze, 0.5 * np.pi - look_lean - 0.4 * now.gesture[:, 5])
        half_pelvis = 0.05 * b.stature_m * left
        pose = Pose.between(
            [
                (middle_m - 0.06 * b.trunk_m * up, top),
                (middle_m + 0.56 * b.trunk_m * up, top),
                (middle_m - half_pelvis, middle_m + half_pelvis),
                (top + 0.6 * b.neck_m * look, top + 1.4 * b.neck_m * look),
                *(ends for k in range(2) for ends in self._arm(k, top, now)),
                *(ends for leg in legs for ends in leg),
            ],
            sides(left, now.yaw_rad - now.facing_rad),
        )
        # Half-lengths of the pelvis are given along the body's own axis.
        pose.axis[:, 2] = up
        return pose

    def _arm(self, k: int, top: Array, now: Moment) -> list[Ends]:
        b, side = self.build, SIDES[k]
        # The chest turns against the pelvis.
        chest = now.facing_rad - 0.7 * (now.yaw_rad - now.facing_rad)
        shoulder = top + side * b.shoulder_m * direction(chest + 0.5 * np.pi)
        yaw, angle, bend, splay = self._arm_swing(k, now, chest)
        links = (
            (angle, b.upper_arm_m, side * splay),
            (angle + bend, b.forearm_m, 0.5 * side * splay),
        )
        _, elbow, wrist = hang(shoulder, yaw, *links)
        return [(shoulder, elbow), (elbow, wrist), (wrist, wrist + 0.3 * (wrist - elbow))]


def sides(left: Array, turn_rad: Array) -> Array:
    """Return the side vectors of all parts, shape (n_slow, n_segments, 3)."""
    ahead = np.stack([left[:, 1], -left[:, 0], left[:, 2]], axis=-1)
    angle = np.outer(turn_rad, _TURNS)[..., None]
    return np.asarray(np.cos(angle) * left[:, None] - np.sin(angle) * ahead[:, None])


def draw_gesture(rng: np.random.Generator) -> Wander:
    """Draw what arms and head do besides: little as a rule; one in four waves or reaches."""
    u = rng.random(3)
    large = float(u[0] < 0.25)
    limits = np.array([0.15 + 1.0 * large * u[1], 0.2 + 0.8 * large, 0.15, 0.2, 0.6, 0.2])
    rates = np.array([0.15 + 2.5 * large * u[2], 0.2 + 3.5 * large * u[2], 0.15, 0.2, 0.4, 0.15])
    if u[1] < 0.5:
        order = [2, 3, 0, 1, 4, 5]
        limits, rates = limits[order], rates[order]
    return Wander(rng, limits, rates)
