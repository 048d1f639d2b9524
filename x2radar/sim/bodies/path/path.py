"""Where a body goes: a course on the floor, and how fast it goes along it.

A course is lines and arcs; its speed rises and falls at one acceleration. Time is cut so that
in each piece both the curvature and the acceleration are constant, which gives the distance
as a parabola of time and the position in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.path.course import LARGEST_M, Bend, bends, check
from x2radar.sim.bodies.path.timetable import Agility, Pace, timetable

__all__ = ["FACING_S", "Agility", "Pace", "Path", "PathState"]

Array = NDArray[np.float64]

FACING_S = 0.2
"""A body turns smoothly: its heading is the mean direction so long before and after (chosen)."""


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
    start_s: float  # when it begins to move
    end_s: float  # when it has come to rest for good
    length_m: float

    @classmethod
    def through(
        cls,
        waypoints_m: Sequence[tuple[float, float]],
        paces: Sequence[Pace] | float,
        *,
        turn_radius_m: float = 0.5,
        agility: Agility | None = None,
        start_s: float = 0.0,
    ) -> Self:
        """Return a path through waypoints, from rest to rest.

        Parameters
        ----------
        waypoints_m : sequence of (float, float)
            Two or more points (x, y), at least 0.1 m apart. Corners up to 130 degrees are
            cut short; at sharper ones the course goes through the point and then round.
        paces : sequence of Pace, or float
            Speeds along the course, in order; a number is one speed all along.
        turn_radius_m : float, optional
            Radius of the corners; smaller where the waypoints leave no room for it.
        agility : Agility, optional
            Limits; those of a walking adult by default.
        start_s : float, optional
            When it begins to move; negative for a body that moves already at time 0.

        Raises
        ------
        SceneError
            If a value makes no sense; the message names its key.
        """
        begin, course = bends(waypoints_m, turn_radius_m)
        return cls._timed(begin, course, paces, agility or Agility(), start_s)

    @classmethod
    def stop_and_go(
        cls,
        waypoints_m: Sequence[tuple[float, float]],
        speed_mps: float,
        stops: Sequence[tuple[float, float]],
        *,
        turn_radius_m: float = 0.5,
        agility: Agility | None = None,
        start_s: float = 0.0,
    ) -> Self:
        """Return a path with stops: way since the last one, in metres, and how long, in seconds.

        `speed_mps` is that between the stops; else as `through`.
        """
        paces = [Pace(speed_mps, length, pause) for length, pause in stops]
        return cls.through(
            waypoints_m,
            [*paces, Pace(speed_mps)],
            turn_radius_m=turn_radius_m,
            agility=agility,
            start_s=start_s,
        )

    @classmethod
    def standing(cls, place_m: tuple[float, float], heading_rad: float = 0.0) -> Self:
        """Return a path that stays where it is; facing `heading_rad`."""
        for axis, value in zip("xy", place_m, strict=True):
            check(f"place_m.{axis}", value, -LARGEST_M, LARGEST_M)
        check("heading_rad", heading_rad, -100.0, 100.0)
        return cls._timed((*place_m, heading_rad), [], 1.0, Agility(), 0.0)

    def at(self, t_s: Array) -> PathState:
        """Return the state at times of shape (n_slow,), in any order."""
        dt, p = self._piece(t_s)
        way = (p[2] + 0.5 * p[3] * dt) * dt
        half = 0.5 * p[7] * way
        chord = way * np.sinc(half / np.pi)
        late = self._turned(t_s + FACING_S)
        early = self._turned(t_s - FACING_S)
        span = 2 * FACING_S
        return PathState(
            x_m=p[4] + chord * np.cos(p[6] + half),
            y_m=p[5] + chord * np.sin(p[6] + half),
            heading_rad=self.pieces[6, 0] + (late[0] - early[0]) / span,
            speed_mps=p[2] + p[3] * dt,
            turn_rad_s=(late[1] - early[1]) / span,
        )

    @classmethod
    def _timed(
        cls,
        begin: tuple[float, float, float],
        course: Sequence[Bend],
        paces: Sequence[Pace] | float,
        agility: Agility,
        start_s: float,
    ) -> Self:
        list_of_paces = [Pace(paces)] if isinstance(paces, (int, float)) else list(paces)
        pieces = timetable(begin, course, list_of_paces, agility, start_s)
        return cls(pieces, start_s, float(pieces[0, -1]), float(pieces[1, -1]))

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
