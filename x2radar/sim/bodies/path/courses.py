"""Courses on the floor: straight lines, corners rounded to arcs; given in points, or drawn."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from x2radar.errors import SceneError

_MIN_LEG_M = 0.1  # waypoints nearer to each other than a foot is long have no direction
_SHARP_RAD = math.radians(130.0)  # sharper corners cannot be cut without missing the waypoint


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
    """Return the beginning (x, y, direction) of a course with rounded corners, and its parts."""
    if len(waypoints_m) < 2:
        raise SceneError(f"waypoints_m: {len(waypoints_m)} waypoint, but a course has 2 or more")
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


Waypoints = list[tuple[float, float]]

NEAR_M, FAR_M = 0.6, 3.4  # swath of the X2's default settings, in metres
# How far outside the swath a course begins: a stride; how far from the radar's wall it stays: half
# a person; radii that bodies usually take; how far to the sides the radar looks.
_LEAD_M = 1.5
_WALL_M = 0.4
_TURN_RADII_M = (0.2, 0.3, 0.4, 0.5, 0.6)
_LARGEST_BEARING = np.deg2rad(50.0)


def _cross(rng: np.random.Generator, near_m: float, far_m: float) -> Waypoints:
    """Return a line across, from one side to the other."""
    away = rng.uniform(near_m + 0.2, max(far_m - 0.3, near_m + 0.3), 2)
    side = rng.choice([-1.0, 1.0])
    half = far_m * np.tan(_LARGEST_BEARING) / 2 + _LEAD_M
    tilt = 0.3 * (away[1] - away[0])
    middle = away[0]
    return [(side * half, middle + tilt), (-side * half, middle - tilt)]


def _approach(rng: np.random.Generator, near_m: float, far_m: float) -> Waypoints:
    """Return a line from behind the swath's far end to its near end."""
    bearing = rng.uniform(-0.5, 0.5, 2) * _LARGEST_BEARING
    begin, end = far_m + _LEAD_M, max(near_m, 0.4)
    return [
        (begin * np.sin(bearing[0]), begin * np.cos(bearing[0])),
        (end * np.sin(bearing[1]), end * np.cos(bearing[1])),
    ]


def _oblique(rng: np.random.Generator, near_m: float, far_m: float) -> Waypoints:
    """Return a line in any direction, past a point that lies anywhere in the swath."""
    bearing = rng.uniform(-1, 1) * _LARGEST_BEARING
    away = rng.uniform(near_m, far_m)
    direction = rng.uniform(0, 2 * np.pi)
    x, y = away * np.sin(bearing), away * np.cos(bearing)
    reach = (far_m - near_m) / 2 + _LEAD_M
    step = np.array([np.cos(direction), np.sin(direction)])
    begin = (x - reach * step[0], max(y - reach * step[1], 0.4))
    return [begin, (x + reach * step[0], max(y + reach * step[1], 0.4))]


def _wander(rng: np.random.Generator, near_m: float, far_m: float) -> Waypoints:
    """Return four to eight points in the swath, each at least 0.8 m from the one before."""

    def draw_point() -> tuple[float, float]:
        bearing = rng.uniform(-1, 1) * _LARGEST_BEARING
        away = rng.uniform(near_m + 0.1, far_m + 0.3)
        return float(away * np.sin(bearing)), float(away * np.cos(bearing))

    return apart(int(rng.integers(4, 9)), draw_point)


def apart(n_points: int, draw_point: Callable[[], tuple[float, float]]) -> Waypoints:
    """Return drawn points (x, y), each at least 0.8 m from the one before."""
    points: Waypoints = []
    while len(points) < n_points:
        x, y = draw_point()
        if not points or np.hypot(x - points[-1][0], y - points[-1][1]) > 0.8:
            points.append((x, y))
    return points


COURSES: Mapping[str, Callable[[np.random.Generator, float, float], Waypoints]] = {
    "cross": _cross,
    "approach": _approach,
    "leave": lambda rng, near_m, far_m: _approach(rng, near_m, far_m)[::-1],
    "oblique": _oblique,
    "wander": _wander,
}
"""Courses by name."""


def draw_course(
    rng: np.random.Generator, name: str, near_m: float = NEAR_M, far_m: float = FAR_M
) -> Waypoints:
    """Return waypoints (x, y), in metres, of a course of `COURSES` through a swath."""
    return off_wall(COURSES[name](rng, near_m, far_m))


def off_wall(points: Waypoints) -> Waypoints:
    """Return a course moved, as a whole, until all of it is 0.4 m off the radar's wall.

    So it is for any usual radius of its corners.
    """
    least_m = min(y for _, y in points)
    for radius_m in _TURN_RADII_M if len(points) > 2 else ():
        at, course = bends(points, radius_m)
        for bend in course:
            least_m = min(least_m, _least_y_m(at, bend))
            at = bend.end(at, bend.length_m)
    into_room_m = max(0.0, _WALL_M - least_m)
    return [(float(x), float(y + into_room_m)) for x, y in points]


def _least_y_m(at: tuple[float, float, float], bend: Bend) -> float:
    """Return the least y of a part of a course: at an end, or where an arc is level."""
    least = min(at[1], bend.end(at, bend.length_m)[1])
    if bend.curvature_per_m:
        # Lowest where it goes right while turning left, or left while turning right.
        level = 0.0 if bend.curvature_per_m > 0 else math.pi
        to_level = (level - at[2]) * math.copysign(1.0, bend.curvature_per_m)
        way_m = to_level % (2 * math.pi) / abs(bend.curvature_per_m)
        if way_m < bend.length_m:
            least = min(least, bend.end(at, way_m)[1])
    return least
