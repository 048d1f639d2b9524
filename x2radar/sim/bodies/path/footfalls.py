"""Stances of all legs of a body: when each begins and ends, and where it is."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.path.clock import STEP_S, Clock
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.points import Array

_EVER_S = 1e9
"""Beyond any scene."""
# Steps that bring a foot less far, in metres and radians, are not made: nobody would see them.
_SAME_PLACE_M = 0.01
_SAME_HEADING = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Footfalls:
    """Stances, each with the swing that follows it.

    The last axis but `place` and `step`'s is legs; those two add one of length 3: x and y in
    metres, heading in radians. The first axis is stances in order, or times in `at`.
    """

    touch_down_s: Array
    lift_off_s: Array
    swing_s: Array  # how long the swing after it takes
    full_s: Array  # how long the stance would be in steady movement, or is, if that is less
    duty: Array
    lift_m: Array
    place: Array  # where the foot stands
    step: Array  # what the swing adds to that

    def at(self, t_s: Array) -> Self:
        """Return the stance that each leg is in, or last was in, at times (n_slow,)."""
        legs = np.arange(self.touch_down_s.shape[1])
        k = np.stack(
            [np.searchsorted(self.touch_down_s[:, leg], t_s, side="right") for leg in legs],
            axis=1,
        )
        k = np.maximum(k - 1, 0)
        return type(self)(*(getattr(self, f.name)[k, legs] for f in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class _Leg:
    """Steps of one leg: the arrays of stances are one longer than those of swings."""

    touch_down_s: Array
    lift_off_s: Array
    duty: Array
    period_s: Array
    place: Array


def fall(
    path: Path, clock: Clock, *, offset: Array, more_duty: Array, home_m: Array, lift_m: Array
) -> Footfalls:
    """Return all footfalls along a path; arrays by leg, as in `Gait`.

    Legs with fewer steps than others are filled up with stances that never come.
    """
    legs = [
        _leg(path, clock, *row)
        for row in zip(offset.tolist(), more_duty.tolist(), home_m, strict=True)
    ]
    n = max(len(leg.lift_off_s) for leg in legs)
    empty = (2 * _EVER_S, 3 * _EVER_S, 1.0, 1.0, 0.6, 0.0, np.zeros(3), np.zeros(3))
    table = Footfalls(*(np.full((n, len(legs), *np.shape(x)), x) for x in empty))
    for k, leg in enumerate(legs):
        m = len(leg.lift_off_s)
        step = np.diff(leg.place, axis=0)
        way = np.hypot(step[:, 0], step[:, 1]) + 0.2 * np.abs(step[:, 2])
        usual = max(float(np.median(way)), 1e-3) if m > 1 else 1.0
        table.touch_down_s[:m, k] = leg.touch_down_s
        table.lift_off_s[:m, k] = leg.lift_off_s
        table.swing_s[: m - 1, k] = leg.touch_down_s[1:] - leg.lift_off_s[:-1]
        table.full_s[:m, k] = np.minimum(
            leg.lift_off_s - leg.touch_down_s, leg.duty * leg.period_s
        )
        table.duty[:m, k] = leg.duty
        table.lift_m[: m - 1, k] = lift_m[k] * np.minimum(way / (0.6 * usual), 1.0)
        table.place[:m, k] = leg.place
        table.step[: m - 1, k] = step
    return table


def _leg(path: Path, clock: Clock, offset: float, more_duty: float, home_m: Array) -> _Leg:
    times = clock.start_s + STEP_S * np.arange(len(clock.rate_hz))
    lifts, lands, duties, periods = [], [], [], []
    for a, b in clock.spans:
        t = times[a : b + 1]
        phase = clock.strides[a : b + 1] - offset
        whole = np.arange(np.floor(phase[0]), np.floor(phase[-1] + 1e-9) + 1)
        # A leg that would be in the air at the beginning, or at the end, stays where it is.
        land = np.interp(whole[1:], phase, t)
        before = np.concatenate([t[:1], land[:-1]])[: len(land)]
        duty = np.interp(before, times, clock.duty) + more_duty
        lift_at = whole[:-1] + duty
        is_step = lift_at >= phase[0] - 1e-6
        lifts.append(np.interp(lift_at, phase, t)[is_step])
        lands.append(land[is_step])
        duties.append(duty[is_step])
        periods.append(1.0 / np.interp(lifts[-1], times, clock.rate_hz))
    lift = np.concatenate([*lifts, [_EVER_S]])
    land = np.concatenate([[-_EVER_S], *lands])
    duty = np.concatenate([*duties, [0.6]])
    period = np.concatenate([*periods, [1.0]])
    if len(duty) > 1:
        duty[-1], period[-1] = duty[-2], period[-2]
    half = np.clip(0.5 * (lift + land), path.start_s - 1.0, path.end_s + 1.0)
    half[0], half[-1] = path.start_s - 1.0, path.end_s + 1.0
    state = path.at(half)
    cos, sin = np.cos(state.heading_rad), np.sin(state.heading_rad)
    place = np.stack(
        [
            state.x_m + home_m[0] * cos - home_m[1] * sin,
            state.y_m + home_m[0] * sin + home_m[1] * cos,
            state.heading_rad,
        ],
        axis=1,
    )
    keep = _moved(place)
    down = np.concatenate([[True], keep])
    up = np.concatenate([keep, [True]])
    return _Leg(land[down], lift[up], duty[up], period[up], place[down])


def _moved(place: Array) -> NDArray[np.bool_]:
    """Return which steps bring the foot to another place than the last one kept."""
    keep = np.ones(len(place) - 1, dtype=bool)
    step = np.abs(np.diff(place, axis=0))
    if (np.hypot(step[:, 0], step[:, 1]) + step[:, 2] > _SAME_PLACE_M + _SAME_HEADING).all():
        return keep
    last = place[0]
    for k, there in enumerate(place[1:]):
        step = np.abs(there - last)
        keep[k] = np.hypot(step[0], step[1]) > _SAME_PLACE_M or step[2] > _SAME_HEADING
        if keep[k]:
            last = there
    return keep
