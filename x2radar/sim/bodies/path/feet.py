"""Feet: when and where each foot of a body stands, for any number of legs; the finer planner.

Feet on the floor do not move; everything else of a body follows from where they stand and
when. A path and a gait give all footfalls at once, and from them the feet at any time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.path.clock import Clock
from x2radar.sim.bodies.path.footfalls import Footfalls, fall
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.points import Array

OfSpeed = Callable[[Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class FootState:
    """Feet at given times."""

    position_m: Array  # (n_slow, n_legs, 3): in room coordinates
    heading_rad: Array  # (n_slow, n_legs): where they point
    # (n_slow, n_legs): of the stride, from 0 at touch-down over the duty factor at lift-off to 1.
    # In a stance that lasts because the body stands, it waits in the middle.
    phase: Array
    swing: Array  # (n_slow, n_legs): share of the swing that is done; 0 on the floor
    is_stance: NDArray[np.bool_]  # (n_slow, n_legs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gait:
    """How a body puts its feet; tuples are by leg."""

    offset: tuple[float, ...]  # how much later than leg 0 it lands, in strides from 0 to 1
    # Where it stands, half-way through a stance: ahead and left of the point on the path.
    home_m: tuple[tuple[float, float], ...]
    stride_m: OfSpeed  # of a speed in m/s, above 0
    duty: OfSpeed  # share of the stride that a foot is on the floor, likewise
    lift_m: tuple[float, ...]  # in a stride of usual length
    more_duty: tuple[float, ...] = ()  # added to `duty`: a leg that hurts is spared
    # Share of the swing in which a foot gains, and loses, its speed; the peak is
    # ``1 / (1 - 2 ramp + 4 ramp / pi)`` times the mean.
    ramp: float = 0.3
    ahead_s: float = 0.2  # how long before the body the first foot starts


@dataclass(frozen=True, slots=True, eq=False)
class Feet:
    """All footfalls of one body on one path."""

    clock: Clock  # strides gone, as a function of time
    falls: Footfalls  # stances of each leg in order
    ramp: float  # as in `Gait`

    @classmethod
    def plan(cls, path: Path, gait: Gait) -> Self:
        """Return the footfalls of a gait along a path.

        Feet begin to step a little before the body goes and go on for a stride after it has
        stopped, until they stand under it. In between, a foot is left where it is if moving it
        would not bring it anywhere else.
        """
        arm = max(float(np.hypot(*home)) for home in gait.home_m)
        clock = Clock.along(path, gait.stride_m, gait.duty, arm_m=arm, ahead_s=gait.ahead_s)
        more = np.array(gait.more_duty or (0.0,) * len(gait.offset))
        clock = clock.started(gait.offset[0], more[0])
        falls = fall(
            path,
            clock,
            offset=np.array(gait.offset),
            more_duty=more,
            home_m=np.array(gait.home_m),
            lift_m=np.array(gait.lift_m),
        )
        return cls(clock, falls, gait.ramp)

    def at(self, t_s: Array) -> FootState:
        """Return the feet at times of shape (n_slow,), in any order.

        On the floor a foot is still to the last bit; at both ends of a swing its velocity is zero.
        """
        f = self.falls.at(t_s)
        t = t_s[:, None]
        since, until = t - f.touch_down_s, f.lift_off_s - t
        is_stance = until >= 0
        swing = np.clip(-until / f.swing_s, 0.0, 1.0)
        stance = np.minimum(since / f.full_s, 0.5) + 0.5 - np.clip(until / f.full_s, 0.0, 0.5)
        done = eased(swing, self.ramp)
        position = f.place + done[..., None] * f.step
        lifted = np.sin(np.pi * swing)
        height = f.lift_m * lifted * lifted
        return FootState(
            position_m=np.concatenate([position[..., :2], height[..., None]], axis=-1),
            heading_rad=position[..., 2],
            phase=f.duty * stance + (1.0 - f.duty) * swing,
            swing=swing,
            is_stance=is_stance,
        )


def eased(share: Array, ramp: float) -> Array:
    """Return the way done in a movement from rest to rest, from 0 to 1."""
    early = np.minimum(share, 1.0 - share)
    quarter = 2.0 * ramp / np.pi
    peak = 1.0 / (1.0 - 2.0 * ramp + 2.0 * quarter)
    rise = quarter * (1.0 - np.cos(np.minimum(early, ramp) / quarter))
    half = peak * (rise + np.maximum(early - ramp, 0.0))
    return np.where(share < 0.5, half, 1.0 - half)
