"""Where a body goes and how fast: a course on the floor, pauses, limits of a body's agility.

A course is lines and arcs; its speed rises and falls at one acceleration. Time is cut so that
in each piece both the curvature and the acceleration are constant, which gives the distance
as a parabola of time and the position in closed form.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from x2radar.sim.bodies.path.courses import Bend, bends
from x2radar.sim.points import Array

_TINY = 1e-9  # shorter stretches, in metres or seconds, are rounding


@dataclass(frozen=True, slots=True)
class Agility:
    """How fast a body changes speed and direction: by default, a walking adult."""

    acceleration_mps2: float = 1.2  # speeding up and slowing down
    lateral_mps2: float = 1.5  # largest in bends; it slows the body down
    turn_rad_s: float = 2.5  # largest turn rate; it slows the body down in the tightest bends


_ADULT = Agility()


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A part of the course with one curvature and one speed limit."""

    bend: Bend
    length_m: float
    limit_mps: float
    pause_s: float


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


_FACING_S = 0.2  # heading is the mean direction so long before and after: half a step


@dataclass(frozen=True, slots=True, eq=False)
class PathState:
    """Place, heading and speed of a body on its path, all of shape (n_slow,), float64."""

    x_m: Array
    y_m: Array
    heading_rad: Array
    speed_mps: Array
    turn_rad_s: Array

    def beside(
        self, ahead_m: Array | float, left_m: Array | float, turn_rad: float = 0.0
    ) -> Array:
        """Return places (n_slow, 2) so far ahead and left of a body that has turned so far."""
        cos, sin = np.cos(self.heading_rad + turn_rad), np.sin(self.heading_rad + turn_rad)
        x_m, y_m = self.x_m + ahead_m * cos, self.y_m + ahead_m * sin
        return np.stack([x_m - left_m * sin, y_m + left_m * cos], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A course on the floor with the times at which it is gone along."""

    # (9, n_pieces), at the beginning of each piece of time: time, distance, speed, acceleration,
    # x, y, direction, curvature, and the time integral of the direction less the first one.
    pieces: Array

    @classmethod
    def through(
        cls,
        waypoints_m: Sequence[tuple[float, float]],
        speed_mps: float,
        stops: Sequence[tuple[float, float]] = (),
        *,
        turn_radius_m: float = 0.5,
        agility: Agility = _ADULT,
        start_s: float = 0.0,
    ) -> Self:
        """Return a path through waypoints with stops: metres since the last, and seconds."""
        begin, bent = bends(waypoints_m, turn_radius_m)
        course = [bend for bend in bent if bend.length_m > _TINY]
        stretches = _stretches(course, speed_mps, stops, agility)
        speeds = _speeds(stretches, agility.acceleration_mps2)
        rows: list[tuple[float, ...]] = []
        t, way, turned, at = start_s, 0.0, 0.0, begin
        for stretch, (va, vb) in zip(stretches, pairwise(speeds), strict=True):
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
        return cls(np.array(rows, dtype=np.float64).T.copy())

    @classmethod
    def standing(cls, place_m: tuple[float, float], heading_rad: float = 0.0) -> Self:
        """Return a path that stays where it is; facing `heading_rad`."""
        return cls(np.array([[0.0, 0.0, 0.0, 0.0, *place_m, heading_rad, 0.0, 0.0]]).T.copy())

    @property
    def start_s(self) -> float:
        """When it begins to move."""
        return float(self.pieces[0, 0])

    @property
    def end_s(self) -> float:
        """When it has come to rest for good."""
        return float(self.pieces[0, -1])

    @property
    def cruise_mps(self) -> float:
        """The highest speed; 0 for a body that stays."""
        return float(self.pieces[2].max())

    def at(self, t_s: Array) -> PathState:
        """Return the state at times of shape (n_slow,), in any order."""
        dt, p = self._piece(t_s)
        way = (p[2] + 0.5 * p[3] * dt) * dt
        half = 0.5 * p[7] * way
        chord = way * np.sinc(half / np.pi)
        late = self._turned(t_s + _FACING_S)
        early = self._turned(t_s - _FACING_S)
        span = 2 * _FACING_S
        return PathState(
            x_m=p[4] + chord * np.cos(p[6] + half),
            y_m=p[5] + chord * np.sin(p[6] + half),
            heading_rad=self.pieces[6, 0] + (late[0] - early[0]) / span,
            speed_mps=p[2] + p[3] * dt,
            turn_rad_s=(late[1] - early[1]) / span,
        )

    def _piece(self, t_s: Array) -> tuple[Array, Array]:
        """Return the times since the pieces that hold them began, and those pieces."""
        k = np.maximum(np.searchsorted(self.pieces[0], t_s, side="right") - 1, 0)
        piece = self.pieces[:, k]
        return np.maximum(t_s - piece[0], 0.0), piece

    def _turned(self, t_s: Array) -> tuple[Array, Array]:
        """Return the time integral of the direction since the start, and the direction."""
        dt, p = self._piece(t_s)
        first = self.pieces[6, 0]
        turned = p[8] + (p[6] - first + p[7] * (p[2] / 2 + p[3] / 6 * dt) * dt) * dt
        return turned, p[6] + p[7] * (p[2] + 0.5 * p[3] * dt) * dt
