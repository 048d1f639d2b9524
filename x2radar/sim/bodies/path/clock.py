"""The stride clock: how far a body is in its strides, as a function of time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from x2radar.sim.bodies.path.path import Path
from x2radar.sim.points import Array

STEP_S = 0.02  # of the table: a tenth of the quickest stride or less
# By eye: over how long, and how much, steps get shorter before they get slower; the duty
# factor of somebody who comes to a stand; below which speed a body stands; and how long the table
# goes on after that.
_NEAR_S = 1.0
_SLOWED = 0.64
_STANDING_DUTY = 0.62
_STILL_MPS = 1e-3
_TAIL_S = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """Strides gone at any time, tabulated every `STEP_S`."""

    start_s: float  # of the first entry
    rate_hz: Array  # (n_times,): strides per second; 0 where the body stands
    duty: Array  # (n_times,)
    spans: NDArray[np.int64]  # (n_spans, 2): first and last entries in which feet step
    strides: Array  # (n_times,): strides gone; never less than before. In between, parabolas

    @classmethod
    def along(
        cls,
        path: Path,
        stride_m: Callable[[Array], Array],
        duty: Callable[[Array], Array],
        *,
        arm_m: float,
        ahead_s: float,
    ) -> Self:
        """Return the clock on a path; feet are `arm_m` off and start `ahead_s` before the body."""
        first = path.start_s - ahead_s - _NEAR_S
        n = int((path.end_s + _TAIL_S - first) / STEP_S) + 2
        state = path.at(first + STEP_S * np.arange(n, dtype=np.float64))
        speed = np.hypot(state.speed_mps, arm_m * state.turn_rad_s)
        reach = int(_NEAR_S / STEP_S)
        around = sliding_window_view(np.pad(speed, reach, mode="edge"), 2 * reach + 1)
        near = around.max(axis=1)
        # Steps get shorter rather than slower where the body slows down for a moment.
        drive = np.maximum(speed, _SLOWED * near)
        spans = _spans(speed, drive, stride_m, int(ahead_s / STEP_S))
        moving = np.zeros(n, dtype=bool)
        for a, b in spans:
            moving[a : b + 1] = True
        safe = np.maximum(drive, _STILL_MPS)
        rate = np.where(moving, safe / stride_m(safe), 0.0)
        # A runner who stops does not go on hopping: he stands on both feet as he slows down.
        share = np.where(moving, np.maximum(duty(safe), _STANDING_DUTY * (1 - speed / safe)), 1.0)
        gone = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) * (STEP_S / 2))])
        return cls(first, rate, share, spans, gone)

    def started(self, offset: float, more_duty: float) -> Self:
        """Return a clock set so that the first leg lifts off at the beginning of every span."""
        gone = self.strides.copy()
        last = 0
        for a, b in self.spans:
            begin = self.duty[a] + more_duty + offset
            begin += np.ceil(gone[last] - begin)
            gone[a : b + 1] = begin + self.strides[a : b + 1] - self.strides[a]
            if last:
                gone[last : a + 1] = np.linspace(gone[last], begin, a + 1 - last)
            else:
                gone[:a] = begin
            last = b
        gone[last:] = gone[last]
        return replace(self, strides=gone)

    def at(self, t_s: Array) -> Array:
        """Return the strides gone at given times; shape (n_slow,), float64."""
        place = np.clip((t_s - self.start_s) / STEP_S, 0.0, len(self.rate_hz) - 1.000001)
        k = place.astype(np.int64)
        u = place - k
        # Between two entries the rate goes straight from one to the other.
        ra, rb = self.rate_hz[k], self.rate_hz[k + 1]
        bend = np.where((ra > 0) & (rb > 0), (rb - ra) * (STEP_S / 2), 0.0)
        step = self.strides[k + 1] - self.strides[k]
        return np.asarray(self.strides[k] + u * (step - bend * (1 - u)), dtype=np.float64)


def _spans(
    speed: Array, drive: Array, stride_m: Callable[[Array], Array], n_ahead: int
) -> NDArray[np.int64]:
    """Return where feet step; `drive` is filled in where the body already, or yet, stands."""
    moves = speed > _STILL_MPS
    edges = np.flatnonzero(np.diff(moves.astype(np.int8)))
    found: list[list[int]] = []
    # It stands at both ends, so starts and stops come in pairs.
    for a, b in edges.reshape(-1, 2):
        begin = max(int(a) + 1 - n_ahead, 0)
        drive[begin : a + 1] = drive[a + 1]
        rate = drive[b] / stride_m(drive[b : b + 1])[0]
        end = min(int(b) + 1 + int(np.ceil(1.0 / (rate * STEP_S))), len(speed) - 1)
        drive[b + 1 : end + 1] = np.maximum(drive[b], drive[b + 1 : end + 1])
        if found and begin <= found[-1][1] + 1:
            found[-1][1] = max(end, found[-1][1])
        else:
            found.append([begin, end])
    return np.array(found, dtype=np.int64).reshape(-1, 2)
