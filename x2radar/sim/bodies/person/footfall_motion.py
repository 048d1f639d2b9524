"""People by footfalls and inverse kinematics: the second of three motion generators.

It shares no gait law with `gait`: stride length is a power of speed with drawn factor and
exponent, duty factor and phase lags are drawn, hips ride over feet that stand where the phase
puts them, arms are pendula with a lag of their own.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.motion.limbs import Moment, bent, direction, hung, segments
from x2radar.sim.bodies.motion.stride_phase import Footprints, StridePhase
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.build import PersonBuild
from x2radar.sim.bodies.person.torso import Torso

Array = NDArray[np.float64]

_SIDES = (1.0, -1.0)
_TURNED_SHARE = 0.3
"""Of people who do not run, those who do not go where they look (chosen)."""
WALK_STRIDE, RUN_STRIDE = 2.65, 2.6
"""`Ways.stride` at half a power of the speed. Walkers take steps of 6.5 mm for every step a minute
(Sekiya et al. 1996, recalled), strides of 1.42 m at 1.3 m/s; runners 2.2 m at 3 m/s."""
_TURNED_STRIDE = 0.85
"""Of those who do not go where they look, for one of those who do (chosen)."""
_HEEL_RISE_RAD = 1.1
"""Of the foot when it leaves the floor (recalled: 60 degrees)."""
_TURNS = np.array([0.0, -0.7, 1.0, -0.2, *[-0.7] * 6, *[1.0] * 6])
"""Of the parts, in their order, for one of the pelvis: the chest turns against it (recalled)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ways:
    """How somebody goes; angles in radians, shares of the leg's length where no unit is named.

    Attributes
    ----------
    stride, power : float
        The stride is ``stride * leg * (v / sqrt(g leg))^power`` long.
    duty : float
        Share of a stride that a foot stands; under a half there is a flight.
    limp : float
        How much later than half a stride the right foot lands, in strides.
    crouch, lift, bob, sway, surge : float
        Of the hips: lower than straight legs, and their amplitudes up, aside and ahead; of the
        feet: height of swing.
    bob_lag, arm_lag : float
        In strides, against the left foot's landing.
    lean, yaw, toe_out, facing : float
        Trunk forward; pelvis about the vertical; feet outward; body to the left of its way.
    arm, arm_rest, elbow, elbow_swing, splay : float
        Amplitude and rest of the arms' swing, bend of the elbows and its swing, arms outward.
    """

    stride: float = WALK_STRIDE
    power: float = 0.5
    duty: float = 0.62
    limp: float = 0.0
    crouch: float = 0.03
    lift: float = 0.10
    bob: float = 0.022
    sway: float = 0.025
    surge: float = 0.014
    bob_lag: float = 0.0
    arm_lag: float = 0.0
    lean: float = 0.05
    yaw: float = 0.1
    toe_out: float = 0.1
    facing: float = 0.0
    arm: float = 0.4
    arm_rest: float = 0.0
    elbow: float = 0.4
    elbow_swing: float = 0.2
    splay: float = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class FootfallPerson:
    """Somebody who goes along a path; an `Action` of a `Person`.

    Attributes
    ----------
    path : Path
        Where, and how fast.
    build : PersonBuild
        Sizes.
    ways : Ways
        How.
    phase : StridePhase
        Strides done.
    prints : tuple of Footprints
        Left and right.
    cruise_mps : float
        Speed at which amplitudes are whole.
    gesture : Wander
        Six numbers added to the angles of shoulders and elbows and to the head's turn and nod.
    torso : Torso
        How the trunk swings.
    """

    path: Path
    build: PersonBuild
    ways: Ways
    phase: StridePhase
    prints: tuple[Footprints, ...]
    cruise_mps: float
    gesture: Wander
    torso: Torso

    @classmethod
    def plan(
        cls, rng: np.random.Generator, path: Path, build: PersonBuild, ways: Ways, gesture: Wander
    ) -> Self:
        """Plan the footfalls along a path; the prints' scatter and the torso are drawn."""
        leg_m = build.leg_m
        phase = StridePhase.along(
            path, lambda v: ways.stride * leg_m * (v / np.sqrt(9.81 * leg_m)) ** ways.power
        )
        scatter = 0.012 * rng.standard_normal((64, 2)).clip(-2, 2)
        prints = tuple(
            Footprints.plan(
                path,
                phase,
                offset=0.0 if side > 0 else 0.5 + ways.limp,
                duty=ways.duty,
                home_m=(0.02, side * 0.75 * build.hip_m),
                facing_rad=ways.facing,
                lift_m=ways.lift * leg_m,
                lift_skew=0.8,
                scatter_m=scatter,
            )
            for side in _SIDES
        )
        cruise = max(float(path.pieces[2].max(initial=0.0)), 0.1)
        return cls(path, build, ways, phase, prints, cruise, gesture, Torso.draw(rng))

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all parts; see `Action`."""
        b, w = self.build, self.ways
        state = self.path.at(t_s)
        vigour = np.clip(state.speed_mps / self.cruise_mps, 0.0, 1.0)
        p = self.phase.at(t_s)
        gesture = self.gesture.at(t_s)
        facing = state.heading_rad + w.facing
        level = np.zeros_like(facing)
        left = direction(facing + 0.5 * np.pi, level)
        two, one = 4 * np.pi * (p - w.bob_lag), 2 * np.pi * (p - 0.5 * w.duty)
        height = b.ankle_m + b.leg_m * (1 - w.crouch + w.bob * vigour * np.cos(two))
        aside = b.leg_m * w.sway * vigour * np.cos(one)
        middle = np.stack([state.x_m, state.y_m, height], axis=-1) + aside[:, None] * left
        # Fastest when both feet are down, slowest over the standing foot.
        ahead = b.leg_m * w.surge * vigour * np.sin(4 * np.pi * (p - 0.5 * w.duty))
        middle = middle - ahead[:, None] * direction(state.heading_rad, level)
        yaw = facing + w.yaw * vigour * np.sin(2 * np.pi * p)
        now = Moment(facing, yaw, p, vigour, gesture)
        legs = [self._leg(k, t_s, middle, now) for k in range(2)]
        lean = w.lean * (0.4 + 0.6 * vigour)
        up = self.torso.up(t_s, facing, lean, p, vigour)
        top = middle + b.trunk_m * up
        arms = [self._arm(k, top, now) for k in range(2)]
        look = direction(facing + gesture[:, 4], 0.5 * np.pi - 0.5 * lean - 0.4 * gesture[:, 5])
        trunk = [(middle - 0.06 * b.trunk_m * up, top), (middle + 0.56 * b.trunk_m * up, top)]
        pelvis = (middle - 0.05 * b.stature_m * left, middle + 0.05 * b.stature_m * left)
        head = (top + 0.6 * b.neck_m * look, top + 1.4 * b.neck_m * look)
        ends = [*trunk, pelvis, head, *arms[0], *arms[1], *legs[0], *legs[1]]
        centre, axis = segments(ends)
        # Half-lengths of the pelvis are given along the body's own axis.
        axis[:, 2] = up
        return centre, axis, sides(left, yaw - facing)

    def _leg(self, k: int, t_s: Array, middle: Array, now: Moment) -> list[tuple[Array, Array]]:
        b, w, side = self.build, self.ways, _SIDES[k]
        facing, vigour = now.facing_rad, now.vigour
        level = np.zeros_like(facing)
        hip = middle + side * b.hip_m * direction(now.yaw_rad + 0.5 * np.pi, level)
        sole, swing = self.prints[k].at(t_s, vigour)
        p = now.phase - self.prints[k].offset
        stance = np.clip((p - np.floor(p)) / w.duty, 0.0, 1.0)
        # The heel rises in the last quarter of the stance, and is down again before landing.
        late = np.clip((stance - 0.7) / 0.3, 0.0, 1.0) * (1 - swing)
        rise = vigour * _HEEL_RISE_RAD * late**2
        rise += vigour * 0.5 * np.sin(np.pi * swing) * (swing < 1)
        way = direction(facing + side * w.toe_out, -rise)
        ankle = sole + np.array([0.0, 0.0, b.ankle_m])
        ankle[:, 2] += 0.7 * b.foot_m * np.sin(rise)
        # About the ball of the foot, so that the ankle goes ahead as the heel rises.
        ankle += (0.7 * b.foot_m * (1 - np.cos(rise)))[:, None] * direction(facing, level)
        knee, ankle = bent(hip, ankle, b.thigh_m, b.shank_m, direction(facing, level))
        heel = ankle - 0.25 * b.foot_m * way
        return [(hip, knee), (knee, ankle), (heel, heel + b.foot_m * way)]

    def _arm(self, k: int, top: Array, now: Moment) -> list[tuple[Array, Array]]:
        b, w, side = self.build, self.ways, _SIDES[k]
        vigour, gesture = now.vigour, now.gesture
        # The chest turns against the pelvis.
        facing = now.facing_rad - 0.7 * (now.yaw_rad - now.facing_rad)
        level = np.zeros_like(facing)
        shoulder = top + side * b.shoulder_m * direction(facing + 0.5 * np.pi, level)
        # Each arm swings against the leg of its side.
        turn = np.cos(2 * np.pi * (now.phase - 0.5 * (k == 0) - w.arm_lag))
        angle = w.arm_rest + w.arm * vigour * turn + gesture[:, 2 * k]
        bend = w.elbow * (0.5 + 0.5 * vigour) + w.elbow_swing * vigour * turn
        bend = np.maximum(bend + gesture[:, 2 * k + 1], 0.05)
        elbow = hung(shoulder, facing, angle, b.upper_arm_m, side * w.splay)
        wrist = hung(elbow, facing, angle + bend, b.forearm_m, side * 0.5 * w.splay)
        hand = wrist + 0.3 * (wrist - elbow)
        return [(shoulder, elbow), (elbow, wrist), (wrist, hand)]


def sides(left: Array, turn_rad: Array) -> Array:
    """Return the side vectors of all parts, shape (n_slow, n_segments, 3).

    Pelvis and legs turn with the stride, `turn_rad`, shape (n_slow,), chest and arms against it.
    """
    ahead = np.stack([left[:, 1], -left[:, 0], left[:, 2]], axis=-1)
    angle = np.outer(turn_rad, _TURNS)[..., None]
    return np.asarray(np.cos(angle) * left[:, None] - np.sin(angle) * ahead[:, None])


def draw_ways(rng: np.random.Generator, style: str) -> Ways:
    """Draw how somebody goes in a style of `STYLES`; unknown ones walk.

    Widths of the draws are chosen: wide, so that a network cannot learn one gait law by heart.
    """
    z, u = rng.standard_normal(16).clip(-2, 2), rng.random(8)
    runs = style in {"jog", "run", "child_run"}
    low = {"crouch": 0.25, "stealth": 0.12, "limp": 0.05}.get(style, 0.02)
    facing = 0.0
    if not runs and u[0] < _TURNED_SHARE:
        # Backwards, sideways or aslant, as people do in front of a shelf.
        aside = float(np.pi / 2 * np.sign(z[0] + 1e-9))
        facing = np.pi if u[1] < 0.35 else aside if u[1] < 0.75 else 1.2 * aside * float(u[7])
    stride = RUN_STRIDE if runs else WALK_STRIDE * (_TURNED_STRIDE if facing else 1.0)
    return Ways(
        stride=stride * float(np.exp(0.12 * z[1])),
        power=0.52 + 0.04 * z[2],
        duty=float(0.36 + 0.08 * u[2] if runs else 0.56 + 0.14 * u[2]),
        limp=float((0.08 + 0.08 * u[3]) if style == "limp" else 0.02 * z[3]),
        crouch=low + 0.05 * u[4] + (0.06 if runs else 0.0),
        lift=float((0.28 if runs else 0.12) * np.exp(0.4 * z[4])),
        bob=float((0.05 if runs else 0.022) * np.exp(0.4 * z[5])),
        sway=float(0.03 * np.exp(0.6 * z[6])),
        surge=float(0.018 * np.exp(0.6 * z[15])),
        bob_lag=float((0.25 if runs else 0.06) + 0.06 * z[7]),
        arm_lag=0.05 * z[8],
        lean={"crouch": 0.6, "stealth": 0.3, "run": 0.2}.get(style, 0.06) + 0.06 * z[9],
        yaw=float(0.16 * np.exp(0.5 * z[10])),
        toe_out=0.12 + 0.1 * z[11],
        facing=facing,
        arm=float(
            (0.05 if style in {"carry", "stealth", "crouch"} else 0.4) * np.exp(0.5 * z[12])
        ),
        arm_rest=(0.5 if style == "carry" else 0.0) + 0.12 * z[13],
        elbow=float((1.5 if runs or style == "carry" else 0.4) * np.exp(0.3 * z[14])),
        elbow_swing=0.2 * float(u[5]),
        splay=0.12 + 0.1 * float(u[6]),
    )


def draw_gesture(rng: np.random.Generator) -> Wander:
    """Draw what arms and head do besides: little as a rule; one in four waves or reaches."""
    u = rng.random(3)
    large = float(u[0] < 0.25)
    limits = np.array([0.15 + 1.0 * large * u[1], 0.2 + 0.8 * large, 0.15, 0.2, 0.6, 0.2])
    rates = np.array([0.15 + 2.5 * large * u[2], 0.2 + 3.5 * large * u[2], 0.15, 0.2, 0.4, 0.15])
    if u[1] < 0.5:
        order = [2, 3, 0, 1, 4, 5]
        limits, rates = limits[order], rates[order]
    return Wander.draw(rng, limits, rates)
