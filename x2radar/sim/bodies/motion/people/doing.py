"""What somebody does besides going: with hands, trunk and head, or with the whole body in place.

No motion capture stands behind this: how far things move is anatomy, how fast a guess (hands 0.2
to 0.9 m/s and the head 0.1 to 0.6 rad/s, rms; exercise is a few sinusoids of 0.4 to 1.6 Hz and its
double), drawn for each person.
"""

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from x2radar.sim.bodies.wander import Wander, bouts, smooth_step
from x2radar.sim.points import Array

REST = np.array([0.10, 0.06, -0.88])  # a hanging wrist: ahead, outward, up, in lengths of the arm
_REACH = 0.9  # farthest wrist, in lengths of the arm: it stays a little bent
# How far, how fast (rms a second) and where hands work, in lengths of the arm: see above.
_SHIFT_M, _CROUCH, _LEAN_RAD, _TWIST_RAD = 0.06, 0.28, 0.75, 0.7
_LIMITS = (_SHIFT_M, _SHIFT_M, 1.0, 1.0, _TWIST_RAD, *[1.0] * 6)
_RATES = np.array([0.04, 0.04, 0.35, 0.7, 0.4, *[1.4] * 6])
_MIDDLE, _SPAN = np.array([0.50, 0.05, -0.30]), np.array([0.35, 0.30, 0.55])


@dataclass(frozen=True, slots=True, eq=False)
class Doing:
    """Bends, turns and reaches of a body at given times, besides its going."""

    share: Array  # (n_slow,): 0 for arms that swing or hang, 1 for hands at work
    shift_m: Array  # (n_slow, 3): of the hips, ahead, to the left and up
    crouch: Array  # (n_slow,): how much lower the hips are, as a share of the leg
    lean_rad: Array  # (n_slow,): of the trunk, forward
    twist_rad: Array  # (n_slow,): of the chest, to the left
    hands: Array  # (n_slow, 2, 3): wrists from the shoulders, as `within_reach` returns them
    look_rad: Array  # (n_slow, 2): turn of the head to the left, and nod backwards
    feet_m: Array  # (n_slow, 2, 3): feet from where they would stand: ahead, to the left and up


class Doer(Protocol):
    """An activity besides going; a function of time alone."""

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done at times (n_slow,); `vigour` is 0 standing to 1 cruising."""
        ...


def within_reach(hands: Array) -> Array:
    """Return hands, (n_slow, 2, 3) in arms' lengths, none farther than an arm reaches."""
    size = np.linalg.norm(hands, axis=-1, keepdims=True)
    short = hands * np.minimum(1, _REACH / np.maximum(size, 1e-9))
    short[..., 1:2] *= np.array([1.0, -1.0])[:, None]
    return np.asarray(short)


@dataclass(frozen=True, slots=True, eq=False)
class Busy:
    """An activity of hands and trunk: fidgeting, working, searching; a `Doer`."""

    wander: Wander  # shift of the hips (2), crouch, lean, twist, and the two hands (6)
    effort: Wander  # one number in -1 to 1: hands rest where it is low
    size: float  # how far all of it goes, 1 for what everyday work takes

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw how far and how fast."""
        size, pace = rng.uniform(0.3, 1.4), float(np.exp(rng.uniform(-0.5, 0.5)))
        wander = Wander.draw(rng, _LIMITS, pace * _RATES)
        return cls(wander, Wander.draw(rng, [1.0], [0.3 * pace]), size)

    def at(self, t_s: Array, vigour: Array) -> Doing:
        w = self.wander.at(t_s)
        share = (1 - vigour) * smooth_step(0.8 + 1.5 * self.effort.at(t_s)[:, 0])
        much = self.size * share
        lean = 0.5 + 0.5 * w[:, 3]
        hands = REST + self.size * (_MIDDLE + _SPAN * w[:, 5:].reshape(-1, 2, 3) - REST)
        # Bending forward puts the hips back.
        ahead = w[:, 0] - 0.18 * np.sin(_LEAN_RAD * lean)
        return Doing(
            share,
            much[:, None] * np.stack([ahead, w[:, 1], np.zeros(len(t_s))], axis=-1),
            much * _CROUCH * (0.5 + 0.5 * w[:, 2]),
            much * _LEAN_RAD * lean,
            much * w[:, 4],
            within_reach(hands),
            np.zeros((len(t_s), 2)),
            np.zeros((len(t_s), 2, 3)),
        )


_RISE_S = 1.4  # how long getting up takes, and sitting down; 1 to 2 s of the healthy (recalled)
# How far the trunk bows to get up and leans, and the head turns and nods (anatomy).
_BOW_RAD, _TRUNK_RAD = 0.6, 0.22
_TURN_RAD, _NOD_RAD = 0.9, 0.3
_HEAD_ALONE_SHARE = 0.25  # of people who move the head alone, listening or watching (a guess)


@dataclass(frozen=True, slots=True, eq=False)
class Seated:
    """Sitting on a seat, with small movements; a `Doer`."""

    crouch: float  # how much lower the hips are than standing, as a share of the leg
    back_m: float  # how far the hips are behind the feet
    recline_rad: float  # of the back, backwards
    busy: Busy  # the hands
    trunk: Wander  # lean of the trunk, turn and nod of the head, in radians
    # The head is shaken or nods, in bouts.
    shake_rad: tuple[float, float]
    shake_hz: float
    shakes: Wander
    up_s: tuple[float, float]  # gets up, and sits down, after the start of each period
    period_s: float  # infinite for a body that stays

    @classmethod
    def draw(cls, rng: np.random.Generator, leg_m: float) -> Self:
        """Draw a seat and somebody on it whose legs are so long."""
        u, pace = rng.random(10), float(np.exp(rng.uniform(-0.7, 0.7)))
        limits = np.array([_TRUNK_RAD, _TURN_RAD, _NOD_RAD])
        busy = Busy.draw(rng)
        if rng.random() < _HEAD_ALONE_SHARE:
            busy, limits[0] = replace(busy, size=0.0), 0.1 * _TRUNK_RAD
        first = 1.0 + 8.0 * u[0]
        last = first + _RISE_S + 1.0 + 6.0 * u[1]
        gets_up = u[2] < 0.4
        return cls(
            crouch=float(0.40 + 0.14 * u[3]),
            back_m=float((0.38 + 0.10 * u[4]) * leg_m),
            recline_rad=float(0.45 * u[5] - 0.15),
            busy=busy,
            trunk=Wander.draw(rng, limits * (0.3 + 0.7 * u[6]), 0.35 * pace * limits),
            shake_rad=(float(0.5 * u[7]), float(0.25 * u[8])),
            shake_hz=float(0.5 + 1.5 * u[9]),
            shakes=Wander.draw(rng, [1.0], [0.6]),
            up_s=(first, last),
            period_s=last + _RISE_S + 4.0 + 8.0 * float(rng.random()) if gets_up else np.inf,
        )

    def at(self, t_s: Array, vigour: Array) -> Doing:
        doing = self.busy.at(t_s, vigour)
        sits = (1 - vigour) * (1 - self._up(t_s))
        # Getting up begins with bending forward over the feet.
        bow = 4 * sits * (1 - sits)
        trunk = self.trunk.at(t_s)
        shake = bouts(self.shakes, t_s) * np.sin(2 * np.pi * self.shake_hz * t_s)
        look = trunk[:, 1:] + shake[:, None] * np.array(self.shake_rad)
        shift = 0.5 * doing.shift_m
        shift[:, 0] -= sits * self.back_m
        return replace(
            doing,
            shift_m=shift,
            crouch=sits * self.crouch,
            lean_rad=0.5 * doing.lean_rad
            - sits * self.recline_rad
            + _BOW_RAD * bow
            + (1 - vigour) * trunk[:, 0],
            look_rad=(1 - vigour)[:, None] * look,
        )

    def _up(self, t_s: Array) -> Array:
        if not np.isfinite(self.period_s):
            return np.zeros(len(t_s))
        since = np.mod(t_s, self.period_s)
        begin, end = self.up_s
        return smooth_step((since - begin) / _RISE_S) - smooth_step((since - end) / _RISE_S)


# Beats: see above; how uneven the beat is; middle and span of the hands, in lengths of the arm:
# by eye.
_BEAT_HZ = (0.4, 1.6)
_DRIFT_RAD = 0.8
_EXERCISED = np.array([0.50, 0.25, -0.20])
_EXERCISE_SPAN = np.array([0.22, 0.40, 0.75])


@dataclass(frozen=True, slots=True, eq=False)
class Exercise:
    """Squats and hops in one place, in a beat that drifts; a `Doer`."""

    beat_hz: float  # beats a second
    drift: Wander  # of the beat, in radians
    effort: Wander  # one number in -1 to 1; it rests where that is low
    crouch: float  # how deep it squats, as a share of the leg
    hop_m: float  # how high both feet leave the floor
    step_m: Array  # (3,): how far a foot is put ahead and outward and is raised, once a beat
    is_in_turn: bool  # whether the feet go in turn, not together
    lean_rad: float  # amplitudes of trunk, chest and hips
    twist_rad: float
    sway_m: float
    hands: Array  # (2, 2, 3): at the beat and its double, by hand, in lengths of the arm
    phase_rad: Array  # (2, 3): of each hand's directions

    @classmethod
    def draw(cls, rng: np.random.Generator, leg_m: float) -> Self:
        """Draw the exercise of somebody whose legs are so long."""
        u = rng.random(11)
        low, high = np.log(_BEAT_HZ)
        size = (
            rng.uniform(0.0, 1.0, (2, 1, 3)) * np.array([1.0, 0.4])[:, None, None] * _EXERCISE_SPAN
        )
        mirrored = np.repeat(size, 2, axis=1)
        phase = rng.uniform(0, 2 * np.pi, 3)
        return cls(
            beat_hz=float(np.exp(low + (high - low) * u[0])),
            drift=Wander.draw(rng, [_DRIFT_RAD], [0.4]),
            effort=Wander.draw(rng, [1.0], [0.3]),
            crouch=float(0.35 * u[1]) if u[2] < 0.5 else 0.0,
            hop_m=float(0.05 + 0.10 * u[3]) * leg_m if u[4] < 0.3 else 0.0,
            step_m=leg_m * np.array([0.5 * u[5] - 0.15, 0.25 * u[6], 0.04 + 0.36 * u[7] ** 2]),
            is_in_turn=bool(u[8] < 0.75),
            lean_rad=float(0.3 * u[9]),
            twist_rad=float(0.6 * u[10]),
            sway_m=0.04 * leg_m,
            hands=mirrored,
            # Arms go together or against each other.
            phase_rad=np.stack([phase, phase + np.pi * rng.integers(0, 2)]),
        )

    def at(self, t_s: Array, vigour: Array) -> Doing:
        turn = 2 * np.pi * self.beat_hz * t_s + self.drift.at(t_s)[:, 0]
        share = (1 - vigour) * smooth_step(0.8 + 1.5 * self.effort.at(t_s)[:, 0])
        swing = np.sin(turn)
        raised = np.maximum(np.stack([swing, -swing if self.is_in_turn else swing], -1), 0) ** 2
        feet = raised[..., None] * self.step_m
        feet[:, 1, 1] *= -1
        hop = self.hop_m * np.maximum(np.sin(turn + 0.5 * np.pi), 0) ** 2
        feet[..., 2] += hop[:, None]
        angle = turn[:, None, None] + self.phase_rad
        hands = REST + share[:, None, None] * (
            _EXERCISED - REST + self.hands[0] * np.sin(angle) + self.hands[1] * np.sin(2 * angle)
        )
        # The weight goes to the foot that stands.
        sway = -self.sway_m * swing if self.is_in_turn else np.zeros(len(t_s))
        shift = np.stack([np.zeros(len(t_s)), sway, hop], axis=-1)
        return Doing(
            share,
            share[:, None] * shift,
            share * self.crouch * (0.5 - 0.5 * np.cos(turn)),
            share * self.lean_rad * np.sin(turn + 0.7),
            share * self.twist_rad * swing,
            within_reach(hands),
            np.stack([0.3 * share * self.twist_rad * swing, np.zeros(len(t_s))], axis=-1),
            share[:, None, None] * feet,
        )
