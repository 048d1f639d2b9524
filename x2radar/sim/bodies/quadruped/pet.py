"""Random four-legged animals: what they do, and how to draw one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.motion.curves import check_motion
from x2radar.sim.bodies.path.courses import off_wall
from x2radar.sim.bodies.path.path import Agility, Path
from x2radar.sim.bodies.quadruped.actions import Going
from x2radar.sim.bodies.quadruped.angle_motion import AngleQuadruped
from x2radar.sim.bodies.quadruped.build import LOUDNESS, NAMES, TRUNK, QuadrupedBuild
from x2radar.sim.bodies.quadruped.footfall_motion import FootfallQuadruped
from x2radar.sim.bodies.quadruped.gait import FOOTWORK, GRAVITY_MPS2, froude, gait, usual_gait
from x2radar.sim.bodies.quadruped.pet_build import draw_build, draw_manner
from x2radar.sim.bodies.quadruped.pet_place import (
    STANDING,
    draw_jumping,
    draw_playing,
    draw_staying,
)
from x2radar.sim.bodies.quadruped.quadruped import Action, Hung, Motion, Quadruped
from x2radar.sim.bodies.quadruped.species import SPECIES, Species
from x2radar.sim.bodies.skin.base import TotalRcs, sized
from x2radar.sim.bodies.skin.draw import draw_skin

Array = NDArray[np.float64]

LARGEST_FROUDE = 25.0
"""Chosen: a cat at 8 m/s, a dog at 10."""
LARGEST_WALK_FROUDE = 1.2
"""Above 1 a stiff leg leaves the floor; a little more for legs that bend."""
PET_AGILITY = Agility(acceleration_mps2=2.5, lateral_mps2=3.0, turn_rad_s=3.5)
"""Chosen: livelier than people."""
_N_POSTURES = 24
"""Over which the mean cross section is taken: within 3 % of that over 480 (measured)."""
_FASTEST_DRAWN_MPS = 4.5
"""Chosen: indoors nobody runs faster."""
_STROLL_FROUDE, _STROLL_SHARE = (0.008, 0.10), 0.7
"""Of animals that walk or roam: at home they go slower than those that are led (chosen)."""


@dataclass(frozen=True, slots=True)
class PetStyle:
    """Something that a pet does."""

    sentence: str
    weight: float
    froude: tuple[float, float] | None = None
    gait: str | None = None


PET_STYLES: Mapping[str, PetStyle] = MappingProxyType(
    {
        "roam": PetStyle("goes about in the gait that goes with its speed", 4, (0.1, 2.2)),
        "walk": PetStyle("walks, one foot after the other", 4, (0.10, 0.45), "walk"),
        "trot": PetStyle("trots, diagonal feet together", 3, (0.6, 2.0), "trot"),
        "pace": PetStyle("paces, feet of one side together", 1, (0.5, 1.6), "pace"),
        "canter": PetStyle("canters in three beats", 1, (2.5, 6.0), "canter"),
        "bound": PetStyle("bounds, both hind feet together", 1, (2.5, 8.0), "bound"),
        "sniff": PetStyle("sniffs along the floor, stops and goes on", 3, (0.03, 0.15), "walk"),
        "stalk": PetStyle("creeps with its body low", 1, (0.02, 0.08), "walk"),
        "stand": PetStyle("stands, looks about and moves its tail", 1),
        "sit": PetStyle("sits and moves its tail", 2),
        "lie": PetStyle("lies and breathes", 1),
        "pant": PetStyle("lies and pants", 1),
        "groom": PetStyle("sits and licks its coat", 1),
        "scratch": PetStyle("sits and scratches itself with a hind paw", 1),
        "play": PetStyle("turns, hops, bows and shakes itself on the spot", 1),
        "jump": PetStyle("jumps onto furniture, stays, and jumps down", 1),
    }
)
"""What animals do, by name; `Species.styles` says which does what."""


def draw_pet(
    rng: np.random.Generator,
    *,
    species: str = "dog",
    style: str | None = None,
    path: Path | Sequence[tuple[float, float]] | None = None,
    mass_kg: float | None = None,
    total_rcs_dbsm: TotalRcs = None,
    motion: str = "gait",
    skin: str = "surface",
) -> Quadruped:
    """Draw an animal.

    Parameters
    ----------
    rng : numpy.random.Generator
        Everything random comes from it.
    species : str, optional
        A key of `SPECIES`.
    style : str, optional
        One of its `styles`; drawn by their weights by default.
    path : Path, or sequence of (float, float), optional
        Where it goes, speeds included; or waypoints, for the style's own speed. Drawn by
        default, within 2.5 m to the sides and 0.8 to 6 m ahead. One that stays, or jumps,
        does so where the path begins, facing along it.
    mass_kg : float, optional
        Instead of a draw, within the species' `possible_kg`.
    total_rcs_dbsm : float, 'physical' or None, optional
        Mean total cross section, see `skin.base.sized`; drawn by default, whatever its
        size.
    motion : str, optional
        One of `MOTIONS`: which generator moves an animal that goes; others move by the first.
    skin : str, optional
        A key of `SKINS`: how the parts echo.

    Raises
    ------
    SceneError
        If a value is unknown or impossible; the message names its key.
    """
    if species not in SPECIES:
        msg = f"species: no pet '{species}'; known are {', '.join(SPECIES)}"
        raise SceneError(msg)
    check_motion(motion)
    row = SPECIES[species]
    known = row.styles
    if style is None:
        weight = np.array([PET_STYLES[name].weight for name in known])
        style = known[int(rng.choice(len(known), p=weight / weight.sum()))]
    if style not in known:
        msg = f"style: no {species} style '{style}'; known are {', '.join(known)}"
        raise SceneError(msg)
    build = draw_build(rng, row, mass_kg)
    course = path if isinstance(path, Path) else _draw_path(rng, style, build, path, motion)
    footwork = _footwork(build, row, style, course)
    manner = draw_manner(rng, build, row, style, FOOTWORK[footwork].nod_rad)
    action: Action
    begin, end = course.start_s, course.end_s
    if style == "jump":
        action, end = draw_jumping(rng, build, course, row)
    elif style == "play":
        action, begin, end = draw_playing(rng, build, course), 0.0, 40.0
    elif PET_STYLES[style].froude is None:
        action, begin, end = draw_staying(rng, build, style, course), 0.0, 40.0
    else:
        action = _going(rng, build, course, style, footwork, species=row)
    moves: Motion = Hung(build, action, manner)
    if motion != "gait" and isinstance(action, Going):
        other = FootfallQuadruped if motion == "footfalls" else AngleQuadruped
        moves = other.draw(rng, course, build, style)
    drawn = draw_skin(rng, skin, build.half_lengths(), len(TRUNK), LOUDNESS)
    postures = moves.posture(np.linspace(begin, end, _N_POSTURES))
    drawn = sized(drawn, rng, total_rcs_dbsm, postures)
    return Quadruped(row.label, drawn.names(NAMES), moves, manner, drawn)


def _draw_froude(rng: np.random.Generator, style: str, motion: str) -> float:
    """Draw the Froude number of an animal's speed; by the first motion none strolls."""
    if motion != "gait" and style in {"roam", "walk"} and rng.random() < _STROLL_SHARE:
        return float(rng.uniform(*np.sqrt(_STROLL_FROUDE)) ** 2)
    return float(rng.uniform(*(PET_STYLES[style].froude or (0.1, 0.2))))


def _draw_path(
    rng: np.random.Generator,
    style: str,
    build: QuadrupedBuild,
    waypoints_m: Sequence[tuple[float, float]] | None,
    motion: str,
) -> Path:
    fr = _draw_froude(rng, style, motion)
    speed = min(float(np.sqrt(fr * GRAVITY_MPS2 * build.hip_m)), _FASTEST_DRAWN_MPS)
    points = _draw_waypoints(rng) if waypoints_m is None else waypoints_m
    radius = rng.uniform(0.3, 0.6)
    n_stops = int(rng.integers(2, 6))
    gaps, pauses = rng.uniform(0.15, 0.9, n_stops), rng.uniform(0.4, 2.5, n_stops)
    stops = list(zip(gaps.tolist(), pauses.tolist(), strict=True)) if style == "sniff" else []
    return Path.stop_and_go(points, speed, stops, turn_radius_m=radius, agility=PET_AGILITY)


def _draw_waypoints(rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return three to five points in the room, each at least 0.8 m from the one before."""
    points: list[tuple[float, float]] = []
    n_points = int(rng.integers(3, 6))
    while len(points) < n_points:
        x, y = float(rng.uniform(-2.5, 2.5)), float(rng.uniform(0.8, 6.0))
        if not points or np.hypot(x - points[-1][0], y - points[-1][1]) > 0.8:
            points.append((x, y))
    return off_wall(points)


def _footwork(build: QuadrupedBuild, species: Species, style: str, path: Path) -> str:
    """Return the name of the gait for a path's speed, or of the one that is forced."""
    fastest = float(path.pieces[2].max())
    fr = float(froude(fastest, build.hip_m))
    name = PET_STYLES[style].gait
    if name not in species.gaits:
        name = None
    most = LARGEST_WALK_FROUDE if name == "walk" else LARGEST_FROUDE
    if PET_STYLES[style].froude is not None and fr > most:
        msg = (
            f"path: {fastest:g} m/s is too fast for a {species.name} with its hip at "
            f"{build.hip_m:.2f} m to {style}"
        )
        raise SceneError(msg)
    return name or usual_gait(fastest, build.hip_m, species)


def _going(
    rng: np.random.Generator,
    build: QuadrupedBuild,
    path: Path,
    style: str,
    footwork: str,
    *,
    species: Species,
) -> Going:
    h = build.hip_m
    low = 0.72 if style == "stalk" else STANDING * rng.uniform(0.96, 1.0)
    steps = gait(
        footwork,
        h,
        species=species,
        girdle_m=(-0.5 * build.back_m, 0.5 * build.back_m),
        half_track_m=build.half_track_m,
        stride_factor=float(np.exp(np.clip(rng.normal(0.0, 0.06), -0.15, 0.15))),
        lift=rng.uniform(0.10, 0.20),
        ramp=rng.uniform(0.3, 0.48),
        is_mirrored=bool(rng.uniform() < 0.5),
    )
    return Going.plan(
        path,
        steps,
        FOOTWORK[footwork],
        build,
        height_m=low * h,
        crouch=0.12 if style == "sniff" else 0.0,
    )
