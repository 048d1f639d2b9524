"""People: walking, sneaking, running, crawling, carrying, standing; and how to draw one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.motion.curves import check_motion
from x2radar.sim.bodies.path.courses import draw_course
from x2radar.sim.bodies.path.feet import Feet
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.angle_motion import AnglePerson
from x2radar.sim.bodies.person.build import (
    LOUDNESS,
    NAMES,
    TRUNK,
    Age,
    PersonBuild,
    draw_person_build,
)
from x2radar.sim.bodies.person.busy import Busy
from x2radar.sim.bodies.person.crawl import Crawling
from x2radar.sim.bodies.person.doing import Doer
from x2radar.sim.bodies.person.exercise import Exercise
from x2radar.sim.bodies.person.footfall_motion import FootfallPerson, draw_gesture, draw_ways
from x2radar.sim.bodies.person.gait import (
    FASTEST_WALK,
    STYLES,
    Carriage,
    carriage_at,
    crawling_gait,
    gait_of,
)
from x2radar.sim.bodies.person.posture import Hips, Soles, moved, upright
from x2radar.sim.bodies.person.seat import Seated
from x2radar.sim.bodies.skin.base import Skin, TotalRcs, sized
from x2radar.sim.bodies.skin.draw import draw_skin
from x2radar.sim.points import Label, Points

Array = NDArray[np.float64]
Posture = tuple[Array, Array, Array]

_N_POSTURES = 16
"""Over which the mean cross section is taken (chosen)."""
_CHEST = NAMES.index("chest")
_ADULT_M = 1.7
"""From this stature on, breath and heart are an adult's (chosen)."""
_FASTEST_RUN_MPS = 8.0
"""Sprints of amateurs (recalled)."""
_QUICKER: Mapping[Age, float] = {"adult": 1.0, "child": 1.1, "toddler": 1.35}
"""Cadence against that of an adult of the same leg length and speed (recalled)."""
# Half-lengths in metres, chosen.
_CARRIED = {"carry": ("box", (0.2, 0.18, 0.15)), "carry_pet": ("pet", (0.2, 0.08, 0.08))}


class Action(Protocol):
    """What a person does; a function of time alone."""

    def posture(self, t_s: Array) -> Posture:
        """Return middles, axes and side vectors of all parts at times of shape (n_slow,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Breath:
    """Breathing and heartbeat at the chest."""

    size_m: float
    rate_hz: float
    phase_rad: float
    beat_m: float = 0.0
    beat_hz: float = 1.2

    @classmethod
    def draw(cls, rng: np.random.Generator, share: Array, stature_m: float) -> Self:
        """Draw how somebody breathes at rest, by three shares, and how the heart beats.

        Adults take 16 breaths a minute, standard deviation 3, and have 70 beats, 10 (recalled);
        children more, 22 and 95 at 1.2 m (Fleming et al. 2011, recalled). The chest wall comes out
        by 2 to 6 mm with a breath and 0.2 to 0.5 mm with a beat (recalled).
        """
        small = (_ADULT_M / min(stature_m, _ADULT_M)) ** 0.85
        breaths = NormalDist(16, 3).inv_cdf(min(max(float(share[1]), 0.02), 0.98)) * small
        size_m, phase_rad = 0.001 + 0.002 * float(share[0]), 2 * np.pi * float(share[2])
        beats = (70 + 10 * float(rng.standard_normal())) * small
        beat_m = float(rng.uniform(1e-4, 2.5e-4))
        return cls(size_m, breaths / 60, phase_rad, beat_m, beats / 60)

    def at(self, t_s: Array) -> Array:
        """Return how far the chest wall has come out, in metres."""
        turn = 2 * np.pi * self.rate_hz * t_s + self.phase_rad
        # The heart beats a little faster while somebody breathes in.
        beat = 2 * np.pi * self.beat_hz * t_s + 0.3 * np.sin(turn)
        # Breathing in is quicker than breathing out.
        return np.asarray(
            self.size_m * np.sin(turn + 0.35 * np.sin(turn)) + self.beat_m * np.sin(beat)
        )


@dataclass(frozen=True, slots=True, eq=False)
class OnFeet:
    """Somebody who goes along a path on two feet, and stands where it stops."""

    path: Path
    feet: Feet
    build: PersonBuild
    carriage: Carriage
    cruise_mps: float
    duty: float
    sway: Wander
    doer: Doer | None = None

    def posture(self, t_s: Array) -> Posture:
        """Return middles, axes and side vectors; see `Action`."""
        b, c = self.build, self.carriage
        state = self.path.at(t_s)
        soles = Soles(self.feet.at(t_s), self.feet.falls.at(t_s).duty)
        strides = self.feet.clock.at(t_s)
        vigour = np.minimum(state.speed_mps / self.cruise_mps, 1.0)
        middle_stance = strides - 0.5 * self.duty
        bob = np.cos(4 * np.pi * middle_stance) * (-1.0 if c.is_spring else 1.0)
        # Long steps lower the hips.
        step_m = 0.25 * vigour * self.cruise_mps / max(self._rate_hz, 0.1)
        straight = np.sqrt(np.maximum(b.leg_m**2 - (0.8 * step_m) ** 2, 0.3 * b.leg_m**2))
        sway = self.sway.at(t_s)
        ahead = sway[:, 0] - c.surge_m * vigour * np.sin(4 * np.pi * middle_stance)
        aside = c.sway_m * vigour * np.cos(2 * np.pi * middle_stance) + sway[:, 1]
        bend, lean = np.full(len(t_s), c.bend), np.full(len(t_s), c.lean_rad)
        heading, up, look = state.heading_rad, sway[:, 2], sway[:, 3:5]
        doing = self.doer.at(t_s, vigour) if self.doer else None
        if doing:
            bend, lean, look = bend + doing.crouch, lean + doing.lean_rad, look + doing.look_rad
            ahead, aside = ahead + doing.shift_m[:, 0], aside + doing.shift_m[:, 1]
            up = up + doing.shift_m[:, 2]
            soles = moved(soles, heading, doing.feet_m)
        cos, sin = np.cos(heading), np.sin(heading)
        height = b.ankle_m + (1 - bend) * straight + c.bob_m * vigour * bob
        middle = np.stack(
            [
                state.x_m - aside * sin + ahead * cos,
                state.y_m + aside * cos + ahead * sin,
                height + up,
            ],
            axis=-1,
        )
        swing = np.cos(2 * np.pi * strides)
        hips = Hips(middle, heading, -c.yaw_rad * vigour * swing, vigour, swing, lean)
        return upright(b, c, hips, soles, look, doing=doing)

    @property
    def _rate_hz(self) -> float:
        """Strides a second at cruising speed."""
        return float(self.feet.clock.rate_hz.max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """A person; see `Mover`."""

    names: tuple[str, ...]
    action: Action
    breath: Breath
    skin: Skin
    burden: Array | None = None  # (3,): what is carried: ahead of the chest, left, over it, m

    @property
    def label(self) -> Label:
        """People are what the alarm is for."""
        return "human"

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points; see `Mover`."""
        centre, axis, side = loaded(self.action.posture(t_s), self.burden)
        # Breathing moves the surface of the trunk towards the antenna.
        towards = antenna_m - centre[:, :TRUNK]
        distance = np.sqrt((towards**2).sum(axis=-1, keepdims=True))
        share = np.array([1.0, 1.0, 0.1])[:, None]
        swell = self.breath.at(t_s)[:, None, None] * share
        centre[:, :TRUNK] += towards * (swell / np.maximum(distance, 0.05))
        return self.skin.points(centre, axis, side, antenna_m)


def loaded(posture: Posture, burden: Array | None) -> Posture:
    """Return a posture with what is carried as one more part."""
    if burden is None:
        return posture
    centre, axis, side = posture
    left, up = side[:, 0], axis[:, _CHEST]
    ahead = np.cross(left, up)
    place = centre[:, _CHEST] + burden[0] * ahead + burden[1] * left + burden[2] * up
    return (
        np.concatenate([centre, place[:, None]], axis=1),
        np.concatenate([axis, left[:, None]], axis=1),
        # What is carried has the trunk's side.
        side if side.shape[1] == 1 else np.concatenate([side, side[:, :1]], axis=1),
    )


def draw_person(
    rng: np.random.Generator,
    *,
    style: str = "walk",
    path: Path | Sequence[tuple[float, float]] | None = None,
    speed_mps: float | None = None,
    height_m: float | None = None,
    total_rcs_dbsm: TotalRcs = None,
    start_s: float = 0.0,
    motion: str = "gait",
    skin: str = "surface",
) -> Person:
    """Draw a person.

    Parameters
    ----------
    rng : numpy.random.Generator
        Everything random comes from it.
    style : str, optional
        A key of `STYLES`.
    path : Path, or sequence of (float, float), optional
        Where it goes, speeds included; or waypoints. Drawn by default. Somebody who stands
        does so where it begins, facing along it.
    speed_mps : float, optional
        Instead of the style's own.
    height_m : float, optional
        Stature.
    total_rcs_dbsm : float, 'physical' or None, optional
        Mean total cross section, see `skin.base.sized`; drawn by default, whatever the size.
    start_s : float, optional
        When it begins to move; negative for somebody who is under way at time 0.
    motion : str, optional
        One of `MOTIONS`: which generator moves somebody who goes on two feet; people who stay in
        place, crawl or are busy move by the first.
    skin : str, optional
        A key of `SKINS`: how the parts echo.

    Raises
    ------
    SceneError
        If a value is unknown or impossible; the message names its key.
    """
    if style not in STYLES:
        msg = f"style: no style '{style}' of people; known are {', '.join(STYLES)}"
        raise SceneError(msg)
    check_motion(motion)
    kind = STYLES[style]
    build = draw_person_build(rng, age=kind.age, height_m=height_m)
    z, share = rng.standard_normal(12).clip(-2.5, 2.5), rng.random(8)
    points = draw_course(rng, "wander")
    course = path if path is not None else points
    if not isinstance(course, Path):
        speed = _speed_mps(rng, style, build, speed_mps)
        course = _path(rng, style, course, speed, start_s)
    fastest = float(course.pieces[2].max(initial=0.0))
    _check_speed(kind.kind, max(fastest, speed_mps or 0.0), build)
    if kind.kind == "crawl":
        action: Action = _crawling(rng, course, build, (z, share))
    elif motion == "gait" or kind.speed_mps is None or kind.does:
        action = _on_feet(rng, style, course, build, (z, share))
    elif motion == "footfalls":
        action = FootfallPerson.plan(rng, course, build, draw_ways(rng, style), draw_gesture(rng))
    else:
        action = AnglePerson.draw(rng, course, build, style, draw_gesture(rng))
    half, burden = build.half_lengths(), None
    names: tuple[str, ...] = NAMES
    if style in _CARRIED:
        name, size = _CARRIED[style]
        names = (*names, name)
        half = np.vstack([half, np.array(size) * (0.8 + 0.4 * share[7])])
        burden = np.array([0.14 * build.stature_m, 0.0, -0.05 * build.stature_m])
    drawn = draw_skin(rng, skin, half, TRUNK, LOUDNESS)
    times = np.linspace(course.start_s, max(course.end_s, course.start_s + 4.0), _N_POSTURES)
    drawn = sized(drawn, rng, total_rcs_dbsm, loaded(action.posture(times), burden))
    breath = Breath.draw(rng, share[4:7], build.stature_m)
    return Person(drawn.names(names), action, breath, drawn, burden)


def _crawling(
    rng: np.random.Generator, course: Path, build: PersonBuild, draws: tuple[Array, Array]
) -> Crawling:
    z, share = draws
    width = (0.10 + 0.05 * share[0]) * build.stature_m / 1.75
    gait = crawling_gait(
        build.hip_height_m, cadence=1 + 0.08 * z[6], width_m=width, reach_m=0.45 * build.trunk_m
    )
    sway = Wander.draw(rng, np.array([0.01, 0.01, 0.01, 0.4, 0.2]), np.full(5, 0.05))
    cruise = max(float(course.pieces[2].max(initial=0.0)), 0.05)
    return Crawling(course, Feet.plan(course, gait), build, cruise, sway, 0.02 + 0.03 * share[1])


def _on_feet(
    rng: np.random.Generator,
    style: str,
    course: Path,
    build: PersonBuild,
    draws: tuple[Array, Array],
) -> OnFeet:
    z, share = draws
    kind = STYLES[style]
    width = (0.045 + 0.03 * share[0]) * (1.8 if kind.age == "toddler" else 1.0)
    toe_m = 0.45 * build.foot_m
    gait = gait_of(
        kind.kind,
        build.hip_height_m,
        cadence=_QUICKER[kind.age] * (1 + 0.06 * z[6]),
        width_m=width * max(build.stature_m, 1.0) / 1.75 + 0.01,
        lift_m=kind.lift * build.stature_m * (0.7 + 0.6 * share[3]),
        limp=0.10 + 0.10 * share[2] if style == "limp" else 0.0,
    )
    gait = replace(gait, home_m=tuple((toe_m, y) for _, y in gait.home_m))
    cruise = max(float(course.pieces[2].max(initial=0.0)), 0.1)
    limits = np.array([0.02, 0.015, 0.004, 0.5, 0.15])
    return OnFeet(
        course,
        Feet.plan(course, gait),
        build,
        _scattered(carriage_at(kind, cruise, build.hip_height_m), z, build),
        cruise,
        float(gait.duty(np.array([cruise]))[0]),
        Wander.draw(rng, limits, np.array([0.012, 0.010, 0.003, 0.10, 0.05])),
        _doer(rng, kind.does, build.leg_m),
    )


def _doer(rng: np.random.Generator, does: str, leg_m: float) -> Doer | None:
    if does == "sit":
        return Seated.draw(rng, leg_m)
    if does == "exercise":
        return Exercise.draw(rng, leg_m)
    return Busy.draw(rng) if does else None


def _speed_mps(
    rng: np.random.Generator, style: str, build: PersonBuild, speed_mps: float | None
) -> float:
    """Return the style's own speed, or the one given; one number is drawn."""
    low, high = STYLES[style].speed_mps or (0.5, 0.5)
    if STYLES[style].kind == "walk":
        high = min(high, FASTEST_WALK * build.hip_height_m)
    drawn = float(rng.uniform(low, high))
    return drawn if speed_mps is None else speed_mps


def _path(
    rng: np.random.Generator,
    style: str,
    points: Sequence[tuple[float, float]],
    speed_mps: float,
    start_s: float,
) -> Path:
    kind = STYLES[style]
    n_stops = int(rng.integers(1, 4))
    gaps, pauses = rng.uniform(0.6, 1.5, n_stops), rng.uniform(0.5, 3.0, n_stops)
    if kind.speed_mps is None:
        (x0, y0), (x1, y1) = points[0], points[1]
        return Path.standing((x0, y0), float(np.arctan2(y1 - y0, x1 - x0)))
    stops = list(zip(gaps.tolist(), pauses.tolist(), strict=True)) if kind.stops else []
    return Path.stop_and_go(points, speed_mps, stops, start_s=start_s)


def _check_speed(kind: str, fastest_mps: float, build: PersonBuild) -> None:
    most = {
        "walk": FASTEST_WALK * build.hip_height_m,
        "run": _FASTEST_RUN_MPS,
        "crawl": 1.5,
    }[kind]
    if fastest_mps > most:
        msg = f"speed_mps: {fastest_mps:g} m/s is too fast to {kind}; at most {most:.1f}"
        raise SceneError(msg)


def _scattered(c: Carriage, z: Array, build: PersonBuild) -> Carriage:
    """Return a carriage of one's own."""
    size = build.stature_m / 1.75
    return replace(
        c,
        bend=c.bend * float(np.exp(0.2 * z[0])),
        lean_rad=c.lean_rad + 0.03 * z[1],
        surge_m=c.surge_m * float(np.exp(0.2 * z[8])),
        bob_m=c.bob_m * size * float(np.exp(0.2 * z[2])),
        sway_m=c.sway_m * size * float(np.exp(0.2 * z[3])),
        arm_rad=c.arm_rad * float(np.exp(0.35 * z[4])),
        elbow_rad=c.elbow_rad * float(np.exp(0.2 * z[5])),
        yaw_rad=c.yaw_rad * float(np.exp(0.25 * z[7])),
    )
