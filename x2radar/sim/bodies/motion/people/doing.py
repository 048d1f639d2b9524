"""What somebody does besides going: with hands, trunk and head, or with the whole body in place.

No motion capture stands behind this: how far things move is anatomy, how fast a guess (hands 0.2
to 0.9 m/s and the head 0.1 to 0.6 rad/s, rms; exercise is a few sinusoids of 0.4 to 1.6 Hz and its
double), drawn for each person.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

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


Doer = Callable[[Array, Array], Doing]
"""What is done besides going at times (n_slow,), given the vigour: 0 standing to 1 cruising."""


def within_reach(hands: Array) -> Array:
    """Return hands, (n_slow, 2, 3) in arms' lengths, none farther than an arm reaches."""
    size = np.linalg.norm(hands, axis=-1, keepdims=True)
    short = hands * np.minimum(1, _REACH / np.maximum(size, 1e-9))
    short[..., 1:2] *= np.array([1.0, -1.0])[:, None]
    return np.asarray(short)


def _draw_work(rng: np.random.Generator) -> tuple[Wander, Wander, float]:
    """Draw how hips (2), crouch, lean, twist and two hands (6) move, when they rest, and size."""
    size, pace = rng.uniform(0.3, 1.4), float(np.exp(rng.uniform(-0.5, 0.5)))
    wander = Wander(rng, _LIMITS, pace * _RATES)
    return wander, Wander(rng, [1.0], [0.3 * pace]), size


def _busy(wander: Wander, effort: Wander, size: float) -> Doer:
    def at(t_s: Array, vigour: Array) -> Doing:
        w = wander.at(t_s)
        share = (1 - vigour) * smooth_step(0.8 + 1.5 * effort.at(t_s)[:, 0])
        much = size * share
        lean = 0.5 + 0.5 * w[:, 3]
        hands = REST + size * (_MIDDLE + _SPAN * w[:, 5:].reshape(-1, 2, 3) - REST)
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

    return at


_RISE_S = 1.4  # how long getting up takes, and sitting down; 1 to 2 s of the healthy (recalled)
# How far the trunk bows to get up and leans, and the head turns and nods (anatomy).
_BOW_RAD, _TRUNK_RAD = 0.6, 0.22
_TURN_RAD, _NOD_RAD = 0.9, 0.3
_HEAD_ALONE_SHARE = 0.25  # of people who move the head alone, listening or watching (a guess)


def _draw_seated(rng: np.random.Generator, leg_m: float) -> Doer:
    """Draw a seat and somebody on it, with small movements, whose legs are so long."""
    u, pace = rng.random(10), float(np.exp(rng.uniform(-0.7, 0.7)))
    limits = np.array([_TRUNK_RAD, _TURN_RAD, _NOD_RAD])
    wander, effort, size = _draw_work(rng)
    if rng.random() < _HEAD_ALONE_SHARE:
        size, limits[0] = 0.0, 0.1 * _TRUNK_RAD
    busy = _busy(wander, effort, size)
    # It gets up, and sits down, after the start of each period, which is infinite if it stays.
    first = 1.0 + 8.0 * u[0]
    last = first + _RISE_S + 1.0 + 6.0 * u[1]
    crouch, back_m = float(0.40 + 0.14 * u[3]), float((0.38 + 0.10 * u[4]) * leg_m)
    recline_rad = float(0.45 * u[5] - 0.15)  # of the back, backwards
    # Lean of the trunk, turn and nod of the head; the head is shaken or nods, in bouts.
    trunk_rad = Wander(rng, limits * (0.3 + 0.7 * u[6]), 0.35 * pace * limits)
    shake_rad, shake_hz = np.array([0.5 * u[7], 0.25 * u[8]]), float(0.5 + 1.5 * u[9])
    shakes = Wander(rng, [1.0], [0.6])
    period_s = last + _RISE_S + 4.0 + 8.0 * float(rng.random()) if u[2] < 0.4 else np.inf

    def up(t_s: Array) -> Array:
        if not np.isfinite(period_s):
            return np.zeros(len(t_s))
        since = np.mod(t_s, period_s)
        return smooth_step((since - first) / _RISE_S) - smooth_step((since - last) / _RISE_S)

    def at(t_s: Array, vigour: Array) -> Doing:
        doing = busy(t_s, vigour)
        sits = (1 - vigour) * (1 - up(t_s))
        # Getting up begins with bending forward over the feet.
        bow = 4 * sits * (1 - sits)
        trunk = trunk_rad.at(t_s)
        shake = bouts(shakes, t_s) * np.sin(2 * np.pi * shake_hz * t_s)
        look = trunk[:, 1:] + shake[:, None] * shake_rad
        shift = 0.5 * doing.shift_m
        shift[:, 0] -= sits * back_m
        lean = 0.5 * doing.lean_rad - sits * recline_rad + _BOW_RAD * bow
        return replace(
            doing,
            shift_m=shift,
            crouch=sits * crouch,
            lean_rad=lean + (1 - vigour) * trunk[:, 0],
            look_rad=(1 - vigour)[:, None] * look,
        )

    return at


# Beats: see above; how uneven the beat is; middle and span of the hands, in lengths of the arm:
# by eye.
_BEAT_HZ = (0.4, 1.6)
_DRIFT_RAD = 0.8
_EXERCISED = np.array([0.50, 0.25, -0.20])
_EXERCISE_SPAN = np.array([0.22, 0.40, 0.75])


def _draw_exercise(rng: np.random.Generator, leg_m: float) -> Doer:
    """Draw squats and hops in one place, in a beat that drifts, of legs that are so long."""
    u = rng.random(11)
    low, high = np.log(_BEAT_HZ)
    # By hand, at the beat and its double, in lengths of the arm; both arms are mirrored.
    size = rng.uniform(0.0, 1.0, (2, 1, 3)) * np.array([1.0, 0.4])[:, None, None] * _EXERCISE_SPAN
    once, twice = np.repeat(size, 2, axis=1)
    phase = rng.uniform(0, 2 * np.pi, 3)
    beat_hz = float(np.exp(low + (high - low) * u[0]))
    drift_rad = Wander(rng, [_DRIFT_RAD], [0.4])
    effort = Wander(rng, [1.0], [0.3])  # it rests where that is low
    squat = float(0.35 * u[1]) if u[2] < 0.5 else 0.0
    hop_m = float(0.05 + 0.10 * u[3]) * leg_m if u[4] < 0.3 else 0.0
    # How far a foot is put ahead and outward and is raised, once a beat, in turn or together.
    step_m = leg_m * np.array([0.5 * u[5] - 0.15, 0.25 * u[6], 0.04 + 0.36 * u[7] ** 2])
    is_in_turn, sway_m = bool(u[8] < 0.75), 0.04 * leg_m
    lean_rad, twist_rad = float(0.3 * u[9]), float(0.6 * u[10])
    # Arms go together or against each other.
    phase_rad = np.stack([phase, phase + np.pi * rng.integers(0, 2)])

    def at(t_s: Array, vigour: Array) -> Doing:
        turn = 2 * np.pi * beat_hz * t_s + drift_rad.at(t_s)[:, 0]
        share = (1 - vigour) * smooth_step(0.8 + 1.5 * effort.at(t_s)[:, 0])
        swing, zero = np.sin(turn), np.zeros(len(t_s))
        raised = np.maximum(np.stack([swing, -swing if is_in_turn else swing], -1), 0) ** 2
        feet = raised[..., None] * step_m
        feet[:, 1, 1] *= -1
        hop = hop_m * np.maximum(np.sin(turn + 0.5 * np.pi), 0) ** 2
        feet[..., 2] += hop[:, None]
        angle = turn[:, None, None] + phase_rad
        hands = REST + share[:, None, None] * (
            _EXERCISED - REST + once * np.sin(angle) + twice * np.sin(2 * angle)
        )
        # The weight goes to the foot that stands.
        shift = np.stack([zero, -sway_m * swing if is_in_turn else zero, hop], axis=-1)
        return Doing(
            share,
            share[:, None] * shift,
            share * squat * (0.5 - 0.5 * np.cos(turn)),
            share * lean_rad * np.sin(turn + 0.7),
            share * twist_rad * swing,
            within_reach(hands),
            np.stack([0.3 * share * twist_rad * swing, zero], axis=-1),
            share[:, None, None] * feet,
        )

    return at


DOERS: Mapping[str, Callable[[np.random.Generator, float], Doer]] = {
    "busy": lambda rng, _: _busy(*_draw_work(rng)),  # fidgeting, working, searching
    "sit": _draw_seated,
    "exercise": _draw_exercise,
}
"""What somebody may do besides going: how it is drawn, given the length of the legs."""
