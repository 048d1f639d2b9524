"""The phase of a gait along a path, and the places where feet stand: the plainer of two planners.

The phase counts strides. It is the time integral of speed over stride length, kept as a table
of 10 ms steps between which it is taken as straight; standing still stops it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.path.feet import eased
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.points import Array

_STEP_S, _MARGIN_S = 0.01, 0.5  # of the table, and how far it goes on before and after the way
_RAMP = 0.25  # of a swing: a foot's peak speed is 1.2 times its mean (recalled)


@dataclass(frozen=True, slots=True, eq=False)
class StridePhase:
    """Strides done since the path's beginning."""

    t_s: Array  # (n_steps,): times of the table
    strides: Array  # (n_steps,): strides done; never falls

    @classmethod
    def along(cls, path: Path, stride_m: Callable[[Array], Array]) -> Self:
        """Return the phase along a path; `stride_m` is metres by speeds in m/s."""
        t_s = np.arange(path.start_s - _MARGIN_S, path.end_s + _MARGIN_S, _STEP_S)
        speed = path.at(t_s).speed_mps
        rate_hz = speed / np.maximum(stride_m(np.maximum(speed, 0.05)), 0.02)
        steps = 0.5 * (rate_hz[1:] + rate_hz[:-1]) * _STEP_S
        return cls(t_s, np.concatenate([[0.0], np.cumsum(steps)]))

    def at(self, t_s: Array) -> Array:
        """Return the strides done at times of shape (n_slow,)."""
        return np.interp(t_s, self.t_s, self.strides)

    def time_s(self, strides: Array) -> Array:
        """Return when so many strides are done; the ends of the table outside of it."""
        # A phase that stands still would have no inverse.
        rising = self.strides + 1e-9 * np.arange(len(self.strides))
        return np.interp(strides, rising, self.t_s)


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Where one foot stands, stance after stance, and how it gets from one to the next."""

    phase: StridePhase  # of the body
    offset: float  # phase at which the foot lands, in strides
    duty: float  # share of a stride that it stands
    first: int  # number of the first print
    place_m: Array  # (n_prints, 2): prints on the floor
    lift_m: float  # height of the swing
    lift_skew: float  # where its top is: 1 in the middle, less is earlier

    @classmethod
    def plan(
        cls,
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
    ) -> Self:
        """Return the prints of a foot along a path, `home_m` ahead of and beside the middle."""
        first = int(np.floor(phase.strides[0] - offset)) - 1
        last = int(np.ceil(phase.strides[-1] - offset)) + 1
        number = np.arange(first, last + 1)
        state = path.at(phase.time_s(np.asarray(number + offset + 0.5 * duty, np.float64)))
        place = state.beside(*home_m, facing_rad)
        if scatter_m is not None:
            place = place + scatter_m[number % len(scatter_m)]
        return cls(phase, offset, duty, first, place, lift_m, lift_skew)

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
