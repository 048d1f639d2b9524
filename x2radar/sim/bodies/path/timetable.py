"""When a body is where on its course: speeds, pauses, and limits of a body's agility."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.path.course import Bend, check

Array = NDArray[np.float64]

# What scenes may ask for (chosen): the fastest sprinters run 12 m/s.
SPEED_MPS = (0.02, 12.0)
_LONGEST_S = 86_400.0
_TINY = 1e-9
"""Shorter stretches, in metres or seconds, are rounding."""


@dataclass(frozen=True, slots=True)
class Agility:
    """How fast a body changes speed and direction."""

    acceleration_mps2: float = 1.2  # speeding up and slowing down
    lateral_mps2: float = 1.5  # largest in bends; it slows the body down
    turn_rad_s: float = 2.5  # largest turn rate; it slows the body down in the tightest bends


@dataclass(frozen=True, slots=True)
class Pace:
    """A stretch of the course at one speed."""

    speed_mps: float  # where bends and accelerations allow it
    length_m: float = math.inf  # the last one of a course goes on to its end
    pause_s: float = 0.0  # standing still at its end; 0 goes on without a stop


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A part of the course with one curvature and one speed limit."""

    bend: Bend
    length_m: float
    limit_mps: float
    pause_s: float


def timetable(
    begin: tuple[float, float, float],
    course: Sequence[Bend],
    paces: Sequence[Pace],
    agility: Agility,
    start_s: float,
) -> Array:
    """Return the pieces of a path, from rest to rest, shape (9, n_pieces); see `Path.pieces`.

    An empty course is that of a body that stays; the last piece is at rest and goes on for
    ever. Raises SceneError if a value makes no sense; the message names its key.
    """
    _check_all(paces, agility, start_s)
    stretches = _stretches([b for b in course if b.length_m > _TINY], paces, agility)
    speeds = _speeds(stretches, agility.acceleration_mps2)
    rows: list[tuple[float, ...]] = []
    t, way, turned, at = start_s, 0.0, 0.0, begin
    for stretch, va, vb in zip(stretches, speeds[:-1], speeds[1:], strict=True):
        bend = stretch.bend
        for dt, v, a in _pieces(stretch, va, vb, agility.acceleration_mps2):
            rows.append((t, way, v, a, *at, bend.curvature_per_m, turned))
            step = (v + 0.5 * a * dt) * dt
            lean = bend.curvature_per_m * (v / 2 + a / 6 * dt) * dt
            turned += (at[2] - begin[2] + lean) * dt
            at = bend.end(at, step)
            way += step
            t += dt
    rows.append((t, way, 0.0, 0.0, *at, 0.0, turned))
    return np.array(rows, dtype=np.float64).T.copy()


def _check_all(paces: Sequence[Pace], agility: Agility, start_s: float) -> None:
    if not paces:
        msg = "paces: at least one is needed"
        raise SceneError(msg)
    for k, pace in enumerate(paces):
        check(f"paces[{k}].speed_mps", pace.speed_mps, *SPEED_MPS)
        check(f"paces[{k}].length_m", pace.length_m, 0.01, math.inf)
        check(f"paces[{k}].pause_s", pace.pause_s, 0.0, _LONGEST_S)
    check("agility.acceleration_mps2", agility.acceleration_mps2, 0.05, 50.0)
    check("agility.lateral_mps2", agility.lateral_mps2, 0.05, 50.0)
    check("agility.turn_rad_s", agility.turn_rad_s, 0.05, 50.0)
    check("start_s", start_s, -_LONGEST_S, _LONGEST_S)


def _stretches(course: Sequence[Bend], paces: Sequence[Pace], agility: Agility) -> list[_Stretch]:
    """Cut the course where its curvature or its pace changes."""
    found: list[_Stretch] = []
    k, left = 0, paces[0].length_m
    for n, bend in enumerate(course):
        rest = bend.length_m
        while rest > _TINY:
            is_last = k == len(paces) - 1
            length = rest if is_last else min(rest, left)
            rest -= length
            left -= length
            limit = paces[k].speed_mps
            if bend.curvature_per_m:
                radius = 1 / abs(bend.curvature_per_m)
                lateral = math.sqrt(agility.lateral_mps2 * radius)
                limit = min(limit, lateral, agility.turn_rad_s * radius)
            pause = 0.0
            if not is_last and left <= _TINY:
                # A pause at the very end is no pause: it stands there anyway.
                is_end = n == len(course) - 1 and rest <= _TINY
                pause = 0.0 if is_end else paces[k].pause_s
                k += 1
                left = paces[k].length_m
            found.append(_Stretch(bend, length, limit, pause))
    return found


def _speeds(stretches: Sequence[_Stretch], acceleration_mps2: float) -> list[float]:
    """Return the speeds at the ends of the stretches, reachable from both sides."""
    v = [0.0] * (len(stretches) + 1)
    for k in range(1, len(stretches)):
        before, after = stretches[k - 1], stretches[k]
        v[k] = 0.0 if before.pause_s else min(before.limit_mps, after.limit_mps)
    for k, stretch in enumerate(stretches):
        v[k + 1] = min(v[k + 1], math.sqrt(v[k] ** 2 + 2 * acceleration_mps2 * stretch.length_m))
    for k in range(len(stretches) - 1, -1, -1):
        v[k] = min(v[k], math.sqrt(v[k + 1] ** 2 + 2 * acceleration_mps2 * stretches[k].length_m))
    return v


def _pieces(
    stretch: _Stretch, va: float, vb: float, acceleration_mps2: float
) -> list[tuple[float, float, float]]:
    """Return duration, first speed and acceleration: speed up, go on, slow down, pause."""
    a, length = acceleration_mps2, stretch.length_m
    top = max(min(stretch.limit_mps, math.sqrt((va**2 + vb**2) / 2 + a * length)), va, vb)
    cruise = length - (2 * top**2 - va**2 - vb**2) / (2 * a)
    pieces = [
        ((top - va) / a, va, a),
        (max(cruise, 0.0) / top, top, 0.0),
        ((top - vb) / a, top, -a),
        (stretch.pause_s, 0.0, 0.0),
    ]
    return [piece for piece in pieces if piece[0] > _TINY]
