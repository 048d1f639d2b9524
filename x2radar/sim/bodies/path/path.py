"""Where a body goes and how fast: a course on the floor, pauses, limits of a body's agility.

A course is straight lines with corners rounded to arcs, given in points or drawn; its speed rises
and falls at one acceleration. Time is cut so that in each piece both the curvature and the
acceleration are constant, which gives the distance as a parabola of time and the position in
closed form.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from x2radar.errors import SceneError
from x2radar.sim.points import Array

_MIN_LEG_M = 0.1  # waypoints nearer to each other than a foot is long have no direction
_SHARP_RAD = math.radians(130.0)  # sharper corners cannot be cut without missing the waypoint
Stops = Sequence[tuple[float, float]]  # metres since the last one, and seconds


@dataclass(frozen=True, slots=True)
class Bend:
    """A part of a course with one curvature, and one speed limit, before a pause."""

    length_m: float
    curvature_per_m: float  # one over the radius, positive to the left; 0 is a straight line
    limit_mps: float = math.inf
    pause_s: float = 0.0

    def end(self, begin: tuple[float, float, float], way_m: float) -> tuple[float, float, float]:
        """Return x, y and direction after `way_m`, from x, y and direction at the beginning."""
        x, y, direction = begin
        half = 0.5 * self.curvature_per_m * way_m
        chord = way_m * (math.sin(half) / half if half else 1.0)
        x, y = x + chord * math.cos(direction + half), y + chord * math.sin(direction + half)
        return x, y, direction + 2 * half


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


_TINY = 1e-9  # shorter stretches, in metres or seconds, are rounding


@dataclass(frozen=True, slots=True)
class Agility:
    """How fast a body changes speed and direction: by default, a walking adult."""

    acceleration_mps2: float = 1.2  # speeding up and slowing down
    lateral_mps2: float = 1.5  # largest in bends; it slows the body down
    turn_rad_s: float = 2.5  # largest turn rate; it slows the body down in the tightest bends


def _stretches(
    course: Sequence[Bend], speed_mps: float, stops: Stops, agility: Agility
) -> list[Bend]:
    """Cut the course where its curvature changes and where the body stops."""
    found: list[Bend] = []
    gaps = [*(gap for gap, _ in stops), math.inf]
    k, left = 0, gaps[0]
    for n, bend in enumerate(course):
        rest, limit = bend.length_m, speed_mps
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
            found.append(Bend(length, bend.curvature_per_m, limit, pause))
    return found


def _speeds(stretches: Sequence[Bend], acceleration_mps2: float) -> list[float]:
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


def _pieces(stretch: Bend, va: float, vb: float, a: float) -> list[tuple[float, float, float]]:
    """Return duration, first speed and acceleration: speed up by `a`, go on, slow down, pause."""
    length = stretch.length_m
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
        stops: Stops = (),
        *,
        turn_radius_m: float = 0.5,
        agility: Agility = Agility(),
        start_s: float = 0.0,
    ) -> Self:
        """Return a path through waypoints that stops there."""
        begin, bent = bends(waypoints_m, turn_radius_m)
        course = [bend for bend in bent if bend.length_m > _TINY]
        stretches = _stretches(course, speed_mps, stops, agility)
        speeds = _speeds(stretches, agility.acceleration_mps2)
        rows: list[tuple[float, ...]] = []
        t, way, turned, at = start_s, 0.0, 0.0, begin
        for bend, (va, vb) in zip(stretches, pairwise(speeds), strict=True):
            for dt, v, a in _pieces(bend, va, vb, agility.acceleration_mps2):
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


def draw_course(
    rng: np.random.Generator, name: str, near_m: float = NEAR_M, far_m: float = FAR_M
) -> Waypoints:
    """Return waypoints (x, y), in metres, of a course of `COURSES` through a swath."""
    return off_wall(COURSES[name](rng, near_m, far_m))


def off_wall(points: Waypoints) -> Waypoints:
    """Return a course moved as a whole until it is off the radar's wall, usual corners too."""
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
