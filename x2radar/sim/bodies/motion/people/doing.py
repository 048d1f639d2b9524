"""What somebody does besides going: with hands, trunk and head, or feet in their place.

Somebody who searches a drawer, gets dressed or talks goes nowhere and still moves. No motion
capture stands behind this: how far things move is anatomy, how fast is a guess at everyday speed
(hands 0.2 to 0.9 m/s, rms), and the rest is drawn for each person.
"""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from x2radar.sim.bodies.wander import Wander, smooth_step
from x2radar.sim.points import Array

REST = np.array([0.10, 0.06, -0.88])
"""A hanging wrist from its shoulder: ahead, outward and up, in lengths of the arm."""
_REACH = 0.9
"""Farthest wrist, in lengths of the arm: it stays a little bent."""
# How far, how fast (rms a second) and where hands work, in lengths of the arm: see above.
_SHIFT_M, _CROUCH, _LEAN_RAD, _TWIST_RAD = 0.06, 0.28, 0.75, 0.7
_LIMITS = (_SHIFT_M, _SHIFT_M, 1.0, 1.0, _TWIST_RAD, *[1.0] * 6)
_RATES = np.array([0.04, 0.04, 0.35, 0.7, 0.4, *[1.4] * 6])
_MIDDLE, _SPAN = np.array([0.50, 0.05, -0.30]), np.array([0.35, 0.30, 0.55])


@dataclass(frozen=True, slots=True, eq=False)
class Doing:
    """What somebody does at given times, besides going."""

    share: Array  # (n_slow,): 0 for arms that swing or hang, 1 for hands at work
    shift_m: Array  # (n_slow, 3): of the hips, ahead, to the left and up
    crouch: Array  # (n_slow,): how much lower the hips are, as a share of the leg
    lean_rad: Array  # (n_slow,): of the trunk, forward
    twist_rad: Array  # (n_slow,): of the chest, to the left
    hands: Array  # (n_slow, 2, 3): wrists from the shoulders, as `within_reach` returns them
    look_rad: Array  # (n_slow, 2): turn of the head to the left, and nod backwards
    feet_m: Array  # (n_slow, 2, 3): feet from where they would stand: ahead, to the left and up


class Doer(Protocol):
    """How somebody does it; a function of time alone."""

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done at times of shape (n_slow,).

        `vigour` is 0 standing to 1 at cruising speed: a person who goes does nothing else.
        """
        ...


def within_reach(hands: Array) -> Array:
    """Return hands of which none is farther from its shoulder than an arm reaches.

    Shape (n_slow, 2, 3), left and right: ahead, outward and up, in lengths of the arm. In what
    is returned the second is to the left for both.
    """
    size = np.linalg.norm(hands, axis=-1, keepdims=True)
    short = hands * np.minimum(1, _REACH / np.maximum(size, 1e-9))
    short[..., 1:2] *= np.array([1.0, -1.0])[:, None]
    return np.asarray(short)


@dataclass(frozen=True, slots=True, eq=False)
class Busy:
    """Somebody who fidgets, works or searches with the hands."""

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
        """Return what is done; see `Doer`."""
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
