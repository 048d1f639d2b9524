"""Feet: when and where each foot of a body stands, by two planners; how far it is in its strides.

Feet on the floor do not move; everything else of a body follows from where they stand and
when. A path and a gait give all footfalls at once, and from them the feet at any time: by a stride
clock for any number of legs (`Feet`), or by a phase that counts strides and plain prints.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from x2radar.sim.bodies.path.path import Path
from x2radar.sim.points import Array

_STEP_S = 0.02  # of the table: a tenth of the quickest stride or less
# By eye: over how long, and how much, steps get shorter before they get slower; the duty
# factor of somebody who comes to a stand; below which speed a body stands; and how long the table
# goes on after that.
_NEAR_S = 1.0
_SLOWED = 0.64
_STANDING_DUTY = 0.62
_STILL_MPS = 1e-3
_TAIL_S = 8.0
_EVER_S = 1e9  # beyond any scene
# Steps that bring a foot less far, in metres and radians, are not made: nobody would see them.
_SAME_PLACE_M = 0.01
_SAME_HEADING = 0.05

OfSpeed = Callable[[Array], Array]


class Clock:
    """Strides gone at any time on a path, tabulated every `_STEP_S`.

    It is set so that the first leg lifts off at the beginning of every span in which feet step.
    """

    def __init__(self, path: Path, gait: "Gait") -> None:
        # How far off the middle the feet are.
        arm_m = max(float(np.hypot(*home)) for home in gait.home_m)
        self.start_s = path.start_s - gait.ahead_s - _NEAR_S
        n = int((path.end_s + _TAIL_S - self.start_s) / _STEP_S) + 2
        state = path.at(self.start_s + _STEP_S * np.arange(n, dtype=np.float64))
        speed = np.hypot(state.speed_mps, arm_m * state.turn_rad_s)
        reach = int(_NEAR_S / _STEP_S)
        around = sliding_window_view(np.pad(speed, reach, mode="edge"), 2 * reach + 1)
        near = around.max(axis=1)
        # Steps get shorter rather than slower where the body slows down for a moment.
        drive = np.maximum(speed, _SLOWED * near)
        self.spans = _spans(speed, drive, gait.stride_m, int(gait.ahead_s / _STEP_S))
        moving = np.zeros(n, dtype=bool)
        for a, b in self.spans:
            moving[a : b + 1] = True
        safe = np.maximum(drive, _STILL_MPS)
        # Strides per second; 0 where the body stands.
        self.rate_hz = np.where(moving, safe / gait.stride_m(safe), 0.0)
        # A runner who stops does not go on hopping: he stands on both feet as he slows down.
        duty = np.maximum(gait.duty(safe), _STANDING_DUTY * (1 - speed / safe))
        self.duty = np.where(moving, duty, 1.0)
        steps = (self.rate_hz[1:] + self.rate_hz[:-1]) * (_STEP_S / 2)
        own = np.concatenate([[0.0], np.cumsum(steps)])
        # Never less than before; in between, parabolas.
        self.strides = gone = own.copy()
        last = 0
        for a, b in self.spans:
            begin = self.duty[a] + gait.more_duty[0] + gait.offset[0]
            begin += np.ceil(gone[last] - begin)
            gone[a : b + 1] = begin + own[a : b + 1] - own[a]
            if last:
                gone[last : a + 1] = np.linspace(gone[last], begin, a + 1 - last)
            else:
                gone[:a] = begin
            last = b
        gone[last:] = gone[last]

    def at(self, t_s: Array) -> Array:
        """Return the strides gone at given times; shape (n_slow,), float64."""
        place = np.clip((t_s - self.start_s) / _STEP_S, 0.0, len(self.rate_hz) - 1.000001)
        k = place.astype(np.int64)
        u = place - k
        # Between two entries the rate goes straight from one to the other.
        ra, rb = self.rate_hz[k], self.rate_hz[k + 1]
        bend = np.where((ra > 0) & (rb > 0), (rb - ra) * (_STEP_S / 2), 0.0)
        step = self.strides[k + 1] - self.strides[k]
        return np.asarray(self.strides[k] + u * (step - bend * (1 - u)), dtype=np.float64)


def _spans(speed: Array, drive: Array, stride_m: OfSpeed, n_ahead: int) -> NDArray[np.int64]:
    """Return first and last entries, (n_spans, 2), of where feet step.

    `drive` is filled in where the body already, or yet, stands.
    """
    moves = speed > _STILL_MPS
    edges = np.flatnonzero(np.diff(moves.astype(np.int8)))
    found: list[list[int]] = []
    # It stands at both ends, so starts and stops come in pairs.
    for a, b in edges.reshape(-1, 2):
        begin = max(int(a) + 1 - n_ahead, 0)
        drive[begin : a + 1] = drive[a + 1]
        rate = drive[b] / stride_m(drive[b : b + 1])[0]
        end = min(int(b) + 1 + int(np.ceil(1.0 / (rate * _STEP_S))), len(speed) - 1)
        drive[b + 1 : end + 1] = np.maximum(drive[b], drive[b + 1 : end + 1])
        if found and begin <= found[-1][1] + 1:
            found[-1][1] = max(end, found[-1][1])
        else:
            found.append([begin, end])
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _leg(path: Path, clock: Clock, gait: "Gait", k: int) -> tuple[Array, ...]:
    """Return when leg `k` touches down and lifts off, duty, period and place of each stance."""
    times = clock.start_s + _STEP_S * np.arange(len(clock.rate_hz))
    lifts, lands, duties, periods = [], [], [], []
    for a, b in clock.spans:
        t = times[a : b + 1]
        phase = clock.strides[a : b + 1] - gait.offset[k]
        whole = np.arange(np.floor(phase[0]), np.floor(phase[-1] + 1e-9) + 1)
        # A leg that would be in the air at the beginning, or at the end, stays where it is.
        land = np.interp(whole[1:], phase, t)
        before = np.concatenate([t[:1], land[:-1]])[: len(land)]
        duty = np.interp(before, times, clock.duty) + gait.more_duty[k]
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
    place = np.column_stack([state.beside(*gait.home_m[k]), state.heading_rad])
    keep = _moved(place)
    down = np.concatenate([[True], keep])
    up = np.concatenate([keep, [True]])
    return land[down], lift[up], duty[up], period[up], place[down]


def _moved(place: Array) -> NDArray[np.bool_]:
    """Return which steps bring the foot to another place than the last one kept."""
    keep, last = np.ones(len(place) - 1, dtype=bool), place[0]
    for k, there in enumerate(place[1:]):
        step = np.abs(there - last)
        keep[k] = np.hypot(step[0], step[1]) > _SAME_PLACE_M or step[2] > _SAME_HEADING
        if keep[k]:
            last = there
    return keep


@dataclass(frozen=True, slots=True, eq=False)
class FootState:
    """Places, headings and phases of all feet at given times."""

    position_m: Array  # (n_slow, n_legs, 3): in room coordinates
    heading_rad: Array  # (n_slow, n_legs): where they point
    # (n_slow, n_legs): of the stride, from 0 at touch-down over the duty factor at lift-off to 1.
    # In a stance that lasts because the body stands, it waits in the middle.
    phase: Array
    duty: Array  # (n_slow, n_legs): duty factor of each one's stride
    swing: Array  # (n_slow, n_legs): share of the swing that is done; 0 on the floor alone


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gait:
    """Timing and places of a body's footfalls; tuples are by leg."""

    offset: tuple[float, ...]  # how much later than leg 0 it lands, in strides from 0 to 1
    # Where it stands, half-way through a stance: ahead and left of the point on the path.
    home_m: tuple[tuple[float, float], ...]
    stride_m: OfSpeed  # of a speed in m/s, above 0
    duty: OfSpeed  # share of the stride that a foot is on the floor, likewise
    lift_m: tuple[float, ...]  # in a stride of usual length
    more_duty: tuple[float, ...] = (0.0,) * 4  # added to `duty`: a leg that hurts is spared
    # Share of the swing in which a foot gains, and loses, its speed; the peak is
    # ``1 / (1 - 2 ramp + 4 ramp / pi)`` times the mean.
    ramp: float = 0.3
    ahead_s: float = 0.2  # how long before the body the first foot starts


class Feet:
    """All footfalls of one body on one path, by a gait."""

    def __init__(self, path: Path, gait: Gait) -> None:
        self.clock = clock = Clock(path, gait)  # strides gone, as a function of time
        self.ramp = gait.ramp
        # Of each leg a row a stance, in order: touch-down, lift-off, duration of the swing after
        # it, and of the stance in steady movement, or what it is, if that is less; duty, lift;
        # where the foot stands, and what the swing adds to that: x, y and heading.
        self.stances: list[Array] = []
        for k, full_lift_m in enumerate(gait.lift_m):
            down_s, up_s, duty, period_s, place = _leg(path, clock, gait, k)
            step = np.diff(place, axis=0, append=place[-1:])
            way = np.hypot(step[:, 0], step[:, 1]) + 0.2 * np.abs(step[:, 2])
            usual = max(float(np.median(way[:-1])), 1e-3) if len(way) > 1 else 1.0
            swing_s = np.append(down_s[1:] - up_s[:-1], 1.0)
            full_s = np.minimum(up_s - down_s, duty * period_s)
            lift_m = full_lift_m * np.minimum(way / (0.6 * usual), 1.0)
            columns = (down_s, up_s, swing_s, full_s, duty, lift_m, place, step)
            self.stances.append(np.column_stack(columns))

    def at(self, t_s: Array) -> FootState:
        """Return the feet at times (n_slow,); on the floor one is still to the last bit."""
        # The stance that each leg is in, or last was in.
        now = (np.searchsorted(leg[:, 0], t_s, side="right") - 1 for leg in self.stances)
        rows = [leg[np.maximum(k, 0)] for leg, k in zip(self.stances, now, strict=True)]
        f = np.stack(rows, axis=1)
        down_s, up_s, swing_s, full_s, duty, lift_m = np.moveaxis(f[..., :6], -1, 0)
        t = t_s[:, None]
        since, until = t - down_s, up_s - t
        swing = np.clip(-until / swing_s, 0.0, 1.0)
        stance = np.minimum(since / full_s, 0.5) + 0.5 - np.clip(until / full_s, 0.0, 0.5)
        done = eased(swing, self.ramp)
        position = f[..., 6:9] + done[..., None] * f[..., 9:]
        lifted = np.sin(np.pi * swing)
        height = lift_m * lifted * lifted
        return FootState(
            position_m=np.concatenate([position[..., :2], height[..., None]], axis=-1),
            heading_rad=position[..., 2],
            phase=duty * stance + (1.0 - duty) * swing,
            duty=duty,
            swing=swing,
        )


def eased(share: Array, ramp: float) -> Array:
    """Return the way done in a movement from rest to rest, from 0 to 1."""
    early = np.minimum(share, 1.0 - share)
    quarter = 2.0 * ramp / np.pi
    peak = 1.0 / (1.0 - 2.0 * ramp + 2.0 * quarter)
    rise = quarter * (1.0 - np.cos(np.minimum(early, ramp) / quarter))
    half = peak * (rise + np.maximum(early - ramp, 0.0))
    return np.where(share < 0.5, half, 1.0 - half)


_TICK_S, _MARGIN_S = 0.01, 0.5  # of the table, and how far it goes on before and after the way
_RAMP = 0.25  # of a swing: a foot's peak speed is 1.2 times its mean (recalled)


class StridePhase:
    """Strides done since a path's beginning: the integral of speed over stride length.

    A table of 10 ms steps, straight in between; standing still stops it. `stride_m` is metres by
    speeds in m/s.
    """

    def __init__(self, path: Path, stride_m: OfSpeed) -> None:
        self.t_s: Array = np.arange(path.start_s - _MARGIN_S, path.end_s + _MARGIN_S, _TICK_S)
        speed = path.at(self.t_s).speed_mps
        rate_hz = speed / np.maximum(stride_m(np.maximum(speed, 0.05)), 0.02)
        steps = 0.5 * (rate_hz[1:] + rate_hz[:-1]) * _TICK_S
        self.strides: Array = np.concatenate([[0.0], np.cumsum(steps)])

    def at(self, t_s: Array) -> Array:
        """Return the strides done at times of shape (n_slow,)."""
        return np.interp(t_s, self.t_s, self.strides)

    def time_s(self, strides: Array) -> Array:
        """Return when so many strides are done; the ends of the table outside of it."""
        # A phase that stands still would have no inverse.
        rising = self.strides + 1e-9 * np.arange(len(self.strides))
        return np.interp(strides, rising, self.t_s)


class Footprints:
    """Where one foot stands, stance after stance, and how it gets from one to the next.

    It lands at the phase `offset` and stands for `duty`, both in strides, `home_m` ahead of and
    beside the middle; `lift_skew` says where a swing is highest: 1 in the middle, less is earlier.
    """

    def __init__(
        self,
        path: Path,
        phase: StridePhase,
        *,
        offset: float,
        duty: float,
        home_m: tuple[float, float],
        facing_rad: float = 0.0,
        lift_m: float,
        lift_skew: float = 1.0,
        scatter_m: Array | None = None,
    ) -> None:
        self.phase, self.offset, self.duty = phase, offset, duty
        self.lift_m, self.lift_skew = lift_m, lift_skew
        self.first = int(np.floor(phase.strides[0] - offset)) - 1  # number of the first print
        last = int(np.ceil(phase.strides[-1] - offset)) + 1
        number = np.arange(self.first, last + 1)
        state = path.at(phase.time_s(np.asarray(number + offset + 0.5 * duty, np.float64)))
        self.place_m = state.beside(*home_m, facing_rad)
        if scatter_m is not None:
            self.place_m = self.place_m + scatter_m[number % len(scatter_m)]

    def at(self, t_s: Array, vigour: Array) -> tuple[Array, Array]:
        """Return the sole, shape (n_slow, 3), and how far its swing is, 0 to 1."""
        p = self.phase.at(t_s) - self.offset
        whole = np.floor(p)
        k = np.clip(whole.astype(np.int64) - self.first, 0, len(self.place_m) - 2)
        swing = np.clip((p - whole - self.duty) / (1.0 - self.duty), 0.0, 1.0)
        done = eased(swing, _RAMP)
        flat = self.place_m[k] + done[:, None] * (self.place_m[k + 1] - self.place_m[k])
        up = self.lift_m * vigour * np.sin(np.pi * swing**self.lift_skew) ** 1.5
        return np.concatenate([flat, up[:, None]], axis=1), swing
