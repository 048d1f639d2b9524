"""The shape of a course on the floor: straight lines, and corners rounded to arcs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from x2radar.errors import SceneError

_MIN_LEG_M = 0.1
"""Waypoints nearer to each other than a foot is long have no direction."""
_SHARP_RAD = math.radians(130.0)
"""Corners sharper than this cannot be cut short without missing the waypoint by far."""


@dataclass(frozen=True, slots=True)
class Bend:
    """A part of a course with one curvature."""

    length_m: float
    curvature_per_m: float  # one over the radius, positive to the left; 0 is a straight line

    def end(self, begin: tuple[float, float, float], way_m: float) -> tuple[float, float, float]:
        """Return x, y and direction after `way_m`, from x, y and direction at the beginning."""
        x, y, direction = begin
        half = 0.5 * self.curvature_per_m * way_m
        chord = way_m * (math.sin(half) / half if half else 1.0)
        return (
            x + chord * math.cos(direction + half),
            y + chord * math.sin(direction + half),
            direction + 2 * half,
        )


def bends(
    waypoints_m: Sequence[tuple[float, float]], turn_radius_m: float
) -> tuple[tuple[float, float, float], list[Bend]]:
    """Return x, y and direction of the beginning of a course through waypoints, and its parts.

    Corners are rounded to `turn_radius_m`, or less where the waypoints leave no room. Raises
    SceneError if there are fewer than two points, or two in one place.
    """
    if len(waypoints_m) < 2:
        msg = f"waypoints_m: {len(waypoints_m)} waypoint, but a course has 2 or more"
        raise SceneError(msg)
    legs = [math.dist(a, b) for a, b in pairwise(waypoints_m)]
    for k, leg in enumerate(legs):
        if leg < _MIN_LEG_M:
            msg = f"waypoints_m[{k + 1}]: {leg:.3g} m from the one before, not {_MIN_LEG_M:g} m"
            raise SceneError(msg)
    (x, y), second = waypoints_m[0], waypoints_m[1]
    begin = at = (x, y, math.atan2(second[1] - y, second[0] - x))
    course: list[Bend] = []
    for k, corner in enumerate(waypoints_m[1:-1], start=1):
        room = min(legs[k - 1], legs[k])
        for bend in _corner(at, corner, waypoints_m[k + 1], turn_radius_m, room):
            course.append(bend)
            at = bend.end(at, bend.length_m)
    course.append(Bend(math.dist(at[:2], waypoints_m[-1]), 0.0))
    return begin, course


def _corner(
    at: tuple[float, float, float],
    corner: tuple[float, float],
    after: tuple[float, float],
    radius_m: float,
    room_m: float,
) -> tuple[Bend, Bend]:
    """Return the line to a corner and the arc round it, leaving in the direction of `after`."""
    way = math.dist(at[:2], corner)
    out = math.atan2(after[1] - corner[1], after[0] - corner[0])
    turn = math.remainder(out - at[2], 2 * math.pi)
    if abs(turn) <= _SHARP_RAD:
        tangent = min(radius_m * math.tan(abs(turn) / 2), 0.45 * room_m)
        radius = tangent / math.tan(abs(turn) / 2) if turn else radius_m
        return Bend(way - tangent, 0.0), Bend(radius * abs(turn), math.copysign(1 / radius, turn))
    # On through the corner and round a circle that touches there, until it points at `after`.
    radius = min(radius_m, 0.4 * room_m)
    side = math.copysign(1.0, turn)
    normal = at[2] + side * math.pi / 2
    centre = (corner[0] + radius * math.cos(normal), corner[1] + radius * math.sin(normal))
    sight = math.atan2(after[1] - centre[1], after[0] - centre[0])
    sight += side * math.asin(radius / math.dist(centre, after))
    round_rad = (side * (sight - at[2])) % (2 * math.pi)
    return Bend(way, 0.0), Bend(radius * round_rad, side / radius)
