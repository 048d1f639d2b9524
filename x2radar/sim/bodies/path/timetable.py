"""When a body is where on its course: speeds, pauses, and limits of a body's agility."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.path.courses import Bend
from x2radar.sim.points import Array

_TINY = 1e-9
"""Shorter stretches, in metres or seconds, are rounding."""


@dataclass(frozen=True, slots=True)
class Agility:
    """How fast a body changes speed and direction: by default, a walking adult."""

    acceleration_mps2: float = 1.2  # speeding up and slowing down
    lateral_mps2: float = 1.5  # largest in bends; it slows the body down
    turn_rad_s: float = 2.5  # largest turn rate; it slows the body down in the tightest bends


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
    speed_mps: float,
    stops: Sequence[tuple[float, float]],
    agility: Agility,
    *,
    start_s: float,
) -> Array:
    """Return the pieces of a path, from rest to rest, shape (9, n_pieces); see `Path.pieces`.

    Stops are ways since the last one, in metres, and pauses, in seconds. An empty course is that
    of a body that stays; the last piece is at rest and goes on for ever.
    """
    stretches = _stretches([b for b in course if b.length_m > _TINY], speed_mps, stops, agility)
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


def _stretches(
    course: Sequence[Bend],
    speed_mps: float,
    stops: Sequence[tuple[float, float]],
    agility: Agility,
) -> list[_Stretch]:
    """Cut the course where its curvature changes and where the body stops."""
    found: list[_Stretch] = []
    gaps = [*(gap for gap, _ in stops), math.inf]
    k, left = 0, gaps[0]
    for n, bend in enumerate(course):
        rest = bend.length_m
        limit = speed_mps
        if bend.curvature_per_m:
            radius = 1 / abs(bend.curvature_per_m)
            lateral = math.sqrt(agility.lateral_mps2 * radius)
            limit = min(limit, lateral, agility.turn_rad_s * radius)
        while rest > _TINY:
            length = min(rest, left)
            rest -= length
            left -= length
            pause = 0.0
            if left <= _TINY:
                # A pause at the very end is no pause: it stands there anyway.
                is_end = n == len(course) - 1 and rest <= _TINY
                pause = 0.0 if is_end else stops[k][1]
                k += 1
                left = gaps[k]
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
