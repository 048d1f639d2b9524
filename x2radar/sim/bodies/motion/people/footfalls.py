"""What people of the second and third motion generator share, and those of the second.

Both have trunk, arms and head over their hips. The trunk pitches twice a stride, rolls once, and
is never quite still: recorded people spread more power beside the trunk's velocity than stiff
trunks do (docs/research/evaluation-tried.md); amplitudes are wide.

People by footfalls and inverse kinematics share no gait law with the first generator: stride
length is a power of speed with drawn factor and exponent, duty factor and phase lags are drawn,
hips ride over feet that stand where the phase puts them, arms are pendula with a lag of their own.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.path.feet import Footprints, StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.skeleton import PersonBuild, direction, hang, two_links
from x2radar.sim.bodies.wander import Wander
from x2radar.sim.points import UP, Array, Ends, Pose

Swing = tuple[Array, Array, Array, float]  # yaw of an arm's swing, shoulder, elbow, and its splay

SIDES = (1.0, -1.0)  # left and right
RUNS = frozenset({"jog", "run", "child_run"})  # styles that leave the floor
WALK_STRIDE, RUN_STRIDE = 2.65, 2.6
"""Of strides that go with half a power of the speed: walkers take steps of 6.5 mm for every step a
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
        links = ((angle, b.upper_arm_m), (angle + bend, b.forearm_m))
        splays = (side * splay, 0.5 * side * splay)
        _, elbow, wrist = hang(shoulder, yaw, *links, splays_rad=splays)
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


_TURNED_SHARE = 0.3  # of people who do not run: they do not go where they look (a guess)
_TURNED_STRIDE = 0.85  # of those who do not go where they look, for one of those who do (a guess)
_HEEL_RISE_RAD = 1.1  # of the foot when it leaves the floor (recalled: 60 degrees)


class FootfallPerson(StridingPerson):
    """A person who walks a path: feet stand where they fall, legs follow; a `Motion`."""

    def __init__(
        self, rng: np.random.Generator, path: Path, build: PersonBuild, style: str
    ) -> None:
        super().__init__(path, build)
        z, u = rng.standard_normal(16).clip(-2, 2), rng.random(8)
        runs, leg_m = style in RUNS, build.leg_m
        self.facing = 0.0  # of the body to the left of its way
        if not runs and u[0] < _TURNED_SHARE:
            # Backwards, sideways or aslant, as people do in front of a shelf.
            aside = float(np.pi / 2 * np.sign(z[0] + 1e-9))
            aslant = aside if u[1] < 0.75 else 1.2 * aside * float(u[7])
            self.facing = np.pi if u[1] < 0.35 else aslant
        walk = WALK_STRIDE * (_TURNED_STRIDE if self.facing else 1.0)
        # A stride is ``stride * leg * (v / sqrt(g leg))^power`` long.
        stride = (RUN_STRIDE if runs else walk) * float(np.exp(0.12 * z[1]))
        power = 0.52 + 0.04 * z[2]
        # Share of a stride that a foot stands; under a half there is a flight.
        self.duty = float(0.36 + 0.08 * u[2] if runs else 0.56 + 0.14 * u[2])
        # How much later than half a stride the right foot lands, in strides.
        limp = float((0.08 + 0.08 * u[3]) if style == "limp" else 0.02 * z[3])
        # How much lower the hips are than on straight legs.
        low = {"crouch": 0.25, "stealth": 0.12, "limp": 0.05}.get(style, 0.02)
        self.crouch = low + 0.05 * u[4] + (0.06 if runs else 0.0)
        lift = float((0.28 if runs else 0.12) * np.exp(0.4 * z[4]))  # of the feet's swing
        # Amplitudes of the hips up, aside and ahead.
        self.bob = float((0.05 if runs else 0.022) * np.exp(0.4 * z[5]))
        self.sway = float(0.03 * np.exp(0.6 * z[6]))
        self.surge = float(0.018 * np.exp(0.6 * z[15]))
        # In strides, against the left foot's landing.
        self.bob_lag = float((0.25 if runs else 0.06) + 0.06 * z[7])
        self.arm_lag = 0.05 * z[8]
        lean = {"crouch": 0.6, "stealth": 0.3, "run": 0.2}.get(style, 0.06)
        self.lean = lean + 0.06 * z[9]  # of the trunk, forward
        self.yaw = float(0.16 * np.exp(0.5 * z[10]))  # amplitude of the pelvis about the vertical
        self.toe_out = 0.12 + 0.1 * z[11]  # of the feet, outward
        # Amplitude and rest of the arms' swing; bend of the elbows, and its swing.
        arm = 0.05 if style in {"carry", "stealth", "crouch"} else 0.4
        self.arm = float(arm * np.exp(0.5 * z[12]))
        self.arm_rest = (0.5 if style == "carry" else 0.0) + 0.12 * z[13]
        self.elbow = float((1.5 if runs or style == "carry" else 0.4) * np.exp(0.3 * z[14]))
        self.elbow_swing = 0.2 * float(u[5])
        self.splay = 0.12 + 0.1 * float(u[6])  # of the arms, outward
        self.gesture = draw_gesture(rng)  # what arms and head do besides, see `Moment`
        usual_mps = np.sqrt(9.81 * leg_m)
        self.phase = StridePhase(path, lambda v: stride * leg_m * (v / usual_mps) ** power)
        scatter = 0.012 * rng.standard_normal((64, 2)).clip(-2, 2)
        self.prints = [
            Footprints(
                path,
                self.phase,
                offset=0.0 if side > 0 else 0.5 + limp,
                duty=self.duty,
                home_m=(0.02, side * 0.75 * build.hip_m),
                facing_rad=self.facing,
                lift_m=lift * leg_m,
                lift_skew=0.8,
                scatter_m=scatter,
            )
            for side in SIDES
        ]
        self.torso = draw_torso(rng)

    def __call__(self, t_s: Array) -> Pose:
        b = self.build
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        p = self.phase.at(t_s)
        facing = state.heading_rad + self.facing
        left = direction(facing + 0.5 * np.pi)
        two, one = 4 * np.pi * (p - self.bob_lag), 2 * np.pi * (p - 0.5 * self.duty)
        height = b.ankle_m + b.leg_m * (1 - self.crouch + self.bob * vigour * np.cos(two))
        aside = b.leg_m * self.sway * vigour * np.cos(one)
        middle = np.stack([state.x_m, state.y_m, height], axis=-1) + aside[:, None] * left
        # Fastest when both feet are down, slowest over the standing foot.
        ahead = b.leg_m * self.surge * vigour * np.sin(4 * np.pi * (p - 0.5 * self.duty))
        middle = middle - ahead[:, None] * direction(state.heading_rad)
        yaw = facing + self.yaw * vigour * np.sin(2 * np.pi * p)
        now = Moment(facing, yaw, p, vigour, self.gesture.at(t_s))
        legs = [self._leg(k, t_s, middle, now) for k in range(2)]
        lean = self.lean * (0.4 + 0.6 * vigour)
        return self._over_hips(t_s, now, middle, (lean, 0.5 * lean), legs)

    def _leg(self, k: int, t_s: Array, middle: Array, now: Moment) -> list[Ends]:
        b, side = self.build, SIDES[k]
        ahead, vigour = direction(now.facing_rad), now.vigour
        hip = middle + side * b.hip_m * direction(now.yaw_rad + 0.5 * np.pi)
        sole, swing = self.prints[k].at(t_s, vigour)
        p = now.phase - self.prints[k].offset
        stance = np.clip((p - np.floor(p)) / self.duty, 0.0, 1.0)
        # The heel rises in the last quarter of the stance, and is down again before landing.
        late = np.clip((stance - 0.7) / 0.3, 0.0, 1.0) * (1 - swing)
        rise = vigour * _HEEL_RISE_RAD * late**2
        rise += vigour * 0.5 * np.sin(np.pi * swing) * (swing < 1)
        way = direction(now.facing_rad + side * self.toe_out, -rise)
        ankle = sole + b.ankle_m * UP
        ankle[:, 2] += 0.7 * b.foot_m * np.sin(rise)
        # About the ball of the foot, so that the ankle goes ahead as the heel rises.
        ankle += (0.7 * b.foot_m * (1 - np.cos(rise)))[:, None] * ahead
        knee, ankle = two_links(hip, ankle, b.thigh_m, b.shank_m, ahead)
        heel = ankle - 0.25 * b.foot_m * way
        return [(hip, knee), (knee, ankle), (heel, heel + b.foot_m * way)]

    def _arm_swing(self, k: int, now: Moment, chest_rad: Array) -> Swing:
        vigour = now.vigour
        # Each arm swings against the leg of its side.
        turn = np.cos(2 * np.pi * (now.phase - 0.5 * (k == 0) - self.arm_lag))
        angle = self.arm_rest + self.arm * vigour * turn + now.gesture[:, 2 * k]
        bend = self.elbow * (0.5 + 0.5 * vigour) + self.elbow_swing * vigour * turn
        bend = np.maximum(bend + now.gesture[:, 2 * k + 1], 0.05)
        return chest_rad, angle, bend, self.splay
