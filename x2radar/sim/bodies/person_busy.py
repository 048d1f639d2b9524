"""What the hands and the trunk do while the feet stand: reaching, bending, turning, crouching.

Somebody who searches a drawer, gets dressed or talks goes nowhere and still moves. No motion
capture stands behind this: how far things move is anatomy, how fast is a guess at everyday speed
(hands 0.2 to 0.9 m/s, rms), and the rest is drawn anew for everybody.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flight import Wander, smooth_step

Array = NDArray[np.float64]

_SHIFT_M, _CROUCH, _LEAN_RAD, _TWIST_RAD = 0.06, 0.28, 0.75, 0.7
_LIMITS = np.array([_SHIFT_M, _SHIFT_M, 1.0, 1.0, _TWIST_RAD, *[1.0] * 6])
_RATES = np.array([0.04, 0.04, 0.35, 0.7, 0.4, *[1.4] * 6])
_REST = np.array([0.10, 0.06, -0.88])
_MIDDLE, _SPAN = np.array([0.50, 0.05, -0.30]), np.array([0.35, 0.30, 0.55])
_REACH = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Doing:
    """What somebody does at given times, besides going.

    Attributes
    ----------
    share : ndarray, shape (n_slow,), float64
        0 for arms that swing or hang, 1 for hands at work.
    shift_m : ndarray, shape (n_slow, 2), float64
        Of the hips, ahead and to the left.
    crouch : ndarray, shape (n_slow,), float64
        How much lower the hips are, as a share of the leg.
    lean_rad, twist_rad : ndarray, shape (n_slow,), float64
        Of the trunk, forward, and of the chest, to the left.
    hands : ndarray, shape (n_slow, 2, 3), float64
        Wrists from the shoulders: ahead of the chest, outward and up, in lengths of the arm.
    """

    share: Array
    shift_m: Array
    crouch: Array
    lean_rad: Array
    twist_rad: Array
    hands: Array


@dataclass(frozen=True, slots=True, eq=False)
class Busy:
    """Somebody's ways with the hands.

    Attributes
    ----------
    wander : Wander
        Shift of the hips (2), crouch, lean, twist, and the two hands (6).
    effort : Wander
        One number in -1 to 1: hands rest where it is low.
    size : float
        How far all of it goes, 1 for what everyday work takes.
    """

    wander: Wander
    effort: Wander
    size: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Busy":
        """Draw somebody who fidgets, works or searches."""
        size, pace = rng.uniform(0.3, 1.4), float(np.exp(rng.uniform(-0.5, 0.5)))
        wander = Wander.draw(rng, _LIMITS, pace * _RATES)
        return cls(wander, Wander.draw(rng, np.ones(1), np.array([0.3 * pace])), size)

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done.

        Parameters
        ----------
        t_s : ndarray, shape (n_slow,), float64
            Times, in seconds.
        vigour : ndarray, shape (n_slow,), float64
            0 standing to 1 at cruising speed: who goes keeps the hands still.
        """
        w = self.wander.at(t_s)
        share = (1 - vigour) * smooth_step(0.8 + 1.5 * self.effort.at(t_s)[:, 0])
        much = self.size * share
        lean = 0.5 + 0.5 * w[:, 3]
        sides = np.array([1.0, -1.0])[:, None]
        hands = _REST + self.size * (_MIDDLE + _SPAN * w[:, 5:].reshape(-1, 2, 3) - _REST)
        hands = hands * np.minimum(1, _REACH / np.linalg.norm(hands, axis=-1, keepdims=True))
        hands[..., 1:2] *= sides
        # Who bends forward puts the hips back.
        ahead = w[:, 0] - 0.18 * np.sin(_LEAN_RAD * lean)
        return Doing(
            share,
            much[:, None] * np.stack([ahead, w[:, 1]], axis=-1),
            much * _CROUCH * (0.5 + 0.5 * w[:, 2]),
            much * _LEAN_RAD * lean,
            much * w[:, 4],
            hands,
        )
