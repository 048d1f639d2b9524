"""What the hands and the trunk do while the feet stand: reaching, bending, turning, crouching.

Somebody who searches a drawer, gets dressed or talks goes nowhere and still moves. No motion
capture stands behind this: how far things move is anatomy, how fast is a guess at everyday speed
(hands 0.2 to 0.9 m/s, rms), and the rest is drawn for each person.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander, smooth_step
from x2radar.sim.bodies.person.doing import REST, Doing, within_reach

Array = NDArray[np.float64]

# How far, how fast (rms a second) and where hands work, in lengths of the arm: see above.
_SHIFT_M, _CROUCH, _LEAN_RAD, _TWIST_RAD = 0.06, 0.28, 0.75, 0.7
_LIMITS = np.array([_SHIFT_M, _SHIFT_M, 1.0, 1.0, _TWIST_RAD, *[1.0] * 6])
_RATES = np.array([0.04, 0.04, 0.35, 0.7, 0.4, *[1.4] * 6])
_MIDDLE, _SPAN = np.array([0.50, 0.05, -0.30]), np.array([0.35, 0.30, 0.55])


@dataclass(frozen=True, slots=True, eq=False)
class Busy:
    """Somebody's ways with the hands; see `Doer`."""

    wander: Wander  # shift of the hips (2), crouch, lean, twist, and the two hands (6)
    effort: Wander  # one number in -1 to 1: hands rest where it is low
    size: float  # how far all of it goes, 1 for what everyday work takes

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Busy":
        """Draw somebody who fidgets, works or searches."""
        size, pace = rng.uniform(0.3, 1.4), float(np.exp(rng.uniform(-0.5, 0.5)))
        wander = Wander.draw(rng, _LIMITS, pace * _RATES)
        return cls(wander, Wander.draw(rng, np.ones(1), np.array([0.3 * pace])), size)

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
