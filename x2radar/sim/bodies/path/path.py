"""Where a body goes: a course on the floor, and how fast it goes along it.

A course is lines and arcs; its speed rises and falls at one acceleration. Time is cut so that
in each piece both the curvature and the acceleration are constant, which gives the distance
as a parabola of time and the position in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.path.courses import bends
from x2radar.sim.bodies.path.timetable import Agility, timetable
from x2radar.sim.points import Array

_FACING_S = 0.2
"""A body turns smoothly: its heading is the mean direction so long before and after, about the
time of half a step."""


@dataclass(frozen=True, slots=True, eq=False)
class PathState:
    """Where a body is on its path, all of shape (n_slow,), float64."""

    x_m: Array
    y_m: Array
    heading_rad: Array
    speed_mps: Array
    turn_rad_s: Array


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A course on the floor with the times at which it is gone along.

    Before `start_s` the body stands at the beginning, after `end_s` at the end.
    """

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
        agility: Agility | None = None,
        start_s: float = 0.0,
    ) -> Self:
        """Return a path through waypoints (x, y), from rest to rest; raises SceneError as `bends`.

        Corners up to 130 degrees are cut short, by `turn_radius_m` or less where there is no room;
        at sharper ones the course goes through the point and then round. The speed is kept where
        bends and accelerations allow it. Stops are ways since the last one, in metres, and how
        long it stands, in seconds; limits are those of a walking adult by default. A body that
        moves already at time 0 starts before.
        """
        begin, course = bends(waypoints_m, turn_radius_m)
        limits = agility or Agility()
        return cls(timetable(begin, course, speed_mps, stops, limits, start_s=start_s))

    @classmethod
    def standing(cls, place_m: tuple[float, float], heading_rad: float = 0.0) -> Self:
        """Return a path that stays where it is; facing `heading_rad`."""
        return cls(timetable((*place_m, heading_rad), (), 1.0, (), Agility(), start_s=0.0))

    @property
    def start_s(self) -> float:
        """When it begins to move."""
        return float(self.pieces[0, 0])

    @property
    def end_s(self) -> float:
        """When it has come to rest for good."""
        return float(self.pieces[0, -1])

    @property
    def length_m(self) -> float:
        """Way along the course."""
        return float(self.pieces[1, -1])

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
