"""Four-legged animals: what they do, and how to draw one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from x2radar.errors import SceneError
from x2radar.keys import Key
from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.motion.angles import draw_angle_quadruped
from x2radar.sim.bodies.motion.quadrupeds import gait
from x2radar.sim.bodies.motion.quadrupeds.footfalls import draw_footfall_quadruped
from x2radar.sim.bodies.motion.quadrupeds.hung import Action, draw_manner, hung
from x2radar.sim.bodies.path.path import Agility, Path, apart, draw_course, off_wall
from x2radar.sim.bodies.skeleton.skeleton import QUADRUPED, QuadrupedBuild
from x2radar.sim.bodies.skeleton.species import SPECIES, Species
from x2radar.sim.bodies.skins import TotalRcs
from x2radar.sim.points import Motion

_MAX_FROUDE = 25.0  # a cat at 8 m/s, a dog at 10: nothing in a home is faster
_MAX_WALK_FROUDE = 1.2  # above 1 a stiff leg leaves the floor; a little more for legs that bend
PET_AGILITY = Agility(acceleration_mps2=2.5, lateral_mps2=3.0, turn_rad_s=3.5)  # livelier, by eye
_N_LOOKS = 24  # over which the mean cross section is taken: within 3 % of that over 480 (measured)
_STAYS_S = 40.0  # how long one that stays is looked at for it
_FASTEST_DRAWN_MPS = 4.5  # indoors nobody runs faster
_STROLL_FROUDE, _STROLL_SHARE = (0.008, 0.10), 0.7
"""Of animals that walk or roam: at home they go slower than those that are led (a guess)."""


@dataclass(frozen=True, slots=True)
class PetStyle:
    """How a style of pets moves: its speed and gait, and how often it is drawn."""

    weight: float  # against the others where a style is drawn
    froude: tuple[float, float] | None = None  # of its speed, for one that goes
    gait: str | None = None  # that it goes in, whatever its speed


PET_STYLES: Mapping[str, PetStyle] = {
    "roam": PetStyle(4, (0.1, 2.2)),
    "walk": PetStyle(4, (0.10, 0.45), "walk"),
    "trot": PetStyle(3, (0.6, 2.0), "trot"),
    "pace": PetStyle(1, (0.5, 1.6), "pace"),
    "canter": PetStyle(1, (2.5, 6.0), "canter"),
    "bound": PetStyle(1, (2.5, 8.0), "bound"),
    "sniff": PetStyle(3, (0.03, 0.15), "walk"),  # along the floor; it stops and goes on
    "stalk": PetStyle(1, (0.02, 0.08), "walk"),
    "sit": PetStyle(2),
    **dict.fromkeys(("stand", "lie", "pant", "groom", "scratch", "play", "jump"), PetStyle(1)),
}
"""What animals do, by name; `Species.styles` says which does what."""


def draw_pet(
    rng: np.random.Generator,
    *,
    species: str = "dog",
    style: str | None = None,
    path: Path | Sequence[tuple[float, float]] | None = None,
    speed_mps: float | None = None,
    start_s: float = 0.0,
    mass_kg: float | None = None,
    total_rcs_dbsm: TotalRcs = None,
    motion: str = "gait",
    skin: str = "surface",
) -> Body:
    """Draw an animal of `SPECIES`, by the arguments of `draw_person`; SceneError if impossible."""
    if speed_mps is not None and not isinstance(path, Path):
        points = path or draw_course(rng, "wander")
        path = Path.through(points, speed_mps, agility=PET_AGILITY, start_s=start_s)
    Key(choices=tuple(SPECIES)).judge(species, "species")
    Key(choices=MOTIONS).judge(motion, "motion")
    row = SPECIES[species]
    if style is None:
        weight = np.array([PET_STYLES[name].weight for name in row.styles])
        style = row.styles[int(rng.choice(len(row.styles), p=weight / weight.sum()))]
    Key(choices=row.styles).judge(style, "style")
    build = QuadrupedBuild(rng, row, mass_kg)
    course = path if isinstance(path, Path) else _draw_path(rng, style, build, path, motion)
    footwork = _footwork(build, row, style, course)
    manner, breath = draw_manner(rng, build, row, style, gait.FOOTWORK[footwork].nod_rad)
    action: Action
    looks_s, goes = (0.0, _STAYS_S), PET_STYLES[style].froude is not None
    if style == "jump":
        action, end_s = gait.draw_jumping(rng, build, course, row)
        looks_s = course.start_s, end_s
    elif style == "play":
        action = gait.draw_romping(rng, build, course)
    elif not goes:
        action = gait.draw_staying(rng, build, style, course)
    else:
        action = gait.draw_going(rng, build, course, style=style, footwork=footwork, species=row)
        looks_s = course.start_s, course.end_s
    moves: Motion = hung(build, action, manner)
    if motion != "gait" and goes:
        other = draw_footfall_quadruped if motion == "footfalls" else draw_angle_quadruped
        moves = other(rng, course, build, style)
    half = np.array(build.half_lengths())
    plan = BodyPlan(row.label, QUADRUPED.names, half, moves, QUADRUPED.n_trunk, QUADRUPED.gain)
    body = plan.dressed(rng, skin, total_rcs_dbsm, np.linspace(*looks_s, _N_LOOKS))
    return replace(body, breath=breath)


def _draw_path(
    rng: np.random.Generator,
    style: str,
    build: QuadrupedBuild,
    waypoints_m: Sequence[tuple[float, float]] | None,
    motion: str,
) -> Path:
    # By the first motion none strolls.
    if motion != "gait" and style in {"roam", "walk"} and rng.random() < _STROLL_SHARE:
        fr = float(rng.uniform(*np.sqrt(_STROLL_FROUDE)) ** 2)
    else:
        fr = float(rng.uniform(*(PET_STYLES[style].froude or (0.1, 0.2))))
    speed = min(float(np.sqrt(fr * gait.GRAVITY_MPS2 * build.hip_m)), _FASTEST_DRAWN_MPS)
    if waypoints_m is None:
        n_points = int(rng.integers(3, 6))
        draw_point = lambda: (float(rng.uniform(-2.5, 2.5)), float(rng.uniform(0.8, 6.0)))  # noqa: E731
        waypoints_m = off_wall(apart(n_points, draw_point))
    radius = rng.uniform(0.3, 0.6)
    n_stops = int(rng.integers(2, 6))
    gaps, pauses = rng.uniform(0.15, 0.9, n_stops), rng.uniform(0.4, 2.5, n_stops)
    stops = list(zip(gaps.tolist(), pauses.tolist(), strict=True)) if style == "sniff" else []
    return Path.through(waypoints_m, speed, stops, turn_radius_m=radius, agility=PET_AGILITY)


def _footwork(build: QuadrupedBuild, species: Species, style: str, path: Path) -> str:
    """Return the name of the gait for a path's speed, or of the one that is forced."""
    fastest, name = path.cruise_mps, PET_STYLES[style].gait
    if name not in species.gaits:
        name = None
    fr = gait.froude(fastest, build.hip_m)
    limit = _MAX_WALK_FROUDE if name == "walk" else _MAX_FROUDE
    if PET_STYLES[style].froude is not None and fr > limit:
        raise SceneError(
            f"path: {fastest:g} m/s is too fast for a {species.name} with its hip at "
            f"{build.hip_m:.2f} m to {style}"
        )
    return name or next(usual for usual, most in species.gaits.items() if fr < most)
