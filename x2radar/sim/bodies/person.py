"""People: walking, sneaking, running, crawling, carrying, standing; and how to draw one."""

from collections.abc import Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from x2radar.errors import SceneError
from x2radar.keys import Key
from x2radar.sim.bodies.body import Body, BodyPlan, Breath, carrying
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.motion.angles import AnglePerson
from x2radar.sim.bodies.motion.people import gait
from x2radar.sim.bodies.motion.people.footfalls import FootfallPerson, draw_gesture
from x2radar.sim.bodies.path.path import Path, draw_course
from x2radar.sim.bodies.skeleton.skeleton import PERSON, PersonBuild
from x2radar.sim.bodies.skins import TotalRcs
from x2radar.sim.points import Array, Motion

_N_LOOKS = 16  # over which the mean cross section is taken
_ADULT_M = 1.7  # from this stature on, breath and heart are an adult's
_FASTEST_MPS = {"run": 8.0, "crawl": 1.5}  # sprints of amateurs, and of babies (recalled)
_CARRIED = {"carry": ("box", (0.2, 0.18, 0.15)), "carry_pet": ("pet", (0.2, 0.08, 0.08))}
"""What is carried, and its half-lengths in metres: a moving box, a cat or small dog."""


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
) -> Body:
    """Draw a person; raises SceneError if a value is unknown or impossible, and names its key.

    `style` is a key of `STYLES`, `path` where it goes, speeds included, or waypoints; drawn by
    default. It begins to move at `start_s`, negative for somebody under way at time 0. `motion` is
    one of `MOTIONS`, `skin` one of `SKINS`.
    """
    Key(choices=tuple(gait.STYLES)).judge(style, "style")
    Key(choices=MOTIONS).judge(motion, "motion")
    row = gait.STYLES[style]
    build = PersonBuild(rng, age=row.age, height_m=height_m)
    traits = rng.standard_normal(12).clip(-2.5, 2.5), rng.random(8)
    share = traits[1]
    # Drawn in any case: a path that is given changes nothing that is drawn later.
    own_course = draw_course(rng, "wander")
    course = own_course if path is None else path
    limit_mps = _FASTEST_MPS.get(row.kind, gait.FASTEST_WALK * build.hip_height_m)
    if not isinstance(course, Path):
        course = _draw_path(rng, row, course, (limit_mps, speed_mps), start_s)
    fastest_mps = max(course.cruise_mps, speed_mps or 0.0)
    if fastest_mps > limit_mps:
        msg = f"speed_mps: {fastest_mps:g} m/s is too fast to {row.kind}; at most {limit_mps:.1f}"
        raise SceneError(msg)
    moves: Motion
    if row.kind == "crawl":
        moves = gait.draw_crawling(rng, course, build, traits)
    elif motion == "gait" or row.speed_mps is None or row.does:
        moves = gait.OnFeet(rng, row, course, build, traits)
    elif motion == "footfalls":
        moves = FootfallPerson(rng, course, build, style)
    else:
        moves = AnglePerson(rng, course, build, style, draw_gesture(rng))
    half, names = build.half_lengths(), PERSON.names
    if style in _CARRIED:
        name, size = _CARRIED[style]
        names = (*names, name)
        half = np.vstack([half, np.array(size) * (0.8 + 0.4 * share[7])])
        moves = carrying(moves, np.array([0.14, 0.0, -0.05]) * build.stature_m)
    plan = BodyPlan("human", names, half, moves, PERSON.n_trunk, PERSON.gain)
    looks_s = np.linspace(course.start_s, max(course.end_s, course.start_s + 4.0), _N_LOOKS)
    body = plan.dressed(rng, skin, total_rcs_dbsm, looks_s)
    return replace(body, breath=_draw_breath(rng, share[4:7], build.stature_m))


def _draw_breath(rng: np.random.Generator, share: Array, stature_m: float) -> Breath:
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
    return Breath(size_m, breaths / 60, phase_rad, beat_m, beats / 60, (1.0, 1.0, 0.1))


def _draw_path(
    rng: np.random.Generator,
    style: gait.PersonStyle,
    points: Sequence[tuple[float, float]],
    speeds_mps: tuple[float, float | None],
    start_s: float,
) -> Path:
    """Return a path, given the fastest speed and that to go at, or None for one of the style's."""
    limit_mps, speed_mps = speeds_mps
    low, high = style.speed_mps or (0.5, 0.5)
    drawn = float(rng.uniform(low, min(high, limit_mps)))
    n_stops = int(rng.integers(1, 4))
    gaps, pauses = rng.uniform(0.6, 1.5, n_stops), rng.uniform(0.5, 3.0, n_stops)
    if style.speed_mps is None:
        (x0, y0), (x1, y1) = points[0], points[1]
        return Path.standing((x0, y0), float(np.arctan2(y1 - y0, x1 - x0)))
    stops = list(zip(gaps.tolist(), pauses.tolist(), strict=True)) if style.stops else []
    return Path.through(points, drawn if speed_mps is None else speed_mps, stops, start_s=start_s)
