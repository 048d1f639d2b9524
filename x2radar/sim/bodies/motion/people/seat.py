"""Somebody who sits: hands, trunk and head move; some get up for a while and sit down again.

A seat is where thighs are about level. How far head and trunk move is anatomy, how fast a guess
at everyday speed (head 0.1 to 0.6 rad/s turned by the wander, rms; up to 2 shakes or nods a
second), as in `doing`.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.people.doing import Busy, Doing
from x2radar.sim.bodies.wander import Wander, bouts, smooth_step
from x2radar.sim.points import Array

_RISE_S = 1.4
"""How long getting up takes, and sitting down; 1 to 2 s of the healthy (recalled)."""
# How far the trunk bows to get up and leans, and the head turns and nods (anatomy).
_BOW_RAD, _TRUNK_RAD = 0.6, 0.22
_TURN_RAD, _NOD_RAD = 0.9, 0.3
_HEAD_ALONE_SHARE = 0.25
"""Share of people who move the head alone, listening or watching (a guess)."""


@dataclass(frozen=True, slots=True, eq=False)
class Shake:
    """A head that is shaken or nods, in bouts."""

    size_rad: tuple[float, float]
    hz: float
    bout: Wander

    def at(self, t_s: Array) -> Array:
        """Return turn and nod, in radians, shape (n_slow, 2)."""
        share = bouts(self.bout, t_s)
        return np.asarray(
            (share * np.sin(2 * np.pi * self.hz * t_s))[:, None] * np.array(self.size_rad)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Seated:
    """Somebody on a seat; see `Doer`."""

    crouch: float  # how much lower the hips are than standing, as a share of the leg
    back_m: float  # how far the hips are behind the feet
    recline_rad: float  # of the back, backwards
    busy: Busy  # the hands
    trunk: Wander  # lean of the trunk, turn and nod of the head, in radians
    shake: Shake  # of the head
    up_s: tuple[float, float]  # gets up, and sits down, after the start of each period
    period_s: float  # infinite for somebody who stays

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
            shake=Shake(
                (float(0.5 * u[7]), float(0.25 * u[8])),
                float(0.5 + 1.5 * u[9]),
                Wander.draw(rng, [1.0], [0.6]),
            ),
            up_s=(first, last),
            period_s=last + _RISE_S + 4.0 + 8.0 * float(rng.random()) if gets_up else np.inf,
        )

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done; see `Doer`."""
        doing = self.busy.at(t_s, vigour)
        sits = (1 - vigour) * (1 - self._up(t_s))
        # Getting up begins with bending forward over the feet.
        bow = 4 * sits * (1 - sits)
        trunk = self.trunk.at(t_s)
        look = trunk[:, 1:] + self.shake.at(t_s)
        back = sits * self.back_m
        shift = 0.5 * doing.shift_m
        shift[:, 0] -= back
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
        """Return how far it stands, 0 to 1."""
        if not np.isfinite(self.period_s):
            return np.zeros(len(t_s))
        since = np.mod(t_s, self.period_s)
        begin, end = self.up_s
        return smooth_step((since - begin) / _RISE_S) - smooth_step((since - end) / _RISE_S)
